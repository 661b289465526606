"""Whether a vehicle's battery readings can be relied on."""

import math

FLOWN_S = 120.0  # in which any battery loses more than a reading's 1 %


class BatteryWatch:
    """Notices readings that are missing, or that no flight changes."""

    def __init__(self) -> None:
        self._remaining = math.nan
        self._since_ns: int | None = None  # in the air, with this reading
        self._unchanged_s = 0.0

    def read(self, t_ns: int, remaining: float, *, flying: bool) -> None:
        """A reading (0..1; NaN: none) at an instant."""
        if not flying:
            self._since_ns = None
        elif self._since_ns is None or remaining != self._remaining:
            self._since_ns, self._unchanged_s = t_ns, 0.0
        else:
            self._unchanged_s = (t_ns - self._since_ns) / 1e9
        self._remaining = remaining

    @property
    def doubt(self) -> str:
        """Why the readings say nothing, for people; empty where they do."""
        if math.isnan(self._remaining):
            return "the vehicle does not say how full its battery is"
        if self._unchanged_s >= FLOWN_S:
            return (
                f"the vehicle's battery has read {100 * self._remaining:.0f} % through "
                f"{self._unchanged_s:.0f} s of flight"
            )
        return ""
