"""The stages of missions, every point, speed, radius, heading and item of them worked by hand."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying import route
from sitl.autopilot.flying.orbit import Orbit, fastest
from sitl.autopilot.parameters import Parameters

NAN = math.nan
FRAME = LocalFrame(HOME)
RAISED = GeodeticPoint(HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m + 5.0)  # home, over the origin
RELATIVE, ABSOLUTE = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL
PARAMETERS = Parameters()
for name, value in {
    "MPC_XY_CRUISE": 8.0, "MPC_XY_VEL_MAX": 20.0, "MPC_Z_VEL_MAX_UP": 4.0, "MPC_Z_VEL_MAX_DN": 2.0,
    "MPC_TKO_SPEED": 3.0, "NAV_ACC_RAD": 6.0,
}.items():  # fmt: skip
    assert PARAMETERS.set(name, value)


def at(
    seq: int, name: str, north: float = 0.0, east: float = 0.0, z: float = 30.0, *params: float,
    frame: int = RELATIVE, autocontinue: bool = True,
) -> MissionItem:  # fmt: skip
    """An item 30 m over home, 35 m over the origin, unless it says otherwise."""
    place = FRAME.to_geodetic(np.array([north, east, -z]))
    four = (*params, *(0.0, 0.0, 0.0, NAN)[len(params) :])
    return MissionItem(
        seq, getattr(mav, f"MAV_CMD_{name}"), frame, four, place.lat_deg, place.lon_deg, z,  # type: ignore[arg-type]  # of four
        autocontinue=autocontinue,
    )  # fmt: skip


def compiled(
    *items: MissionItem, start: Sequence[float] = (0.0, 0.0, -35.0), **keys: Any
) -> list[tuple[Any, ...]]:
    """The stages as tuples: kind, then what it says."""
    keys = {"on_ground": False, **keys}
    stages = route.compile_route(
        items, PARAMETERS, frame=FRAME, home=RAISED, start=np.array(start), **keys
    )
    found: list[tuple[Any, ...]] = []
    for stage in stages:
        match stage:
            case route.Fly(path, reached, headings):
                points = [tuple(round(x, 2) + 0.0 for x in p) for p in path.points_ned_m.tolist()]
                speeds = [round(v, 3) for v in path.speeds_mps.tolist()]
                turns = [round(math.degrees(h), 6) for h in headings]
                found.append(("fly", points, speeds, path.acceptance_m.tolist(), reached, turns))
            case route.Wait(duration_s, seq):
                found.append(("wait", duration_s, seq))
            case route.Turn(params, seq):
                found.append(("turn", params, seq))
            case route.End(command, seq, heading):
                found.append(("end", command, seq, round(math.degrees(heading), 6)))
            case route.Circle(orbit, phase, seq):
                found.append(("circle", orbit, round(phase, 6), seq))
    return found


def same(found: list[tuple[Any, ...]], *expected: tuple[Any, ...]) -> None:
    assert repr(found) == repr(list(expected))  # NaN is written alike


def test_waypoints_become_one_path_up_to_a_stop() -> None:
    found = compiled(
        at(0, "NAV_WAYPOINT", 100, 0, 30, 0, 2.5, 0, 90.0),
        at(1, "DO_CHANGE_SPEED", 0, 0, 0, 1, 5.0),
        at(2, "NAV_WAYPOINT", 100, 50),
        at(3, "DO_SET_ROI_NONE"),
        at(4, "NAV_WAYPOINT", 0, 50, 30, 0.7, 0.5),
        at(5, "NAV_LOITER_TIME", 0, 0, 30, 3.0),
        at(6, "NAV_DELAY", 0, 0, 0, 2.0),
        at(7, "CONDITION_DELAY", 0, 0, 0, 4.0),
        at(8, "CONDITION_YAW", 0, 0, 0, 90.0, 20.0, 1.0, 0.0),
        at(9, "NAV_LAND", 20, 0, 0, 0, 0, 0, 45.0),
        at(10, "NAV_WAYPOINT", 500, 0),
    )
    same(
        found,
        ("fly", [(0.0, 0.0, -35.0), (100.0, 0.0, -35.0), (100.0, 50.0, -35.0), (0.0, 50.0, -35.0)],
         [8.0, 5.0, 5.0], [6.0, 2.5, 6.0, 0.5], ((), (0, 1), (2, 3), ()), [90.0, NAN, NAN]),
        ("wait", 0.7, 4),
        ("fly", [(0.0, 50.0, -35.0), (0.0, 0.0, -35.0)], [5.0], [6.0, 6.0], ((), ()), [NAN]),
        ("wait", 3.0, 5),
        ("wait", 2.0, 6),
        ("wait", 4.0, 7),
        ("turn", (90.0, 20.0, 1.0, 0.0), 8),
        ("fly", [(0.0, 0.0, -35.0), (20.0, 0.0, -35.0)], [5.0], [6.0, 6.0], ((), ()), [45.0]),
        ("end", mav.MAV_CMD_NAV_LAND, 9, 45.0),
    )  # fmt: skip


def test_from_the_ground_it_climbs_first() -> None:
    climb = ("fly", [(1.0, 2.0, -5.0), (1.0, 2.0, -35.0)], [3.0], [6.0, 6.0], ((), ()), [NAN])
    same(
        compiled(at(0, "NAV_WAYPOINT", 60, 2), start=(1.0, 2.0, -5.0), on_ground=True),
        climb,
        ("fly", [(1.0, 2.0, -35.0), (60.0, 2.0, -35.0)], [8.0], [6.0, 6.0], ((), (0,)), [NAN]),
    )
    # A take-off says it itself, and goes to its own place; what it leaves open is where it is.
    up = at(0, "NAV_TAKEOFF", 11, 2, 30, 0, 0, 0, 180.0)
    same(
        compiled(up, at(1, "NAV_WAYPOINT", 11, 9), start=(1.0, 2.0, -5.0), on_ground=True),
        ("fly", [(1.0, 2.0, -5.0), (1.0, 2.0, -35.0), (11.0, 2.0, -35.0)], [3.0, 8.0],
         [6.0, 6.0, 6.0], ((), (), (0,)), [180.0, 180.0]),
        ("fly", [(11.0, 2.0, -35.0), (11.0, 9.0, -35.0)], [8.0], [6.0, 6.0], ((), (1,)), [NAN]),
    )  # fmt: skip
    down = MissionItem(0, mav.MAV_CMD_NAV_TAKEOFF, ABSOLUTE, (0, 0, 0, NAN), NAN, NAN, 493.0)
    ((_, points, speeds, *_),) = compiled(down, start=(5.0, 5.0, -50.0))
    assert points == [(5.0, 5.0, -50.0), (5.0, 5.0, -50.0), (5.0, 5.0, HOME.alt_msl_m - 493.0)]
    assert speeds == [3.0, 2.0]


def test_circles_begin_at_their_nearest_point() -> None:
    anticlockwise = at(0, "NAV_LOITER_TURNS", 100, 0, 30, 1.5, 0, -20.0, 45.0)
    found = compiled(anticlockwise, at(1, "NAV_WAYPOINT", 120, 30))
    same(
        [found[0], found[2]],
        ("fly", [(0.0, 0.0, -35.0), (80.0, 0.0, -35.0)], [8.0], [6.0, 6.0], ((), ()), [45.0]),
        ("fly", [(120.0, 0.0, -35.0), (120.0, 30.0, -35.0)], [8.0], [6.0, 6.0], ((), (1,)), [NAN]),
    )
    _, orbit, phase, seq = found[1]
    assert (phase, seq, orbit.turns, orbit.yaw) == (round(math.pi, 6), 0, 1.5, 0)
    assert orbit.center_ned_m == pytest.approx((100.0, 0.0, -35.0), abs=0.01)
    assert (orbit.radius_m, orbit.speed_mps) == (20.0, pytest.approx(-math.sqrt(2.0 * 20.0)))
    assert orbit.heading_rad == pytest.approx(math.pi / 4)
    # No radius is one of 10 m; an ordered speed counts, and no number of turns is none.
    plain = at(1, "NAV_LOITER_TURNS", 0, 100, 30, NAN, 0, 0.0)
    _, (_, orbit, phase, _) = compiled(at(0, "DO_CHANGE_SPEED", 0, 0, 0, 1, 3.0), plain)
    assert (orbit.radius_m, orbit.speed_mps, orbit.turns) == (10.0, 3.0, 0.0)
    assert phase == pytest.approx(-math.pi / 2, abs=1e-3)
    (_, (_, orbit, *_)) = compiled(at(0, "NAV_LOITER_TURNS", 0, 100, 30, 0.5, 0, 0.5))
    assert (orbit.radius_m, orbit.speed_mps, orbit.turns) == (0.5, 1.0, 0.5)
    (_, (_, orbit, *_)) = compiled(at(0, "NAV_LOITER_TURNS", 0, 100, 30, 1, 0, 900.0))
    assert orbit.speed_mps == 8.0
    assert math.isnan(orbit.heading_rad)


def test_where_missions_end() -> None:
    on, home = at(0, "NAV_WAYPOINT", 40), at(1, "NAV_RETURN_TO_LAUNCH")
    way = ("fly", [(0.0, 0.0, -35.0), (40.0, 0.0, -35.0)], [8.0], [6.0, 6.0], ((), (0,)), [NAN])
    same(compiled(on, home, at(2, "NAV_WAYPOINT", 90)), way, ("end", home.command, 1, NAN))
    stay = at(0, "NAV_LOITER_UNLIM", 40, 0, 30, 0, 0, 0, 90.0)
    turned = (*way[:-1], [90.0])
    same(compiled(stay, at(1, "NAV_WAYPOINT", 90)), turned, ("end", stay.command, 0, NAN))
    last = at(0, "NAV_WAYPOINT", 40, autocontinue=False)
    same(compiled(last, at(1, "NAV_WAYPOINT", 90)), way)
    # What waits at a height has no heading; what comes before all movement is reported by a path.
    high = at(0, "NAV_LOITER_TO_ALT", 0, 0, 40, 0, 0, 0, 90.0)
    same(
        compiled(high, at(1, "NAV_WAYPOINT", 10, 0, 40)),
        ("fly", [(0.0, 0.0, -35.0), (0.0, 0.0, -45.0)], [4.0], [6.0, 6.0], ((), (0,)), [NAN]),
        ("fly", [(0.0, 0.0, -45.0), (10.0, 0.0, -45.0)], [8.0], [6.0, 6.0], ((), (1,)), [NAN]),
    )
    same(
        compiled(at(0, "DO_CHANGE_SPEED", 0, 0, 0, 1, 5.0), at(1, "NAV_DELAY", 0, 0, 0, 2.0)),
        ("fly", [(0.0, 0.0, -35.0)] * 2, [8.0], [6.0, 6.0], ((), (0,)), [NAN]),
        ("wait", 2.0, 1),
    )
    assert compiled() == []


def test_jumps_are_taken_as_often_as_they_say() -> None:
    items = (
        at(0, "NAV_WAYPOINT", 10), at(1, "NAV_WAYPOINT", 20), at(2, "DO_JUMP", 0, 0, 0, 1, 2),
        at(3, "NAV_WAYPOINT", 30),
    )  # fmt: skip
    left = route.repeats(items)
    assert left == {2: 2}
    assert [i.seq for i in route.flown_order(items, 0, left)] == [0, 1, 1, 1, 3]
    assert left == {2: 0}
    for first, taken, order in ((1, 1, (1, 1, 3)), (2, 1, (1, 3)), (3, 2, (3,)), (0, 0, (0, 1, 3))):
        (stage,) = compiled(*items, first=first, jumps_left={2: taken}, speed_mps=6.0)
        assert sum(stage[4], ()) == order
        assert set(stage[2]) == {6.0}


@pytest.mark.parametrize(
    ("way", "ordered_mps", "speed_mps"),
    [
        ((50, 0, 0), 7.0, 7.0), ((0, 50, 0), 40.0, 20.0), ((0, 0, -9), 10.0, 4.0),
        ((0, 0, 9), 10.0, 2.0), ((0, 40, -30), 10.0, 4.0 / 0.6), ((40, 0, 30), 10.0, 2.0 / 0.6),
        ((40, 0, -30), 6.0, 6.0), ((40, 0, 30), 3.0, 3.0), ((0, 0, 0), 9.0, 9.0),
        ((50, 0, 0), 0.05, 0.1), ((0, 0, -9), 0.05, 0.1),
    ],
)  # fmt: skip
def test_a_leg_keeps_within_climb_descent_and_speed(
    way: tuple[float, float, float], ordered_mps: float, speed_mps: float
) -> None:
    start = np.array([7.0, -3.0, -40.0])
    found = route.leg_speed(start, start + way, ordered_mps, PARAMETERS)
    assert found == pytest.approx(speed_mps)


@pytest.mark.parametrize(
    ("params", "heading_deg", "by_deg", "rate_degps"),
    [
        ((90, 20, 1, 1), 50.0, 90.0, 20.0), ((90, 20, -1, 1), 50.0, -90.0, 20.0),
        ((90, 0, 0, 1), 50.0, 90.0, NAN), ((90, -1, 0, 1), 50.0, 90.0, NAN),
        ((90, 20, 0, 0), 30.0, 60.0, 20.0), ((90, 20, 0, 0), 300.0, 150.0, 20.0),
        ((90, 20, 1, 0), 120.0, 330.0, 20.0), ((90, 20, -1, 0), 120.0, -30.0, 20.0),
        ((90, 20, -1, 0), 30.0, -300.0, 20.0), ((90, 20, 1, 0), 30.0, 60.0, 20.0),
        # Half a degree is there; the longer way needs a rate, and gets the greatest.
        ((90, 20, 1, 0), 90.4, -0.4, 20.0), ((90, 20, 1, 0), 90.6, 359.4, 20.0),
        ((90, 20, -1, 0), 89.6, 0.4, 20.0), ((90, 20, -1, 0), 89.4, -359.4, 20.0),
        ((179.4, 0, 1, 1), 0.0, 179.4, NAN), ((179.6, 0, 1, 1), 0.0, 179.6, 60.0),
        ((200, NAN, -1, 1), 0.0, -200.0, 60.0), ((200, 5, 1, 1), 0.0, 200.0, 5.0),
    ],
)  # fmt: skip
def test_a_turn_has_its_direction_and_rate(
    params: tuple[float, ...], heading_deg: float, by_deg: float, rate_degps: float
) -> None:
    turned = route.turn_of(params, math.radians(heading_deg))
    expected = math.radians(by_deg), math.radians(rate_degps)
    assert turned == pytest.approx(expected, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize(
    ("ordered", "before", "after"),
    [(5.0, 3.0, 5.0), (-1.0, 3.0, 3.0), (-2.0, 3.0, None), (0.0, 3.0, 3.0), (-1.0, None, None)],
)
def test_speeds_are_ordered_kept_and_given_back(
    ordered: float, before: float | None, after: float | None
) -> None:
    assert route.speed_from(at(0, "DO_CHANGE_SPEED", 0, 0, 0, 1, ordered), before) == after
    assert route.speed_from(at(0, "NAV_WAYPOINT", 0, 0, 0, 1, ordered), before) == before


def test_a_circle_is_round_and_looked_at_in_seventy_two_points() -> None:
    assert fastest(8.0) == 4.0
    orbit = Orbit((10.0, -20.0, -30.0), 5.0, 2.0, 0)
    assert orbit.point(0.0).tolist() == [15.0, -20.0, -30.0]
    assert orbit.point(math.pi / 2).tolist() == pytest.approx([10.0, -15.0, -30.0])
    assert orbit.after(0.0, 0.25).tolist() == pytest.approx([10.0, -15.0, -30.0])
    back = Orbit((10.0, -20.0, -30.0), 5.0, -2.0, 0, turns=0.25)
    assert back.after(0.0, 0.25).tolist() == pytest.approx([10.0, -25.0, -30.0])
    whole, part = orbit.points(0.0), back.points(math.pi)
    assert (len(whole), len(part)) == (73, 19)
    assert whole[[0, 18, 72]] == pytest.approx(
        np.array([[15, -20, -30], [10, -15, -30], [15, -20, -30]])
    )
    assert part[[0, -1]] == pytest.approx(np.array([[5, -20, -30], [10, -15, -30]]))


def test_what_moves_is_asked_about_by_the_fence() -> None:
    items = at(0, "NAV_WAYPOINT", 40, 0, 30, 2.0), at(1, "NAV_LOITER_TURNS", 100, 0, 30, 2, 0, 20.0)
    stages = route.compile_route(
        items, PARAMETERS, frame=FRAME, home=RAISED, start=np.array([0, 0, -35.0]), on_ground=False
    )
    first, second, third = route.points_of(stages)
    np.testing.assert_allclose(first, [(40, 0, -35)], atol=0.01)
    np.testing.assert_allclose(second, [(80, 0, -35)], atol=0.01)
    assert third.shape == (73, 3)


def test_what_is_looked_at() -> None:
    place = at(0, "DO_SET_ROI_LOCATION", 30, 40, 0)
    seen = route.looked_at(place, FRAME, RAISED)
    assert seen is not None
    assert seen.tolist() == pytest.approx([30.0, 40.0, -5.0], abs=0.01)
    assert route.looked_at(at(0, "DO_SET_ROI_NONE", 30, 40), FRAME, RAISED) is None
    assert route.looked_at(at(0, "DO_SET_ROI", 30, 40, 0, 0.0), FRAME, RAISED) is None
    assert route.looked_at(at(0, "DO_SET_ROI", 30, 40, 0, 3.0), FRAME, RAISED) is not None
    absolute = at(0, "DO_SET_ROI_LOCATION", 30, 40, 500.0, frame=ABSOLUTE)
    seen = route.looked_at(absolute, FRAME, RAISED)
    assert seen is not None
    assert seen[2] == pytest.approx(HOME.alt_msl_m - 500.0, abs=0.01)


def why_not(*items: MissionItem, farthest_m: float = 20_000.0) -> str:
    return route.check_mission(items, frame=FRAME, home=RAISED, farthest_m=farthest_m)


def test_items_are_near_enough() -> None:
    assert not why_not(at(3, "NAV_WAYPOINT", 600, 799), farthest_m=1000.0)
    far = why_not(at(3, "NAV_WAYPOINT", -600, 801), farthest_m=1000.0)
    assert far == "item 3 is 1001 m from home, MIS_DIST_1WP allows 1000 m"
    assert not why_not(at(3, "DO_SET_ROI_LOCATION", 2000), farthest_m=1000.0)
    rally = at(0, "NAV_RALLY_POINT", 10_100)
    near = at(0, "NAV_RALLY_POINT", 9_800), at(0, "NAV_RALLY_POINT", 10_100)
    assert "9800 m from home, MIS_DIST_1WP allows 1000 m" in why_not(near[0], farthest_m=1000.0)
    assert why_not(near[1], farthest_m=10_000.0).endswith(
        "10 km from home, MIS_DIST_1WP allows 10 km"
    )
    assert why_not(rally, farthest_m=9999.0).endswith("10 km from home, MIS_DIST_1WP allows 9999 m")
    away = route.too_far(np.array([80e3, 0, 80e3]), np.array([80e3, 0, 0]), farthest_m=1e3)
    assert away == "113 km from where the vehicle started, the most is 100 km"
    assert not route.too_far(np.array([1000.0, 0, 0]), np.zeros(3), farthest_m=1e3)


def test_jumps_lead_to_an_item_and_come_to_an_end() -> None:
    here = at(0, "NAV_WAYPOINT", 10)
    assert not why_not(here, at(1, "DO_JUMP", 0, 0, 0, 1, 0))
    assert "item 1 jumps to item 2, which is not there" in why_not(
        here, at(1, "DO_JUMP", 0, 0, 0, 2, 1)
    )
    jumps = [at(seq, "DO_JUMP", 0, 0, 0, 0, 0) for seq in range(1, 102)]
    assert not why_not(here, *jumps[:100])
    assert why_not(here, *jumps) == "101 items jump; at most 100 may"
    # Of two items and a jump 3333 times, then a landing, and of one item and a jump 5000 times.
    second, jump = at(1, "NAV_WAYPOINT", 20), at(2, "DO_JUMP", 0, 0, 0, 0, 3332)
    assert not why_not(here, second, jump, at(3, "NAV_LAND", 10))
    words = "from item 0 on it is more than 10000 items with its jumps"
    often = at(1, "DO_JUMP", 0, 0, 0, 0, 4999)
    assert why_not(here, often, at(2, "NAV_LAND", 10)) == words
    # A landing ends a walk, and what is behind it is walked from there.
    land, beyond = at(1, "NAV_LAND", 10), at(2, "NAV_WAYPOINT", 10)
    words = "from item 2 on it is more than 10000 items with its jumps"
    assert why_not(here, land, beyond, at(3, "DO_JUMP", 0, 0, 0, 2, 5010)) == words
    assert not why_not(here, land, beyond, at(3, "DO_JUMP", 0, 0, 0, 0, 9000))
    assert why_not(here, land, at(2, "DO_JUMP", 0, 0, 0, 2, 10_001)) == words
