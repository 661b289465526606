"""What ground stations order the aircraft to do: commands turned into orders to the flight."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import yaw_of
from flightdyn.state import GeodeticPoint
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, RELATIVE_FRAMES, CommandOrder
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.route import turn_of
from sitl.autopilot.modes import Mode, mode_of_custom
from sitl.autopilot.protocol.commands import (
    Commands,
    RefusedError,
    UnsupportedError,
    demand,
    demand_global,
    demand_within,
)

_MODES = ranges.Range(0, 255, "")
_FORCE = 21196.0  # the magic number of forced disarming


class FlightCommands:
    """Handlers of the commands that arm, fly and land."""

    def __init__(
        self,
        aircraft: Aircraft,
        flight: Flight,
        *,
        pilots: Mapping[Mode, Callable[[], str | None]],
    ) -> None:
        """`pilots`: functions that enter the modes flown from outside, and return why if not."""
        self._aircraft = aircraft
        self._flight = flight
        self._pilots = pilots

    def commands(self) -> Commands:
        """The handler of each MAV_CMD that is carried out."""
        flight = self._flight
        return {
            mav.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mav.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mav.MAV_CMD_NAV_LAND: lambda _: demand(flight.land()),
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: demand(flight.return_home()),
            mav.MAV_CMD_NAV_LOITER_UNLIM: lambda _: demand(flight.hold()),
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_DO_CHANGE_ALTITUDE: self._change_altitude,
            mav.MAV_CMD_DO_SET_ROI_LOCATION: self._look_at,
            mav.MAV_CMD_DO_SET_ROI_NONE: lambda _: self._aircraft.look_at(None),
            mav.MAV_CMD_DO_SET_ROI: self._look_at_or_ahead,
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_CONDITION_YAW: self._turn,
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_MISSION_START: self._start_mission,
            mav.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
            mav.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_current,
            mav.MAV_CMD_DO_SET_HOME: self._set_home,
            mav.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
        }

    def set_mode(self, custom_mode: int) -> None:
        """Change to the mode with this PX4 number; raise RefusedError if that is not possible."""
        flight = self._flight
        orders: dict[Mode, Callable[[], str | None]] = {
            Mode.HOLD: flight.hold,
            Mode.TAKEOFF: lambda: flight.take_off(None),
            Mode.MISSION: flight.fly_mission,
            Mode.RETURN: flight.return_home,
            Mode.LAND: flight.land,
            **self._pilots,
        }
        mode = mode_of_custom(custom_mode)
        order = None if mode is None else orders.get(mode)
        if order is None:
            names = ", ".join(mode.name for mode in orders)
            raise UnsupportedError(f"no such mode; there are {names}")
        demand(order())

    # --- motors and flight ----------------------------------------------------------------------

    def _arm(self, order: CommandOrder) -> None:
        match order.params[0]:
            case 1.0:
                demand(self._flight.arm())
            case 0.0:
                demand(self._flight.disarm(force=order.params[1] == _FORCE))
            case wanted:
                raise RefusedError(f"parameter 1 = {wanted:g}: 0 disarms, 1 arms")

    def _take_off(self, order: CommandOrder) -> None:
        z = order.params[6]
        altitude = self._altitude(z, order.frame) if math.isfinite(z) else None
        demand(self._flight.take_off(altitude))

    def _reposition(self, order: CommandOrder) -> None:
        speed, _, _, yaw, *_ = order.params
        demand_global(order)
        place = self._place(order, here=self._here())
        if speed > 0:
            demand_within("speed", speed, ranges.SPEED)
        if math.isfinite(yaw):
            demand_within("heading", math.degrees(yaw), ranges.TURN)
        goal = self._aircraft.frame.to_ned(place.lat_deg, place.lon_deg, place.alt_msl_m)
        demand(self._flight.go_to(goal, yaw_rad=yaw if math.isfinite(yaw) else None))
        if speed > 0:
            self._flight.change_speed(speed)

    def _change_altitude(self, order: CommandOrder) -> None:
        altitude, frame = order.params[:2]
        if frame not in GLOBAL_FRAMES:
            raise RefusedError(f"frame {frame:g} is not a global one")
        north, east, _ = map(float, self._flight.here())
        down = self._flight.frame.origin.alt_msl_m - self._altitude(altitude, frame)
        demand(self._flight.go_to(np.array([north, east, down])))

    def _look_at(self, order: CommandOrder) -> None:
        place = self._place(order)
        self._aircraft.look_at(
            self._aircraft.frame.to_ned(place.lat_deg, place.lon_deg, place.alt_msl_m)
        )

    def _look_at_or_ahead(self, order: CommandOrder) -> None:
        match order.params[0]:
            case 0.0:
                self._aircraft.look_at(None)
            case 3.0:
                self._look_at(order)
            case mode:
                raise UnsupportedError(f"mode {mode:g}: 0 nothing, 3 a place")

    def _change_speed(self, order: CommandOrder) -> None:
        kind, speed = order.params[:2]
        if kind not in (0.0, 1.0):
            raise RefusedError(f"speed type {kind:g}: only horizontal speeds (0, 1)")
        if speed == -2.0:
            self._flight.change_speed(None)
        elif speed != -1.0:
            demand_within("speed", speed, ranges.SPEED)
            self._flight.change_speed(speed)

    def _turn(self, order: CommandOrder) -> None:
        demand_within("angle", order.params[0], ranges.TURN)
        yaw_rad, relative = turn_of(order.params)
        now_rad = yaw_of(self._aircraft.belief.q_frd_to_ned) if relative else 0.0
        demand(self._flight.turn_to(now_rad + yaw_rad))

    def _set_mode(self, order: CommandOrder) -> None:
        base, main, sub = order.params[:3]
        if not (math.isfinite(base) and int(base) & 1):
            raise UnsupportedError("only custom modes")
        if not (main in _MODES and sub in _MODES):
            raise UnsupportedError("no such mode")
        self.set_mode(int(main) << 16 | int(sub) << 24)

    def _terminate(self, order: CommandOrder) -> None:
        if not order.params[0] > 0.5:
            raise RefusedError("termination cannot be undone")
        demand(self._flight.terminate())

    # --- mission --------------------------------------------------------------------------------

    def _start_mission(self, order: CommandOrder) -> None:
        if order.params[0] > 0:
            self._rewind(order.params[0])
        demand(self._flight.fly_mission())

    def _pause(self, order: CommandOrder) -> None:
        match order.params[0]:
            case 0.0:
                demand(self._flight.hold())
            case 1.0:
                demand(self._flight.fly_mission())
            case wanted:
                raise RefusedError(f"parameter 1 = {wanted:g}: 0 pauses, 1 continues")

    def _set_current(self, order: CommandOrder) -> None:
        seq = order.params[0]
        self._rewind(seq if math.isfinite(seq) and seq != -1.0 else self._flight.mission.current)

    def _rewind(self, seq: float) -> None:
        demand_within("item", seq, ranges.ITEM)
        if reason := self._flight.rewind_mission(int(seq)):
            raise RefusedError(reason)

    def _set_home(self, order: CommandOrder) -> None:
        here = order.params[0] == 1.0
        self._flight.set_home(self._here() if here else self._place(order))

    def _here(self) -> GeodeticPoint:
        return self._aircraft.frame.to_geodetic(np.asarray(self._aircraft.belief.pos_ned_m))

    def _altitude(self, z: float, frame: float | None) -> float:
        """Altitude above mean sea level (m) of a height `z` in a MAVLink `frame`."""
        altitude = z + (self._flight.guard.home.alt_msl_m if frame in RELATIVE_FRAMES else 0.0)
        demand_within("altitude", altitude, ranges.ALTITUDE)
        return altitude

    def _place(self, order: CommandOrder, here: GeodeticPoint | None = None) -> GeodeticPoint:
        """The position a command names; what is left open (NaN) is taken from `here`."""
        lat_deg, lon_deg, z = order.params[4:]
        if here is not None:
            lat_deg = here.lat_deg if math.isnan(lat_deg) else lat_deg
            lon_deg = here.lon_deg if math.isnan(lon_deg) else lon_deg
        if not (lat_deg in ranges.LATITUDE and lon_deg in ranges.LONGITUDE):
            raise RefusedError(f"no such position: {lat_deg:g}, {lon_deg:g}")
        if here is not None and math.isnan(z):
            altitude = here.alt_msl_m
        else:
            altitude = self._altitude(z, order.frame)
        place = GeodeticPoint(lat_deg, lon_deg, altitude)
        if far := self._flight.navigator.too_far(
            self._aircraft.frame.to_ned(lat_deg, lon_deg, altitude)
        ):
            raise RefusedError(far)
        return place
