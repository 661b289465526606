"""Where the runs of a sweep are executed: what an engine can do, and the choice between them."""

from dataclasses import dataclass
from typing import Literal, Protocol

from mission.errors import InputError
from mission.sweep.worker import RunEnd, RunOrder

EngineName = Literal["joblib", "ray"]


@dataclass(frozen=True)
class Ended:
    """A run that is over."""

    order: RunOrder
    end: RunEnd | None  # None: its worker died, which says nothing about the run


class Engine(Protocol):
    """Executes runs in processes of their own."""

    @property
    def slots(self) -> int:
        """How many runs it executes at a time."""
        ...

    def start(self, order: RunOrder) -> None:
        """Begin a run; there must be a free slot."""
        ...

    def wait(self, timeout_s: float) -> tuple[Ended, ...]:
        """The runs that ended since the last call, waiting at most so long for one."""
        ...

    def close(self) -> None:
        """End the workers, also those that are at work."""
        ...


def check_options(name: EngineName, *, jobs: int | None, address: str | None) -> None:
    """Refuse options that do not fit the engine.

    Raises:
        InputError: naming the option.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: at least 1")
    if address is not None and name != "ray":
        raise InputError(f"--address {address}: belongs to --engine ray")


def make_engine(name: EngineName, *, jobs: int | None, address: str | None) -> Engine:
    """The engine of that name. Its library is imported here, not before.

    Raises:
        InputError: it is not installed, or the options do not fit it.
        LinkLostError: it cannot be reached.
    """
    check_options(name, jobs=jobs, address=address)
    if name == "ray":
        from mission.sweep.cluster import RayEngine

        return RayEngine(jobs=jobs, address=address)
    from mission.sweep.local import LocalEngine

    return LocalEngine(jobs)
