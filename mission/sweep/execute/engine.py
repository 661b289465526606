"""Where the runs of a sweep are executed, and the loop that hands them out until all have ended."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, get_args

from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.sweep.execute.worker import RunEnd, RunOrder
from mission.sweep.grid import SweepRun

ATTEMPTS = 3  # of a run whose worker dies, the first included
POLL_S = 0.5
EngineName = Literal["joblib", "ray"]


class Engine(Protocol):
    """Executor of runs in processes of their own, here or on a cluster."""

    @property
    def slots(self) -> int:
        """How many runs it executes at a time."""

    def start(self, order: RunOrder) -> None:
        """Begin a run; there must be a free slot."""

    def wait(self, timeout_s: float) -> Mapping[str, RunEnd | None]:
        """The runs that ended since the last call, by name, waiting at most so long for one.

        None: its worker died, which says nothing about the run.
        """

    def close(self) -> None:
        """End the workers, also those that are at work."""


@dataclass(frozen=True)
class EngineChoice:
    """The choice of engine for a sweep: its name, runs at a time, address of a cluster."""

    name: EngineName = "joblib"
    jobs: int | None = None  # runs at a time; None: one a core
    address: str | None = None  # of a Ray cluster

    def __post_init__(self) -> None:
        """Refuse options that do not fit the engine, before anything is written.

        Raises:
            InputError: naming it.
        """
        if self.name not in get_args(EngineName):
            names = " or ".join(get_args(EngineName))
            raise InputError(f"engine = {self.name}: must be {names}")
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"jobs = {self.jobs}: at least 1")
        if self.address is not None and self.name != "ray":
            raise InputError(f"address = {self.address}: belongs to engine = ray")
        if self.address is not None and "://" in self.address:
            raise InputError(
                f"address = {self.address}: must be HOST:PORT of a cluster that this machine is "
                "part of; ray start --address=HOST:PORT makes it one"
            )

    def make(self, configs: Sequence[RunConfig], *, data_dir: Path | None) -> Engine:
        """The engine, for runs of these configurations. Its library is imported here.

        Raises:
            InputError: it is not installed.
            LinkLostError: it cannot be reached.
        """
        if self.name == "ray":
            from mission.sweep.execute.cluster import RayEngine

            return RayEngine(
                jobs=self.jobs, address=self.address, configs=configs, data_dir=data_dir
            )
        from mission.sweep.execute.local import LocalEngine

        return LocalEngine(self.jobs)


def execute_all(
    runs: Sequence[SweepRun], engine: Engine, *, order: Callable[[SweepRun], RunOrder]
) -> Iterator[tuple[SweepRun | None, RunEnd | None, Sequence[SweepRun]]]:
    """Execute every run. A run whose worker dies is handed to another.

    Yields each run that ended, its end (None: its worker died, another takes it) and the runs at
    work; at every poll also None, None and the runs at work. The engine stays open.
    """
    waiting, attempts = deque(runs), Counter[str]()
    running: dict[str, SweepRun] = {}
    while waiting or running:
        while waiting and len(running) < engine.slots:
            run = waiting.popleft()
            attempts[run.name] += 1
            running[run.name] = run
            engine.start(order(run))
        for name, end in engine.wait(POLL_S).items():
            run = running.pop(name)
            if end is None and attempts[run.name] >= ATTEMPTS:
                end = RunEnd(1, f"its worker died {ATTEMPTS} times (out of memory?)")
            if end is None:
                waiting.append(run)
            yield run, end, tuple(running.values())
        yield None, None, tuple(running.values())
