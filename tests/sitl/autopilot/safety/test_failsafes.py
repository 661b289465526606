"""Each failsafe with each of its actions, and the failures that ground stations inject."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of
from sitl_mavsdk import HOME, Recorder, make_vehicle

from flightdyn.config import AircraftConfig
from flightdyn.faults import GnssOff, WindBurst
from flightdyn.state import BatteryState
from sitl.autopilot.failsafe import RULES, Action, Cause
from sitl.autopilot.fence import Fence
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.parameters import SPECS
from sitl.config import VehicleConfig

AFTERWARDS = {
    Action.NOTHING: Mode.HOLD,
    Action.WARN: Mode.HOLD,
    Action.STABILIZED: Mode.RETURN,  # nobody is at the sticks
    Action.ALTITUDE: Mode.RETURN,
    Action.POSITION: Mode.RETURN,
    Action.HOLD: Mode.HOLD,
    Action.RETURN: Mode.RETURN,
    Action.LAND: Mode.LAND,
    Action.TERMINATE: Mode.TERMINATED,
}


def drain(desk: Desk, remaining: float) -> None:
    desk.mass.battery = BatteryState(14.0, 10.0, 4000.0, remaining)
    desk.fly(seconds=0.2)


def lose_gnss(desk: Desk) -> None:
    desk.mass.gnss_works = False
    desk.fly(seconds=21.0)


def lose_ground_station(desk: Desk) -> None:
    desk.send(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    desk.pass_wall_time(11.0)


def breach_fence(desk: Desk) -> None:
    desk.vehicle.autopilot.parameters.set("GF_MAX_VER_DIST", 20.0)
    desk.fly(seconds=0.2)


def lose_setpoints(desk: Desk) -> None:
    still = mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, 0b110111000111, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    desk.send(still)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 6, 0) == mav.MAV_RESULT_ACCEPTED
    desk.pass_wall_time(0.9)
    assert desk.vehicle.autopilot.mode is Mode.OFFBOARD
    desk.pass_wall_time(0.2)


def lose_sticks(desk: Desk) -> None:
    desk.send(mav.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 3, 0) == mav.MAV_RESULT_ACCEPTED
    desk.pass_wall_time(0.4)
    assert desk.vehicle.autopilot.mode is Mode.POSITION
    desk.pass_wall_time(0.2)


BRING_ABOUT: dict[Cause, Callable[[Desk], None]] = {
    Cause.BATTERY_LOW: lambda desk: drain(desk, 0.14),
    Cause.BATTERY_CRITICAL: lambda desk: drain(desk, 0.06),
    Cause.BATTERY_EMERGENCY: lambda desk: drain(desk, 0.04),
    Cause.GNSS_LOST: lose_gnss,
    Cause.GROUND_STATION_LOST: lose_ground_station,
    Cause.FENCE_BREACHED: breach_fence,
    Cause.SETPOINTS_LOST: lose_setpoints,
    Cause.STICKS_LOST: lose_sticks,
}
CASES = [
    pytest.param(cause, value, action, id=f"{cause.name}-{action.name}-{value}")
    for cause, rule in RULES.items()
    for value, action in enumerate(rule.actions)
]


def test_parameters_mean_what_px4_documents() -> None:
    """The numbers that ground stations offer for PX4's parameters."""
    a = Action
    px4 = {
        Cause.FENCE_BREACHED: [a.NOTHING, a.WARN, a.HOLD, a.RETURN, a.TERMINATE, a.LAND],
        Cause.BATTERY_LOW: [a.WARN, a.WARN, a.WARN, a.WARN],
        Cause.BATTERY_CRITICAL: [a.WARN, a.WARN, a.LAND, a.RETURN],
        Cause.BATTERY_EMERGENCY: [a.WARN, a.WARN, a.LAND, a.LAND],
        Cause.GROUND_STATION_LOST: [a.NOTHING, a.HOLD, a.RETURN, a.LAND, a.WARN, a.TERMINATE],
        Cause.SETPOINTS_LOST: [
            *(a.POSITION, a.ALTITUDE, a.STABILIZED, a.RETURN, a.LAND, a.HOLD),
            *(a.TERMINATE, a.TERMINATE),
        ],
        Cause.STICKS_LOST: [
            *(a.NOTHING, a.HOLD, a.RETURN, a.LAND, a.WARN, a.TERMINATE, a.TERMINATE)
        ],
    }
    ours = {Cause.GNSS_LOST: [a.NOTHING, a.WARN, a.HOLD, a.LAND, a.TERMINATE]}
    for cause, actions in {**px4, **ours}.items():
        assert RULES[cause].actions == tuple(actions), cause
        assert SPECS[RULES[cause].parameter].high == len(actions) - 1
    assert set(RULES) == set(Cause)


