"""What firmwares are started with for our aircraft: arguments, ports, streams and parameters."""

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from firmware_stand_ins import plant, px4_stand_in, script
from sitl_mavsdk import HOME

from flightdyn.config import AircraftConfig
from native.errors import FirmwareSilentError
from sitl.autopilot.parameters import parameters_of
from sitl.config import FirmwareConfig, VehicleConfig
from sitl.firmware.ardupilot import airframe_parameters as of_copter
from sitl.firmware.ardupilot import ardupilot_launch, check_arducopter
from sitl.firmware.launch import LaunchOptions
from sitl.firmware.px4 import airframe_parameters as of_px4
from sitl.firmware.px4 import px4_launch


def test_legs_without_a_speed_are_as_fast_under_a_firmware_as_they_are_planned() -> None:
    """The mission's own speed is ordered with each mission that has one."""
    options = LaunchOptions(VehicleConfig(), 1, 2, 20.0)
    px4, copter = of_px4(options, plant()), of_copter(options, plant())
    cruise_mps = parameters_of(VehicleConfig())["MPC_XY_CRUISE"]
    assert (px4["MPC_XY_CRUISE"], px4["MPC_XY_VEL_MAX"]) == (cruise_mps, 20.0)
    assert copter["WPNAV_SPEED"] == 100 * cruise_mps
    assert copter["WP_SPD"] == cruise_mps


def test_every_parameter_that_a_firmware_is_given_for_our_aircraft() -> None:
    """In each firmware's units, from limits of 5 m/s2, 0.4 s of smoothing, 60 deg, 4 m/s up and
    2.5 m/s down, and a receiver of 5 Hz whose fixes are 120 ms old."""
    options = LaunchOptions(VehicleConfig(), 1, 2, 20.0)
    assert of_copter(options, plant(250)) == pytest.approx({
        "FRAME_CLASS": 1, "FRAME_TYPE": 1, "MOT_PWM_MIN": 1000, "MOT_PWM_MAX": 2000,
        "MOT_THST_EXPO": 0.82, "MOT_THST_HOVER": 0.17, "SIM_RATE_HZ": 250,
        "FS_THR_ENABLE": 0, "FS_GCS_ENABLE": 0, "BATT_MONITOR": 0,
        "ANGLE_MAX": 6000, "WPNAV_SPEED": 1000, "WP_SPD": 10, "WPNAV_ACCEL": 500,
        "WPNAV_JERK": 5 / 0.4, "WPNAV_SPEED_UP": 400, "WPNAV_SPEED_DN": 250,
        "LOG_DISARMED": 0, "LOG_BACKEND_TYPE": 0,
        "ATC_RAT_RLL_P": 0.0675, "ATC_RAT_RLL_I": 0.0675, "ATC_RAT_RLL_D": 0.0018,
        "ATC_RAT_PIT_P": 0.0675, "ATC_RAT_PIT_I": 0.0675, "ATC_RAT_PIT_D": 0.0018,
        "SIM_DRIFT_SPEED": 0, "SIM_BARO_RND": 0, "SIM_BARO2_RND": 0, "SIM_BARO_DRIFT": 0,
        "SIM_MAG_RND": 4.0 * 3**0.5,  # a standard deviation of 4 milligauss, uniform
        "SIM_GPS1_HZ": 5, "SIM_GPS1_LAG_MS": 120, "SIM_GPS1_NUMSATS": 14, "SIM_GPS1_NOISE": 0,
        "GPS1_DELAY_MS": 120,
        **{f"COMPASS_OFS{n}_{axis}": by for n in ("", 2, 3)
           for axis, by in (("X", 5), ("Y", 13), ("Z", -18))},
    })  # fmt: skip
    px4 = of_px4(options, plant())
    arm_m = 0.25 * 0.5**0.5  # an arm of 25 cm at 45 degrees to the nose
    for rotor, (ahead, right, turns) in enumerate(
        ((1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))
    ):
        place = px4.pop(f"CA_ROTOR{rotor}_PX"), px4.pop(f"CA_ROTOR{rotor}_PY")
        assert place == pytest.approx((ahead * arm_m, right * arm_m))
        assert px4.pop(f"CA_ROTOR{rotor}_KM") == pytest.approx(turns * 0.0158, rel=2e-3)
    assert px4 == pytest.approx({
        "THR_MDL_FAC": 0.82, "MC_ROLLRATE_K": 0.25, "MC_PITCHRATE_K": 0.25,
        "EKF2_GPS_DELAY": 120, "EKF2_GPS_CHECK": 31, "MPC_XY_VEL_MAX": 20, "MPC_XY_CRUISE": 10,
        "MPC_ACC_HOR": 5, "MPC_JERK_AUTO": 12.5, "MPC_TILTMAX_AIR": 60, "MPC_Z_VEL_MAX_UP": 4,
        "MPC_Z_V_AUTO_UP": 4, "MPC_Z_VEL_MAX_DN": 2.5, "MPC_Z_V_AUTO_DN": 2.5,
        "MPC_THR_HOVER": 0.17, "SIM_BAT_ENABLE": 0, "COM_FLTT_LOW_ACT": 0, "COM_FAIL_ACT_T": 0,
        "SDLOG_MODE": -1,
    })  # fmt: skip


