"""Runs on a Ray cluster, or on a Ray that is started here: the one home of ray.

No folder is shared. Data sets and the user's code go to the machines, and runs come back, through
Ray's object store. The sweep's folder is the only truth: it has what a run needs to go on, so that
another machine can when the first one dies.
"""

import importlib
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fl.data.load import Source
from fl.errors import LearningInputError, first_line
from mission.base.errors import AerofedError, InputError, LinkLostError
from mission.base.run_folder import library_versions
from mission.config.models import RunConfig
from mission.sweep.execute.engine import RunFinished
from mission.sweep.execute.luggage import data_sets, own_code, put_together
from mission.sweep.execute.parcels import Inbox, Kept, Part
from mission.sweep.execute.worker import ENVIRONMENT, RunEnd, RunOrder, failed

_PARCELS_AHEAD = 2  # that a machine makes before they are fetched


@dataclass(frozen=True)
class _Flight:
    """A run that a machine was given."""

    order: RunOrder
    inbox: Inbox


class RayEngine:
    """One Ray task of one CPU for each run."""

    def __init__(
        self,
        *,
        jobs: int | None,
        address: str | None,
        configs: Sequence[RunConfig],
        data_dir: Path | None,
    ) -> None:
        """Connect to the cluster at `address`, or start Ray on this machine.

        Raises:
            InputError: Ray is not installed, or what should go along cannot.
            LinkLostError: there is no cluster at that address.
        """
        try:
            self._ray: Any = importlib.import_module("ray")
        except ImportError:
            raise InputError(
                "--engine ray: Ray is not installed: pip install 'aerofed[ray]'"
            ) from None
        try:
            read = data_sets(configs, data_dir)
        except LearningInputError as error:
            raise InputError(str(error)) from None
        with tempfile.TemporaryDirectory(prefix="aerofed-code-") as folder:
            here = Path.cwd()
            files = own_code(configs, here)
            put_together(files, here, Path(folder))
            self._connect(address, jobs, code=folder if files else None)
        self._data = {source: self._ray.put(dataset) for source, dataset in read.items()}
        self._jobs = jobs
        if self._cpus() < 1:
            self._ray.shutdown()
            raise LinkLostError(f"--address {address}: no machine of the cluster offers a CPU")
        # No retry by Ray: only the sweep knows how often a run was lost, and what there is of it.
        self._fly = self._ray.remote(
            num_cpus=1,
            max_retries=0,
            num_returns="streaming",
            _generator_backpressure_num_objects=_PARCELS_AHEAD,
        )(_flying())
        self._versions = library_versions()
        self._flights: dict[Iterator[object], _Flight] = {}
        self._ended: list[RunFinished] = []

    def _connect(self, address: str | None, jobs: int | None, *, code: str | None) -> None:
        # Ray's workers run at the lowest priority unless this is set before it starts.
        os.environ["RAY_worker_niceness"] = "0"  # noqa: SIM112  # Ray's own spelling
        # A Ray that is started here tells nobody of it, unless it is asked to.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        local = {"num_cpus": jobs, "include_dashboard": False} if address is None else {}
        place = {} if code is None else {"working_dir": code}
        try:
            self._ray.init(
                address=address or "local",
                log_to_driver=False,
                logging_level="error",
                runtime_env={"env_vars": ENVIRONMENT, **place},
                **local,
            )
        except (OSError, ValueError, RuntimeError, self._ray.exceptions.RayError) as error:
            doing = (
                "--engine ray: cannot start Ray here"
                if address is None
                else f"--address {address}: cannot reach Ray"
            )
            raise LinkLostError(f"{doing}: {first_line(error)}") from None

    @property
    def slots(self) -> int:
        """Runs at a time: as many as asked for, by default one for each CPU that is there now."""
        return self._jobs or max(1, self._cpus())

    def _cpus(self) -> int:
        return int(self._ray.cluster_resources().get("CPU", 0))

    def start(self, order: RunOrder) -> None:
        """Hand a run to the cluster, with what the sweep's folder has of it."""
        try:
            inbox = Inbox(order.folder)
            brought = inbox.brought()
        except (AerofedError, OSError) as error:
            self._ended.append(RunFinished(order, failed(error, order.folder)))
            return
        if inbox.finished:  # all of it had come as the last sweep was cut off
            self._ended.append(RunFinished(order, RunEnd(0)))
            return
        # Packed, so that a machine without Aerofed can say so.
        packed = pickle.dumps((order, brought))
        self._flights[self._fly.remote(self._versions, packed, self._data)] = _Flight(order, inbox)

    def wait(self, timeout_s: float) -> tuple[RunFinished, ...]:
        """Runs that ended; one whose process or machine died has no end.

        Raises:
            InputError: a machine has other versions.
            Exception: whatever a run raised that is no error of the application.
        """
        until = time.monotonic() + timeout_s
        while not self._ended and self._flights:
            left = until - time.monotonic()
            ready, _ = self._ray.wait(list(self._flights), timeout=max(0.0, left))
            for stream in ready:
                self._receive(stream)
            if left <= 0.0:
                break
        ended, self._ended = tuple(self._ended), []
        return ended

    def _receive(self, stream: Iterator[object]) -> None:
        """Take in what comes next from a run."""
        flight, lost = self._flights[stream], self._ray.exceptions
        try:
            parcel = self._ray.get(next(stream))
        except (
            lost.WorkerCrashedError,
            lost.NodeDiedError,
            lost.OutOfMemoryError,
            lost.ObjectLostError,
        ):
            self._end(stream, None)
            return
        try:
            match parcel:
                case Kept():
                    flight.inbox.keep(parcel)
                case Part():
                    flight.inbox.add(parcel)
                case RunEnd():
                    flight.inbox.complete()
                    self._end(stream, parcel)
                case (str(machine), dict(versions)):
                    raise _OtherVersionsError(machine, versions, self._versions)
        except _OtherVersionsError:
            raise
        except (AerofedError, OSError) as error:
            # A full disk here, say: the end of this run, and not of the sweep.
            self._ray.cancel(stream, force=True)
            self._end(stream, failed(error, flight.order.folder))

    def _end(self, stream: Iterator[object], end: RunEnd | None) -> None:
        flight = self._flights.pop(stream)
        flight.inbox.close()
        self._ended.append(RunFinished(flight.order, end))

    def close(self) -> None:
        """Cancel what is at work and leave the cluster; a Ray that was started here ends."""
        for stream, flight in self._flights.items():
            self._ray.cancel(stream, force=True)
            flight.inbox.close()
        self._flights.clear()
        self._ray.shutdown()


class _OtherVersionsError(InputError):
    """A machine of the cluster would find something else."""

    def __init__(self, machine: str, there: dict[str, str | None], here: dict[str, str]) -> None:
        named = ", ".join(
            f"{name} {there.get(name) or 'is missing'} (here {value})"
            for name, value in here.items()
            if there.get(name) != value
        )
        super().__init__(
            f"--engine ray: machine {machine} has other versions: {named}; install the same on "
            "all machines of the cluster"
        )


def _flying() -> Callable[..., Iterator[object]]:
    """What a machine does. It is sent as code, and so says itself if Aerofed is missing there."""

    def fly(wanted: dict[str, str], packed: bytes, data: dict[Source, object]) -> Iterator[object]:
        import importlib.metadata
        import pickle
        import socket

        found: dict[str, str | None] = {}
        for name in wanted:
            try:
                found[name] = importlib.metadata.version(name)
            except importlib.metadata.PackageNotFoundError:
                found[name] = None
        if found != wanted:
            yield socket.gethostname(), found
            return
        import ray

        from fl.data.load import bring
        from mission.sweep.execute.remote import fly_here

        bring({source: ray.get(reference) for source, reference in data.items()})
        yield from fly_here(*pickle.loads(packed))

    return fly
