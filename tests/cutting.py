"""Runs that end in the middle, for tests of what goes on from there."""

import pytest

from mission.base.errors import FlightError
from mission.run.recorder import FolderRecorder, RoundResult


def cut_after(patch: pytest.MonkeyPatch, number: int) -> None:
    """Have a run fail with FlightError("cut") as soon as that round is in its checkpoint."""
    finished = FolderRecorder.finished

    def cut(self: FolderRecorder, result: RoundResult) -> None:
        finished(self, result)
        if result.record.round == number:
            raise FlightError("cut")

    patch.setattr(FolderRecorder, "finished", cut)
