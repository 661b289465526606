"""The motors, as orders release and stop them."""

from flightdyn.aircraft import Aircraft
from sitl.autopilot.reporter import Reporter


class Motors:
    """Released by order; stopped by order, or by a crash without one."""

    def __init__(self, aircraft: Aircraft, reporter: Reporter) -> None:
        self.flights = 0  # how often they were released
        self.armed_t_ns = 0  # when last
        self._aircraft = aircraft
        self._report = reporter
        self._released = False

    def release(self) -> None:
        """Let them turn."""
        self._aircraft.arm()
        self._released = True
        self.flights += 1
        self.armed_t_ns = self._aircraft.t_ns
        self._report.armed(True)

    def stop(self) -> bool:
        """Stop them; whether they had been released."""
        if not self._released:
            return False
        self._released = False
        self._aircraft.disarm()
        self._report.armed(False)
        return True
