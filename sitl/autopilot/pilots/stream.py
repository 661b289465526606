"""Something that has to be heard again and again, in wall time, as long as it is flown by."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from sitl.autopilot.safety.failsafe import Cause, Failsafes


@dataclass(slots=True)
class WallClock:
    """The wall time (s) that the autopilot was told last."""

    now: float = 0.0


class Stream:
    """When it was heard, and what follows when it is not."""

    def __init__(
        self,
        clock: WallClock,
        failsafes: Failsafes,
        cause: Cause,
        *,
        patience_s: Callable[[], float],
    ) -> None:
        self._clock = clock
        self._failsafes = failsafes
        self._cause = cause
        self._patience_s = patience_s
        self._heard_at = -math.inf

    @property
    def alive(self) -> bool:
        """Whether it was heard a short while ago."""
        return self._clock.now - self._heard_at < self._patience_s()

    def heard(self) -> None:
        """Note that it was heard now."""
        self._heard_at = self._clock.now

    def watch(self, *, flown_by: bool) -> None:
        """Look for a loss; one that has come stays until the stream is back or nobody flies."""
        missed = flown_by or self._failsafes.present(self._cause)
        silence_s = self._clock.now - self._heard_at
        self._failsafes.update(self._cause, missed and not self.alive, lambda: f"{silence_s:.1f} s")

    def forget(self) -> None:
        """A loss does not matter any more."""
        self._failsafes.update(self._cause, False)

    def due(self) -> float | None:
        """When a loss will show; None where there is nothing to lose."""
        return self._heard_at + self._patience_s() if self.alive else None