SLOW = {
    "acceleration_mps2": 0.5, "smoothing_s": 0.0, "tilt_deg": 10, "speed_mps": 1, "climb_mps": 0.2,
    "descent_mps": 0.2,
}  # fmt: skip
FAST = {
    "acceleration_mps2": 10, "smoothing_s": 2, "tilt_deg": 75, "speed_mps": 30, "climb_mps": 8,
    "descent_mps": 5,
}  # fmt: skip


@pytest.mark.parametrize(
    ("limits", "mission_mps", "px4", "copter"),
    [
        (SLOW, 4.0, (4, 4, 2, 5, 20, 0.2, 0.2, 0.2, 0.2), (1000, 1000, 50, 5, 20, 20)),
        (SLOW, 0.5, (1, 1, 2, 5, 20, 0.2, 0.2, 0.2, 0.2), (1000, 1000, 50, 5, 20, 20)),
        (FAST, 4.0, (20, 10, 10, 5, 75, 8, 8, 4, 4), (7500, 1000, 500, 5, 800, 500)),
        ({**FAST, "smoothing_s": 0.05}, 25.0, (20, 10, 10, 80, 75, 8, 8, 4, 4),
         (7500, 1000, 500, 20, 800, 500)),
        ({**SLOW, "smoothing_s": 2.0, "descent_mps": 3.9}, 4.0,
         (4, 4, 2, 1, 20, 0.2, 0.2, 3.9, 3.9), (1000, 1000, 50, 0.25, 20, 390)),
    ],
)  # fmt: skip
def test_limits_stay_in_the_ranges_that_firmwares_take(
    limits: dict[str, float], mission_mps: float, px4: Any, copter: Any
) -> None:
    """The cruise is 10 m/s unless the aircraft is slower; ArduPilot limits no speed of its own."""
    aircraft = AircraftConfig.model_validate({"limits": limits})
    options = LaunchOptions(VehicleConfig(aircraft=aircraft), 1, 2, mission_mps)
    said = of_px4(options, plant())
    names = (
        "MPC_XY_VEL_MAX", "MPC_XY_CRUISE", "MPC_ACC_HOR", "MPC_JERK_AUTO", "MPC_TILTMAX_AIR",
        "MPC_Z_VEL_MAX_UP", "MPC_Z_V_AUTO_UP", "MPC_Z_VEL_MAX_DN", "MPC_Z_V_AUTO_DN",
    )  # fmt: skip
    assert tuple(said[name] for name in names) == pytest.approx(px4)
    heard = of_copter(options, plant())
    theirs = (
        "ANGLE_MAX", "WPNAV_SPEED", "WPNAV_ACCEL", "WPNAV_JERK", "WPNAV_SPEED_UP",
        "WPNAV_SPEED_DN",
    )  # fmt: skip
    assert tuple(heard[name] for name in theirs) == pytest.approx(copter)


def test_receivers_are_said_to_firmwares_in_whole_numbers() -> None:
    for delay_s, px4_ms, lag_ms, least_ms in (
        (0.0, 0, 0, 1),
        (0.0016, 2, 2, 2),
        (0.5, 500, 500, 500),
    ):
        sensors = {"gnss": {"interval_s": 0.3, "delay_s": delay_s, "satellites": 9}}
        aircraft = AircraftConfig.model_validate({"sensors": sensors})
        options = LaunchOptions(VehicleConfig(aircraft=aircraft), 1, 2, 10.0)
        assert of_px4(options, plant())["EKF2_GPS_DELAY"] == px4_ms
        said = of_copter(options, plant(1000))
        names = (
            "SIM_GPS1_HZ",
            "SIM_GPS1_LAG_MS",
            "GPS1_DELAY_MS",
            "SIM_GPS1_NUMSATS",
            "SIM_RATE_HZ",
        )
        assert [said[name] for name in names] == [3, lag_ms, least_ms, 9, 1000]


