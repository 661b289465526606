"""Where the runs of a sweep are executed: what an engine can do."""

from dataclasses import dataclass
from typing import Protocol

from mission.sweep.execute.worker import RunEnd, RunOrder


@dataclass(frozen=True)
class RunFinished:
    """A run that is over."""

    order: RunOrder
    end: RunEnd | None  # None: its worker died, which says nothing about the run


class Engine(Protocol):
    """Executes runs in processes of their own."""

    @property
    def slots(self) -> int:
        """How many runs it executes at a time."""

    def start(self, order: RunOrder) -> None:
        """Begin a run; there must be a free slot."""

    def wait(self, timeout_s: float) -> tuple[RunFinished, ...]:
        """The runs that ended since the last call, waiting at most so long for one."""

    def close(self) -> None:
        """End the workers, also those that are at work."""
