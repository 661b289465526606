"""What ground stations order the aircraft to do: commands turned into orders to the flight."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import yaw_of
from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import RELATIVE_FRAMES, CommandOrder
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.modes import PILOTED, Mode, Need, Trigger
from sitl.autopilot.flying.orbit import DEFAULT_RADIUS_M, Orbit, fastest
from sitl.autopilot.protocol.commands import (
    Commands,
    RefusedError,
    UnsupportedError,
    demand,
    demand_within,
)
from sitl.autopilot.protocol.order_rules import FORCE

_MODES = ranges.Range(0, 255, whole=True)
# Flags of DO_REPOSITION.
_CHANGE_MODE, _RELATIVE_YAW, _BOTH = 1.0, 2.0, 3.0
_DEFAULT_SPEED_MPS = 2.0  # on a circle


def mode_of_custom(custom_mode: int) -> Mode | None:
    """The mode that a ground station means, or None where the vehicle has no such mode."""
    by_number = {4 << 16: Mode.MISSION} | {mode.custom_mode: mode for mode in Mode}
    return by_number.get(custom_mode)


def _heading(order: CommandOrder) -> float:
    """The fourth parameter, a heading in degrees, in radians; NaN if it is left open."""
    return math.radians(order.params[3])


class FlightCommands:
    """Handlers of the commands that arm, fly and land."""

    def __init__(
        self, aircraft: Aircraft, flight: Flight, *, pilots: Mapping[Mode, Callable[[], str | None]]
    ) -> None:
        """`pilots`: functions that enter the modes flown from outside, and return why if not."""
        self._aircraft = aircraft
        self._flight = flight
        self._pilots = pilots
        self.commands: Commands = {
            mav.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mav.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mav.MAV_CMD_NAV_LAND: self._land,
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: demand(flight.return_home()),
            mav.MAV_CMD_NAV_LOITER_UNLIM: self._hold,
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_DO_CHANGE_ALTITUDE: self._change_altitude,
            mav.MAV_CMD_DO_SET_ROI_LOCATION: self._look_at,
            mav.MAV_CMD_DO_SET_ROI_NONE: lambda _: aircraft.look_at(None),
            mav.MAV_CMD_DO_SET_ROI: self._look_at_or_ahead,
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_CONDITION_YAW: lambda order: demand(flight.turn(order.params)),
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_MISSION_START: self._start_mission,
            mav.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
            mav.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_current,
            mav.MAV_CMD_DO_SET_HOME: self._set_home,
            mav.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
        }

    def set_mode(self, base_mode: int, custom_mode: int) -> None:
        """Change to the mode with this PX4 number; raise RefusedError if that is not possible."""
        if not base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            raise UnsupportedError("only custom modes")
        flight = self._flight
        orders: dict[Mode, Callable[[], str | None]] = {
            Mode.HOLD: flight.hold,
            Mode.TAKEOFF: flight.take_off,
            Mode.MISSION: flight.fly_mission,
            Mode.RETURN: flight.return_home,
            Mode.LAND: flight.land,
            **self._pilots,
        }
        mode = mode_of_custom(custom_mode)
        order = None if mode is None else orders.get(mode)
        if mode is None or order is None:
            names = ", ".join(mode.name for mode in orders)
            raise UnsupportedError(f"no such mode; there are {names}")
        demand(flight.choose(mode, order))

    # --- motors and flight ----------------------------------------------------------------------

    def _arm(self, order: CommandOrder) -> None:
        if order.params[0] == 1.0:
            demand(self._flight.arm())
        else:
            demand(self._flight.disarm(force=order.params[1] == FORCE))

    def _take_off(self, order: CommandOrder) -> None:
        place, z = self._somewhere(order), order.params[6]
        altitude = self._altitude(z, order.frame) if math.isfinite(z) else None
        yaw_rad = _heading(order)
        order_it = partial(self._flight.take_off, altitude, place_ned_m=place, yaw_rad=yaw_rad)
        demand(self._flight.choose(Mode.TAKEOFF, order_it))

    def _land(self, order: CommandOrder) -> None:
        place = self._somewhere(order)
        demand(self._flight.land(place_ned_m=place, yaw_rad=_heading(order)))

    def _hold(self, order: CommandOrder) -> None:
        place, yaw_rad, z = self._somewhere(order), _heading(order), order.params[6]
        if place is None and math.isfinite(z) and z != 0.0:
            here = replace(self._here(), alt_msl_m=self._altitude(z, order.frame))
            place = self._ned(here)
        if place is None:
            demand(self._flight.hold(yaw_rad=yaw_rad))
        else:
            demand(self._flight.go_to(place, yaw_rad=yaw_rad))

    def _reposition(self, order: CommandOrder) -> None:
        speed, flags, _, yaw_rad, *_ = order.params
        mode = self._flight.mode
        if mode is not Mode.HOLD and flags not in (_CHANGE_MODE, _BOTH):
            raise RefusedError(f"flag 1 of parameter 2 is needed to leave the mode {mode.name}")
        goal = self._ned(self._place(order, here=self._here()))
        if flags in (_RELATIVE_YAW, _BOTH):
            yaw_rad += yaw_of(self._aircraft.belief.q_frd_to_ned)
        demand(self._flight.go_to(goal, yaw_rad=yaw_rad))
        if not math.isnan(speed):
            demand(self._flight.change_speed(speed if speed > 0.0 else None))

    def _change_altitude(self, order: CommandOrder) -> None:
        altitude, frame = order.params[:2]
        north, east, _ = map(float, self._flight.here())
        down = self._flight.frame.origin.alt_msl_m - self._altitude(altitude, frame)
        demand(self._flight.go_to(np.array([north, east, down])))

    def _look_at(self, order: CommandOrder) -> None:
        if (mode := self._flight.mode) in PILOTED:
            raise RefusedError(f"mode {mode.name} has a heading of its own")
        self._aircraft.look_at(self._ned(self._place(order)))

    def _look_at_or_ahead(self, order: CommandOrder) -> None:
        if order.params[0] == 0.0:
            self._aircraft.look_at(None)
        else:
            self._look_at(order)

    def _change_speed(self, order: CommandOrder) -> None:
        speed = order.params[1]
        if speed != -1.0:
            demand(self._flight.change_speed(None if speed == -2.0 else speed))

    def _set_mode(self, order: CommandOrder) -> None:
        base, main, sub = order.params[:3]
        if not all(number in _MODES for number in (base, main, sub)):
            raise UnsupportedError("no such mode")
        self.set_mode(int(base), int(main) << 16 | int(sub) << 24)

    def _terminate(self, order: CommandOrder) -> None:
        if not order.params[0] > 0.5:
            raise RefusedError("termination cannot be undone")
        demand(self._flight.terminate())

    # --- mission --------------------------------------------------------------------------------

    def _start_mission(self, order: CommandOrder) -> None:
        first, last = order.params[:2]
        begin, end = None if math.isnan(first) else int(first), int(last) if last > 0.0 else None
        start = partial(self._flight.start_mission, begin, end)
        demand(start() if self._aircraft.armed else self._flight.arm(start))  # as PX4 does

    def _pause(self, order: CommandOrder) -> None:
        if order.params[0] == 0.0:
            demand(self._flight.hold())
        else:
            demand(self._flight.start_mission(None, self._flight.mission.last))

    def _set_current(self, order: CommandOrder) -> None:
        seq, reset = order.params[:2]
        if math.isnan(seq) or seq == -1.0:
            seq = self._flight.mission.current
        if reason := self._flight.rewind_mission(int(seq), reset=reset == 1.0):
            raise RefusedError(reason)

    def _set_home(self, order: CommandOrder) -> None:
        here = order.params[0] == 1.0
        if here and not (self._aircraft.ready and self._flight.needs[Need.POSITION]()):
            raise RefusedError(Need.POSITION.value, mav.MAV_RESULT_TEMPORARILY_REJECTED)
        self._flight.set_home(self._here() if here else self._place(order, as_home=True))

    def _here(self) -> GeodeticPoint:
        return self._aircraft.frame.to_geodetic(np.asarray(self._aircraft.belief.pos_ned_m))

    def _altitude(self, z: float, frame: float | None) -> float:
        """Altitude above mean sea level (m) of a height `z` in a MAVLink `frame`."""
        altitude = z + (self._flight.guard.home.alt_msl_m if frame in RELATIVE_FRAMES else 0.0)
        demand_within("altitude", altitude, ranges.ALTITUDE)
        return altitude

    def _somewhere(self, order: CommandOrder) -> Vector | None:
        """The place, (3,) NED, that an order names; None where it leaves it open.

        Ground stations leave it open as NaN or as zeros; what else is open is that of the vehicle.
        """
        lat_deg, lon_deg = order.params[4:6]
        if (lat_deg == lon_deg == 0.0) or (math.isnan(lat_deg) and math.isnan(lon_deg)):
            return None
        return self._ned(self._place(order, here=self._here()))

    def _ned(self, place: GeodeticPoint) -> Vector:
        return self._aircraft.frame.to_ned(place.lat_deg, place.lon_deg, place.alt_msl_m)

    def _place(
        self, order: CommandOrder, here: GeodeticPoint | None = None, *, as_home: bool = False
    ) -> GeodeticPoint:
        """The position a command names; what is left open (NaN) is taken from `here`.

        One that home moves to (`as_home`) may be far from where home is now.
        """
        lat_deg, lon_deg, z = order.params[4:]
        if here is not None:
            lat_deg = here.lat_deg if math.isnan(lat_deg) else lat_deg
            lon_deg = here.lon_deg if math.isnan(lon_deg) else lon_deg
        if here is not None and math.isnan(z):
            altitude = here.alt_msl_m
        else:
            altitude = self._altitude(z, order.frame)
        place = GeodeticPoint(lat_deg, lon_deg, altitude)
        there = self._aircraft.frame.to_ned(lat_deg, lon_deg, altitude)
        if far := self._flight.navigator.too_far(there, there if as_home else None):
            raise RefusedError(far)
        return place


class Orbits:
    """Carries out DO_ORBIT; `current` is the circle being flown."""

    def __init__(self, aircraft: Aircraft, flight: Flight) -> None:
        self._aircraft = aircraft
        self._flight = flight
        self._orbit: Orbit | None = None
        self.commands: Commands = {mav.MAV_CMD_DO_ORBIT: self._command}

    @property
    def current(self) -> Orbit | None:
        """The circle being flown, or None."""
        return self._orbit if self._flight.mode is Mode.ORBIT else None

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
            self._aircraft.look_at(None)
            yield self._flight.navigator.go_to(here, orbit.point(phase), speed_mps=None)
            yield do.Circle(self._aircraft, orbit, phase_rad=phase)

        return do.Sequence(parts())
