"""What ground stations order the aircraft to do: commands turned into orders to the flight."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.frames import yaw_of
from flightdyn.state import GeodeticPoint
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.route import turn_of
from sitl.autopilot.modes import Mode, mode_of_custom
from sitl.autopilot.protocol.commands import Answer, Handler, Refusal
from sitl.autopilot.values import messages as m
from sitl.autopilot.values import ranges
from sitl.autopilot.values.enums import GLOBAL_FRAMES, RELATIVE_FRAMES, Command, Result

_MODES = ranges.Range(0, 255, "")
_FORCE = 21196.0  # the magic number of forced disarming


def _rejected(reason: str | None) -> Answer:
    return None if reason is None else Refusal(Result.TEMPORARILY_REJECTED, reason)


class FlightCommands:
    """Handlers of the commands that arm, fly and land."""

    def __init__(
        self,
        aircraft: Aircraft,
        flight: Flight,
        *,
        pilots: Mapping[Mode, Callable[[], str | None]],
    ) -> None:
        """`pilots`: what enters the modes that somebody outside flies."""
        self._aircraft = aircraft
        self._flight = flight
        self._pilots = pilots

    def handlers(self) -> Mapping[Command, Handler]:
        """Who answers which command."""
        flight = self._flight
        return {
            Command.COMPONENT_ARM_DISARM: self._arm,
            Command.NAV_TAKEOFF: self._take_off,
            Command.NAV_LAND: lambda *_: _rejected(flight.land()),
            Command.NAV_RETURN_TO_LAUNCH: lambda *_: _rejected(flight.return_home()),
            Command.NAV_LOITER_UNLIM: lambda *_: _rejected(flight.hold()),
            Command.DO_REPOSITION: self._reposition,
            Command.DO_CHANGE_ALTITUDE: self._change_altitude,
            Command.DO_SET_ROI_LOCATION: self._look_at,
            Command.DO_SET_ROI_NONE: lambda *_: self._look_ahead(),
            Command.DO_SET_ROI: self._look_at_or_ahead,
            Command.DO_CHANGE_SPEED: self._change_speed,
            Command.CONDITION_YAW: self._turn,
            Command.DO_SET_MODE: self._set_mode,
            Command.MISSION_START: self._start_mission,
            Command.DO_PAUSE_CONTINUE: self._pause,
            Command.DO_SET_MISSION_CURRENT: self._set_current,
            Command.DO_SET_HOME: self._set_home,
            Command.DO_FLIGHTTERMINATION: self._terminate,
        }

    def set_mode(self, custom_mode: int) -> Answer:
        """Change to a PX4 mode."""
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
            return Refusal(Result.UNSUPPORTED, f"no such mode; there are {names}")
        return _rejected(order())

    # --- motors and flight ----------------------------------------------------------------------

    def _arm(self, order: m.CommandOrder, _now: float) -> Answer:
        wanted, force = order.params[0], order.params[1] == _FORCE
        if wanted not in (0.0, 1.0):
            return Refusal(Result.DENIED, f"parameter 1 = {wanted:g}: 0 disarms, 1 arms")
        if wanted == 1.0:
            return _rejected(self._flight.arm())
        return _rejected(self._flight.disarm(force=force))

    def _take_off(self, order: m.CommandOrder, _now: float) -> Answer:
        altitude = order.params[6]
        if not math.isfinite(altitude):
            return _rejected(self._flight.take_off(None))
        if order.frame in RELATIVE_FRAMES:
            altitude += self._flight.home.alt_msl_m
        if altitude not in ranges.ALTITUDE:
            return Refusal(Result.DENIED, f"altitude {altitude:g} m: {ranges.ALTITUDE}")
        return _rejected(self._flight.take_off(altitude))

    def _reposition(self, order: m.CommandOrder, _now: float) -> Answer:
        speed, _, _, yaw, lat_deg, lon_deg, z = order.params
        if order.frame is not None and order.frame not in GLOBAL_FRAMES:
            return Refusal(Result.DENIED, f"frame {order.frame} is not a global one")
        belief = self._aircraft.belief
        here = self._aircraft.frame.to_geodetic(np.asarray(belief.pos_ned_m))
        point = self._point(order, lat_deg, lon_deg, z, here=here)
        if isinstance(point, Refusal):
            return point
        if speed > 0 and speed not in ranges.SPEED:
            return Refusal(Result.DENIED, f"speed {speed:g} m/s: {ranges.SPEED}")
        if math.isfinite(yaw) and math.degrees(yaw) not in ranges.TURN:
            return Refusal(Result.DENIED, f"heading {yaw:g} rad")
        goal = self._aircraft.frame.to_ned(point.lat_deg, point.lon_deg, point.alt_msl_m)
        reason = self._flight.go_to(goal, yaw_rad=yaw if math.isfinite(yaw) else None)
        if reason is None and speed > 0:
            self._flight.change_speed(speed)
        return _rejected(reason)

    def _change_altitude(self, order: m.CommandOrder, _now: float) -> Answer:
        altitude, frame = order.params[:2]
        if frame not in GLOBAL_FRAMES:
            return Refusal(Result.DENIED, f"frame {frame:g} is not a global one")
        if frame in RELATIVE_FRAMES:
            altitude += self._flight.home.alt_msl_m
        if altitude not in ranges.ALTITUDE:
            return Refusal(Result.DENIED, f"altitude {altitude:g} m: {ranges.ALTITUDE}")
        north, east, _ = map(float, self._flight.here())
        down = self._flight.frame.origin.alt_msl_m - altitude
        return _rejected(self._flight.go_to(np.array([north, east, down])))

    def _look_at(self, order: m.CommandOrder, _now: float) -> Answer:
        lat_deg, lon_deg, z = order.params[4:]
        point = self._point(order, lat_deg, lon_deg, z, here=None)
        if isinstance(point, Refusal):
            return point
        place = self._aircraft.frame.to_ned(point.lat_deg, point.lon_deg, point.alt_msl_m)
        self._aircraft.look_at(place)
        return None

    def _look_ahead(self) -> Answer:
        self._aircraft.look_at(None)
        return None

    def _look_at_or_ahead(self, order: m.CommandOrder, now: float) -> Answer:
        match order.params[0]:
            case 0.0:
                return self._look_ahead()
            case 3.0:
                return self._look_at(order, now)
            case mode:
                return Refusal(Result.UNSUPPORTED, f"mode {mode:g}: 0 nothing, 3 a place")

    def _change_speed(self, order: m.CommandOrder, _now: float) -> Answer:
        kind, speed = order.params[0], order.params[1]
        if kind not in (0.0, 1.0):
            return Refusal(Result.DENIED, f"speed type {kind:g}: only horizontal speeds (0, 1)")
        if speed == -2.0:
            self._flight.change_speed(None)
        elif speed in ranges.SPEED:
            self._flight.change_speed(speed)
        elif speed != -1.0:
            return Refusal(Result.DENIED, f"speed {speed:g} m/s: {ranges.SPEED}")
        return None

    def _turn(self, order: m.CommandOrder, _now: float) -> Answer:
        angle_deg = order.params[0]
        if angle_deg not in ranges.TURN:
            return Refusal(Result.DENIED, f"angle {angle_deg:g} deg: {ranges.TURN}")
        yaw_rad, relative = turn_of(order.params)
        now_rad = yaw_of(self._aircraft.belief.q_frd_to_ned) if relative else 0.0
        return _rejected(self._flight.turn_to(now_rad + yaw_rad))

    def _set_mode(self, order: m.CommandOrder, _now: float) -> Answer:
        base, main, sub = order.params[:3]
        if not (math.isfinite(base) and int(base) & 1):
            return Refusal(Result.UNSUPPORTED, "only custom modes")
        if not (main in _MODES and sub in _MODES):
            return Refusal(Result.UNSUPPORTED, "no such mode")
        return self.set_mode(int(main) << 16 | int(sub) << 24)

    def _terminate(self, order: m.CommandOrder, _now: float) -> Answer:
        if not order.params[0] > 0.5:
            return Refusal(Result.DENIED, "termination cannot be undone")
        return _rejected(self._flight.terminate())

    # --- mission --------------------------------------------------------------------------------

    def _start_mission(self, order: m.CommandOrder, _now: float) -> Answer:
        first = order.params[0]
        if first > 0:
            if first not in ranges.ITEM:
                return Refusal(Result.DENIED, f"no item {first:g}")
            reason = self._flight.rewind_mission(int(first))
            if reason is not None:
                return Refusal(Result.DENIED, reason)
        return _rejected(self._flight.fly_mission())

    def _pause(self, order: m.CommandOrder, _now: float) -> Answer:
        if order.params[0] == 0.0:
            return _rejected(self._flight.hold())
        if order.params[0] == 1.0:
            return _rejected(self._flight.fly_mission())
        return Refusal(Result.DENIED, f"parameter 1 = {order.params[0]:g}: 0 pauses, 1 continues")

    def _set_current(self, order: m.CommandOrder, _now: float) -> Answer:
        seq = order.params[0]
        if seq == -1.0 or not math.isfinite(seq):
            seq = float(self._flight.mission.current)
        if seq not in ranges.ITEM:
            return Refusal(Result.DENIED, f"no item {seq:g}")
        reason = self._flight.rewind_mission(int(seq))
        return None if reason is None else Refusal(Result.DENIED, reason)

    def _set_home(self, order: m.CommandOrder, _now: float) -> Answer:
        use_current, *_, lat_deg, lon_deg, z = order.params
        here = self._aircraft.frame.to_geodetic(np.asarray(self._aircraft.belief.pos_ned_m))
        if use_current == 1.0:
            self._flight.set_home(here)
            return None
        point = self._point(order, lat_deg, lon_deg, z, here=None)
        if isinstance(point, Refusal):
            return point
        self._flight.set_home(point)
        return None

    def _point(
        self,
        order: m.CommandOrder,
        lat_deg: float,
        lon_deg: float,
        z: float,
        *,
        here: GeodeticPoint | None,
    ) -> GeodeticPoint | Refusal:
        """The position a command names; what is left open (NaN) is taken from `here`."""
        if here is not None:
            lat_deg = here.lat_deg if math.isnan(lat_deg) else lat_deg
            lon_deg = here.lon_deg if math.isnan(lon_deg) else lon_deg
        if here is not None and math.isnan(z):
            z = here.alt_msl_m
        elif order.frame in RELATIVE_FRAMES:
            z += self._flight.home.alt_msl_m
        known = lat_deg in ranges.LATITUDE and lon_deg in ranges.LONGITUDE
        if not (known and z in ranges.ALTITUDE):
            return Refusal(Result.DENIED, f"no such position: {lat_deg:g}, {lon_deg:g}, {z:g}")
        far = self._flight.navigator.too_far(self._aircraft.frame.to_ned(lat_deg, lon_deg, z))
        return Refusal(Result.DENIED, far) if far else GeodeticPoint(lat_deg, lon_deg, z)
