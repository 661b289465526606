"""Flying round a place: MAV_CMD_DO_ORBIT, with PX4's limits."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.frames import yaw_of
from flightdyn.guidance.pursuit import Target
from flightdyn.state import Vector
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.modes import Mode, Trigger
from sitl.autopilot.protocol.commands import Answer, Refusal
from sitl.autopilot.values import ranges
from sitl.autopilot.values.enums import GLOBAL_FRAMES, OrbitYaw, Result
from sitl.autopilot.values.messages import CommandOrder

_DEFAULT_RADIUS_M, _DEFAULT_SPEED_MPS = 10.0, 2.0
_INWARDS_MPS2 = 2.0  # greatest centripetal acceleration
_LOOKS = 16  # points of the circle that the fence is asked about


@dataclass(frozen=True, slots=True)
class Orbit:
    """A circle being flown, positive speed clockwise seen from above."""

    center_ned_m: tuple[float, float, float]
    radius_m: float
    speed_mps: float
    yaw: OrbitYaw

    def point(self, phase_rad: float) -> Vector:
        """On the circle, in the direction `phase_rad` from its middle."""
        north, east, down = self.center_ned_m
        r = self.radius_m
        return np.array([north + r * math.cos(phase_rad), east + r * math.sin(phase_rad), down])


class Circle(do.Manoeuvre):
    """The manoeuvre: round and round, from the point at `phase_rad` on."""

    def __init__(self, aircraft: Aircraft, orbit: Orbit, *, phase_rad: float) -> None:
        self._aircraft = aircraft
        self._orbit = orbit
        self._phase = phase_rad
        self._heading = yaw_of(aircraft.belief.q_frd_to_ned)
        self._t_ns = aircraft.t_ns

    def tick(self) -> bool:
        passed_s = (self._aircraft.t_ns - self._t_ns) * 1e-9
        self._t_ns = self._aircraft.t_ns
        self._phase += self._orbit.speed_mps / self._orbit.radius_m * passed_s
        self._aircraft.pursue(self._target())
        return False

    def _target(self) -> Target:
        orbit = self._orbit
        c, s = math.cos(self._phase), math.sin(self._phase)
        north, east, down = map(float, orbit.point(self._phase))
        v, inwards = orbit.speed_mps, orbit.speed_mps**2 / orbit.radius_m
        return Target(
            pos=(north, east, down),
            vel=(-v * s, v * c, 0.0),
            acc=(-inwards * c, -inwards * s, 0.0),
            yaw=self._yaw(),
        )

    def _yaw(self) -> float:
        match self._orbit.yaw:
            case OrbitYaw.FRONT_TO_CENTER:
                return self._phase + math.pi
            case OrbitYaw.INITIAL_HEADING:
                return self._heading
            case OrbitYaw.TANGENT:
                return self._phase + math.copysign(math.pi / 2, self._orbit.speed_mps)
            case _:
                return math.nan


class Orbits:
    """Carries out DO_ORBIT; `current` is the circle being flown."""

    def __init__(self, aircraft: Aircraft, flight: Flight) -> None:
        self._aircraft = aircraft
        self._flight = flight
        self._orbit: Orbit | None = None

    @property
    def current(self) -> Orbit | None:
        """The circle being flown."""
        return self._orbit if self._flight.mode is Mode.ORBIT else None

    def command(self, order: CommandOrder, _now: float) -> Answer:
        """Fly round a place, or round another one."""
        orbit = self._asked(order)
        if isinstance(orbit, Refusal):
            return orbit
        if far := self._flight.navigator.too_far(np.array(orbit.center_ned_m)):
            return Refusal(Result.DENIED, f"the orbit is {far}")
        circle = np.array([orbit.point(math.tau * i / _LOOKS) for i in range(_LOOKS)])
        if forbidden := self._flight.forbidden(circle):
            return Refusal(Result.DENIED, f"the orbit leads {forbidden}")
        if orbit == self.current:
            return None
        reason = self._flight.order(Trigger.ORDER_ORBIT, lambda: self._fly(orbit))
        if reason is not None:
            return Refusal(Result.TEMPORARILY_REJECTED, reason)
        self._orbit = orbit
        return None

    def _asked(self, order: CommandOrder) -> Orbit | Refusal:
        radius, speed, yaw, _, lat_deg, lon_deg, z = order.params
        if order.frame is not None and order.frame not in GLOBAL_FRAMES:
            return Refusal(Result.DENIED, f"frame {order.frame} is not a global one")
        radius = _DEFAULT_RADIUS_M if math.isnan(radius) else radius
        speed = _DEFAULT_SPEED_MPS if math.isnan(speed) else speed
        if abs(radius) not in ranges.ORBIT_RADIUS:
            return Refusal(Result.DENIED, f"radius {radius:g} m: {ranges.ORBIT_RADIUS}")
        if abs(speed) not in ranges.ORBIT_SPEED:
            return Refusal(Result.DENIED, f"speed {speed:g} m/s: {ranges.ORBIT_SPEED}")
        if not (math.isnan(yaw) or yaw in OrbitYaw.__members__.values()):
            return Refusal(Result.DENIED, f"yaw behaviour {yaw:g}, 0 to 5 are allowed")
        here = self._aircraft.belief.pos_ned_m
        center = [float(here[0]), float(here[1]), float(here[2])]
        frame = self._flight.frame
        if not (math.isnan(lat_deg) or math.isnan(lon_deg)):
            if not (lat_deg in ranges.LATITUDE and lon_deg in ranges.LONGITUDE):
                return Refusal(Result.DENIED, f"no such place: {lat_deg:g}, {lon_deg:g}")
            center[:2] = map(float, frame.to_ned(lat_deg, lon_deg, frame.origin.alt_msl_m)[:2])
        if not (math.isnan(z) or z in ranges.ALTITUDE):
            return Refusal(Result.DENIED, f"altitude {z:g} m: {ranges.ALTITUDE}")
        if not math.isnan(z):
            # Above mean sea level in every frame, as PX4 has it: MAVSDK names a relative one.
            center[2] = frame.origin.alt_msl_m - z
        # The sign of the radius is the direction; a speed that would press too hard is lowered.
        fastest = math.sqrt(_INWARDS_MPS2 * abs(radius))
        return Orbit(
            (center[0], center[1], center[2]),
            abs(radius),
            math.copysign(min(abs(speed), fastest), radius * (speed or 1.0)),
            OrbitYaw.FRONT_TO_CENTER if math.isnan(yaw) else OrbitYaw(int(yaw)),
        )

    def _fly(self, orbit: Orbit) -> do.Manoeuvre:
        def parts() -> Iterator[do.Manoeuvre]:
            here = self._flight.navigator.here(resting=False)
            north, east, _ = orbit.center_ned_m
            phase = math.atan2(here[1] - east, here[0] - north)
            yield self._flight.navigator.go_to(
                here, orbit.point(phase), speed_mps=None, yaw_rad=None
            )
            yield Circle(self._aircraft, orbit, phase_rad=phase)

        return do.Sequence(parts())
