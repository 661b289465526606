"""How old the last GNSS solution is."""

import math

from flightdyn.aircraft import Aircraft
from flightdyn.state import GnssFix
from sitl.autopilot.parameters import Parameters

_CURRENT_S = 1.5  # a solution is current for so long
_SATELLITES_UNKNOWN = 255


class GnssWatch:
    """Notes when solutions arrive, as often as it is asked."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters) -> None:
        self._aircraft = aircraft
        self._parameters = parameters
        self._fix: GnssFix | None = None
        self._arrived_ns = 0

    def look(self) -> None:
        """Note a solution that has arrived."""
        aircraft = self._aircraft
        fix = aircraft.gnss
        if fix is None and aircraft.ready:
            # No receiver, and yet it knows where it is: flown on the truth. That is a fix, too.
            at = aircraft.belief
            fix = GnssFix(at.t_ns, at.pos_ned_m, at.vel_ned_mps, 0.0, 0.0, 0.0, _SATELLITES_UNKNOWN)
        if fix is not self._fix:
            self._fix, self._arrived_ns = fix, aircraft.t_ns

    def age_s(self) -> float:
        """Simulated seconds since a solution arrived; infinite where there was none."""
        self.look()
        if self._fix is None:
            return math.inf
        return (self._aircraft.t_ns - self._arrived_ns) * 1e-9

    def current(self) -> GnssFix | None:
        """The last solution, if it is a recent one."""
        return self._fix if self.age_s() < _CURRENT_S else None

    def navigable(self) -> bool:
        """Whether the estimate of the position may still be navigated by."""
        return self.age_s() < self._parameters["COM_POS_FS_DELAY"]
