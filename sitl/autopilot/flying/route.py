"""The mission compiler: turns mission items into the stages that the navigator flies.

Waypoints without hold time are flown through without stopping, so everything between two stops
becomes one path. DO_CHANGE_SPEED rules the legs after it. A pure function of items and start.
"""

import math
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame, wrap_pi
from flightdyn.guidance.path import FlightPath
from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import RELATIVE_FRAMES, MissionItem
from sitl.autopilot.flying.orbit import DEFAULT_RADIUS_M, Orbit, fastest
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.order_rules import PLACES

_JUMPS = frozenset({mav.MAV_CMD_DO_JUMP})
_FLOWN_TO = PLACES | {mav.MAV_CMD_NAV_RALLY_POINT}
_ENDS = frozenset(
    {mav.MAV_CMD_NAV_LAND, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_LOITER_UNLIM}
)
_THERE_RAD = math.radians(0.5)  # that near a heading is the one ordered
MAX_STEPS = 10_000  # items carried out, jumps included
# Items whose fourth parameter is a heading.
_HEADED = PLACES - {mav.MAV_CMD_NAV_LOITER_TO_ALT}
MAX_JUMPS = 100  # items of a mission that jump; ArduPilot's limit, too


@dataclass(frozen=True, slots=True)
class Fly:
    """Fly `path` to its end; `reached[i]` are the items reached when point i is passed.

    `headings_rad[i]` is to be kept from there on; NaN: the nose points along the course.
    """

    path: FlightPath
    reached: tuple[tuple[int, ...], ...]
    headings_rad: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Wait:
    """Hold still for some simulated time; then the item counts as reached."""

    duration_s: float
    seq: int


