"""Frames that are valid and mean harm: answered, and the vehicle goes on."""

import logging
import math
import time
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of, speed_item, the

from sitl.autopilot.flying import route
from sitl.autopilot.flying.modes import Mode
from sitl.config import VehicleConfig

OK, DENIED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_DENIED
ACCEPTED, INVALID = mav.MAV_MISSION_ACCEPTED, mav.MAV_MISSION_INVALID
HUGE = 3.4e38
WAYPOINT = mav.MAV_CMD_NAV_WAYPOINT


def jump(seq: int, to: float, times: float) -> object:
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_JUMP, 0, 1, to, times, 0, 0, 0, 0, 0.0, 0
    )  # fmt: skip


def test_home_cannot_be_lifted_out_of_the_world() -> None:
    """Twice added up, 3.4e38 m is more than a float of MAVLink's holds."""
    desk = Desk()
    relative = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
    for _ in range(2):
        result = desk.command_int(
            mav.MAV_CMD_DO_SET_HOME, relative, (0, 0, 0, 0), 473977000, 85454000, HUGE
        )
        assert result == DENIED
    for _ in range(30):  # nor in steps that are small enough each
        desk.command_int(
            mav.MAV_CMD_DO_SET_HOME, relative, (0, 0, 0, 0), 473977418, 85455939, 9_000.0
        )
    assert of(desk.pass_wall_time(1.1), "HOME_POSITION")[-1].altitude <= 20_000_000
    assert "Internal" not in "".join(desk.texts())


@pytest.mark.parametrize("lat_lon", [(-473977418, -945000000), (900000000, 0), (0, 0)])
def test_home_and_goals_stay_within_reach(lat_lon: tuple[int, int]) -> None:
    desk = Desk()
    desk.take_off()
    for command, params in (
        (mav.MAV_CMD_DO_SET_HOME, (0, 0, 0, 0)),
        (mav.MAV_CMD_DO_REPOSITION, (-1, 0, 0, math.nan)),
    ):
        frame = mav.MAV_FRAME_GLOBAL
        assert desk.command_int(command, frame, params, *lat_lon, 500.0) == DENIED
    assert "MIS_DIST_1WP allows 20 km" in "".join(desk.texts())


@pytest.mark.parametrize(
    ("number", "params"),
    [
        (mav.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, 0, 0, HUGE)),
        (mav.MAV_CMD_DO_CHANGE_SPEED, (1, HUGE)),
        (mav.MAV_CMD_DO_CHANGE_SPEED, (1, 1e-30)),
        (mav.MAV_CMD_DO_CHANGE_SPEED, (1, math.nan)),
        (mav.MAV_CMD_CONDITION_YAW, (HUGE, 0, 1, 0)),
        (mav.MAV_CMD_DO_SET_MISSION_CURRENT, (HUGE,)),
        (mav.MAV_CMD_MISSION_START, (HUGE,)),
    ],
)
def test_numbers_beyond_physics_are_denied(number: int, params: tuple[float, ...]) -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(number, *params) == DENIED
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.HOLD


def test_jumps_are_judged_from_every_item() -> None:
    """From the first item this mission ends at the second; from the third it goes on for ever."""
    desk = Desk()
    mission = [
        item(0, WAYPOINT, north=20.0),
        item(1, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH),
        item(2, WAYPOINT, north=30.0),
        jump(3, 2, 1e6),
    ]
    assert desk.upload(mission) == INVALID
    assert "from item 2 on it is more than 10000 items with its jumps" in "".join(desk.texts())
    mission[3] = jump(3, 2, 3)
    assert desk.upload(mission) == ACCEPTED
    desk.take_off()
    assert desk.command(mav.MAV_CMD_MISSION_START, 2) == OK
    desk.fly()


def test_more_jumps_than_may_be() -> None:
    desk = Desk()
    mission = [jump(seq, 0, 0) for seq in range(route.MAX_JUMPS + 1)]
    assert desk.upload(mission) == INVALID
    assert "101 items jump; at most 100 may" in "".join(desk.texts())


