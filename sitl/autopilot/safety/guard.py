"""Looks for what the failsafes react to: battery, GNSS, fence, ground station."""

import math

from flightdyn.aircraft import Aircraft
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.safety.clearance import Clearance
from sitl.autopilot.safety.failsafe import Cause, Failsafes


class Guard:
    """Watches one flight. `watch` is for simulated time, `poll` for wall time."""

    def __init__(
        self,
        aircraft: Aircraft,
        flight: Flight,
        parameters: Parameters,
        *,
        clearance: Clearance,
        failsafes: Failsafes,
    ) -> None:
        self._aircraft = aircraft
        self._flight = flight
        self._parameters = parameters
        self._clearance = clearance
        self._failsafes = failsafes
        self._ground_station_at = math.nan  # wall time of the last heartbeat from one

    def heard_ground_station(self, now: float) -> None:
        """A ground station is alive."""
        self._ground_station_at = now

    def watch(self) -> None:
        """Look at battery, GNSS and fence."""
        clearance, failsafes = self._clearance, self._failsafes
        charge = self._aircraft.battery.remaining
        for cause, below in clearance.charge.look().items():
            failsafes.update(cause, below, lambda: f"{charge * 100:.0f} % left")
        age_s = clearance.gnss.age_s()
        lost = age_s < math.inf and not clearance.gnss.navigable()
        failsafes.update(Cause.GNSS_LOST, lost, lambda: f"no solution for {age_s:.0f} s")
        breach = ""
        if clearance.fence.in_force and self._flight.airborne:
            breach = self._flight.forbidden(self._aircraft.belief.pos_ned_m)
        failsafes.update(Cause.FENCE_BREACHED, bool(breach), lambda: breach)

    def poll(self, now: float) -> None:
        """Look for the ground station."""
        silence_s = now - self._ground_station_at
        if not math.isnan(silence_s):
            lost = silence_s > self._parameters["COM_DL_LOSS_T"]
            self._failsafes.update(
                Cause.GROUND_STATION_LOST, lost, lambda: f"silent for {silence_s:.0f} s"
            )
