"""Runs on a Ray cluster, or on a Ray that is started here: the one home of ray."""

import importlib
import os
from typing import Any

from mission.base.errors import InputError, LinkLostError
from mission.sweep.execute.engine import RunFinished
from mission.sweep.execute.worker import ENVIRONMENT, RunEnd, RunOrder, execute


class RayEngine:
    """One Ray task of one CPU for each run. The sweep's folder must be visible to all machines."""

    def __init__(self, *, jobs: int | None, address: str | None) -> None:
        """Connect to the cluster at `address`, or start Ray on this machine.

        Raises:
            InputError: Ray is not installed.
            LinkLostError: there is no cluster at that address.
        """
        try:
            self._ray: Any = importlib.import_module("ray")
        except ImportError:
            raise InputError(
                "--engine ray: Ray is not installed: pip install 'aerofed[ray]'"
            ) from None
        # Ray's workers run at the lowest priority unless this is set before it starts.
        os.environ["RAY_worker_niceness"] = "0"  # noqa: SIM112  # Ray's own spelling
        local = {"num_cpus": jobs, "include_dashboard": False} if address is None else {}
        try:
            self._ray.init(
                address=address or "local",
                log_to_driver=False,
                logging_level="error",
                runtime_env={"env_vars": ENVIRONMENT},
                **local,
            )
        except (ConnectionError, ValueError, RuntimeError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise LinkLostError(f"--address {address}: cannot reach Ray: {reason}") from None
        cpus = int(self._ray.cluster_resources().get("CPU", 1))
        self._slots = cpus if jobs is None else jobs
        # No retry by Ray: only the sweep knows how often a run was lost.
        self._execute = self._ray.remote(num_cpus=1, max_retries=0)(execute)
        self._running: dict[Any, RunOrder] = {}

    @property
    def slots(self) -> int:
        """Runs at a time: as many as asked for, by default one for each CPU of the cluster."""
        return self._slots

    def start(self, order: RunOrder) -> None:
        """Hand a run to the cluster."""
        self._running[self._execute.remote(order)] = order

    def wait(self, timeout_s: float) -> tuple[RunFinished, ...]:
        """Runs that ended; one whose process or machine died has no end.

        Raises:
            Exception: whatever a run raised that is no error of the application.
        """
        lost = self._ray.exceptions
        done, _ = self._ray.wait(list(self._running), timeout=timeout_s)
        ended = []
        for reference in done:
            order = self._running.pop(reference)
            end: RunEnd | None
            try:
                end = self._ray.get(reference)
            except (lost.WorkerCrashedError, lost.NodeDiedError, lost.OutOfMemoryError):
                end = None
            if end is not None and end.exit_code == 0 and not order.folder.is_dir():
                raise InputError(
                    f"{order.folder}: a run was finished on another machine and is not seen here: "
                    "--out must be a folder that all machines of the cluster share"
                )
            ended.append(RunFinished(order, end))
        return tuple(ended)

    def close(self) -> None:
        """Cancel what is at work and leave the cluster; a Ray that was started here ends."""
        for reference in self._running:
            self._ray.cancel(reference, force=True)
        self._running.clear()
        self._ray.shutdown()