def test_px4_is_started_with_its_ports_streams_and_parameters(tmp_path: Path) -> None:
    config = px4_stand_in(tmp_path).model_copy(
        update={
            "system_id": 7,
            "firmware": FirmwareConfig(
                path=tmp_path / "bin" / "px4", arguments=("-v",),
                parameters={"SDLOG_MODE": 2.0, "MY_SHARE": 0.125},
            ),
        }
    )  # fmt: skip
    launch = px4_launch(LaunchOptions(config, 14_550, 18_570, 10.0), plant())
    instance = launch.bridge.port - 4560
    launch.bridge.close()
    assert 40 <= instance <= 239
    assert launch.argv == (
        str(tmp_path / "bin" / "px4"), "-d", "-i", str(instance), str(tmp_path / "etc"), "-w", ".",
        "-v",
    )  # fmt: skip
    assert (launch.env["PX4_SIM_MODEL"], launch.env["PWD"]) == ("none_iris", "/proc/self/cwd")
    assert launch.env["PATH"].startswith(".:/")
    first, start, *streams, last = launch.files["px4-rc.mavlink"].split("\n")
    assert (first, last) == ("#!/bin/sh", "")
    assert start == "mavlink start -x -u 18570 -r 4000000 -f -m custom -o 14550"
    assert sorted(streams) == sorted(
        f"mavlink stream -u 18570 -s {name} -r {rate}"
        for name, rate in {
            "HEARTBEAT": 5, "SYS_STATUS": 2, "STATUSTEXT": 20, "ATTITUDE": 10,
            "ATTITUDE_QUATERNION": 10, "GLOBAL_POSITION_INT": 20, "GPS_RAW_INT": 2,
            "HOME_POSITION": 1, "EXTENDED_SYS_STATE": 5, "BATTERY_STATUS": 1,
            "ESTIMATOR_STATUS": 1, "VFR_HUD": 4,
        }.items()
    )  # fmt: skip
    first, system, *lines, last = launch.files["px4-rc.params"].split("\n")
    assert (first, system, last) == ("#!/bin/sh", "param set MAV_SYS_ID 7", "")
    said = dict(line.removeprefix("param set ").split() for line in lines)
    assert (said["SDLOG_MODE"], said["MY_SHARE"]) == ("2", "0.125")  # ours, over theirs
    assert (said["EKF2_GPS_CHECK"], said["MC_ROLLRATE_K"]) == ("31", "0.25")


def test_arducopter_is_started_where_it_stands_and_with_its_ports(tmp_path: Path) -> None:
    binary = script(tmp_path / "arducopter", "exit 0")
    aircraft = AircraftConfig(heading_deg=123.456)
    config = VehicleConfig(
        autopilot="ardupilot", aircraft=aircraft, system_id=9,
        firmware=FirmwareConfig(
            path=Path(binary), arguments=("--wipe",), parameters={"ANGLE_MAX": 3000, "MINE": 1 / 3}
        ),
    )  # fmt: skip
    launch = ardupilot_launch(LaunchOptions(config, 14_550, 5501, 10.0), plant())
    port = launch.bridge.port
    launch.bridge.close()
    assert port >= 1024
    home = f"{HOME.lat_deg:.9f},{HOME.lon_deg:.9f},{HOME.alt_msl_m:.3f},123.46"
    assert launch.argv == (
        binary, "--model", "JSON:127.0.0.1", "--sim-port-out", str(port), "--home", home,
        "--defaults", "aerofed.parm", "--serial0", "udpclient:127.0.0.1:14550",
        "--serial1", "none:1", "--serial2", "none:2", "--rc-in-port", "5501", "--sysid", "9",
        "--wipe",
    )  # fmt: skip
    (text,) = launch.files.values()
    lines = text.splitlines()
    assert {"FRAME_CLASS 1", "ANGLE_MAX 3000", "MINE 0.333333333", "SIM_RATE_HZ 250"} <= {*lines}
    assert [line for line in lines if line.startswith("ANGLE_MAX")] == ["ANGLE_MAX 3000"]


def test_arducopter_is_known_by_what_it_says_of_itself(tmp_path: Path) -> None:
    binary = tmp_path / "arducopter"
    for content, known in ((b"\x7fELF ArduCopter V4.6", True), (b"\x7fELF ArduPlane V4", False)):
        binary.write_bytes(content)
        binary.chmod(0o755)
        with nullcontext() if known else pytest.raises(FirmwareSilentError, match="not ArduCopter"):
            check_arducopter(binary)