@dataclass(frozen=True, slots=True)
class Circle:
    """Fly an orbit from its point at `phase_rad` (clockwise from north) on."""

    orbit: Orbit
    phase_rad: float
    seq: int


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn as the parameters of a CONDITION_YAW ask for."""

    params: tuple[float, ...]
    seq: int


@dataclass(frozen=True, slots=True)
class End:
    """The end of a mission: by its command it lands here, returns or loiters without limit."""

    command: int
    seq: int
    heading_rad: float  # of a landing; NaN: as it is


Stage: TypeAlias = Fly | Wait | Circle | Turn | End


@dataclass(slots=True)
class _Leg:
    points: list[Vector]
    headings: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    acceptance: list[float] = field(default_factory=list)
    reached: list[list[int]] = field(default_factory=list)


def leg_speed(start: Vector, end: Vector, speed_mps: float, parameters: Parameters) -> float:
    """Speed along a leg such that neither the vertical nor the overall limit is exceeded."""
    delta = np.asarray(end) - np.asarray(start)
    length = float(np.linalg.norm(delta))
    speed = min(speed_mps, parameters["MPC_XY_VEL_MAX"])
    climb_share = -float(delta[2]) / length if length > 1e-6 else 0.0
    if climb_share > 1e-6:
        speed = min(speed, parameters["MPC_Z_VEL_MAX_UP"] / climb_share)
    elif climb_share < -1e-6:
        speed = min(speed, parameters["MPC_Z_VEL_MAX_DN"] / -climb_share)
    return max(speed, ranges.SPEED.low)


def points_of(stages: Sequence[Stage]) -> list[Vector]:
    """Return the points (P, 3), NED, of each stage that moves, for fence checks."""
    return [
        stage.path.points_ned_m[1:]
        if isinstance(stage, Fly)
        else stage.orbit.points(stage.phase_rad)
        for stage in stages
        if isinstance(stage, Fly | Circle)
    ]


def turn_of(params: Sequence[float], heading_rad: float) -> tuple[float, float]:
    """Return the signed angle (rad) of a CONDITION_YAW and its rate (rad/s; NaN: not given).

    A turn the longer way needs a rate, and gets the greatest one.
    """
    angle_deg, rate_degps, direction, relative = params[:4]
    by_rad = math.radians(-angle_deg if direction < 0 else angle_deg)
    if relative != 1.0:
        by_rad = wrap_pi(math.radians(angle_deg) - heading_rad)
        if direction * by_rad < 0.0 and abs(by_rad) > _THERE_RAD:
            by_rad += math.copysign(math.tau, direction)
    given = rate_degps if rate_degps > 0.0 else math.nan
    if math.isnan(given) and abs(by_rad) > math.pi - _THERE_RAD:
        given = ranges.TURN_RATE.high
    return by_rad, math.radians(given)


def _positive(value: float) -> float:
    """Return a positive number as it is; 0 for any other and for NaN (left open)."""
    return value if value > 0.0 else 0.0


def speed_from(item: MissionItem, before: float | None) -> float | None:
    """The ordered speed (m/s) after an item; None for the default."""
    if item.command != mav.MAV_CMD_DO_CHANGE_SPEED:
        return before
    speed = item.params[1]  # -1 keeps it, -2 returns to the default
    return speed if speed > 0 else None if speed == -2.0 else before


def heading_of(item: MissionItem) -> float:
    """The heading (rad) that an item asks for on the way and at its place; NaN for none."""
    return math.radians(item.params[3]) if item.command in _HEADED else math.nan


def item_altitude(item: MissionItem, home: GeodeticPoint) -> float:
    """Altitude above mean sea level in metres of an item with a global frame."""
    return item.z + (home.alt_msl_m if item.frame in RELATIVE_FRAMES else 0.0)


def place_of(
    item: MissionItem, frame: LocalFrame, home: GeodeticPoint, here: GeodeticPoint | None = None
) -> Vector:
    """Return the position of an item with a global frame, (3,) NED.

    What it leaves open (NaN) of latitude and longitude is that of `here`, or home's.
    """
    at = here or home
    lat_deg = at.lat_deg if math.isnan(item.x) else item.x
    lon_deg = at.lon_deg if math.isnan(item.y) else item.y
    return frame.to_ned(lat_deg, lon_deg, item_altitude(item, home))


def looked_at(item: MissionItem, frame: LocalFrame, home: GeodeticPoint) -> Vector | None:
    """Return the region of interest of an item, (3,) NED; None if it ends one."""
    free = item.command == mav.MAV_CMD_DO_SET_ROI and item.params[0] == 0.0
    if free or item.command == mav.MAV_CMD_DO_SET_ROI_NONE:
        return None
    return place_of(item, frame, home)


@dataclass(slots=True)
class _Compiler:
    """Walks through the items once and collects stages."""

    parameters: Parameters
    frame: LocalFrame
    home: GeodeticPoint
    here: Vector  # where the items so far lead
    climb_first: bool
    speed_mps: float | None  # ordered; None: the cruise speed
    stages: list[Stage] = field(default_factory=list)
    leg: _Leg = field(init=False)

    def __post_init__(self) -> None:
        self.leg = self._new_leg()

    def _new_leg(self) -> _Leg:
        return _Leg([self.here], acceptance=[self.parameters["NAV_ACC_RAD"]], reached=[[]])

    def _cruise_mps(self) -> float:
        return self.parameters["MPC_XY_CRUISE"] if self.speed_mps is None else self.speed_mps

    def add(self, item: MissionItem) -> None:
        """Carry out one item after those added before."""
        match item.command:
            case mav.MAV_CMD_NAV_WAYPOINT:
                hold_s = _positive(item.params[0])
                through = hold_s == 0.0
                self._go(item, self._place(item), acceptance_m=item.params[1], report=through)
                if not through:
                    self._then(Wait(hold_s, item.seq))
            case mav.MAV_CMD_NAV_LOITER_TIME:
                self._go(item, self._place(item), report=False)
                self._then(Wait(_positive(item.params[0]), item.seq))
            case mav.MAV_CMD_NAV_LOITER_TO_ALT:
                self._go(item, self._place(item))
                self.close()  # where it stands at the altitude
            case mav.MAV_CMD_NAV_LOITER_TURNS:
                self._circle(item)
            case mav.MAV_CMD_NAV_LOITER_UNLIM:
                self._go(item, self._place(item))
                self._then(End(item.command, item.seq, math.nan))
            case mav.MAV_CMD_NAV_TAKEOFF:
                self._takeoff(item)
            case mav.MAV_CMD_NAV_LAND:
                place = self._place(item)
                above = np.array([place[0], place[1], min(self.here[2], place[2])])
                self._go(item, above, report=False)
                self._then(End(item.command, item.seq, heading_of(item)))
            case mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self._then(End(item.command, item.seq, math.nan))
            case mav.MAV_CMD_NAV_DELAY | mav.MAV_CMD_CONDITION_DELAY:
                self._then(Wait(item.params[0], item.seq))
            case mav.MAV_CMD_CONDITION_YAW:
                self._then(Turn(item.params, item.seq))
            case mav.MAV_CMD_DO_CHANGE_SPEED:
                self.speed_mps = speed_from(item, self.speed_mps)
                self.leg.reached[-1].append(item.seq)
            case _:  # what is done on the way
                self.leg.reached[-1].append(item.seq)

    def close(self) -> None:
        """End the path that is being collected, with a stop at its last point."""
        leg = self.leg
        if leg.speeds or any(leg.reached):
            if not leg.speeds:  # items before any movement: a path of no length reports them
                leg.points.append(leg.points[0])
                leg.speeds.append(self.parameters["MPC_XY_CRUISE"])
                leg.acceptance.append(self.parameters["NAV_ACC_RAD"])
                leg.headings.append(math.nan)
                leg.reached = [[], leg.reached[0]]
            self.stages.append(
                Fly(
                    FlightPath(
                        np.array(leg.points), np.array(leg.speeds), np.array(leg.acceptance)
                    ),
                    tuple(tuple(seqs) for seqs in leg.reached),
                    tuple(leg.headings),
                )
            )
        self.leg = self._new_leg()

    def _then(self, stage: Stage) -> None:
        self.close()
        self.stages.append(stage)

    def _place(self, item: MissionItem) -> Vector:
        return place_of(item, self.frame, self.home, here=self.frame.to_geodetic(self.here))

    def _takeoff(self, item: MissionItem) -> None:
        place = self._place(item)
        self.climb_first = False
        self._climb(item, place)
        self._go(item, place)
        self.close()

    def _climb(self, item: MissionItem, to: Vector) -> None:
        """Straight up to the height of a place, if that is higher."""
        up = np.array([self.here[0], self.here[1], min(to[2], self.here[2])])
        climb_mps, radius_m = self.parameters["MPC_TKO_SPEED"], self.parameters["NAV_ACC_RAD"]
        self._append(up, climb_mps, radius_m, [], heading_of(item))

    def _circle(self, item: MissionItem) -> None:
        """Add a circle from its nearest point on, clockwise unless the radius is negative."""
        centre = self._place(item)
        radius_m = abs(item.params[2]) if abs(item.params[2]) > 0.0 else DEFAULT_RADIUS_M
        phase_rad = math.atan2(self.here[1] - centre[1], self.here[0] - centre[0])
        speed_mps = min(self._cruise_mps(), self.parameters["MPC_XY_VEL_MAX"], fastest(radius_m))
        north, east, down = map(float, centre)
        clockwise = -1.0 if item.params[2] < 0.0 else 1.0
        turns = _positive(item.params[0])
        orbit = Orbit(
            (north, east, down), radius_m, clockwise * speed_mps, 0, turns, heading_of(item)
        )
        self._go(item, orbit.point(phase_rad), report=False)
        self._then(Circle(orbit, phase_rad, item.seq))
        self.here = orbit.after(phase_rad, turns)
        self.leg = self._new_leg()

    def _go(
        self,
        item: MissionItem,
        point: Vector,
        *,
        acceptance_m: float = math.nan,
        report: bool = True,
    ) -> None:
        if self.climb_first:
            # From the ground straight up first, before any leg to the side.
            self.climb_first = False
            self._climb(item, point)
            self.close()
        radius = acceptance_m if acceptance_m > 0 else self.parameters["NAV_ACC_RAD"]
        reached = [item.seq] if report else []
        self._append(point, self._cruise_mps(), radius, reached, heading_of(item))

    def _append(
        self,
        point: Vector,
        speed_mps: float,
        acceptance_m: float,
        reached: list[int],
        heading_rad: float,
    ) -> None:
        self.leg.headings.append(heading_rad)
        self.leg.speeds.append(leg_speed(self.here, point, speed_mps, self.parameters))
        self.leg.points.append(point)
        self.leg.acceptance.append(acceptance_m)
        self.leg.reached.append(reached)
        self.here = point


def compile_route(
    items: Sequence[MissionItem],
    parameters: Parameters,
    *,
    frame: LocalFrame,
    home: GeodeticPoint,
    start: Vector,
    on_ground: bool,
    speed_mps: float | None = None,
    first: int = 0,
    jumps_left: Mapping[int, int] | None = None,
) -> tuple[Stage, ...]:
    """Compile the stages from item `first` on of a mission that `check_mission` accepts.

    It is flown from `start`, (3,) NED, at `speed_mps` until an item orders another speed; without
    it at the cruise speed. `jumps_left`: how often each jump is still taken; without it as often
    as the items say.
    """
    here = np.array(start, dtype=float)
    compiler = _Compiler(parameters, frame, home, here, on_ground, speed_mps)
    left = repeats(items) if jumps_left is None else dict(jumps_left)
    for item in flown_order(items, first, left):
        compiler.add(item)
        if item.command in _ENDS or not item.autocontinue:
            break
    compiler.close()
    return tuple(compiler.stages)


def repeats(items: Sequence[MissionItem]) -> dict[int, int]:
    """Return how often each DO_JUMP of a mission is taken, by its sequence number."""
    return {item.seq: int(item.params[1]) for item in items if item.command in _JUMPS}


def flown_order(
    items: Sequence[MissionItem], first: int, jumps_left: dict[int, int]
) -> Iterator[MissionItem]:
    """Yield items from `first` on in flown order; deduct jumps taken from `jumps_left`."""
    index = first
    while index < len(items):
        item = items[index]
        index += 1
        if item.command not in _JUMPS:
            yield item
        elif jumps_left[item.seq] > 0:
            jumps_left[item.seq] -= 1
            index = int(item.params[0])


def _jump_trouble(items: Sequence[MissionItem]) -> str:
    """Return why jumps lead to no item, or from some start to too many items; else empty."""
    jumps = {item.seq: item for item in items if item.command in _JUMPS}
    if len(jumps) > MAX_JUMPS:
        return f"{len(jumps)} items jump; at most {MAX_JUMPS} may"
    for item in jumps.values():
        if not item.params[0] < len(items):
            return f"item {item.seq} jumps to item {item.params[0]:g}, which is not there"
    # Where a walk goes without jumping is the same from every item between two of these.
    stops = sorted({len(items), *jumps, *(i.seq for i in items if i.command in _ENDS)})
    for before, stop in zip([-1, *stops], stops, strict=False):
        if stop - before > 1 or stop in jumps:
            first = before + 1
            if _steps(first, jumps, stops) > MAX_STEPS:
                return f"from item {first} on it is more than {MAX_STEPS} items with its jumps"
    return ""


def _steps(first: int, jumps: Mapping[int, MissionItem], stops: Sequence[int]) -> int:
    """Count the items carried out from `first` on, with jumps, to just beyond MAX_STEPS."""
    left = repeats(tuple(jumps.values()))
    index, steps = first, 0
    while steps <= MAX_STEPS:
        stop = stops[bisect_left(stops, index)]
        steps += stop - index + 1
        if stop not in jumps:
            break
        index = stop + 1
        if left[stop] > 0:
            left[stop] -= 1
            index = int(jumps[stop].params[0])
    return steps


def check_mission(
    items: Sequence[MissionItem], *, frame: LocalFrame, home: GeodeticPoint, farthest_m: float
) -> str:
    """Return why a mission cannot be flown (an item too far away, bad jumps); empty if it can.

    Of rally points, too, whether one is too far away.
    """
    home_ned_m = frame.to_ned(home.lat_deg, home.lon_deg, home.alt_msl_m)
    for item in items:
        if item.command in _FLOWN_TO:
            place = place_of(item, frame, home)
            if far := too_far(place, home_ned_m, farthest_m=farthest_m):
                return f"item {item.seq} is {far}"
    return _jump_trouble(items)


def too_far(place_ned_m: Vector, home_ned_m: Vector, *, farthest_m: float) -> str:
    """Describe how a place is too far from home, or from the frame's origin; empty if it is not."""
    north_m, east_m, _ = np.subtract(place_ned_m, home_ned_m)
    reach_m = ranges.AWAY.high  # the far side of the earth lies below the origin, not beside it
    for distance_m, most_m, words in (
        (math.hypot(north_m, east_m), farthest_m, "home, MIS_DIST_1WP allows"),
        (math.hypot(*place_ned_m), reach_m, "where the vehicle started, the most is"),
    ):
        if distance_m > most_m:
            return f"{_distance(distance_m)} from {words} {_distance(most_m)}"
    return ""


def _distance(metres: float) -> str:
    return f"{metres:.0f} m" if metres < 10_000 else f"{metres / 1000:.0f} km"
