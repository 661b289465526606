"""The loop of a sweep: hands runs to an engine until every one has ended."""

from collections import Counter, deque
from collections.abc import Callable, Sequence

from mission.sweep.execute.engine import Engine
from mission.sweep.execute.worker import RunEnd, RunOrder
from mission.sweep.grid import SweepRun

ATTEMPTS = 3  # of a run whose worker dies, the first included
POLL_S = 0.5

Watch = Callable[[SweepRun | None, RunEnd | None, Sequence[SweepRun]], None]


def execute_all(
    runs: Sequence[SweepRun], engine: Engine, *, order: Callable[[SweepRun], RunOrder], watch: Watch
) -> dict[str, RunEnd]:
    """Execute every run; how each ended, by name. A run whose worker dies is handed to another.

    `watch(run, end, running)` is called for each run that ends (`end` None: another goes on with
    it) and between (`run` None). The engine stays open.
    """
    waiting, attempts = deque(runs), Counter[str]()
    running: dict[str, SweepRun] = {}
    ends: dict[str, RunEnd] = {}
    while waiting or running:
        while waiting and len(running) < engine.slots:
            run = waiting.popleft()
            attempts[run.name] += 1
            running[run.name] = run
            engine.start(order(run))
        for ended in engine.wait(POLL_S):
            run, end = running.pop(ended.order.name), ended.end
            if end is None and attempts[run.name] >= ATTEMPTS:
                end = RunEnd(1, f"its worker died {ATTEMPTS} times (out of memory?)")
            if end is None:
                waiting.append(run)
            else:
                ends[run.name] = end
            watch(run, end, tuple(running.values()))
        watch(None, None, tuple(running.values()))
    return ends
