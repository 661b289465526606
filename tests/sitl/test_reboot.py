"""A rebooted vehicle is a new one; what an autopilot keeps on flash stays."""

from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, the
from sitl_mavsdk import HOME, Recorder

from flightdyn.faults import GnssOff
from flightdyn.random import RandomStreams
from sitl.autopilot.failsafe import Cause
from sitl.autopilot.flying.modes import Mode
from sitl.config import VehicleConfig
from sitl.vehicle import Vehicle

REBOOT = mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN


class RealDesk(Desk):
    """With the real aircraft, which may be rebooted."""

    def __init__(self) -> None:
        super().__init__(ready=False)
        self.recorder = Recorder()
        self.vehicle = Vehicle(
            VehicleConfig(),
            home=HOME,
            streams=RandomStreams(1),
            observers=(self.recorder,),
            standalone=True,
        )
        self.fly()


def lists(desk: Desk, kind: int) -> list[tuple[int, int]]:
    """Command and latitude of what is downloaded."""
    heard = desk.send(mav.MAVLink_mission_request_list_message(1, 1, kind))
    found = []
    for seq in range(the(heard, "MISSION_COUNT").count):
        asked = mav.MAVLink_mission_request_int_message(1, 1, seq, kind)
        back = the(desk.send(asked), "MISSION_ITEM_INT")
        found.append((back.command, back.x))
    return found


def test_a_reboot_makes_the_vehicle_as_new() -> None:
    desk = RealDesk()
    waypoints = [item(i, mav.MAV_CMD_NAV_WAYPOINT, north=40.0 * i) for i in range(3)]
    assert desk.upload(waypoints) == mav.MAV_MISSION_ACCEPTED
    circle = item(
        0, mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, params=(300.0, 0, 0, 0),
        mission_type=mav.MAV_MISSION_TYPE_FENCE,
    )  # fmt: skip
    assert desk.upload([circle], mav.MAV_MISSION_TYPE_FENCE) == mav.MAV_MISSION_ACCEPTED
    kept = [lists(desk, kind) for kind in (0, 1, 2)]
    desk.send(mav.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", 15.0, 9))
    desk.take_off()
    desk.vehicle.aircraft.inject(GnssOff())
    assert desk.command(mav.MAV_CMD_DO_FLIGHTTERMINATION, 1) == mav.MAV_RESULT_ACCEPTED
    # Disarmed, but falling.
    assert desk.command(REBOOT, 1) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert not desk.vehicle.aircraft.crashed
    desk.fly()
    assert desk.vehicle.aircraft.crashed
    old, autopilot = desk.vehicle.aircraft, desk.vehicle.autopilot

    heard = desk.send(mav.MAVLink_command_long_message(1, 1, REBOOT, 0, 1, *[float("nan")] * 6))
    assert the(heard, "COMMAND_ACK").result == mav.MAV_RESULT_ACCEPTED

    assert desk.vehicle.aircraft is not old
    assert desk.vehicle.autopilot is not autopilot
    desk.fly()
    aircraft = desk.vehicle.aircraft
    assert (aircraft.crashed, aircraft.faults.active, aircraft.armed) == (False, (), False)
    assert aircraft.battery.remaining > 0.999
    assert abs(aircraft.truth.pos_ned_m).max() < 0.1
    assert desk.vehicle.autopilot.mode is Mode.HOLD
    assert [lists(desk, kind) for kind in (0, 1, 2)] == kept
    assert desk.vehicle.autopilot.parameters["MIS_TAKEOFF_ALT"] == 15.0
    # The lists are in force, not only stored.
    desk.take_off()
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 0) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert abs(aircraft.belief.pos_ned_m[0] - 80.0) < 1.0
    outside = item(0, 16, north=500.0)
    result = desk.command_int(192, 6, (-1, 0, 0, float("nan")), outside.x, outside.y, 30.0)
    assert result != mav.MAV_RESULT_ACCEPTED


def test_a_fresh_battery_is_seen_though_time_stands_still() -> None:
    vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
    plant = vehicle.aircraft
    plant._battery.consumed_mah = 5000.0
    plant.battery = plant._battery.state()
    vehicle.autopilot.watch()
    failsafes, t_ns = vehicle.autopilot.failsafes, vehicle.t_ns
    assert failsafes.present(Cause.BATTERY_CRITICAL)
    vehicle.exchange_battery()
    assert vehicle.t_ns == t_ns
    assert not failsafes.present(Cause.BATTERY_CRITICAL)


def test_a_rebooted_vehicle_flies_as_a_restarted_one() -> None:
    def flown(desk: RealDesk) -> bytes:
        desk.recorder.samples.clear()
        desk.take_off()
        return desk.recorder.track()

    desk = RealDesk()
    first = flown(desk)
    assert desk.command(mav.MAV_CMD_NAV_LAND) == mav.MAV_RESULT_ACCEPTED
    desk.fly()
    assert not desk.vehicle.aircraft.armed
    assert desk.command(REBOOT, 1) == mav.MAV_RESULT_ACCEPTED
    assert desk.vehicle.t_ns == 0
    desk.fly()
    assert flown(desk) == first


def test_who_may_not_be_rebooted_says_why() -> None:
    desk = Desk()  # as part of a run
    assert desk.command(REBOOT, 1) == mav.MAV_RESULT_DENIED
    said = desk.recorder.texts("status")[-1]
    assert said == "PREFLIGHT_REBOOT_SHUTDOWN refused: the vehicle is part of a run"
    desk = RealDesk()
    assert desk.command(REBOOT, 3) == mav.MAV_RESULT_DENIED
    desk.take_off()
    assert desk.command(REBOOT, 1) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert desk.recorder.texts("status")[-1] == "PREFLIGHT_REBOOT_SHUTDOWN refused: armed"
