"""Commands that answer at once import little: a library can take longer than what it is for."""

import os
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from fl.data import bundled
from mission.cli import call

OWN_MODULES = Path(__file__).parents[1] / "fl"
OWN = {"fl", "flightdyn", "mission", "native", "sitl"}
THIRD_PARTY = set(packages_distributions()) - OWN
HELP = {"attr", "attrs", "cyclopts", "docstring_parser", "rich", "typing_extensions"}
PLAN = HELP | {
    "annotated_types", "numpy", "pydantic", "pydantic_core", "tomli_w", "typing_inspection",
}  # fmt: skip
AIRCRAFT = {"filterpy", "jsbsim", "mavsdk", "pymavlink"}
SCRIPT = """
import sys
before = set(sys.modules)
from mission.cli import call
assert call(sys.argv[1:]) == 0
print(*set(sys.modules) - before, file=sys.stderr)
"""


@pytest.mark.parametrize(("argument", "libraries"), [("--help", HELP), ("plan", PLAN)])
def test_no_more_is_imported_than_is_used(argument: str, libraries: set[str]) -> None:
    command = [sys.executable, "-c", SCRIPT, argument]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    modules = set(ended.stderr.split())
    assert {name.partition(".")[0] for name in modules} & THIRD_PARTY <= libraries
    assert not modules & {
        "asyncio",
        "numpy.ma",
        "sitl.links",
        "sitl.vehicle",
        "fl.training.modules",
    }
    if libraries == HELP:
        assert not modules & {"email", "importlib.metadata", "mission.config.models"}


@pytest.mark.slow
@pytest.mark.parametrize("override", ["mission.strategy=ideal", "mission.flight=none"])
def test_a_run_without_flight_imports_nothing_of_an_aircraft(override: str, tmp_path: Path) -> None:
    options = ["--set", override, "mission.rounds=1", "--out", str(tmp_path / "run"), "--quiet"]
    command = [sys.executable, "-c", SCRIPT, "run", "quickstart", *options]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    modules = set(ended.stderr.split())
    assert "mission.run.session" in modules
    assert not modules & AIRCRAFT
    assert "sitl.vehicle" not in modules


def test_a_plan_draws_no_image(monkeypatch: pytest.MonkeyPatch) -> None:
    bundled.colour_shapes.cache_clear()
    with monkeypatch.context() as patched:
        patched.delattr(bundled, "_draw")
        assert call(["plan"]) == 0
    assert bundled.colour_shapes().train.images.shape == (6000, 16, 16, 3)


def test_training_on_the_processor_imports_nothing_of_the_experimental_path() -> None:
    script = """
import sys
from fl.training.models import make_network
shape = {"image_shape": (16, 16, 3), "classes": 10}
make_network("lenet", **shape)
assert "torch" not in sys.modules
make_network("own_modules:Dense", **shape)
assert "torch" in sys.modules
print(*sys.modules)
"""
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([*sys.path, str(OWN_MODULES)])},
    )  # fmt: skip
    modules = set(ended.stdout.split())
    assert "fl.training.modules.network" in modules
    assert not modules & {"fl.training.modules.lockstep", "fl.training.modules.cuda"}