@pytest.mark.parametrize("target", [0.5, -1.0, math.nan, math.inf, 65536.0])
def test_a_jump_leads_to_an_item(target: float) -> None:
    assert Desk().upload([item(0, WAYPOINT), jump(1, target, 1)]) == mav.MAV_MISSION_INVALID_PARAM1


@pytest.mark.parametrize("speed", [0.05, 1e-40, 101.0, HUGE, math.nan, -3.0, 0.0])
def test_items_with_speeds_that_nobody_flies(speed: float) -> None:
    """Below 0.1 m/s, a leg of no length ended the process by its upload alone."""
    desk = Desk()
    here = item(1, WAYPOINT, params=(0, 0, 0, 0))
    mission = [speed_item(0, speed), here, item(2, WAYPOINT)]
    assert desk.upload(mission) == mav.MAV_MISSION_INVALID_PARAM2


def test_legs_of_no_length_at_the_least_speed() -> None:
    desk = Desk()
    mission = [speed_item(0, 0.1), *(item(n, WAYPOINT, height=30.0) for n in (1, 2, 3))]
    assert desk.upload(mission) == ACCEPTED
    desk.take_off()
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly()
    assert desk.vehicle.autopilot.flight.mission.complete


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({"height": HUGE}, mav.MAV_MISSION_INVALID_PARAM7),
        ({"height": math.nan}, mav.MAV_MISSION_INVALID_PARAM7),
        ({"params": (HUGE, 0, 0, 0)}, mav.MAV_MISSION_INVALID_PARAM1),
        ({"params": (-1, 0, 0, 0)}, mav.MAV_MISSION_INVALID_PARAM1),
        ({"params": (0, HUGE, 0, 0)}, mav.MAV_MISSION_INVALID_PARAM2),
        ({"command": mav.MAV_CMD_NAV_LAND, "height": HUGE}, mav.MAV_MISSION_INVALID_PARAM7),
    ],
)
def test_items_beyond_physics(change: dict[str, Any], verdict: int) -> None:
    assert Desk().upload([item(0, **{"command": WAYPOINT, **change})]) == verdict


# --- what is acknowledged happens ---------------------------------------------------------------


def loitering() -> Desk:
    """At the end of a mission whose last item is a loiter without end."""
    desk = Desk()
    mission = [
        item(0, WAYPOINT, north=20.0),
        item(1, mav.MAV_CMD_NAV_LOITER_UNLIM, north=40.0, params=(0, 0, 0, 0)),
    ]
    desk.upload(mission)
    desk.take_off()
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.MISSION
    return desk


def test_a_new_mission_is_flown_after_a_loiter_without_end() -> None:
    desk = loitering()
    assert desk.upload([item(0, WAYPOINT, north=-60.0)]) == ACCEPTED
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly()
    assert desk.mass.belief.pos_ned_m[0] == pytest.approx(-60.0, abs=0.5)
    assert desk.vehicle.autopilot.flight.mission.complete


def test_starting_what_loiters_at_its_end_changes_nothing() -> None:
    desk = loitering()
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    assert not desk.vehicle.moving


def test_an_emptied_mission_does_not_start() -> None:
    desk = loitering()
    heard = desk.send(mav.MAVLink_mission_clear_all_message(1, 1, 0))
    assert the(heard, "MISSION_ACK").type == ACCEPTED
    result = desk.command(mav.MAV_CMD_MISSION_START)
    assert result == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "no mission uploaded" in "".join(desk.texts())


def test_a_mission_of_nothing_to_fly_does_not_start() -> None:
    desk = Desk()
    assert desk.upload([item(0, WAYPOINT, north=20.0), jump(1, 0, 0)]) == ACCEPTED
    desk.take_off()
    result = desk.command(mav.MAV_CMD_MISSION_START, 1)
    assert result == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "from item 1 on the mission holds nothing to fly" in "".join(desk.texts())


