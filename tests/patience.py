"""How long tests wait: a guard against hanging that a stalled machine must not trip."""

import time
from collections.abc import Callable

# Wall time. The longest of all waits for one thing, a cluster's whole sweep, took 40 s where 17
# programs wanted two cores: this is six times that, and not so long that defects which make many
# tests wait would hide behind a job's own time limit.
HANG_S = 240.0


def until(
    condition: Callable[[], bool], what: str = "waited in vain", *, poll_s: float = 0.02
) -> None:
    """Return as soon as the condition holds."""
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(poll_s)
