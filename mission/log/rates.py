"""How often each kind of message is written, on simulated time."""

from dataclasses import dataclass

from mission.log.values import NS_PER_S


@dataclass(frozen=True, slots=True)
class LogRates:
    """How often each kind of message is written, in simulated hertz; poses at every sample."""

    tf_hz: float = 5.0  # viewers interpolate
    velocity_hz: float = 2.0
    command_hz: float = 1.0
    location_hz: float = 1.0
    battery_hz: float = 1.0
    wind_hz: float = 1.0
    innovations_hz: float = 1.0  # what the filter refused is written in any case


class Every:
    """True once a period of simulated time, on a fixed grid so that rates do not drift."""

    __slots__ = ("_next_ns", "_period_ns")

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._next_ns = 0

    @classmethod
    def of(cls, rate_hz: float) -> "Every":
        return cls(round(NS_PER_S / rate_hz))

    def now(self, t_ns: int) -> bool:
        if t_ns < self._next_ns:
            return False
        self._next_ns = (t_ns // self._period_ns + 1) * self._period_ns
        return True
