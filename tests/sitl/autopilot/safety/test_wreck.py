"""What the autopilot says and does after a crash."""

import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of, the
from sitl_mavsdk import HOME, Recorder, make_vehicle

from flightdyn.aircraft import Aircraft
from flightdyn.faults import GnssJump, GnssOff, MotorLoss
from sitl.autopilot.flying.modes import Mode
from sitl.vehicle import Vehicle

TEXT = "Crashed: hit the ground at 9.9 m/s"


def crashed_in_a_mission() -> Desk:
    """The point mass plays an aircraft that has just hit the ground."""
    desk = Desk()
    desk.take_off()
    waypoint = mav.MAV_CMD_NAV_WAYPOINT
    places = [item(0, waypoint, north=100.0), item(1, waypoint, north=300.0)]
    assert desk.upload(places) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 0) == mav.MAV_RESULT_ACCEPTED
    desk.fly(seconds=3.0)
    assert desk.vehicle.moving
    desk.mass.armed = False
    desk.mass.crashed, desk.mass.impact_mps = True, 9.9
    desk.fly(seconds=0.1)
    return desk


def test_a_crash_ends_the_flight_and_is_said_once() -> None:
    desk = crashed_in_a_mission()
    assert not desk.vehicle.moving
    heard = desk.exchange()
    assert the(heard, "STATUSTEXT").severity == mav.MAV_SEVERITY_CRITICAL
    assert desk.texts().count(TEXT) == 1
    beat = the(heard, "HEARTBEAT")
    assert beat.system_status == mav.MAV_STATE_FLIGHT_TERMINATION
    assert not beat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED
    landed = the(heard, "EXTENDED_SYS_STATE").landed_state
    assert landed == mav.MAV_LANDED_STATE_UNDEFINED  # whoever waits for a landing goes on waiting
    assert of(heard, "MISSION_CURRENT")[-1].mission_state != mav.MISSION_STATE_COMPLETE
    assert desk.recorder.texts("armed") == ["armed", "disarmed"]
    assert desk.recorder.texts("mode")[-1] == "TERMINATED (crashed)"
    desk.fly(seconds=5.0)
    desk.exchange()
    assert desk.texts().count(TEXT) == 1


def test_a_wreck_takes_no_orders() -> None:
    desk = crashed_in_a_mission()
    desk.mass.armed = False
    for number in (
        mav.MAV_CMD_NAV_TAKEOFF,
        mav.MAV_CMD_MISSION_START,
        mav.MAV_CMD_NAV_LAND,
        mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    ):
        assert desk.command(number, 0) != mav.MAV_RESULT_ACCEPTED
    assert desk.vehicle.autopilot.flight.rewind_mission(0, reset=True) is None
    assert not desk.vehicle.moving


def fly(vehicle: Vehicle) -> None:
    limit_ns = vehicle.t_ns + 120_000_000_000
    while vehicle.moving and vehicle.t_ns < limit_ns:
        vehicle.step()


@pytest.mark.parametrize("height_m", [3.0, 30.0, 100.0])
def test_termination_in_the_air_ends_in_a_wreck(height_m: float) -> None:
    recorder = Recorder()
    vehicle = make_vehicle(recorder)
    flight = vehicle.autopilot.flight
    fly(vehicle)
    assert flight.arm() is None
    assert flight.take_off(HOME.alt_msl_m + height_m) is None
    fly(vehicle)
    assert flight.mode is Mode.HOLD
    assert flight.terminate("by the test") is None
    fly(vehicle)
    assert not vehicle.moving
    assert vehicle.aircraft.crashed
    assert vehicle.aircraft.why_not_ready == "crashed"
    assert flight.arm() == "crashed"
    (said,) = [text for text in recorder.texts("status") if text.startswith("Crashed")]
    assert said == f"Crashed: hit the ground at {vehicle.aircraft.impact_mps:.1f} m/s"
    stopped_ns = vehicle.t_ns
    assert flight.land() is not None
    assert vehicle.t_ns == stopped_ns


def test_the_end_of_one_failure_does_not_begin_the_others_again() -> None:
    """OK for the motor leaves the receiver's outage its own end."""
    vehicle = make_vehicle()
    aircraft: Aircraft = vehicle.aircraft
    aircraft.inject(GnssOff(duration_s=3.0))
    aircraft.inject(GnssJump(north_m=5.0))
    aircraft.inject(MotorLoss(motor=1))
    end = aircraft.t_ns + 3.2e9
    while aircraft.t_ns < end - 1.2e9:
        vehicle.step()
    desk_out = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    ok = mav.MAVLink_command_long_message(
        1, 1, mav.MAV_CMD_INJECT_FAILURE, 0,
        mav.FAILURE_UNIT_SYSTEM_MOTOR, mav.FAILURE_TYPE_OK, 0, 0, 0, 0, 0,
    )  # fmt: skip
    vehicle.receive(bytes(ok.pack(desk_out)), 1.0)
    assert [fault.kind for fault in aircraft.faults.active] == ["gnss_off", "gnss_jump"]
    while aircraft.t_ns < end:
        vehicle.step()
    assert [fault.kind for fault in aircraft.faults.active] == ["gnss_jump"]
