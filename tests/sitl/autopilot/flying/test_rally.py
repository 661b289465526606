"""Rally points: a return leads to the closest place that is allowed."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item

from sitl.autopilot.flying.modes import Mode

RALLY = mav.MAV_MISSION_TYPE_RALLY
FENCE = mav.MAV_MISSION_TYPE_FENCE


def rally_point(seq: int, north: float, east: float, height: float = 0.0) -> object:
    return item(
        seq, mav.MAV_CMD_NAV_RALLY_POINT, north=north, east=east, height=height,
        params=(0.0, 0.0, 0.0, 0.0), frame=mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        mission_type=RALLY,
    )  # fmt: skip


def flown_to(north: float, east: float, *points: object) -> Desk:
    """Hovering 20 m above a place, with rally points."""
    desk = Desk()
    assert desk.upload(list(points), RALLY) == mav.MAV_MISSION_ACCEPTED
    desk.take_off(20.0)
    assert desk.vehicle.autopilot.flight.go_to(np.array([north, east, -20.0])) is None
    desk.fly()
    return desk


def landed_at(desk: Desk) -> tuple[float, float]:
    """Where a return ends."""
    assert desk.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == mav.MAV_RESULT_ACCEPTED
    assert desk.vehicle.autopilot.mode is Mode.RETURN
    desk.fly()
    assert not desk.mass.armed
    north, east, down = desk.mass.truth.pos_ned_m
    assert down == pytest.approx(0.0, abs=0.1)
    return float(north), float(east)


def said(desk: Desk) -> str:
    return next(t for t in reversed(desk.recorder.texts("status")) if t.startswith("Returning"))


@pytest.mark.parametrize(
    ("at", "goal", "name"),
    [
        ((180.0, 10.0), (200.0, 0.0), "rally point 0"),
        ((20.0, 170.0), (0.0, 150.0), "rally point 1"),
        ((60.0, 60.0), (0.0, 0.0), "home"),
    ],
)
def test_a_return_leads_to_the_closest_place(
    at: tuple[float, float], goal: tuple[float, float], name: str
) -> None:
    desk = flown_to(*at, rally_point(0, 200.0, 0.0), rally_point(1, 0.0, 150.0))
    assert landed_at(desk) == pytest.approx(goal, abs=0.5)
    assert said(desk) == f"Returning to {name}"


@pytest.mark.parametrize(("own", "highest"), [(5.0, 30.0), (55.0, 55.0)])
def test_the_way_is_as_high_as_parameter_and_point_ask_for(own: float, highest: float) -> None:
    desk = flown_to(120.0, 0.0, rally_point(0, 200.0, 0.0, own))
    desk.recorder.samples.clear()
    landed_at(desk)
    heights = [-s.truth.pos_ned_m[2] for s in desk.recorder.samples]
    assert max(heights) == pytest.approx(highest, abs=0.3)


def test_a_point_outside_the_fence_is_none() -> None:
    desk = flown_to(150.0, 0.0, rally_point(0, 220.0, 0.0))
    circle = item(
        0, mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, params=(200.0, 0, 0, 0), mission_type=FENCE
    )
    assert desk.upload([circle], FENCE) == mav.MAV_MISSION_ACCEPTED
    assert landed_at(desk) == pytest.approx((0.0, 0.0), abs=0.5)


def test_a_failsafe_returns_to_it_too_and_a_cleared_list_is_forgotten() -> None:
    desk = flown_to(180.0, 0.0, rally_point(0, 200.0, 0.0))
    desk.send(mav.MAVLink_mission_clear_all_message(1, 1, RALLY))
    assert landed_at(desk) == pytest.approx((0.0, 0.0), abs=0.5)
    desk = flown_to(180.0, 0.0, rally_point(0, 200.0, 0.0))
    assert desk.vehicle.autopilot.flight.return_home("Battery critical") is None
    desk.fly()
    assert math.dist(desk.mass.truth.pos_ned_m[:2], (200.0, 0.0)) < 0.5
