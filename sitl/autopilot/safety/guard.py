"""Looks for what the failsafes react to: battery, GNSS, fence, ground station."""

import math
from collections.abc import Sequence

from flightdyn.aircraft import Aircraft
from flightdyn.state import Vector
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.safety.failsafe import Cause, Failsafes
from sitl.autopilot.safety.fence import Fence, breach_of, compile_fence
from sitl.autopilot.safety.monitor import Monitor
from sitl.autopilot.values.messages import MissionItem

_CHARGE_HYSTERESIS = 0.02
_THRESHOLDS = (
    (Cause.BATTERY_LOW, "BAT_LOW_THR"),
    (Cause.BATTERY_CRITICAL, "BAT_CRIT_THR"),
    (Cause.BATTERY_EMERGENCY, "BAT_EMERGEN_THR"),
)


class Guard:
    """Watches one flight. `watch` is for simulated time, `poll` for wall time."""

    def __init__(
        self,
        aircraft: Aircraft,
        flight: Flight,
        parameters: Parameters,
        *,
        monitor: Monitor,
        failsafes: Failsafes,
    ) -> None:
        self.fence_enabled = True
        self._aircraft = aircraft
        self._flight = flight
        self._parameters = parameters
        self._monitor = monitor
        self._failsafes = failsafes
        self._fence = Fence()

    def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Another fence; none where there are no items.

        Raises:
            SitlInputError: the items make no fence.
        """
        self._fence = compile_fence(items, self._aircraft.frame)

    def fenced(self) -> bool:
        """Whether there is a fence, and it is not switched off."""
        p = self._parameters
        cylinder = p["GF_MAX_HOR_DIST"] > 0 or p["GF_MAX_VER_DIST"] > 0
        drawn = bool(self._fence.inclusions or self._fence.exclusions)
        return self.fence_enabled and p["GF_ACTION"] != 0 and (cylinder or drawn)

    def breach(self, pos_ned_m: Vector) -> str:
        """What the fence has against being there; empty if nothing."""
        if not self.fence_enabled:
            return ""
        home_ned_m = self._flight.home_ned_m
        return breach_of(self._fence, pos_ned_m, home_ned_m=home_ned_m, parameters=self._parameters)

    def position_ok(self) -> bool:
        """Whether the estimate of the position may be navigated by."""
        return self._monitor.gnss_age_s() < self._parameters["COM_POS_FS_DELAY"]

    def watch(self) -> None:
        """Look at battery, GNSS and fence."""
        self._watch_battery()
        age_s = self._monitor.gnss_age_s()
        lost = self._parameters["COM_POS_FS_DELAY"] <= age_s < math.inf
        self._failsafes.update(Cause.GNSS_LOST, lost, lambda: f"no solution for {age_s:.0f} s")
        fenced = self.fenced() and self._flight.airborne
        breach = self.breach(self._aircraft.belief.pos_ned_m) if fenced else ""
        self._failsafes.update(Cause.FENCE_BREACHED, bool(breach), lambda: breach)

    def poll(self, now: float) -> None:
        """Look for the ground station."""
        silence_s = now - self._monitor.ground_station_at
        if not math.isnan(silence_s):
            lost = silence_s > self._parameters["COM_DL_LOSS_T"]
            self._failsafes.update(
                Cause.GROUND_STATION_LOST, lost, lambda: f"silent for {silence_s:.0f} s"
            )

    def _watch_battery(self) -> None:
        charge = self._aircraft.battery.remaining
        for cause, name in _THRESHOLDS:
            was = self._failsafes.present(cause)
            threshold = self._parameters[name] + (_CHARGE_HYSTERESIS if was else 0.0)
            self._failsafes.update(cause, charge < threshold, lambda: f"{charge * 100:.0f} % left")