def hovering(parameters: dict[str, float] | None = None) -> Desk:
    desk = Desk(VehicleConfig(parameters=parameters or {}))
    desk.take_off(30.0)
    desk.vehicle.autopilot.flight.go_to(np.array([80.0, 0.0, -30.0]))
    desk.fly()
    return desk


@pytest.mark.slow
@pytest.mark.parametrize(("cause", "value", "action"), CASES)
def test_every_row_of_the_table(cause: Cause, value: int, action: Action) -> None:
    desk = hovering({RULES[cause].parameter: value})
    BRING_ABOUT[cause](desk)
    expected = AFTERWARDS[action]
    if cause is Cause.STICKS_LOST and action <= Action.WARN:
        expected = Mode.POSITION
    assert desk.vehicle.autopilot.mode is expected
    desk.exchange()
    said = any(text.startswith(cause.value) for text in desk.texts())
    assert said == (action is not Action.NOTHING)
    critical = of(desk.pass_wall_time(1.1), "HEARTBEAT")[-1].system_status
    if action is Action.TERMINATE:
        assert critical == mav.MAV_STATE_FLIGHT_TERMINATION
    else:
        assert (critical == mav.MAV_STATE_CRITICAL) == (action > Action.WARN)
    if expected in (Mode.RETURN, Mode.LAND, Mode.TERMINATED):
        desk.fly()
        assert desk.mass.on_ground
        assert not desk.mass.armed
        lands_at = 0.0 if expected is Mode.RETURN else 80.0
        assert desk.mass.belief.pos_ned_m[0] == pytest.approx(lands_at, abs=0.5)


def test_holding_stops_what_is_being_flown() -> None:
    desk = hovering({"GF_ACTION": 2})
    desk.upload([item(0, mav.MAV_CMD_NAV_WAYPOINT, north=400.0)])
    desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 4)
    desk.fly(seconds=5.0)
    desk.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 100.0)
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    assert desk.mass.belief.pos_ned_m[0] < 160.0


def test_whoever_flies_may_override_a_failsafe() -> None:
    desk = hovering()
    drain(desk, 0.06)
    assert desk.vehicle.autopilot.mode is Mode.RETURN
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 3) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    drain(desk, 0.04)  # but the next one comes
    assert desk.vehicle.autopilot.mode is Mode.LAND


def test_a_weaker_action_does_not_undo_a_stronger_one() -> None:
    desk = hovering()
    desk.command(mav.MAV_CMD_NAV_LAND)
    drain(desk, 0.06)
    assert desk.vehicle.autopilot.mode is Mode.LAND


def test_without_position_a_return_becomes_a_landing() -> None:
    desk = hovering({"COM_POSLOSS_ACT": 1})
    lose_gnss(desk)
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    drain(desk, 0.06)
    assert desk.vehicle.autopilot.mode is Mode.LAND
    assert "return not possible (no position estimate), land" in desk.recorder.texts("failsafe")