# --- what is large ------------------------------------------------------------------------------


def fence_items(corners: int, radius_m: float) -> list[object]:
    turns = np.linspace(0, math.tau, corners, endpoint=False)
    return [
        item(
            seq, mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            north=radius_m * math.cos(turn), east=radius_m * math.sin(turn),
            params=(float(corners), 0, 0, 0), mission_type=mav.MAV_MISSION_TYPE_FENCE,
        )
        for seq, turn in enumerate(turns)
    ]  # fmt: skip


@pytest.mark.slow
def test_the_largest_fence_and_the_largest_mission_together() -> None:
    """5,000 x 5,000: no handler looks at corner after corner (which took minutes)."""
    began_s = time.process_time()
    desk = Desk(VehicleConfig(parameters={"GF_ACTION": 2}))
    assert desk.upload(fence_items(5000, 900.0), mav.MAV_MISSION_TYPE_FENCE) == ACCEPTED
    places = [
        item(n, WAYPOINT, north=float(n % 71), east=float(n % 73), params=(0, 0, 0, 0))
        for n in range(5000)
    ]
    assert desk.upload(places) == ACCEPTED
    desk.take_off()
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    places[4999] = item(4999, WAYPOINT, north=1000.0)
    desk.command(mav.MAV_CMD_DO_PAUSE_CONTINUE, 0)
    assert desk.upload(places) == ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "the mission leads outside the fence" in "".join(desk.texts())
    assert time.process_time() - began_s < 30.0


# --- whatever else goes wrong -------------------------------------------------------------------


class BrokenError(RuntimeError):
    """An error that nobody has foreseen."""


def break_(*_: object, **__: object) -> None:
    raise BrokenError("of a kind that nobody thought of")


def test_an_error_in_a_command_is_answered(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    desk = Desk()
    desk.take_off()
    monkeypatch.setattr(desk.vehicle.autopilot.flight, "set_home", break_)
    assert desk.command(mav.MAV_CMD_DO_SET_HOME, 1) == mav.MAV_RESULT_FAILED
    assert "Internal error in COMMAND_LONG: BrokenError" in desk.texts()
    (record,) = caplog.records
    assert record.levelno == logging.ERROR
    assert record.exc_info is not None
    assert desk.command(mav.MAV_CMD_NAV_LAND) == OK
    desk.fly()
    assert desk.mass.on_ground


def test_an_error_in_a_transfer_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    with monkeypatch.context() as patched:
        patched.setattr(desk.vehicle.autopilot.flight, "replace_mission", break_)
        assert desk.upload([item(0, WAYPOINT)]) == mav.MAV_MISSION_ERROR
    assert desk.upload([item(0, WAYPOINT)]) == ACCEPTED


def test_an_error_while_flying_ends_in_a_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    desk.upload([item(0, WAYPOINT, north=20.0), item(1, WAYPOINT, north=40.0)])
    desk.take_off()
    monkeypatch.setattr(desk.vehicle.autopilot.flight.mission, "reached", break_)
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly()
    desk.exchange()
    assert "Internal error in flying: BrokenError" in desk.texts()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    assert desk.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == OK
    desk.fly()
    assert desk.mass.on_ground


@pytest.mark.parametrize("part", ["monitor", "failsafes"])
def test_an_error_in_a_watch_is_told_once(monkeypatch: pytest.MonkeyPatch, part: str) -> None:
    desk = Desk()
    desk.take_off()
    monkeypatch.setattr(getattr(desk.vehicle.autopilot, part), "watch", break_)
    desk.fly(seconds=2.0)
    desk.exchange()
    assert sum("Internal error" in text for text in desk.texts()) == 1


def test_an_observers_error_is_not_contained() -> None:
    """A full disk must end the run."""
    desk = Desk()
    desk.recorder.happened = break_  # type: ignore[method-assign]
    with pytest.raises(BrokenError):
        desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
