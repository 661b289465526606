"""Options of a run that is small enough for a test, and still loses and learns something.

And what a run has left behind, or has said.
"""

import csv
import hashlib
import math
from dataclasses import replace
from pathlib import Path

import pytest

from mission.analysis.load import LoadedRun

SETTINGS = (
    *("--set", "mission.steps=5", "--set", "mission.path_budget_m=300"),
    *("--set", "communities.0.devices=3", "--set", "communities.1.devices=3"),
    *("--set", "learning.local_epochs=1"),
    *("--set", "communities.0.subset=0.2", "--set", "communities.1.subset=0.2"),
)
# Every flight climbs and lands, which by default takes as long as the rounds of a small run.
UP_AND_DOWN = (
    *("--set", "vehicle.parameters={MPC_TKO_SPEED=5, MPC_Z_VEL_MAX_DN=5, MPC_LAND_SPEED=1.5}"),
    *("--set", "vehicle.aircraft.limits.descent_mps=5"),
)
LOW = ("--set", "mission.altitude_m=30", *UP_AND_DOWN)
QUIET = ("--quiet", "--no-report")
OF_ANY_VEHICLE = (*SETTINGS, *QUIET)
SMALL = (*OF_ANY_VEHICLE, *LOW)


def last_counts(*words: str) -> list[str]:
    """The words of a command, where of a key that is set twice the last value is left."""
    left: dict[str, tuple[str, ...]] = {}
    rest = iter(words)
    for index, word in enumerate(rest):
        if word == "--set":
            setting = next(rest)
            left[setting.partition("=")[0]] = word, setting
        else:
            left[f"{index}"] = (word,)
    return [word for each in left.values() for word in each]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def digests(folder: Path) -> dict[str, str]:
    names = (
        "rounds.csv",
        "aircraft.csv",
        "uplinks.csv",
        "learning.csv",
        "devices.csv",
        "flight.mcap",
    )
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names}


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> None:
    """One line says so, and nothing else was said."""
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1, printed.err
    for word in words:
        assert word in printed.err


def without_its_end(run: LoadedRun) -> LoadedRun:
    """The flight of a plan as if its last place had never been reached."""
    assert run.judged is not None
    (found,) = run.judged.passes
    end = replace(found.passages[-1], t_s=math.nan)
    cut = replace(found, passages=(*found.passages[:-1], end))
    return replace(run, judged=replace(run.judged, passes=(cut,)))
