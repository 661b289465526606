"""Runs in processes of this machine: the one home of joblib.

Every slot is a pool of one process, so that a worker that is killed takes no other run with it.
"""

import os
import signal
import sys
import threading
import time
from concurrent.futures import FIRST_COMPLETED, Future, wait

import joblib
from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from mission.sweep.execute.worker import ENVIRONMENT, RunEnd, RunOrder, execute

_FEEDER = "QueueFeederThread"  # loky's name for the thread that hands a worker its runs


class LocalEngine:
    """Runs in loky's processes on this machine, each in a pool of its own."""

    def __init__(self, jobs: int | None) -> None:
        self._free: list[ProcessPoolExecutor] = []
        self._running: dict[Future[RunEnd], tuple[str, ProcessPoolExecutor]] = {}
        self.slots = jobs or joblib.cpu_count()  # runs at a time

    def start(self, order: RunOrder) -> None:
        """Begin a run in an idle process, or in a new one."""
        # A worker inherits the mask: Ctrl-C is for the sweep, which ends its workers itself.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            future, pool = self._submit(order)
            self._running[future] = (order.name, pool)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _submit(self, order: RunOrder) -> tuple[Future[RunEnd], ProcessPoolExecutor]:
        while self._free:
            pool = self._free.pop()
            try:
                return pool.submit(execute, order), pool
            except TerminatedWorkerError:  # it was killed while it was idle
                pool.shutdown(kill_workers=True)
        pool = ProcessPoolExecutor(
            max_workers=1, initializer=_prepare, initargs=(os.getpid(),), env=ENVIRONMENT
        )
        return pool.submit(execute, order), pool

    def wait(self, timeout_s: float) -> dict[str, RunEnd | None]:
        """Return how runs ended, by name, within `timeout_s`; None: its process was killed.

        Raises:
            Exception: whatever a run raised that is no error of the application, once every
                other run that ended was told.
        """
        done, _ = wait(self._running, timeout_s, FIRST_COMPLETED)
        ended: dict[str, RunEnd | None] = {}
        bug: BaseException | None = None
        for future in done:
            error = future.exception()
            if error is not None and not isinstance(error, TerminatedWorkerError):
                bug = error  # stays among the running: the next call raises it
                continue
            name, pool = self._running.pop(future)
            if error is None:
                self._free.append(pool)
            else:
                pool.shutdown(kill_workers=True)
            ended[name] = None if error else future.result()
        if bug is not None and not ended:
            raise bug
        return ended

    def close(self) -> None:
        """Kill the processes: the next sweep goes on with what they had not finished."""
        for pool in (*self._free, *(pool for _, pool in self._running.values())):
            pool.shutdown(kill_workers=True)
        self._free.clear()
        self._running.clear()
        # Their daemons may be the last to hold a semaphore; one that the end of this process cuts
        # off while it releases it is told as a leak on standard error.
        for thread in threading.enumerate():
            if thread.name == _FEEDER:
                thread.join()


def _prepare(parent: int) -> None:
    """Set up a worker process: ignore Ctrl-C, print to standard error, end with the parent."""
    sys.stdout = sys.stderr
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()
