"""Commands that answer at once import little: a library can take longer than what it is for."""

import json
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
from small_runs import SETTINGS

from fl.data import bundled
from mission.cli import call

OWN = {"fl", "flightdyn", "mission", "native", "sitl"}
THIRD_PARTY = set(packages_distributions()) - OWN
HELP = {"attr", "attrs", "cyclopts", "docstring_parser", "rich", "typing_extensions"}
PLAN = HELP | {
    "annotated_types", "fastcrc", "numpy", "pydantic", "pydantic_core", "pymavlink", "tomli_w",
    "typing_inspection",
}  # fmt: skip
AIRCRAFT = {"filterpy", "jsbsim", "mavsdk"}
SCRIPT = """
import sys
before = set(sys.modules)
from mission.cli import call
assert call(sys.argv[1:]) == 0
print(*set(sys.modules) - before, file=sys.stderr)
"""
# Other processes draw, whose modules are not those of the program: here they have drawn nothing.
DRAWS_NOTHING = """
from contextlib import nullcontext
from mission.figures import render
class Engine(nullcontext):
    def poll(self): ...
render.engine = lambda *_: Engine()
render._results = lambda _, jobs: [b"" for _ in (None, *jobs)]
"""


@pytest.mark.slow
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
    out = tmp_path / "run"
    options = [*SETTINGS, "--set", override, "mission.rounds=1", "--out", str(out), "--quiet"]
    script = SCRIPT.replace("from mission.cli", f"{DRAWS_NOTHING}from mission.cli")
    command = [sys.executable, "-c", script, "run", "quickstart", *options]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    modules = set(ended.stderr.split())
    assert {"mission.run.session", "mission.figures.run", "mission.report.page"} <= modules
    assert (out / "report.html").is_file()
    assert not modules & AIRCRAFT
    assert "sitl.vehicle" not in modules


def test_a_plan_draws_no_image(monkeypatch: pytest.MonkeyPatch) -> None:
    bundled.colour_shapes.cache_clear()
    with monkeypatch.context() as patched:
        patched.delattr(bundled, "_draw")
        assert call(["plan"]) == 0
    assert bundled.colour_shapes().train.images.shape == (6000, 16, 16, 3)


@pytest.mark.slow
def test_torch_is_for_networks_of_ones_own_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)  # as where it is not installed
    for name in ("own_network", "own_trainer"):
        (tmp_path / f"{name}.py").write_text("import torch")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mission.base.run_folder.LIBRARIES", ("numpy", "no-such-library"))
    run = ["run", "--quiet", "--set", "mission.flight=none", "mission.rounds=1"]
    assert call([*run, "--out", "out"]) == 0
    libraries = json.loads((tmp_path / "out" / "summary.json").read_text())["libraries"]
    assert libraries == {"numpy": np.__version__}
    capsys.readouterr()
    extra = "needs torch, which is an extra and not installed: pip install 'aerofed[torch]'\n"
    for key, name in (
        ("communities.0.network", "own_network:Net"),
        ("learning.trainer", "own_trainer:make"),
    ):
        assert call([*run, f"{key}={name}", "--out", "none"]) == 2
        assert capsys.readouterr().err.endswith(f"{key} = '{name}': {extra}")
        assert not (tmp_path / "none").exists()


def test_a_library_that_is_left_out_is_named() -> None:
    """As in the image of the vehicle alone."""
    script = (
        "import sys; sys.modules['altair'] = None; from mission.cli import call; "
        "sys.exit(call(['report', '.']))"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    said = "aerofed: altair is not installed here; pip install aerofed brings it\n"
    assert (ended.returncode, ended.stderr) == (2, said)


@pytest.mark.slow
def test_a_flight_waits_for_no_statistics_which_others_have() -> None:
    """Those that a library of the filter would import; whoever imports it next gets it whole."""
    script = """
import sys
import flightdyn.navigation.estimator
print(*{"scipy.stats", "scipy.ndimage", "filterpy"} & set(sys.modules))
import filterpy.stats, scipy.ndimage
print(filterpy.stats.norm_cdf((-1e9, 0.0), 0.0, 1.0), scipy.ndimage.shift([1, 2], 1))
"""
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert told.stdout == "\n0.5 [0 1]\n"
