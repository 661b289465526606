"""Whether a flight may begin and where it may lead: by GNSS, battery and fence."""

import math
from collections.abc import Sequence

from flightdyn.aircraft import Aircraft
from flightdyn.frames import yaw_of
from flightdyn.state import GnssFix, Vector
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.fence import Fence, breach_of, compile_fence
from sitl.autopilot.parameters import Parameters

_CURRENT_S = 1.5  # a GNSS solution is current for so long
_SATELLITES_UNKNOWN = 255
_HYSTERESIS = 0.02  # of the charge
LOW, CRITICAL, EMERGENCY = "BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"


class Guard:
    """Watches what a flight depends on. It knows nothing of the flight that asks."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters) -> None:
        self.home = aircraft.frame.origin
        self.home_yaw_rad = yaw_of(aircraft.belief.q_frd_to_ned)
        self.fence_enabled = True
        self._fence = Fence()
        self._aircraft = aircraft
        self._parameters = parameters
        self._fix: GnssFix | None = None
        self._arrived_ns = 0
        self._below = dict.fromkeys((LOW, CRITICAL, EMERGENCY), False)

    def look_for_gnss(self) -> None:
        """Note a GNSS solution that has arrived."""
        aircraft = self._aircraft
        fix = aircraft.gnss
        if fix is None and aircraft.ready:
            # No receiver, and yet it knows where it is: flown on the truth. That is a fix, too.
            at = aircraft.belief
            fix = GnssFix(at.t_ns, at.pos_ned_m, at.vel_ned_mps, 0.0, 0.0, 0.0, _SATELLITES_UNKNOWN)
        if fix is not self._fix:
            self._fix, self._arrived_ns = fix, aircraft.t_ns

    def gnss_age_s(self) -> float:
        """Simulated seconds since a solution arrived; infinite where there was none."""
        self.look_for_gnss()
        if self._fix is None:
            return math.inf
        return (self._aircraft.t_ns - self._arrived_ns) * 1e-9

    def gnss(self) -> GnssFix | None:
        """Return the last solution; None if it arrived more than 1.5 s ago, or never."""
        return self._fix if self.gnss_age_s() < _CURRENT_S else None

    def position_ok(self) -> bool:
        """Whether the position estimate may be used: GNSS age below COM_POS_FS_DELAY."""
        return self.gnss_age_s() < self._parameters["COM_POS_FS_DELAY"]

    def look_at_charge(self) -> dict[str, bool]:
        """Return for each threshold parameter whether the charge is below it, with hysteresis."""
        charge = self._aircraft.battery.remaining
        for name, below in self._below.items():
            self._below[name] = charge < self._parameters[name] + (_HYSTERESIS if below else 0.0)
        return self._below

    @property
    def home_ned_m(self) -> Vector:
        """Home in the aircraft's frame."""
        home = self.home
        return self._aircraft.frame.to_ned(home.lat_deg, home.lon_deg, home.alt_msl_m)

    def draw_fence(self, items: Sequence[MissionItem]) -> None:
        """Replace the fence by the one that these items describe; no items remove it.

        Raises:
            FenceError: the items do not make a fence.
        """
        self._fence = compile_fence(items, self._aircraft.frame)

    @property
    def fenced(self) -> bool:
        """Whether there is a fence, drawn or by parameters, and it is not switched off."""
        p = self._parameters
        if not self.fence_enabled or p["GF_ACTION"] == 0:
            return False
        drawn = bool(self._fence.inclusions or self._fence.exclusions)
        return drawn or p["GF_MAX_HOR_DIST"] > 0 or p["GF_MAX_VER_DIST"] > 0

    def forbidden(self, places_ned_m: Vector) -> str:
        """Describe how places, (3,) or (n, 3), breach the fence; empty if they do not."""
        if not self.fenced:
            return ""
        home = self.home_ned_m
        return breach_of(self._fence, places_ned_m, home_ned_m=home, parameters=self._parameters)

    def arming_denied(self) -> str:
        """Why the motors must not be released; empty if they may."""
        if self.gnss() is None:
            return "no GNSS solution"
        return "battery critical" if self._below[CRITICAL] else ""
