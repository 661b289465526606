"""Runs that end in the middle, for tests of what goes on from there."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import aerofed
from mission.api.runs import Run
from mission.base.errors import FlightError
from mission.run.callbacks import RoundReport
from mission.run.recorder import FolderRecorder


def check_resumed(
    config: Mapping[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Run:
    """A run that is cut and resumed has the same tables as a whole one, which is returned."""
    whole = aerofed.run("quickstart", config, out=tmp_path / "whole")
    with monkeypatch.context() as patch:
        cut_after(patch, 2)
        with pytest.raises(FlightError):
            aerofed.run("quickstart", config, out=tmp_path / "cut")
    resumed = aerofed.resume(tmp_path / "cut")
    for name in ("rounds.csv", "uplinks.csv", "learning.csv"):
        assert (resumed.path / name).read_bytes() == (whole.path / name).read_bytes()
    return whole


def cut_after(patch: pytest.MonkeyPatch, number: int) -> None:
    """Have a run fail with FlightError("cut") as soon as that round is in its checkpoint."""
    finished = FolderRecorder.finished

    def cut(self: FolderRecorder, report: RoundReport, *learnt: Any) -> None:
        finished(self, report, *learnt)
        if report.round.round == number:
            raise FlightError("cut")

    patch.setattr(FolderRecorder, "finished", cut)
