"""Simulated time: an integer count of ticks. Nobody else keeps time."""

from native.errors import InputError

NS_PER_S = 1_000_000_000


class SimClock:
    """Counts ticks of a whole number of nanoseconds, so that no rounding accumulates."""

    __slots__ = ("dt_ns", "tick")

    def __init__(self, rate_hz: int) -> None:
        if rate_hz <= 0 or NS_PER_S % rate_hz:
            raise InputError(f"rate {rate_hz} Hz: a tick must be a whole number of ns")
        self.dt_ns = NS_PER_S // rate_hz
        self.tick = 0

    @property
    def t_ns(self) -> int:
        """Nanoseconds of simulated time; negative before the power-up alignment is over."""
        return self.tick * self.dt_ns

    @property
    def dt_s(self) -> float:
        """Length of a tick in seconds."""
        return self.dt_ns / NS_PER_S

    def ticks(self, duration_s: float, *, what: str) -> int:
        """Return the ticks in `duration_s`; raise InputError if not whole, or under 1."""
        exact = duration_s * NS_PER_S / self.dt_ns
        count = round(exact)
        if count < 1 or abs(exact - count) > 1e-6:
            raise InputError(
                f"{what} = {duration_s:g} s is not a whole number of {self.dt_ns / 1e6:g} ms ticks"
            )
        return count
