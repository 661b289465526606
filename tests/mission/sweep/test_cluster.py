"""Sweeps on machines that see no folder of the sweep's, which die, differ and have no room."""

import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S, until
from ray_cluster import Cluster, can_hide

from mission.base.errors import LinkLostError
from mission.sweep.execute.cluster import RayEngine

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed"),
    pytest.mark.xdist_group("ray"),
]
hidden = pytest.mark.skipif(not can_hide(), reason="no mount namespaces for this user")

OWN = "own_rules*"  # folder of the run with the user's strategy
TABLES = ("runs.csv", "rounds.csv")
CONFIG = """
name = "own"
[mission]
steps = 3
path_budget_m = 100.0
altitude_m = 30.0
[vehicle.parameters]
MPC_TKO_SPEED = 5
MPC_LAND_SPEED = 1.5
[learning]
local_epochs = 1
[[communities]]
name = "table"
task = "npz"
data_file = "table.npz"
positions_file = "places.csv"
partition = "owners"
network = "convnet"
convnet = {channels = []}
[[communities]]
name = "digits"
task = "digits"
devices = 2
labels_per_device = 5
"""
# It waits in its second round until it is let on, so that a test can interrupt it there.
RULES = """
import tempfile
import time
from pathlib import Path

from aerofed import Sortie

from own_rules.weights import weights


class Own:
    fairness, approach_m = False, None

    def __init__(self, context):
        self.planner = context.planner

    def importance(self, info):
        return weights(info)

    def sortie(self, round_index, problem):
        while round_index > 1 and not Path(tempfile.gettempdir(), "go").exists():
            time.sleep(0.02)
        return Sortie(self.planner.plan(problem))
"""
WEIGHTS = """
from pathlib import Path


def weights(info):
    return info.p * float(Path("factor.txt").read_text()) * info.age_rounds
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working directory with data, places and code of the user's own."""
    folder = tmp_path_factory.mktemp("cluster")
    rng = np.random.default_rng(1)
    (folder / "data").mkdir()
    np.savez(
        folder / "data" / "table.npz",
        x_train=rng.standard_normal((90, 4)).astype(np.float32), y_train=np.arange(90) % 3,
        x_test=rng.standard_normal((30, 4)).astype(np.float32), y_test=np.arange(30) % 3,
        owner=np.arange(90) // 30,
    )  # fmt: skip
    (folder / "places.csv").write_text("x,y\n100,100\n300,500\n700,200\n")
    (folder / "own.toml").write_text(CONFIG)
    (folder / "factor.txt").write_text("2.5\n")
    (folder / "own_rules").mkdir()
    for name, text in (("strategy", RULES), ("weights", WEIGHTS)):
        (folder / "own_rules" / f"{name}.py").write_text(text)
    return folder


def command(out: str, *more: str, rounds: int = 2) -> list[str]:
    return [
        sys.executable, "-m", "mission", "sweep", "own.toml", "--data-dir", "data", "--out", out,
        "--strategies", "own_rules.strategy:Own,ideal", "--seeds", "1", "--rounds", str(rounds),
        "--no-run-figures", "--no-report", *more,
    ]  # fmt: skip


def sweep(project: Path, *tokens: str) -> "subprocess.CompletedProcess[str]":
    (project / "free").mkdir(exist_ok=True)
    (project / "free" / "go").touch()
    return subprocess.run(
        [*tokens], cwd=project, capture_output=True, text=True, timeout=HANG_S, check=False,
        env={**os.environ, "TMPDIR": str(project / "free")},
    )  # fmt: skip


def tables(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in TABLES}


def run_named(folder: Path, start: str) -> Path:
    return next(path for path in (folder / "runs").iterdir() if path.name.startswith(start))


@pytest.fixture(scope="module")
def here(project: Path) -> Path:
    """What joblib finds on this machine."""
    done = sweep(project, *command("here", "--jobs", "1"))
    assert done.returncode == 0, done.stderr
    return project / "here"


@pytest.fixture(scope="module")
def cluster(project: Path) -> Iterator[Cluster]:
    """One for all: a test adds the machines that it needs, and others may still be there."""
    made = Cluster(project)
    try:
        yield made
    finally:
        made.close()


def begin(cluster: Cluster, project: Path, *tokens: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*tokens, "--engine", "ray", "--address", cluster.address], cwd=project,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=cluster.environment,
        start_new_session=True,
    )  # fmt: skip