def test_causes_end_and_come_again() -> None:
    desk = hovering({"NAV_DLL_ACT": 1})
    lose_ground_station(desk)
    desk.send(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    assert "Ground station lost: over" in desk.texts()
    lose_ground_station(desk)
    assert len(desk.recorder.texts("failsafe")) == 2


def test_no_arming_without_gnss_or_charge() -> None:
    desk = Desk()
    desk.mass.gnss_works = False
    desk.fly(seconds=2.0)
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "COMPONENT_ARM_DISARM refused: no GNSS solution" in desk.texts()
    status = of(desk.pass_wall_time(1.0), "SYS_STATUS")[-1]
    assert not status.onboard_control_sensors_health & mav.MAV_SYS_STATUS_SENSOR_GPS
    assert not status.onboard_control_sensors_health & mav.MAV_SYS_STATUS_PREARM_CHECK
    assert of(desk.heard, "GPS_RAW_INT")[-1].fix_type == mav.GPS_FIX_TYPE_NO_FIX
    desk.mass.gnss_works = True
    drain(desk, 0.05)
    desk.fly(seconds=1.0)
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "COMPONENT_ARM_DISARM refused: battery critical" in desk.texts()


def test_no_take_off_with_a_battery_that_became_critical_after_arming() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_ACCEPTED
    desk.upload([item(0, mav.MAV_CMD_NAV_WAYPOINT, north=40.0)])
    drain(desk, 0.06)
    flight = desk.vehicle.autopilot.flight
    assert flight.take_off(None) == flight.fly_mission() == "battery critical"
    assert desk.recorder.texts("failsafe") == [
        "Battery low: 6 % left",
        "Battery critical: 6 % left",
    ]


def test_what_fails_on_the_ground_is_acted_on_in_the_air_once_a_flight() -> None:
    desk = Desk(VehicleConfig(parameters={"NAV_DLL_ACT": 2}))
    flight = desk.vehicle.autopilot.flight
    for _ in range(2):
        assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_ACCEPTED
        lose_ground_station(desk)
        assert flight.take_off(None) is None
        desk.fly(seconds=1.0)
        desk.exchange()
        assert flight.mode is Mode.RETURN
        assert flight.hold() is None  # overridden
        desk.pass_wall_time(1.0)
        assert flight.mode is Mode.HOLD
        assert flight.land() is None
        desk.fly()
    assert len(desk.recorder.texts("failsafe")) == 4  # told on the ground, acted on in the air


def test_setpoints_lost_on_the_ground_do_not_end_a_flight_without_them() -> None:
    desk = Desk()
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_ACCEPTED
    lose_setpoints(desk)
    assert desk.recorder.texts("failsafe") == ["Offboard setpoints lost: 1.1 s"]
    assert desk.vehicle.autopilot.flight.take_off(None) is None
    desk.fly(seconds=1.0)
    desk.exchange()
    assert desk.vehicle.autopilot.mode is Mode.TAKEOFF


SQUARE = [(-50.0, -50.0), (150.0, -50.0), (150.0, 50.0), (-50.0, 50.0)]
INCLUSION = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION


def fence_items() -> list[object]:
    """A square to stay in and a circle in it to stay out of."""
    kind, frame = mav.MAV_MISSION_TYPE_FENCE, mav.MAV_FRAME_GLOBAL_INT
    corners = [
        item(
            i, INCLUSION, north=n, east=e, height=0.0,
            params=(4.0, 0, 0, 0), frame=frame, mission_type=kind,
        )
        for i, (n, e) in enumerate(SQUARE)
    ]  # fmt: skip
    circle = item(
        4, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, north=100.0, east=0.0, height=0.0,
        params=(20.0, 0, 0, 0), frame=frame, mission_type=kind,
    )  # fmt: skip
    return [*corners, circle]


def test_fence_of_polygons_and_circles() -> None:
    desk = hovering()
    assert desk.upload(fence_items(), mav.MAV_MISSION_TYPE_FENCE) == mav.MAV_MISSION_ACCEPTED
    flight = desk.vehicle.autopilot.flight
    inside, outside, excluded = (60.0, 0.0), (60.0, 51.0), (100.0, 19.0)
    assert flight.guard.forbidden(np.array([*inside, -30.0])) == ""
    assert flight.guard.forbidden(np.array([*outside, -30.0])) == "outside the fence"
    assert flight.guard.forbidden(np.array([*excluded, -30.0])) == "inside an excluded area"
    assert flight.go_to(np.array([*outside, -30.0])) == "the position is outside the fence"
    desk.upload([item(0, mav.MAV_CMD_NAV_WAYPOINT, north=60.0, east=80.0)])
    assert flight.fly_mission() == "the mission leads outside the fence"
    assert desk.command(mav.MAV_CMD_DO_FENCE_ENABLE, 0) == mav.MAV_RESULT_ACCEPTED
    assert flight.fly_mission() is None
    desk.fly(seconds=2.0)
    assert desk.vehicle.autopilot.mode is Mode.MISSION
    assert desk.command(mav.MAV_CMD_DO_FENCE_ENABLE, 1) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    assert desk.mass.belief.pos_ned_m[1] < 75.0


def test_polygons_may_be_concave_and_turn_either_way() -> None:
    corners = np.array([[0, 0], [40, 0], [40, 40], [20, 40], [20, 20], [0, 20]], dtype=float)
    inside = [(1, 1), (39, 1), (39, 39), (21, 39), (1, 19), (19, 19)]
    outside = [(-1, 1), (41, 1), (-30, 10), (1, 21), (19, 21), (19, 39), (60, 39), (1, -1), (1, 50)]
    for shape in (corners, corners[::-1]):
        fence = Fence((shape,), groups=(0,))
        assert fence.breach(np.array([(*place, -9.0) for place in inside])) == ""
        assert all(fence.breach(np.array([*place, -9.0])) for place in outside)


def test_the_fence_in_the_vehicles_status() -> None:
    bit = mav.MAV_SYS_STATUS_GEOFENCE

    def status(desk: Desk) -> tuple[bool, bool]:
        message = of(desk.pass_wall_time(1.0), "SYS_STATUS")[-1]
        return (
            bool(message.onboard_control_sensors_present & bit),
            bool(message.onboard_control_sensors_health & bit),
        )

    desk = hovering({"GF_ACTION": 1})
    assert status(desk) == (False, True)
    desk.upload(fence_items(), mav.MAV_MISSION_TYPE_FENCE)
    assert status(desk) == (True, True)
    breach_fence(desk)
    assert status(desk) == (True, False)


def test_a_polygon_that_lacks_corners_is_refused() -> None:
    desk = Desk()
    broken = fence_items()[:3]
    verdict = desk.upload(broken, mav.MAV_MISSION_TYPE_FENCE)
    assert verdict == mav.MAV_MISSION_INVALID_PARAM1
    assert "fence item 0: a polygon of 4 corners is needed" in desk.texts()


def test_a_polygon_without_end_is_refused() -> None:
    corner = item(
        0,
        mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        params=(math.inf, 0.0, 0.0, 0.0),
        mission_type=mav.MAV_MISSION_TYPE_FENCE,
    )
    verdict = Desk().upload([corner], mav.MAV_MISSION_TYPE_FENCE)
    assert verdict == mav.MAV_MISSION_INVALID_PARAM1


INJECT = mav.MAV_CMD_INJECT_FAILURE


def test_failures_by_command() -> None:
    desk = Desk()
    gnss, motor = mav.FAILURE_UNIT_SENSOR_GPS, mav.FAILURE_UNIT_SYSTEM_MOTOR
    assert desk.command(INJECT, gnss, mav.FAILURE_TYPE_OFF, 0) == mav.MAV_RESULT_ACCEPTED
    assert desk.command(INJECT, motor, mav.FAILURE_TYPE_OFF, 2) == mav.MAV_RESULT_ACCEPTED
    assert [fault.kind for fault in desk.mass.faults.active] == ["gnss_off", "motor_loss"]
    assert desk.mass.faults.active[1].motor == 1  # type: ignore[union-attr]
    assert desk.command(INJECT, gnss, mav.FAILURE_TYPE_OK, 0) == mav.MAV_RESULT_ACCEPTED
    assert [fault.kind for fault in desk.mass.faults.active] == ["motor_loss"]
    assert desk.command(INJECT, motor, mav.FAILURE_TYPE_OK, 1) == mav.MAV_RESULT_ACCEPTED
    assert len(desk.mass.faults.active) == 1
    assert desk.command(INJECT, motor, mav.FAILURE_TYPE_OFF, 5) == mav.MAV_RESULT_DENIED
    for odd in (0.5, 1.5, -1.0, math.inf):  # 0 means all
        assert desk.command(INJECT, motor, mav.FAILURE_TYPE_OFF, odd) == mav.MAV_RESULT_DENIED
    unsupported = mav.MAV_RESULT_UNSUPPORTED
    for odd in (0.5, math.inf, math.nan):
        assert desk.command(INJECT, motor + odd, mav.FAILURE_TYPE_OFF, 1) == unsupported
        assert desk.command(INJECT, motor, mav.FAILURE_TYPE_OFF + odd, 1) == unsupported
    assert desk.command(INJECT, gnss, mav.FAILURE_TYPE_SLOW, 0) == unsupported
    assert desk.command(INJECT, mav.FAILURE_UNIT_SENSOR_VIO, 1, 0) == unsupported
    assert desk.recorder.texts("fault") == [
        "Fault begins: gnss_off",
        "Fault begins: motor_loss",
        "Fault ends: gnss_off",
    ]
    desk.vehicle.autopilot.parameters.set("SYS_FAILURE_EN", 0)
    assert desk.command(INJECT, gnss, mav.FAILURE_TYPE_OFF, 0) == mav.MAV_RESULT_DENIED


@pytest.mark.slow
def test_configured_faults_and_the_failsafe_on_the_real_aircraft() -> None:
    """GNSS fails in the hover: said at once, dead reckoning for a while, then the landing."""
    faults = (GnssOff(at_s=20.0), WindBurst(at_s=22.0, duration_s=2.0, north_mps=3.0))
    recorder = Recorder()
    vehicle = make_vehicle(
        recorder,
        config=VehicleConfig(
            aircraft=AircraftConfig(faults=faults), parameters={"COM_POS_FS_DELAY": 5.0}
        ),
    )
    flight = vehicle.autopilot.flight
    while vehicle.moving:
        vehicle.step()
    assert flight.arm() is None
    assert flight.take_off(HOME.alt_msl_m + 15.0) is None
    while vehicle.t_ns < 27e9:
        vehicle.step()
    assert flight.mode is Mode.LAND
    while vehicle.moving:
        vehicle.step()
    assert not vehicle.aircraft.armed
    assert recorder.texts("fault") == [
        "Fault begins: gnss_off",
        "Fault begins: wind_burst",
        "Fault ends: wind_burst",
    ]
    (lost,) = recorder.of_kind("failsafe")
    assert lost.text == "GNSS lost: no solution for 5 s, land"
    assert 25.0 <= lost.t_ns * 1e-9 <= 25.5
    assert not math.isnan(vehicle.aircraft.belief.alt_rel_m)
