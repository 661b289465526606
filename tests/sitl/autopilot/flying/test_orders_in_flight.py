"""What orders in flight lead to, of what they name and what they leave open."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from sitl.autopilot.flying.modes import Mode

NAN, OK, DENIED = math.nan, mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_DENIED
REJECTED = mav.MAV_RESULT_TEMPORARILY_REJECTED
ORBIT, INSIDE = mav.MAV_CMD_DO_ORBIT, mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION


def place(north: float, east: float) -> tuple[float, float]:
    point = LocalFrame(HOME).to_geodetic(np.array([north, east, 0.0]))
    return point.lat_deg, point.lon_deg


def hovering(height_m: float = 30.0) -> Desk:
    """At a height over a place 40 m north and 30 m east of home."""
    desk = Desk()
    desk.take_off(1.0)
    desk.mass.pos_ned_m = np.array([40.0, 30.0, -height_m])
    desk.mass.vel_ned_mps = np.zeros(3)
    assert desk.vehicle.autopilot.flight.hold(yaw_rad=0.0) is None
    desk.fly()
    return desk


def circled(desk: Desk) -> tuple[float, float, float, float, float]:
    """Radius (positive clockwise), speed, and north, east and height of the middle."""
    desk.fly(seconds=30.0)
    assert desk.vehicle.autopilot.mode is Mode.ORBIT
    request = mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS
    assert desk.command(*request) == OK
    told = of(desk.heard, "ORBIT_EXECUTION_STATUS")[-1]
    middle = LocalFrame(HOME).to_ned(told.x * 1e-7, told.y * 1e-7, told.z)
    target = desk.mass.target
    assert target is not None
    off = np.array(target.pos[:2]) - middle[:2]
    assert np.linalg.norm(off) == pytest.approx(abs(told.radius), abs=0.05)
    turning = off[0] * target.vel[1] - off[1] * target.vel[0]
    assert (turning > 0) == (told.radius > 0)
    return told.radius, math.hypot(target.vel[0], target.vel[1]), *middle.tolist()


@pytest.mark.parametrize(
    ("params", "flown"),
    [
        # Nothing named: 10 m about where it is, clockwise at 2 m/s.
        ((NAN,) * 7, (10.0, 2.0, 40.0, 30.0, -30.0)),
        ((-12.0, 3.0, NAN, NAN, *place(70.0, 10.0), HOME.alt_msl_m + 20.0),
         (-12.0, 3.0, 70.0, 10.0, -20.0)),
        # A negative speed turns it round; half a place is none, and the sideways push is bounded.
        ((12.0, -3.0, NAN, NAN, place(70.0, 10.0)[0], NAN, NAN), (-12.0, 3.0, 40.0, 30.0, -30.0)),
        ((-12.0, -3.0, NAN, NAN, NAN, place(70.0, 10.0)[1], NAN), (12.0, 3.0, 40.0, 30.0, -30.0)),
        ((8.0, 9.0, NAN, NAN, NAN, NAN, NAN), (8.0, 4.0, 40.0, 30.0, -30.0)),
        ((8.0, 9.0, NAN, 0.0, NAN, NAN, NAN), (8.0, 4.0, 40.0, 30.0, -30.0)),
    ],
)  # fmt: skip
def test_an_orbit_has_what_is_named_and_the_rest_by_default(
    params: tuple[float, ...], flown: tuple[float, ...]
) -> None:
    desk = hovering()
    assert desk.command(ORBIT, *params) == OK
    assert circled(desk) == pytest.approx(flown, abs=0.3)


def test_what_an_orbit_leaves_open_is_that_of_the_one_being_flown() -> None:
    desk = hovering()
    where = (*place(70.0, 10.0), HOME.alt_msl_m + 20.0)
    assert desk.command(ORBIT, -12.0, 3.0, 1, NAN, *where) == OK
    assert circled(desk) == pytest.approx((-12.0, 3.0, 70.0, 10.0, -20.0), abs=0.5)
    assert desk.command(ORBIT, NAN, NAN, NAN, NAN, NAN, NAN, NAN) == OK
    assert circled(desk) == pytest.approx((-12.0, 3.0, 70.0, 10.0, -20.0), abs=0.5)
    assert desk.command(ORBIT, NAN, 2.0, NAN, NAN, NAN, NAN, HOME.alt_msl_m + 25.0) == OK
    assert circled(desk) == pytest.approx((-12.0, 2.0, 70.0, 10.0, -25.0), abs=0.5)
    target = desk.mass.target
    assert target is not None
    assert target.yaw == pytest.approx(desk.mass.yaw_rad, abs=0.2)  # as it was as it began
    assert desk.command(ORBIT, 20.0, NAN, 5, NAN, NAN, NAN, NAN) == OK  # 5: as before
    assert circled(desk)[:2] == pytest.approx((20.0, 2.0))


def test_a_part_of_an_orbit_ends() -> None:
    desk = hovering()
    assert desk.command(ORBIT, 10.0, 4.0, 0, math.pi, NAN, NAN, NAN) == OK
    began_ns = desk.vehicle.t_ns
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    # 10 m to the circle at the cruise speed, which the point mass flies at, and half of it.
    seconds = (desk.vehicle.t_ns - began_ns) * 1e-9
    assert 7.8 < seconds < 11.0
    away = desk.mass.pos_ned_m[:2] - [40.0, 30.0]
    assert np.linalg.norm(away) == pytest.approx(10.0, abs=0.2)


@pytest.mark.parametrize(
    ("flags", "yaw_rad", "heads"),
    [(0, 1.0, 1.0), (1, 1.0, 1.0), (2, 1.0, 1.5), (3, 1.0, 1.5), (3, -1.0, -0.5), (1, NAN, 0.5)],
)
def test_a_reposition_turns_to_a_heading_or_by_an_angle(
    flags: int, yaw_rad: float, heads: float
) -> None:
    """From half a radian on."""
    desk = hovering()
    desk.mass.yaw_rad = 0.5
    where = (*place(60.0, 30.0), HOME.alt_msl_m + 30.0)
    assert desk.command(mav.MAV_CMD_DO_REPOSITION, 4.0, flags, 0.0, yaw_rad, *where) == OK
    assert desk.mass.paths[-1].speeds_mps.tolist() == [4.0]
    desk.fly()
    assert desk.mass.yaw_rad == pytest.approx(heads)
    assert desk.mass.pos_ned_m[0] == pytest.approx(60.0, abs=0.2)


def test_a_speed_is_kept_by_a_reposition_that_names_none_and_given_back_by_a_negative_one() -> None:
    desk = hovering()
    for speed_mps, north, flown_mps in ((4.0, 60.0, 4.0), (NAN, 80.0, 4.0), (-1.0, 60.0, 10.0)):
        where = (*place(north, 30.0), HOME.alt_msl_m + 30.0)
        assert desk.command(mav.MAV_CMD_DO_REPOSITION, speed_mps, 1, 0, NAN, *where) == OK
        assert desk.mass.paths[-1].speeds_mps.tolist() == [flown_mps]
        desk.fly(seconds=0.2)


def test_a_loiter_may_name_a_height_alone() -> None:
    loiter = mav.MAV_CMD_NAV_LOITER_UNLIM
    for frame, z in ((6, 45.0), (5, HOME.alt_msl_m + 45.0)):
        desk = hovering()
        open_ = (0.0, 0.0, 0.0, NAN)
        assert desk.command_int(loiter, frame, open_, 0, 0, z) == OK
        desk.fly()
        np.testing.assert_allclose(desk.mass.pos_ned_m, [40.0, 30.0, -45.0], atol=0.01)
    # A height of 0 is none: it stays where it is, and so it does where all is open.
    for params in ((0, 0, 0, NAN, 0, 0, 0), (0, 0, 0, NAN, NAN, NAN, NAN)):
        assert desk.command(loiter, *params) == OK
        desk.fly()
        np.testing.assert_allclose(desk.mass.pos_ned_m, [40.0, 30.0, -45.0], atol=0.01)
    north = place(60.0, 30.0)[0]  # half of a place, in single precision
    assert desk.command(loiter, 0, 0, 0, NAN, north, NAN, NAN) == OK
    desk.fly()
    np.testing.assert_allclose(desk.mass.pos_ned_m, [60.0, 30.0, -45.0], atol=0.2)


def test_home_is_told_at_once_where_it_moves() -> None:
    desk = hovering()
    desk.pass_wall_time(1.1)
    lat, lon = place(20.0, 0.0)
    at = (round(lat * 1e7), round(lon * 1e7))
    assert desk.command_int(mav.MAV_CMD_DO_SET_HOME, 5, (0, 0, 0, NAN), *at, 490.0) == OK
    told = of(desk.heard, "HOME_POSITION")[-1]
    assert (told.latitude, told.longitude, told.altitude) == (*at, 490_000)


def fence(radius_m: float) -> list[Any]:
    params = (radius_m, 0.0, 0.0, 0.0)
    return [item(0, INSIDE, params=params, mission_type=mav.MAV_MISSION_TYPE_FENCE)]


def test_no_order_leads_out_of_the_fence() -> None:
    desk = Desk()
    assert desk.upload(fence(60.0), mav.MAV_MISSION_TYPE_FENCE) == OK
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == OK
    up = (NAN, NAN, NAN, NAN, *place(61.0, 0.0), HOME.alt_msl_m + 20.0)
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, *up) != OK
    assert "the end of the take-off is outside the fence" in "".join(desk.texts())
    up = (*up[:4], *place(59.0, 0.0), up[6])
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, *up) == OK
    desk.fly()
    for order, first, words in (
        (mav.MAV_CMD_NAV_LAND, 0.0, "the place is outside the fence"),
        (mav.MAV_CMD_DO_REPOSITION, -1.0, "the position is outside the fence"),
    ):
        params = (first, 1.0 if first else 0.0, 0.0, NAN)
        assert desk.command(order, *params, *place(0.0, 61.0), HOME.alt_msl_m + 20.0) != OK
        assert words in "".join(desk.texts())
        assert desk.command(order, *params, *place(0.0, 59.0), HOME.alt_msl_m + 20.0) == OK


@pytest.mark.parametrize(
    ("first", "last", "words"),
    [
        (0, 1, ""), (1, 1, ""), (2, 0, "mission has 2 items, no item 2"),
        (1, 5, "mission has 2 items, and ends after 5 only if it begins before"),
        (0, 2, "mission has 2 items, and ends after 2 only if it begins before"),
    ],
)  # fmt: skip
def test_a_mission_begins_and_ends_at_items_that_are_there(
    first: int, last: int, words: str
) -> None:
    desk = hovering()
    way = [item(n, mav.MAV_CMD_NAV_WAYPOINT, north=50.0 + 10.0 * n) for n in (0, 1)]
    assert desk.upload(way) == OK
    result = desk.command(mav.MAV_CMD_MISSION_START, first, last)
    assert (result == OK) == (words == "")
    assert words in "".join(desk.texts())


def test_a_return_takes_the_speed_that_is_ordered_meanwhile() -> None:
    desk = hovering()
    assert desk.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == OK
    assert desk.mass.paths[-1].speeds_mps[-1] == 10.0
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0, -1.0) == OK
    assert desk.mass.paths[-1].speeds_mps[-1] == 4.0
    count = len(desk.mass.paths)
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0, -1.0) == OK
    assert len(desk.mass.paths) == count  # it has that speed already
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, -2.0, -1.0) == OK
    assert desk.mass.paths[-1].speeds_mps[-1] == 10.0


def test_a_filter_that_does_not_get_ready_is_given_up_after_two_minutes() -> None:
    desk = Desk(ready=False, ready_after_s=500.0)
    desk.fly(seconds=119.9)
    assert desk.vehicle.moving
    desk.fly(seconds=0.2)
    desk.exchange()
    assert not desk.vehicle.moving
    (told,) = of(desk.heard, "STATUSTEXT")
    assert (told.text, told.severity) == ("Not ready: aligning", mav.MAV_SEVERITY_ERROR)
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == REJECTED


def test_what_does_not_leave_the_ground_is_switched_off() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == OK
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, *(NAN,) * 6, HOME.alt_msl_m + 20.0) == OK
    desk.mass.idle()
    desk.mass.progress.stalled = True
    desk.fly(seconds=0.1)
    desk.exchange()
    assert not desk.mass.armed
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    told = of(desk.heard, "STATUSTEXT")[-1]
    assert told.text == "The aircraft does not follow its path"
    assert told.severity == mav.MAV_SEVERITY_CRITICAL


def test_what_gets_stuck_in_the_air_lands() -> None:
    desk = hovering()
    assert desk.vehicle.autopilot.flight.go_to(np.array([90.0, 30.0, -30.0])) is None
    desk.mass.progress.stalled = True
    desk.fly(seconds=0.1)
    assert desk.vehicle.autopilot.mode is Mode.LAND
    desk.fly()
    assert desk.mass.on_ground
    assert not desk.mass.armed


def test_a_mission_whose_return_is_not_possible_rests_where_it_ends() -> None:
    desk = hovering()
    desk.vehicle.autopilot.parameters.set("COM_POSLOSS_ACT", 0)
    way = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, north=300.0),
        item(1, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH),
    ]
    assert desk.upload(way) == OK
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, NAN) == OK
    desk.mass.gnss_works = False
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    assert desk.vehicle.autopilot.flight.mission.complete
    assert desk.mass.pos_ned_m[0] == pytest.approx(300.0, abs=0.5)


def test_health_is_said_bit_by_bit() -> None:
    """By the numbers of MAV_SYS_STATUS_SENSOR."""
    sensors, rates, heading, motors, battery = 1 | 2 | 4 | 8, 1024 | 2048, 4096, 32768, 0x2000000
    always = sensors | rates | heading | motors | battery
    gps, height, across, ahrs, arming, area = 32, 8192, 16384, 0x200000, 0x10000000, 0x100000

    def told(desk: Desk) -> tuple[int, int, int]:
        said = of(desk.pass_wall_time(1.1), "SYS_STATUS")[-1]
        return (
            said.onboard_control_sensors_present,
            said.onboard_control_sensors_enabled,
            said.onboard_control_sensors_health,
        )

    there = always | gps | height | across | ahrs | arming
    assert told(Desk(ready=False)) == (there, there, always | area)
    desk = Desk()
    assert told(desk) == (there, there, there | area)
    assert desk.upload(fence(60.0), mav.MAV_MISSION_TYPE_FENCE) == OK
    assert told(desk) == (there | area, there | area, there | area)
    desk.take_off(10.0)
    desk.mass.gnss_works = False
    desk.fly(seconds=3.0)
    assert told(desk)[2] == (there | area) & ~(gps | across)
    desk.mass.gnss_works = True
    desk.fly(seconds=1.0)
    desk.vehicle.autopilot.parameters.set("GF_MAX_VER_DIST", 5.0)
    desk.fly(seconds=0.2)
    assert told(desk)[2] == there  # outside of it
    desk.vehicle.autopilot.parameters.set("GF_ACTION", 0)
    assert told(desk)[0] == there