@hidden
def test_a_run_starts_anew_elsewhere_when_its_machine_dies(
    cluster: Cluster, project: Path, here: Path
) -> None:
    one, other = cluster.add("one"), cluster.add("other")
    process = begin(cluster, project, *command("there"))
    runs = project / "there" / "runs"
    until(lambda: process.poll() is not None or one.flies(OWN) or other.flies(OWN))
    assert process.poll() is None, process.communicate()
    victim, survivor = (one, other) if one.flies(OWN) else (other, one)
    victim.die()
    (survivor.temporary / "go").touch()
    printed, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 0, errors
    assert "its worker died; another takes the run" in printed
    assert tables(project / "there") == tables(here)
    # The folder is a whole one, and names nothing of the machine that it was flown on.
    ours, theirs = ({p.relative_to(f / "runs") for p in (f / "runs").rglob("*")} for f in
                    (here, project / "there"))  # fmt: skip
    assert theirs == ours
    name = run_named(project / "there", "own_rules").name
    for file in ("flight.mcap", "rounds.csv"):
        assert (runs / name / file).read_bytes() == (here / "runs" / name / file).read_bytes()
    assert str(cluster.top) not in (runs / name / "summary.json").read_text()
    assert not list(survivor.temporary.glob("aerofed-*"))


@hidden
def test_a_machine_with_another_version_is_named(
    cluster: Cluster, project: Path, tmp_path: Path
) -> None:
    old = tmp_path / "aerofed-0.0.1.dist-info"
    old.mkdir()
    (old / "METADATA").write_text("Metadata-Version: 2.1\nName: aerofed\nVersion: 0.0.1\n")
    cluster.add("old", PYTHONPATH=str(tmp_path))
    process = begin(cluster, project, *command("mixed"))
    _, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 2
    assert errors.count("\n") == 1
    assert f"has other versions: aerofed 0.0.1 (here {version('aerofed')})" in errors
    assert "install the same on all machines" in errors


def locally(project: Path, out: str, temporary: Path, *before: str) -> "subprocess.Popen[str]":
    """A sweep on a Ray of its own, whose runs are flown below `temporary`."""
    return subprocess.Popen(
        [*before, *command(out, "--jobs", "1", "--engine", "ray")], cwd=project,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )  # fmt: skip


@pytest.fixture
def short() -> Iterator[Path]:
    """A folder for temporary files whose name is short enough for Ray's sockets."""
    with tempfile.TemporaryDirectory(prefix="ray-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def test_ctrl_c_ends_it_and_joblib_goes_on(project: Path, here: Path, short: Path) -> None:
    process = locally(project, "cut", short)
    at_work = lambda: any(short.glob(f"aerofed-run-*/{OWN}/rounds.csv"))  # noqa: E731
    until(lambda: process.poll() is not None or at_work())
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to Ray's processes too
    printed, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 130, errors
    assert errors == ""
    assert "the same command goes on from here" in printed
    done = sweep(project, *command("cut", "--jobs", "1"))
    assert done.returncode == 0, done.stderr
    assert tables(project / "cut") == tables(here)


@hidden
def test_a_full_disk_here_is_the_end_of_a_run(project: Path, short: Path) -> None:
    (project / "full").mkdir()
    (short / "go").touch()
    small = 'mount -t tmpfs -o size=64k none full && exec "$@"'
    space = ("unshare", "--map-root-user", "--mount", "sh", "-c", small, "sh")
    process = locally(project, "full/out", short, *space)
    _, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 2
    for name in ("own_rules", "ideal"):
        assert f"run {name}" in errors
    assert errors.count("No space left on device") == 2


def test_a_ray_that_cannot_start_is_one_line(project: Path, tmp_path: Path) -> None:
    far = tmp_path / ("far" * 30)  # a socket's name has 107 bytes at most
    far.mkdir()
    process = locally(project, "far", far)
    _, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 5
    assert errors.count("\n") == 1
    assert "engine = ray: cannot start Ray here" in errors
    assert "107 bytes" in errors


def test_a_ray_that_is_up_too_late_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(**_: object) -> None:
        raise Exception("The current node timed out during startup.\nOn a loaded machine.")

    monkeypatch.setattr("ray.init", late)
    with pytest.raises(LinkLostError) as caught:
        RayEngine(jobs=1, address=None, configs=(), data_dir=None)
    assert str(caught.value).startswith("engine = ray: cannot start Ray here: ")
    assert str(caught.value).endswith(": The current node timed out during startup.")
