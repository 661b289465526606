"""Navigation: manoeuvres such as go-to, return and landing, from parameters and positions."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import wrap_pi, yaw_of
from flightdyn.guidance.path import FlightPath
from flightdyn.state import Vector
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying import route
from sitl.autopilot.flying.mission import Mission
from sitl.autopilot.guard import Guard
from sitl.autopilot.parameters import Parameters

_SAME_PLACE_M = 2.0  # the guidance's own reference is as good as the estimate within this
_UNSURE = 3.0  # times the height from which the landing speed rules, without GNSS


class SpeedLimits(NamedTuple):
    """The greatest horizontal, climb and descent speed that a pilot may order."""

    speed_mps: float
    climb_mps: float
    descent_mps: float


class Navigator:
    """Makes manoeuvres of one aircraft. A manoeuvre starts when it is made."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters, guard: Guard) -> None:
        self._aircraft = aircraft
        self._guard = guard
        self._parameters = parameters

    @property
    def speed_limits(self) -> SpeedLimits:
        """The limits that the parameters set."""
        p = self._parameters
        return SpeedLimits(p["MPC_XY_VEL_MAX"], p["MPC_Z_VEL_MAX_UP"], p["MPC_Z_VEL_MAX_DN"])

    def here(self, *, resting: bool) -> Vector:
        """Return where new paths begin, (3,) NED: the point held, or the estimated position."""
        belief = np.asarray(self._aircraft.belief.pos_ned_m)
        held = self._aircraft.cmd_pos_ned_m
        if held is None or not resting or self._aircraft.on_ground:
            return np.array(belief)
        near = float(np.linalg.norm(held - belief)) < _SAME_PLACE_M
        return np.array(held if near else belief)

    def too_far(self, pos_ned_m: Vector, home_ned_m: Vector | None = None) -> str:
        """Why a place is too far away to be flown to, in words; empty if it is not.

        `home_ned_m`: where home will be, if not where it is.
        """
        home = self._guard.home_ned_m if home_ned_m is None else home_ned_m
        return route.too_far(pos_ned_m, home, farthest_m=self._parameters["MIS_DIST_1WP"])

    def trouble(self, items: Sequence[MissionItem]) -> str:
        """Why a mission cannot be flown, or rally points not be landed at; empty if they can."""
        frame, home = self._aircraft.frame, self._guard.home
        farthest_m = self._parameters["MIS_DIST_1WP"]
        return route.check_mission(items, frame=frame, home=home, farthest_m=farthest_m)

    def climb(
        self, start: Vector, goal: Vector, *, speed_mps: float | None, yaw_rad: float
    ) -> do.Manoeuvre:
        """A climb straight up to the height of a place, then the way there; with a heading
        (NaN: as it is, then along the course)."""
        up = np.array([start[0], start[1], goal[2]])

        def parts() -> Iterator[do.Manoeuvre]:
            path = self._path([start, up], self._parameters["MPC_TKO_SPEED"])
            yield self._facing(yaw_rad, do.Climb(self._aircraft, path))
            if tuple(goal) != tuple(up):
                yield self._facing(yaw_rad, self._follow([up, goal], self._speed(speed_mps)))

        return do.Sequence(parts())

    def _facing(self, yaw_rad: float, manoeuvre: do.Manoeuvre) -> do.Manoeuvre:
        """A manoeuvre along a path that has begun, with a heading in place of a place to look at;
        NaN: with its own."""
        if not math.isnan(yaw_rad):
            self._aircraft.look_at(None)
            self._aircraft.face(yaw_rad)
        return manoeuvre

    def stop(self, yaw_rad: float = math.nan) -> do.Manoeuvre:
        """Brake, and hold where the aircraft comes to rest; then turn to a heading, if given."""
        stop = do.Brake(self._aircraft, deceleration_mps2=self._parameters["MPC_ACC_HOR"])
        return stop if math.isnan(yaw_rad) else self._turned(stop, yaw_rad)

    def _turned(self, first: do.Manoeuvre, yaw_rad: float) -> do.Manoeuvre:
        def parts() -> Iterator[do.Manoeuvre]:
            yield first
            yield self.turn(self.here(resting=True), yaw_rad)

        return do.Sequence(parts())

    def turn(self, place: Vector, yaw_rad: float) -> do.Manoeuvre:
        """A turn on the spot to a heading, the shorter way."""
        by_rad = wrap_pi(yaw_rad - self._heading_rad)
        return do.Turn(self._aircraft, pos_ned_m=place, by_rad=by_rad)

    def turn_by(self, place: Vector, params: Sequence[float]) -> do.Manoeuvre:
        """A turn on the spot as the parameters of a CONDITION_YAW ask for."""
        by_rad, rate_radps = route.turn_of(params, self._heading_rad)
        return do.Turn(self._aircraft, pos_ned_m=place, by_rad=by_rad, rate_radps=rate_radps)

    @property
    def _heading_rad(self) -> float:
        return yaw_of(self._aircraft.belief.q_frd_to_ned)

    def go_to(
        self, start: Vector, goal: Vector, *, speed_mps: float | None, yaw_rad: float = math.nan
    ) -> do.Manoeuvre:
        """Fly straight to a position (NED, m), then turn to a heading, if one is given."""
        way = self._follow([start, goal], self._speed(speed_mps))
        return way if math.isnan(yaw_rad) else self._turned(way, yaw_rad)

    def return_to(self, start: Vector, goal: Vector, *, speed_mps: float | None) -> do.Manoeuvre:
        """Climb to the return height, or the goal's own if that is higher, and fly above the goal.

        It does not climb if the goal is nearer than RTL_MIN_DIST.
        """
        p = self._parameters
        far = float(np.hypot(*(start - goal)[:2])) > p["RTL_MIN_DIST"]
        ceiling = min(float(goal[2]), self._home_down_m() - p["RTL_RETURN_ALT"])
        down = min(float(start[2]), ceiling) if far else float(start[2])
        above_start = np.array([start[0], start[1], down])
        above_goal = np.array([goal[0], goal[1], down])
        return self._follow([start, above_start, above_goal], self._speed(speed_mps))

    def refuge(self, here: Vector, rally: Sequence[MissionItem]) -> tuple[str, Vector]:
        """Choose where a return leads (name, NED in m): home, or a rally point that is closer.

        Rally points that the fence forbids do not count; home always does.
        """
        name, goal = "home", self._guard.home_ned_m
        for item in rally:
            place = route.place_of(item, self._aircraft.frame, self._guard.home)
            closer = np.hypot(*(here - place)[:2]) < np.hypot(*(here - goal)[:2])
            if closer and not self._guard.forbidden(place):
                name, goal = f"rally point {item.seq}", place
        return name, goal

    def land_at(
        self, start: Vector, goal: Vector, *, speed_mps: float | None, yaw_rad: float
    ) -> do.Manoeuvre:
        """Fly above a place, not lower than that, and land there with a heading (NaN: any)."""
        above = np.array([goal[0], goal[1], min(start[2], goal[2])])

        def parts() -> Iterator[do.Manoeuvre]:
            if tuple(above) != tuple(start):
                yield self._facing(yaw_rad, self._follow([start, above], self._speed(speed_mps)))
            yield self.land(above, heading_rad=yaw_rad)

        return do.Sequence(parts())

    def land(
        self, start: Vector, *, sure: bool = True, heading_rad: float = math.nan
    ) -> do.Manoeuvre:
        """Land straight below; if the position is not `sure`, slower and without keeping it."""
        p = self._parameters
        terms = do.LandingTerms(
            ground_down_m=self._home_down_m(),
            descent_mps=p["MPC_Z_VEL_MAX_DN"],
            landing_mps=p["MPC_LAND_SPEED"] * (1.0 if sure else 0.7),
            landing_height_m=p["MPC_LAND_ALT2"] * (1.0 if sure else _UNSURE),
            settle_s=p["COM_DISARM_LAND"],
        )
        if sure:
            landing = do.Descend(self._aircraft, terms, start_ned_m=start)
            return self._facing(heading_rad, landing)
        return do.DescendUnsure(self._aircraft, terms)

    def stages(
        self, mission: Mission, start: Vector, speed_mps: float | None
    ) -> tuple[route.Stage, ...]:
        """Compile the stages of the mission from the item at which it would start."""
        first, jumps_left, item_speed = mission.next_start
        return route.compile_route(
            mission.flown,
            self._parameters,
            frame=self._aircraft.frame,
            home=self._guard.home,
            start=start,
            on_ground=self._aircraft.on_ground,
            speed_mps=item_speed if speed_mps is None else speed_mps,
            first=first,
            jumps_left=jumps_left,
        )

    def fly(
        self,
        stages: Sequence[route.Stage],
        *,
        reached: Callable[[int], None],
        ended: Callable[[int], None],
    ) -> do.Manoeuvre:
        """Fly the stages; call `reached(seq)` at each item, `ended(command)` at the end item."""

        def tell(flown: route.Fly, point: int) -> None:
            for seq in flown.reached[point]:
                reached(seq)
            if point < len(flown.headings_rad):
                self._aircraft.face(flown.headings_rad[point])

        def parts() -> Iterator[do.Manoeuvre]:
            for stage in stages:
                match stage:
                    case route.Fly(path):
                        yield do.Follow(self._aircraft, path, passed=partial(tell, stage))
                    case route.Wait(duration_s, seq):
                        if duration_s > 0:
                            if self._aircraft.on_ground:  # which is no height to hover at
                                self._aircraft.idle()
                            yield do.pause(self._aircraft, duration_s)
                        reached(seq)
                    case route.Circle(orbit, phase_rad, seq):
                        yield do.Circle(self._aircraft, orbit, phase_rad=phase_rad)
                        reached(seq)
                    case route.Turn(params, seq):
                        yield self.turn_by(self.here(resting=True), params)
                        reached(seq)
                    case route.End(command, seq, heading_rad):
                        if command == mav.MAV_CMD_NAV_LAND:
                            yield self.land(self.here(resting=True), heading_rad=heading_rad)
                        if command != mav.MAV_CMD_NAV_LOITER_UNLIM:
                            reached(seq)
                        ended(command)
                        return

        return do.Sequence(parts())

    def _home_down_m(self) -> float:
        return float(self._guard.home_ned_m[2])

    def _speed(self, ordered_mps: float | None) -> float:
        return self._parameters["MPC_XY_CRUISE"] if ordered_mps is None else ordered_mps

    def _follow(self, points: Sequence[Vector], speed_mps: float) -> do.Manoeuvre:
        return do.Follow(self._aircraft, self._path(points, speed_mps))

    def _path(self, points: Sequence[Vector], speed_mps: float) -> FlightPath:
        speeds = [route.leg_speed(a, b, speed_mps, self._parameters) for a, b in pairwise(points)]
        radii = np.full(len(points), self._parameters["NAV_ACC_RAD"])
        return FlightPath(np.array(points), np.array(speeds), radii)
