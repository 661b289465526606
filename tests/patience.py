"""How long tests wait: a guard against hanging that a stalled machine must not trip."""

import time
from collections.abc import Callable

HANG_S = 900.0  # wall time


def until(
    condition: Callable[[], bool], what: str = "waited in vain", *, poll_s: float = 0.02
) -> None:
    """Return as soon as the condition holds."""
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(poll_s)
