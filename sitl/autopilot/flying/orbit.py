"""Flying round a place: MAV_CMD_DO_ORBIT, with PX4's limits."""

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from sitl.autopilot.codec.orders import CommandOrder
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.circle import DEFAULT_RADIUS_M, Orbit, fastest
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.modes import Mode, Trigger
from sitl.autopilot.protocol.commands import Commands, RefusedError, demand

_DEFAULT_SPEED_MPS = 2.0


class Orbits:
    """Carries out DO_ORBIT; `current` is the circle being flown."""

    def __init__(self, aircraft: Aircraft, flight: Flight) -> None:
        self._aircraft = aircraft
        self._flight = flight
        self._orbit: Orbit | None = None

    @property
    def current(self) -> Orbit | None:
        """The circle being flown, or None."""
        return self._orbit if self._flight.mode is Mode.ORBIT else None

    def commands(self) -> Commands:
        """The handler of each MAV_CMD that is carried out."""
        return {mav.MAV_CMD_DO_ORBIT: self._command}

    def _command(self, order: CommandOrder) -> None:
        orbit, flight = self._asked(order), self._flight
        if forbidden := flight.guard.forbidden(orbit.points(self._phase(orbit))):
            raise RefusedError(f"the orbit leads {forbidden}")
        if orbit != self.current:
            demand(flight.order(Trigger.ORDER_ORBIT, lambda: self._fly(orbit)))
            self._orbit = orbit

    def _asked(self, order: CommandOrder) -> Orbit:
        """The circle that an order asks for; what it leaves open is that of the one being flown,
        else the vehicle's default."""
        radius, speed, yaw, arc_rad, lat_deg, lon_deg, z = order.params
        now, frame = self.current, self._flight.frame
        north, east, down = map(float, self._aircraft.belief.pos_ned_m)
        if now is not None:
            north, east, _ = now.center_ned_m
        if not (math.isnan(lat_deg) or math.isnan(lon_deg)):
            there = frame.to_ned(lat_deg, lon_deg, frame.origin.alt_msl_m)
            if far := self._flight.navigator.too_far(there):
                raise RefusedError(f"the orbit is {far}")
            north, east, _ = map(float, there)
        if not math.isnan(z):
            down = frame.origin.alt_msl_m - z
        # The sign of the radius is the direction; a speed that would press too hard is lowered.
        if math.isnan(radius):
            radius = DEFAULT_RADIUS_M if now is None else math.copysign(now.radius_m, now.speed_mps)
        if math.isnan(speed):
            speed = _DEFAULT_SPEED_MPS if now is None else abs(now.speed_mps)
        if math.isnan(yaw) or yaw == mav.ORBIT_YAW_BEHAVIOUR_UNCHANGED:
            yaw = 0.0 if now is None else now.yaw
        if math.isnan(arc_rad):
            turns = math.inf if now is None else now.turns
        else:
            turns = arc_rad / math.tau or math.inf
        flown_mps = min(abs(speed), fastest(abs(radius)))
        speed_mps = math.copysign(flown_mps, radius * (speed or 1.0))
        return Orbit((north, east, down), abs(radius), speed_mps, int(yaw), turns)

    def _phase(self, orbit: Orbit) -> float:
        """Where the circle is nearest to the vehicle, clockwise from north (rad)."""
        here = self._flight.navigator.here(resting=False)
        north, east, _ = orbit.center_ned_m
        return math.atan2(here[1] - east, here[0] - north)

    def _fly(self, orbit: Orbit) -> do.Manoeuvre:
        def parts() -> Iterator[do.Manoeuvre]:
            here, phase = self._flight.navigator.here(resting=False), self._phase(orbit)
            yield self._flight.navigator.go_to(here, orbit.point(phase), speed_mps=None)
            yield do.Circle(self._aircraft, orbit, phase_rad=phase)

        return do.Sequence(parts())
