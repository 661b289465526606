"""Launch of ArduCopter for our aircraft: its command line and parameters."""

import math
from pathlib import Path

from flightdyn.plant import Plant
from sitl.errors import FirmwareSilentError
from sitl.firmware.ardupilot import ArduPilotBridge
from sitl.firmware.launch import HOVER_THRUST, THRUST_CURVE, Launch, LaunchOptions, check_binary

_DEFAULTS = "aerofed.parm"
NAME = b"ArduCopter V"  # of itself, to ground stations
_SCRIPT = b"#!"
_RATE, _RATE_GAIN = {"P": 0.135, "I": 0.135, "D": 0.0036}, 0.5  # its defaults; our share of them


def ardupilot_launch(options: LaunchOptions, plant: Plant) -> Launch:
    """Open a bridge on a free port and prepare ArduCopter for it.

    Raises:
        LinkLostError: no port can be had.
        FirmwareSilentError: see `check_arducopter`.
    """
    binary = options.vehicle.firmware.path
    assert binary is not None
    check_arducopter(binary)
    bridge = ArduPilotBridge(plant, port=0)
    bridge.open()
    home = plant.frame.origin
    heading = options.vehicle.aircraft.heading_deg
    argv = (
        str(binary.resolve()),
        *("--model", "JSON:127.0.0.1"),
        *("--sim-port-out", str(bridge.port)),
        *("--home", f"{home.lat_deg:.9f},{home.lon_deg:.9f},{home.alt_msl_m:.3f},{heading:.2f}"),
        *("--defaults", _DEFAULTS),
        *("--serial0", f"udpclient:127.0.0.1:{options.our_port}"),
        *("--serial1", "none:1"),
        *("--serial2", "none:2"),
        *("--rc-in-port", str(options.its_port)),
        *("--sysid", str(options.vehicle.system_id)),
        *options.vehicle.firmware.arguments,
    )
    values = airframe_parameters(options, plant) | options.vehicle.firmware.parameters
    text = "".join(f"{name} {value:.9g}\n" for name, value in values.items())
    return Launch(bridge, argv, files={_DEFAULTS: text})


def check_arducopter(binary: Path) -> None:
    """Check that a binary is ArduCopter's; a script is accepted whatever it starts.

    Raises:
        FirmwareSilentError: there is no binary, or it is not ArduCopter's.
    """
    check_binary(binary)
    try:
        content = binary.read_bytes()
    except OSError as error:
        raise FirmwareSilentError(
            f"vehicle.firmware.path = {binary}: cannot be read: {error.strerror}"
        ) from None
    if not content.startswith(_SCRIPT) and NAME not in content:
        raise FirmwareSilentError(
            f"vehicle.firmware.path = {binary}: this is not ArduCopter (ArduPilot's build "
            "makes it as build/sitl/bin/arducopter)"
        )


def airframe_parameters(options: LaunchOptions, plant: Plant) -> dict[str, float]:
    """Return ArduCopter's parameters for our aircraft: airframe, sensors and limits.

    Versions differ in names and units; a version ignores what it does not know.
    """
    aircraft = options.vehicle.aircraft
    limits, sensors = aircraft.limits, aircraft.sensors
    values = {
        "FRAME_CLASS": 1,  # four rotors
        "FRAME_TYPE": 1,  # X
        "MOT_PWM_MIN": 1000,
        "MOT_PWM_MAX": 2000,
        "MOT_THST_EXPO": THRUST_CURVE,
        "MOT_THST_HOVER": HOVER_THRUST,
        "SIM_RATE_HZ": round(1e9 / plant.dt_ns),
        "FS_THR_ENABLE": 0,  # nobody holds a remote control
        "FS_GCS_ENABLE": 0,
        "BATT_MONITOR": 0,  # JSON carries no battery: the mission's own reserve watches it
        "ANGLE_MAX": 100 * min(limits.tilt_deg, 80.0),
        "WPNAV_SPEED": min(100 * options.cruise_mps, 2000),
        "WP_SPD": options.cruise_mps,
        "WPNAV_ACCEL": min(100 * limits.acceleration_mps2, 500),
        "WPNAV_JERK": min(limits.acceleration_mps2 / max(limits.smoothing_s, 0.1), 20),
        "WPNAV_SPEED_UP": min(100 * limits.climb_mps, 1000),
        "WPNAV_SPEED_DN": min(100 * limits.descent_mps, 500),
        "LOG_DISARMED": 0,
        "LOG_BACKEND_TYPE": 0,  # the run's own log holds the flight
        # Its own sensor models add nothing to the errors of ours.
        "SIM_DRIFT_SPEED": 0,
        "SIM_BARO_RND": 0,
        "SIM_BARO2_RND": 0,
        "SIM_BARO_DRIFT": 0,
        "SIM_MAG_RND": 1e3 * math.sqrt(3) * sensors.mag.white_gauss,  # uniform, milligauss
        "SIM_GPS1_HZ": round(1 / sensors.gnss.interval_s),
        "SIM_GPS1_LAG_MS": round(1e3 * sensors.gnss.delay_s),
        "SIM_GPS1_NUMSATS": sensors.gnss.satellites,
        "SIM_GPS1_NOISE": 0,
        "GPS1_DELAY_MS": max(1, round(1e3 * sensors.gnss.delay_s)),
    }
    # With its default gains this aircraft, strong for its inertia and with rotors that lag 41 ms,
    # cycles at 8 Hz where it brakes from 20 m/s: there its rotors hardly turn, and air from below
    # lifts it. Half of them do not.
    for axis in ("RLL", "PIT"):
        values |= {f"ATC_RAT_{axis}_{term}": _RATE_GAIN * gain for term, gain in _RATE.items()}
    # What its simulated compasses and accelerometers are off by, so that it takes them for
    # calibrated.
    for n in ("", "2", "3"):
        values |= {f"COMPASS_OFS{n}_X": 5, f"COMPASS_OFS{n}_Y": 13, f"COMPASS_OFS{n}_Z": -18}
    return values
