"""Telemetry of sensors, setpoints, motors and filter, against what the aircraft does."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of
from sitl_mavsdk import HOME, make_vehicle

from flightdyn.frames import quaternion_from_euler, rotation_matrix
from flightdyn.guidance.control import attitude_along
from sitl.autopilot.codec.instruments import INSTRUMENTS
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.autopilot.protocol.streams import DEFAULT_RATES_HZ, SERVED_RATES_HZ
from sitl.config import VehicleConfig

OK = mav.MAV_RESULT_ACCEPTED
WIND = {"speed_mps": 4.0, "from_deg": 0.0}
SPEED_MPS = 6.0


@pytest.fixture(scope="module")
def desk() -> Desk:
    """A vehicle with all its sensors that flies east at 6 m/s in a wind from the north."""
    config = VehicleConfig.model_validate({"aircraft": {"wind": WIND}})
    desk = Desk(aircraft=make_vehicle(config=config).aircraft)
    desk.take_off(40.0)
    desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, SPEED_MPS)
    flight = desk.vehicle.autopilot.flight
    assert flight.go_to(np.array([0.0, 400.0, -40.0])) is None
    desk.fly(seconds=20.0)
    return desk


def asked(desk: Desk, kind: int) -> Any:
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, kind) == OK
    return of(desk.heard, mav.mavlink_map[kind].msgname)[-1]


def test_inertial_sensors_and_pressure(desk: Desk) -> None:
    imu = asked(desk, mav.MAVLINK_MSG_ID_HIGHRES_IMU)
    force = np.array([imu.xacc, imu.yacc, imu.zacc])
    # It flies straight: what it feels is gravity and nothing else.
    assert np.linalg.norm(force) == pytest.approx(9.81, abs=0.7)
    assert imu.time_usec == desk.vehicle.t_ns // 1000
    assert np.linalg.norm([imu.xmag, imu.ymag, imu.zmag]) == pytest.approx(0.48, abs=0.03)
    assert imu.pressure_alt == pytest.approx(HOME.alt_msl_m + 40.0, abs=8.0)
    assert imu.abs_pressure == pytest.approx(950.0, abs=8.0)  # hPa
    assert imu.fields_updated & 0b1111111111 == 0b1111111111
    for kind in (mav.MAVLINK_MSG_ID_SCALED_IMU, mav.MAVLINK_MSG_ID_RAW_IMU):
        scaled = asked(desk, kind)
        assert scaled.zacc / 1e3 * 9.80665 == pytest.approx(imu.zacc, abs=0.5)
        assert scaled.xmag / 1e3 == pytest.approx(imu.xmag, abs=0.05)
    pressure = asked(desk, mav.MAVLINK_MSG_ID_SCALED_PRESSURE)
    assert pressure.press_abs == pytest.approx(imu.abs_pressure, abs=0.3)
    assert pressure.temperature / 100 == pytest.approx(15.0 - 0.0065 * 528, abs=0.2)


def test_vibration_is_what_the_accelerometer_adds(desk: Desk) -> None:
    shaken = [asked(desk, mav.MAVLINK_MSG_ID_VIBRATION).vibration_x]
    for _ in range(60):
        desk.fly(seconds=0.02)
        shaken.append(asked(desk, mav.MAVLINK_MSG_ID_VIBRATION).vibration_x)
    noise = 1.86e-3 / math.sqrt(0.004)  # white, at 250 Hz
    assert float(np.mean(shaken)) == pytest.approx(noise, rel=0.4)


def test_odometry_is_the_belief(desk: Desk) -> None:
    odometry = asked(desk, mav.MAVLINK_MSG_ID_ODOMETRY)
    local = asked(desk, mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
    assert (odometry.x, odometry.y, odometry.z) == (local.x, local.y, local.z)
    r = np.array(rotation_matrix(tuple(odometry.q))).reshape(3, 3)
    ned = r @ [odometry.vx, odometry.vy, odometry.vz]
    np.testing.assert_allclose(ned, [local.vx, local.vy, local.vz], atol=1e-4)
    assert 0.0 < odometry.pose_covariance[0] < 4.0
    assert odometry.pose_covariance[1] == 0.0
    assert math.isnan(odometry.velocity_covariance[0])
    estimator = asked(desk, mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS)
    across = math.sqrt(odometry.pose_covariance[0] + odometry.pose_covariance[6])
    assert estimator.pos_horiz_accuracy == pytest.approx(across, rel=1e-3)
    assert 0.0 < estimator.pos_horiz_ratio < 1.0
    assert estimator.flags & mav.ESTIMATOR_POS_HORIZ_ABS


def filter_status(gnss: object, stds: Any, **ratios: float) -> Any:
    """ESTIMATOR_STATUS of a filter with such ratios of innovations."""
    readings = SimpleNamespace(stds=stds)
    deferred = SimpleNamespace(
        instruments=SimpleNamespace(readings=readings),
        innovation_ratios={kind.replace("_", " "): ratio for kind, ratio in ratios.items()},
    )
    moment: Any = SimpleNamespace(t_ns=5_000_000, gnss=gnss, deferred=deferred)
    return INSTRUMENTS[mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS](moment)


def test_each_ratio_of_the_filter_has_its_field() -> None:
    ratios = {"gnss_position": 0.25, "gnss_velocity": 0.5, "baro": 2.0, "heading": 0.75}
    said = filter_status(object(), np.array([0.3, 0.4, 0.7]), **ratios)
    assert said.time_usec == 5_000
    assert (said.pos_horiz_ratio, said.vel_ratio) == (0.25, 0.5)
    assert (said.pos_vert_ratio, said.mag_ratio) == (2.0, 0.75)
    assert said.pos_horiz_accuracy == pytest.approx(0.5)
    assert said.pos_vert_accuracy == pytest.approx(0.7)
    assert not said.flags & mav.ESTIMATOR_GPS_GLITCH  # of the barometer, whose jump that is
    assert said.flags & mav.ESTIMATOR_POS_HORIZ_ABS
    for kind in ("gnss_position", "gnss_velocity"):
        refused = filter_status(object(), None, **(ratios | {kind: 1.0}))
        assert refused.flags & mav.ESTIMATOR_GPS_GLITCH, kind


def test_what_has_not_been_measured_has_no_ratio() -> None:
    said = filter_status(None, None)
    assert (said.pos_horiz_ratio, said.vel_ratio, said.pos_vert_ratio, said.mag_ratio) == (0.0,) * 4
    assert (said.pos_horiz_accuracy, said.pos_vert_accuracy) == (0.0, 0.0)
    absolute = mav.ESTIMATOR_POS_HORIZ_ABS | mav.ESTIMATOR_PRED_POS_HORIZ_ABS
    assert not said.flags & (absolute | mav.ESTIMATOR_GPS_GLITCH)


def test_targets_are_what_is_flown(desk: Desk) -> None:
    target = asked(desk, mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED)
    local = asked(desk, mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
    assert (target.x, target.y) == pytest.approx((local.x, local.y), abs=1.0)
    assert (target.vx, target.vy) == pytest.approx((0.0, SPEED_MPS), abs=0.1)
    assert target.yaw == pytest.approx(math.pi / 2, abs=0.05)
    assert target.type_mask == 0
    place = asked(desk, mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT)
    here = asked(desk, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert (place.lat_int, place.lon_int) == pytest.approx((here.lat, here.lon), abs=100)
    assert place.alt == pytest.approx(here.alt / 1e3, abs=0.5)
    wanted = asked(desk, mav.MAVLINK_MSG_ID_ATTITUDE_TARGET)
    q = asked(desk, mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)
    np.testing.assert_allclose(wanted.q, [q.q1, q.q2, q.q3, q.q4], atol=0.05)
    assert wanted.thrust == pytest.approx(0.486, abs=0.03)  # a bit beyond what hovers


def test_motors_and_wind(desk: Desk) -> None:
    servos = asked(desk, mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)
    widths = [servos.servo1_raw, servos.servo2_raw, servos.servo3_raw, servos.servo4_raw]
    assert np.mean(widths) == pytest.approx(1490, abs=30)
    assert servos.servo5_raw == 0
    outputs = asked(desk, mav.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS)
    assert outputs.active == 0b1111
    assert [round(1000 + 1000 * share) for share in outputs.actuator[:4]] == widths
    wind = asked(desk, mav.MAVLINK_MSG_ID_WIND_COV)
    assert (wind.wind_x, wind.wind_y) == pytest.approx((-4.0, 0.0), abs=0.3)


def test_the_simulation_is_where_it_truly_is(desk: Desk) -> None:
    hil = asked(desk, mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)
    seen = asked(desk, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert (hil.lat, hil.lon) != (seen.lat, seen.lon)
    assert hil.alt == pytest.approx(seen.alt, abs=10_000)
    assert hil.vy / 1e2 == pytest.approx(SPEED_MPS, abs=0.3)


def test_an_attitude_is_told_by_thrust_and_heading() -> None:
    q = quaternion_from_euler(0.3, -0.4, 2.0)
    r = rotation_matrix(q)
    np.testing.assert_allclose(
        attitude_along((-7 * r[2], -7 * r[5], -7 * r[8]), yaw=2.0), q, atol=1e-12
    )


def test_without_a_setpoint_every_field_is_to_be_ignored() -> None:
    desk = Desk()
    target = asked(desk, mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED)
    assert target.type_mask == 0b110111111111
    assert math.isnan(target.x)
    assert asked(desk, mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT).type_mask == 0b110111111111
    assert not asked(desk, mav.MAVLINK_MSG_ID_HIGHRES_IMU).fields_updated & 1 << 15
    # Nobody flies round anything: there is nothing to say.
    orbit = mav.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS
    rejected = mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert desk.command(mav.MAV_CMD_REQUEST_MESSAGE, orbit) == rejected
    assert not of(desk.heard, "ORBIT_EXECUTION_STATUS")


def test_an_orbit_says_where_it_is() -> None:
    desk = Desk()
    desk.take_off()
    assert desk.command(34, -12.0, 2.0, 0, math.nan, 47.4, 8.5, HOME.alt_msl_m + 30.0) == OK
    status = asked(desk, mav.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS)
    assert (status.x, status.y) == pytest.approx((474000000, 85000000), abs=40)  # as 32-bit floats
    assert status.radius == -12.0
    assert status.z == pytest.approx(HOME.alt_msl_m + 30.0, abs=0.01)


def test_what_nobody_asked_for_is_streamed_only_where_the_vehicle_stands_alone() -> None:
    assert not set(INSTRUMENTS) & set(DEFAULT_RATES_HZ)
    assert set(SERVED_RATES_HZ) <= set(TELEMETRY)
    assert not of(Desk().pass_wall_time(3.0), "HIGHRES_IMU")


def test_200_times_a_second_where_that_is_asked_for(desk: Desk) -> None:
    assert (
        desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_HIGHRES_IMU, 5000) == OK
    )
    assert len(of(desk.pass_wall_time(1.0, step=0.005), "HIGHRES_IMU")) in (199, 200, 201)
    assert desk.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_HIGHRES_IMU, -1) == OK
    assert not of(desk.pass_wall_time(1.0), "HIGHRES_IMU")
