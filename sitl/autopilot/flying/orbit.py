"""Flying round a place: MAV_CMD_DO_ORBIT, with PX4's limits."""

import math
from collections.abc import Iterator

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import CommandOrder
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.circle import DEFAULT_RADIUS_M, Orbit, fastest
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.modes import Mode, Trigger
from sitl.autopilot.protocol.commands import (
    Commands,
    RefusedError,
    demand,
    demand_global,
    demand_within,
)

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
        if far := flight.navigator.too_far(np.array(orbit.center_ned_m)):
            raise RefusedError(f"the orbit is {far}")
        if forbidden := flight.guard.forbidden(orbit.points()):
            raise RefusedError(f"the orbit leads {forbidden}")
        if orbit != self.current:
            demand(flight.order(Trigger.ORDER_ORBIT, lambda: self._fly(orbit)))
            self._orbit = orbit

    def _asked(self, order: CommandOrder) -> Orbit:
        demand_global(order)
        radius, speed, yaw, _, lat_deg, lon_deg, z = order.params
        radius = DEFAULT_RADIUS_M if math.isnan(radius) else radius
        speed = _DEFAULT_SPEED_MPS if math.isnan(speed) else speed
        yaw = 0.0 if math.isnan(yaw) else yaw
        demand_within("radius", abs(radius), ranges.ORBIT_RADIUS)
        demand_within("speed", abs(speed), ranges.ORBIT_SPEED)
        demand_within("yaw behaviour", yaw, ranges.ORBIT_YAW)
        north, east, down = map(float, self._aircraft.belief.pos_ned_m)
        frame = self._flight.frame
        if not (math.isnan(lat_deg) or math.isnan(lon_deg)):
            if not (lat_deg in ranges.LATITUDE and lon_deg in ranges.LONGITUDE):
                raise RefusedError(f"no such place: {lat_deg:g}, {lon_deg:g}")
            north, east, _ = map(float, frame.to_ned(lat_deg, lon_deg, frame.origin.alt_msl_m))
        if not math.isnan(z):
            # Above mean sea level in every frame, as PX4 has it: MAVSDK names a relative one.
            demand_within("altitude", z, ranges.ALTITUDE)
            down = frame.origin.alt_msl_m - z
        # The sign of the radius is the direction; a speed that would press too hard is lowered.
        flown_mps = min(abs(speed), fastest(abs(radius)))
        speed_mps = math.copysign(flown_mps, radius * (speed or 1.0))
        return Orbit((north, east, down), abs(radius), speed_mps, int(yaw))

    def _fly(self, orbit: Orbit) -> do.Manoeuvre:
        def parts() -> Iterator[do.Manoeuvre]:
            here = self._flight.navigator.here(resting=False)
            north, east, _ = orbit.center_ned_m
            phase = math.atan2(here[1] - east, here[0] - north)
            yield self._flight.navigator.go_to(
                here, orbit.point(phase), speed_mps=None, yaw_rad=None
            )
            yield do.Circle(self._aircraft, orbit, phase_rad=phase)

        return do.Sequence(parts())
