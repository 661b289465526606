"""Jobs on several threads: results in order, and no work that nobody waits for."""

import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest

from fl.training.local import in_parallel


@pytest.mark.parametrize("workers", [1, 2, 9])
def test_results_come_in_the_order_of_the_jobs(workers: int) -> None:
    jobs: list[Callable[[], int]] = [partial(pow, k, 2) for k in range(5)]
    assert in_parallel(jobs, workers=workers) == [0, 1, 4, 9, 16]


def test_ctrl_c_ends_what_is_under_way_and_begins_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    submitted, released = threading.Semaphore(0), threading.Event()
    begun: list[int] = []

    class Pool(ThreadPoolExecutor):
        """Whoever waits for the threads lets the jobs under way end."""

        def submit(self, *job: Any, **named: Any) -> Future[Any]:
            future = super().submit(*job, **named)
            submitted.release()
            return future

        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            if wait:
                released.set()
            super().shutdown(wait, cancel_futures=cancel_futures)

    def job(k: int) -> None:
        begun.append(k)
        if k == 1:
            for _ in range(9):
                submitted.acquire()
            # Only a signal that the main thread is given wakes it from its waiting, and not one
            # that comes just before: then people press Ctrl-C once more.
            main = threading.main_thread().ident
            assert main is not None
            signal.pthread_kill(main, signal.SIGINT)
            while not released.wait(5.0):
                signal.pthread_kill(main, signal.SIGINT)
        released.wait()

    monkeypatch.setattr("fl.training.local.ThreadPoolExecutor", Pool)
    with pytest.raises(KeyboardInterrupt):
        in_parallel([partial(job, k) for k in range(9)], workers=2)
    assert sorted(begun) == [0, 1]


def test_of_jobs_that_fail_the_first_in_order_is_told() -> None:
    def fails(k: int) -> None:
        raise ValueError(k)

    with pytest.raises(ValueError, match=r"^0$"):
        in_parallel([partial(fails, k) for k in range(3)], workers=2)
