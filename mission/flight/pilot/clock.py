"""A vehicle's clock, by the time stamps of its messages."""

_REBOOT_MS = 5_000  # no message is that late


class VehicleClock:
    """Nanoseconds since a stamp, the first if no other. A vehicle that starts anew goes on where
    it was.
    """

    def __init__(self, zero_ms: int | None = None) -> None:
        self._zero_ms = zero_ms
        self._last_ms = zero_ms or 0
        self.restarts = 0

    def t_ns(self, boot_ms: int) -> int:
        """The instant of a stamp in milliseconds since the vehicle's start."""
        if self._zero_ms is None:
            self._zero_ms = self._last_ms = boot_ms
        if boot_ms < self._last_ms - _REBOOT_MS:
            self._zero_ms -= self._last_ms - boot_ms
            self._last_ms = boot_ms
            self.restarts += 1
        self._last_ms = max(boot_ms, self._last_ms)
        return (boot_ms - self._zero_ms) * 1_000_000
