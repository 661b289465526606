"""Runs that end in the middle, for tests of what goes on from there."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from small_runs import digests

import aerofed
from mission.api.runs import Run
from mission.base.errors import FlightError
from mission.run.callbacks import RoundReport
from mission.run.recorder import FolderRecorder


def check_resumed(config: Mapping[str, Any], tmp_path: Path, *, after: int = 2) -> Run:
    """A run that is cut and resumed leaves the same bytes as a whole one, which is returned."""
    whole = aerofed.run("quickstart", config, out=tmp_path / "whole")
    with cut_after(after), pytest.raises(FlightError, match="cut"):
        aerofed.run("quickstart", config, out=tmp_path / "cut")
    assert digests(aerofed.resume(tmp_path / "cut").path) == digests(whole.path)
    return whole


@contextmanager
def cut_after(number: int) -> Iterator[None]:
    """Here a run fails with FlightError("cut") as soon as that round is in its checkpoint."""
    finished = FolderRecorder.finished

    def cut(self: FolderRecorder, report: RoundReport, *learnt: Any) -> None:
        finished(self, report, *learnt)
        if report.round.round == number:
            raise FlightError("cut")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FolderRecorder, "finished", cut)
        yield
