"""Where missions lead, by hand; and at which number exactly a plan is refused."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from flightdyn.config import LimitsConfig
from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import InputError
from mission.flight.missions.geofence import fence_items, fence_of, item_zones
from mission.flight.missions.mission_path import (
    MissionPath,
    items_of,
    leads_on,
    mission_path,
    place_m,
    record_of,
    returns,
)
from mission.flight.missions.plan_check import CheckedPath, checked_path, nowhere, placed, wait_of
from mission.flight.missions.plan_file import PlanFile
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.parameters import Parameters

NAN = math.nan
HOME = GeodeticPoint(47.0, 8.0, 500.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME)
RELATIVE, MSL, TERRAIN, LOCAL, NONE = 3, 0, 10, 1, 2
TAKEOFF, WAYPOINT, LAND, RETURN, JUMP, TURNS, SPEED, DELAY = 22, 16, 21, 20, 177, 18, 178, 93


def item(
    command: int,
    x_m: float = 0.0,
    y_m: float = 0.0,
    z: float = 20.0,
    *,
    frame: int = RELATIVE,
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> MissionItem:
    """An item at a place of the area, in metres."""
    at = LocalFrame(HOME).to_geodetic(np.array([y_m - 50.0, x_m - 100.0, 0.0]))
    return MissionItem(0, command, frame, params, at.lat_deg, at.lon_deg, z)


def numbered(*items: MissionItem) -> list[MissionItem]:
    return [
        MissionItem(seq, i.command, i.frame, i.params, i.x, i.y, i.z)
        for seq, i in enumerate(items)
    ]  # fmt: skip


def jump(to: int, times: float) -> MissionItem:
    return MissionItem(0, JUMP, NONE, (to, times, 0.0, 0.0), 0.0, 0.0, 0.0)


def way(
    *items: MissionItem, start: tuple[float, float, float] = (10.0, 20.0, 30.0), first: int = 0,
    rally: Sequence[tuple[float, float, float]] = (), straight: bool = False,
) -> MissionPath:  # fmt: skip
    rally_m = [np.array(point) for point in rally]
    return mission_path(
        numbered(*items), AREA, np.array(start), first=first, rally_m=rally_m,
        climbs_straight=straight,
    )  # fmt: skip


def check(
    found: MissionPath, points: Sequence[tuple[float, float, float]], seqs: list[int]
) -> None:
    np.testing.assert_allclose(found.points_m, points, atol=1e-3)
    assert found.seqs.tolist() == seqs


GOES = item(WAYPOINT, 50.0, 60.0, 40.0)
BACK = MissionItem(0, RETURN, NONE, (0.0,) * 4, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("z", "up"), [(30.0, False), (1.0, False), (0.999, True), (0.0, True)])
def test_a_flight_that_begins_on_the_ground_goes_up_first(z: float, up: bool) -> None:
    found = way(GOES, start=(10.0, 20.0, z))
    climb_ = [(10.0, 20.0, 40.0)] * up
    check(found, [(10.0, 20.0, z), *climb_, (50.0, 60.0, 40.0)], [-1, *[-1] * up, 0])
    assert found.height_known.tolist() == [True] * (2 + up)
    assert found.given == 2 + up
    assert not found.left_out


@pytest.mark.parametrize("command", [16, 82, 19, 17, 31, 94])
def test_commands_that_lead_straight_to_their_place(command: int) -> None:
    """Waypoint, spline, loiter for a time, without end and to a height, payload."""
    assert way(item(command, 50.0, 60.0, 40.0)).seqs.tolist() == [-1, 0]
    assert leads_on(numbered(item(SPEED), item(command)), 0)
    assert not leads_on(numbered(item(SPEED), item(command)), 1)


@pytest.mark.parametrize(
    ("command", "left"),
    [(93, {}), (92, {}), (95, {}), (0, {}), (85, {"NAV_VTOL_LAND": 1}), (80, {"NAV_ROI": 2}),
     (96, {}), (178, {}), (30, {"NAV_CONTINUE_AND_CHANGE_ALT": 2})],
)  # fmt: skip
def test_navigation_that_leads_nowhere_known_is_counted(command: int, left: dict[str, int]) -> None:
    """MAV_CMD_NAV_LAST is 95; what follows orders no way. A landing without a frame has none."""
    frame = NONE if command == 85 else RELATIVE
    one = item(command, frame=frame)
    found = way(one, *[one] * (command != 85))
    assert found.left_out == left
    assert found.points_m.tolist() == [[10.0, 20.0, 30.0]]


def test_places_without_a_global_frame_are_counted_too() -> None:
    found = way(
        item(WAYPOINT, frame=LOCAL), item(WAYPOINT, frame=LOCAL), item(TAKEOFF, frame=NONE),
        item(TURNS, frame=LOCAL), item(LAND, frame=LOCAL),
    )  # fmt: skip
    assert found.left_out == {
        "NAV_WAYPOINT": 2, "NAV_TAKEOFF": 1, "NAV_LOITER_TURNS": 1, "NAV_LAND": 1,
    }  # fmt: skip


@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize(("start_m", "up_m"), [(0.0, 40.0), (70.0, 70.0)])
def test_a_take_off_goes_up_and_then_to_its_place(
    straight: bool, start_m: float, up_m: float
) -> None:
    found = way(item(TAKEOFF, 50.0, 60.0, 40.0), start=(10.0, 20.0, start_m), straight=straight)
    end = (10.0, 20.0, 40.0) if straight else (50.0, 60.0, 40.0)
    check(found, [(10.0, 20.0, start_m), (10.0, 20.0, up_m), end], [-1, -1, 0])
    # A waypoint is flown to all the same.
    assert way(GOES, straight=straight).points_m[1] == pytest.approx([50.0, 60.0, 40.0], abs=1e-3)


def test_heights_count_from_home_from_the_sea_or_from_a_ground_that_nobody_knows() -> None:
    found = way(
        item(WAYPOINT, 50.0, 60.0, 540.0, frame=MSL),
        item(WAYPOINT, 50.0, 60.0, 25.0, frame=TERRAIN),
    )
    check(found, [(10, 20, 30), (50, 60, 40), (50, 60, 25)], [-1, 0, 1])
    assert found.height_known.tolist() == [True, True, False]


def test_what_an_item_leaves_open_is_where_the_vehicle_is() -> None:
    here = np.array([1.0, 2.0, 3.0])
    for x, y in ((NAN, NAN), (0.0, 0.0), (NAN, 8.0), (47.0, NAN)):
        at = place_m(MissionItem(0, 16, RELATIVE, (0.0,) * 4, x, y, NAN), AREA, here)
        assert at.tolist() == [1.0, 2.0, 3.0]
    at = place_m(MissionItem(0, 16, RELATIVE, (0.0,) * 4, 0.0, 8.0, 7.0), AREA, here)
    assert at[2] == 7.0
    assert at[1] < -1e6  # on the equator
    assert np.isnan(place_m(MissionItem(0, 16, 3, (0.0,) * 4, NAN, NAN, NAN), AREA)).all()


def test_a_landing_comes_down_over_its_place_and_a_return_over_the_nearest() -> None:
    found = way(GOES, item(LAND, 70.0, 80.0, 0.0))
    check(
        found, [(10, 20, 30), (50, 60, 40), (70, 80, 40), (70, 80, 0)], [-1, 0, -1, 1]
    )  # fmt: skip
    assert found.height_known.tolist() == [True, True, False, False]
    assert found.given == 4
    near = [(60.0, 60.0, 9.0), (55.0, 60.0, 9.0)]
    for rally, end in (([], (100, 50)), (near, (55, 60)), ([(0.0, 0.0, 9.0)], (100, 50))):
        found = way(GOES, BACK, GOES, rally=rally)
        check(
            found, [(10, 20, 30), (50, 60, 40), (*end, 40), (*end, 0)], [-1, 0, -1, 1]
        )  # fmt: skip
        assert found.given == 2


def test_a_landing_without_a_place_comes_down_where_it_is() -> None:
    bare = MissionItem(0, LAND, RELATIVE, (0.0,) * 4, NAN, NAN, NAN)
    check(way(GOES, bare), [(10, 20, 30), (50, 60, 40), (50, 60, 40), (50, 60, 0)], [-1, 0, -1, 1])
    # Unless it is said, a take-off leads to its place.
    start = np.array([10.0, 20.0, 0.0])
    up = mission_path(numbered(item(TAKEOFF, 50.0, 60.0, 40.0)), AREA, start)
    check(up, [(10, 20, 0), (10, 20, 40), (50, 60, 40)], [-1, -1, 0])
    assert items_of(record_of(5, 1, numbered(GOES)))[0].mission_type == 0


def test_jumps_are_taken_as_often_as_they_say_or_for_ever() -> None:
    goes = [item(WAYPOINT, 50.0), item(WAYPOINT, 60.0)]
    assert way(*goes, jump(0, 2), item(WAYPOINT, 70.0)).seqs.tolist() == [-1, *[0, 1] * 3, 3]
    assert way(*goes, jump(1, 0), item(WAYPOINT, 70.0)).seqs.tolist() == [-1, 0, 1, 3]
    assert way(*goes, jump(0, 2), first=1).seqs.tolist() == [-1, 1, *[0, 1] * 2]
    endless = way(*goes, jump(0, -1), item(WAYPOINT, 70.0)).seqs
    assert len(endless) == 1 + 2 * 501 + 1


@pytest.mark.parametrize(
    ("laps", "radius", "points", "turned"),
    [(1.0, 12.0, 25, 1.0), (2.0, 12.0, 49, 2.0), (0.26, 12.0, 8, 0.26), (0.0, 12.0, 1, 0.0),
     (-1.0, 12.0, 1, 0.0), (1.0, -12.0, 25, -1.0), (51.0, 12.0, 1201, 50.0), (1.0, 0.0, 25, 1.0),
     (1.0, 0.5, 25, 1.0)],
)  # fmt: skip
def test_turns_are_circles_from_the_nearest_point_on(
    laps: float, radius: float, points: int, turned: float
) -> None:
    """Clockwise seen from above; 24 corners each."""
    found = way(
        item(TURNS, 100.0, 50.0, 40.0, params=(laps, 0.0, radius, 0.0)), start=(40.0, 50.0, 30.0)
    )
    ring = found.points_m[1:] - [100.0, 50.0, 40.0]
    size = abs(radius) or 10.0  # of our vehicle, and of ArduCopter
    assert len(ring) == points
    assert found.seqs.tolist() == [-1] * points + [0]
    np.testing.assert_allclose(np.hypot(ring[:, 0], ring[:, 1]), size, atol=1e-3)
    np.testing.assert_allclose(ring[:, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(ring[0], [-size, 0.0, 0.0], atol=1e-3)  # from the west
    bearing = np.unwrap(np.arctan2(ring[:, 0], ring[:, 1]))
    assert bearing[-1] - bearing[0] == pytest.approx(turned * math.tau, abs=1e-4)


def test_a_mission_returns_if_its_last_item_does() -> None:
    for command in (RETURN, LAND, 85):
        assert returns(numbered(item(WAYPOINT), item(command)))
        assert not returns(numbered(item(command), item(WAYPOINT)))
    assert not returns([])
    assert leads_on(numbered(item(SPEED), item(TAKEOFF)), 0)
    assert leads_on(numbered(item(SPEED), item(TURNS)), 0)
    assert not leads_on(numbered(item(WAYPOINT), item(LAND), item(RETURN)), 0)


def checked(
    *items: MissionItem, fence: Sequence[MissionItem] = (), rally: Sequence[MissionItem] = ()
) -> CheckedPath:
    plan = PlanFile(Path("a.plan"), b"", HOME, tuple(numbered(*items)), tuple(fence), tuple(rally))
    return checked_path(plan, HOME, parameters=Parameters(), limits=LimitsConfig())


def speed(mps: float) -> MissionItem:
    return MissionItem(0, SPEED, NONE, (1.0, mps, -1.0, 0.0), 0.0, 0.0, 0.0)


UP = item(TAKEOFF, 100.0, 50.0)
LEGS = {
    "the lowest": (item(WAYPOINT, 150.0, 50.0, 1.0), ""),
    "too low": (item(WAYPOINT, 150.0, 50.0, 0.99), "1.0 m above home; 1 to 500 m are allowed"),
    "the highest": (item(WAYPOINT, 150.0, 50.0, 500.0), ""),
    "too high": (item(WAYPOINT, 150.0, 50.0, 500.06), "500.1 m above home; 1 to 500 m"),
    "the slowest": (speed(0.5), ""),
    "too slow": (speed(0.49), "0.49 m/s; 0.5 to 30 m/s are allowed"),
    "the fastest": (speed(30.0), ""),
    "too fast": (speed(30.1), "30.1 m/s; 0.5 to 30 m/s are allowed"),
    "as it is": (speed(-1.0), ""),
    "as usual": (speed(-2.0), ""),
    "the longest wait": (item(WAYPOINT, 150.0, 50.0, params=(3600.0, 0, 0, 0)), ""),
    "too long": (item(WAYPOINT, 150.0, 50.0, params=(3601.0, 0, 0, 0)), "waits 3601 s; 3600 s at"),
    "a late take-off": (item(TAKEOFF, 150.0, 50.0), "a take-off has to come first"),
    "an early landing": (item(LAND, 150.0, 50.0), "nothing may come after it"),
}  # fmt: skip


@pytest.mark.parametrize("case", LEGS)
def test_what_is_fit_for_an_unattended_flight_up_to_its_last_digit(case: str) -> None:
    leg, wrong = LEGS[case]
    items = (UP, leg, item(WAYPOINT, 160.0, 50.0), BACK)
    if wrong:
        with pytest.raises(InputError) as refused:
            checked(*items)
        assert str(refused.value).startswith("a.plan: item 1, ")
        assert wrong in str(refused.value)
    else:
        assert [seq for seq, _ in checked(*items).places] == [0, *[1] * (leg.command == 16), 2]


def test_a_delay_may_come_before_the_take_off_and_a_speed_too() -> None:
    delay = MissionItem(0, DELAY, NONE, (5.0, -1.0, -1.0, -1.0), 0.0, 0.0, 0.0)
    assert checked(delay, UP, BACK).returns
    assert checked(speed(5.0), UP, BACK).returns
    assert not checked(UP, item(WAYPOINT, 150.0, 50.0)).returns
    with pytest.raises(InputError, match="no item leads anywhere"):
        checked(delay)


def test_rally_points_stand_at_home_height_or_above_and_are_returned_to() -> None:
    def point(z: float, x_m: float = 60.0) -> MissionItem:
        made = item(5100, x_m, 50.0, z)
        return MissionItem(0, 5100, 3, made.params, made.x, made.y, made.z, 2)

    path = checked(UP, item(WAYPOINT, 150.0, 50.0), BACK, rally=[point(0.0)])
    np.testing.assert_allclose(path.rally_ned_m[0], [0.0, -40.0, 0.0], atol=1e-2)
    with pytest.raises(InputError, match=r"rally point 0, .*: -0\.1 m above home; 0 to 500"):
        checked(UP, BACK, rally=[point(-0.06)])
    nowhere_ = MissionItem(0, 5100, 3, (0.0,) * 4, 0.0, 0.0, 5.0, 2)
    with pytest.raises(InputError, match="it has no position"):
        checked(UP, BACK, rally=[nowhere_])
    with pytest.raises(InputError, match="rally point 0"):
        checked(UP, BACK, rally=[point(5.0, 5e5)])


def square(half_m: float) -> list[MissionItem]:
    """A fence to stay in around home."""
    at = [
        (y, x)
        for y, x in ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    ]
    ring = [LocalFrame(HOME).to_geodetic(np.array([n, e, 0.0])) for n, e in at]
    return list(fence_items([(True, [(p.lat_deg, p.lon_deg) for p in ring])]))  # fmt: skip


def test_each_metre_of_the_way_keeps_to_the_fence() -> None:
    out = item(WAYPOINT, 100.0 + 45.0, 50.0)
    back = item(WAYPOINT, 100.0, 50.0)
    assert len(checked(UP, out, BACK, fence=square(50.0)).places) == 2
    with pytest.raises(InputError, match=r"item 1, .*: the way there is partly "):
        checked(UP, out, back, BACK, fence=square(44.0))


def test_what_has_no_place_gets_that_where_it_happens() -> None:
    bare = MissionItem(0, TAKEOFF, RELATIVE, (0.0,) * 4, NAN, NAN, 20.0)
    zero = MissionItem(0, LAND, RELATIVE, (0.0,) * 4, 0.0, 0.0, 0.0)
    far = item(WAYPOINT, 300.0, 200.0)
    turn = MissionItem(0, WAYPOINT, RELATIVE, (0.0,) * 4, 0.0, 0.0, 0.0)
    found = placed([bare, far, zero, turn], HOME)
    assert [(i.x, i.y) for i in found] == [(47.0, 8.0), (far.x, far.y), (far.x, far.y), (0.0, 0.0)]
    assert nowhere(bare)
    assert nowhere(zero)
    half = MissionItem(0, LAND, RELATIVE, (0.0,) * 4, NAN, 8.0, 0.0)
    assert not nowhere(half)
    assert not nowhere(MissionItem(0, LAND, RELATIVE, (0.0,) * 4, 0.0, 8.0, 0.0))


@pytest.mark.parametrize("command", [16, 19, 93, 112])
def test_waits_are_the_first_parameter_of_what_waits(command: int) -> None:
    assert wait_of(item(command, params=(7.5, 1.0, 1.0, 1.0))) == 7.5
    assert wait_of(item(command, params=(-1.0, 1.0, 1.0, 1.0))) == 0.0
    assert wait_of(item(TURNS, params=(7.5, 1.0, 1.0, 1.0))) == 0.0


def test_the_last_place_is_passed_before_what_is_waited_there() -> None:
    """5 m/s over 100 m: with a wait of a minute all is over later, and the place at the same."""
    ends = []
    for wait_s in (0.0, 60.0):
        stay = item(19, 200.0, 50.0, params=(wait_s, 0.0, 0.0, 0.0))
        path = checked(UP, speed(5.0), stay)
        assert len(path.slot_s) == len(path.points_ned_m)
        ends.append(path)
    climb_s = ends[0].slot_s[-1] - 20.0
    assert 20.0 / 3.0 < climb_s < 20.0
    assert ends[1].slot_s[-1] == pytest.approx(ends[0].slot_s[-1] + 60.0)
    np.testing.assert_allclose(ends[1].slot_s[:-1], ends[0].slot_s[:-1])


def test_a_plan_is_over_as_late_as_its_parts_take() -> None:
    """Twice round a circle of 20 m at 4 m/s, a wait, and a landing from 20 m: what each adds."""

    def over_s(*items: MissionItem) -> float:
        parameters = Parameters()
        parameters.apply({"MPC_XY_CRUISE": 4.0, "MPC_LAND_SPEED": 0.5, "MPC_LAND_ALT2": 8.0,
                          "MPC_Z_VEL_MAX_DN": 2.5}, "here")  # fmt: skip
        plan = PlanFile(Path("a.plan"), b"", HOME, tuple(numbered(*items)))
        path = checked_path(plan, HOME, parameters=parameters, limits=LimitsConfig())
        return float(path.slot_s[-1])

    circle = item(TURNS, 200.0, 50.0, params=(2.0, 0.0, 20.0, 0.0))
    once = item(TURNS, 200.0, 50.0, params=(1.0, 0.0, 20.0, 0.0))
    stay = item(19, 100.0, 50.0, params=(7.0, 0.0, 0.0, 0.0))
    lands = MissionItem(0, LAND, RELATIVE, (0.0,) * 4, HOME.lat_deg, HOME.lon_deg, 0.0)
    # To the circle it is 80 m, and it settles there before it turns.
    way = item(WAYPOINT, 180.0, 50.0)
    assert over_s(UP, circle) - over_s(UP, once) == pytest.approx(math.tau * 20.0 / 4.0)
    assert over_s(UP, once) - over_s(UP, way) == pytest.approx(math.tau * 20.0 / 4.0, abs=0.01)
    assert over_s(UP, stay) - over_s(UP) == pytest.approx(7.0, abs=1.0)
    # A leg of no length, to above where it lands, is one that it stops after: 0.45 s.
    assert over_s(UP, lands) - over_s(UP) == pytest.approx(0.45 + 12 / 2.5 + 8 / 0.5, abs=1e-3)


def test_a_fence_is_what_it_draws_and_the_circle_about_home() -> None:
    parameters = Parameters()
    drawn = fence_items(
        [(False, [(47.0, 8.0), (47.001, 8.0), (47.001, 8.001)])], [(True, 30.0, (47.0, 8.0))]
    )
    assert [(i.seq, i.command, i.params, i.mission_type) for i in drawn] == [
        *((n, 5002, (3.0, 0.0, 0.0, 0.0), 1) for n in range(3)),
        (3, 5003, (30.0, 0.0, 0.0, 0.0), 1),
    ]
    circle, drawn_ring = item_zones(drawn, AREA)
    assert (circle.keep_in, drawn_ring.keep_in) == (True, False)
    away = np.linalg.norm(circle.outline_m - [100.0, 50.0], axis=1)
    np.testing.assert_allclose(away, 30.0, rtol=0.01)
    np.testing.assert_allclose(drawn_ring.outline_m[0], [100.0, 50.0], atol=1e-3)
    parameters.apply({"GF_MAX_HOR_DIST": 40.0, "GF_ACTION": 1.0}, "here")
    *zones, about = fence_of(drawn, parameters, AREA)
    assert len(zones) == 2
    assert about.keep_in
    np.testing.assert_allclose(
        np.linalg.norm(about.outline_m - [100.0, 50.0], axis=1), 40.0, rtol=0.01
    )
    parameters.apply({"GF_MAX_HOR_DIST": 0.0}, "here")
    assert len(fence_of(drawn, parameters, AREA)) == 2
    parameters.apply({"GF_ACTION": 0.0}, "here")
    assert fence_of(drawn, parameters, AREA) == ()
    corner = MissionItem(0, 5001, 0, (0.0,) * 4, 47.0, 8.0, 0.0, 1)  # of a ring of no corners
    assert item_zones([corner], AREA) == ()
