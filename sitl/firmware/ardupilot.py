"""ArduCopter for our aircraft: the bridge to its JSON interface over UDP, and how it is started.

ArduPilot asks with the pulses of its motors and waits for a state, one datagram each way a tick.
It makes GNSS, barometer and compass itself, from position, velocity and attitude: so these are
handed over with the errors of our receiver and barometer, and only the IMU's readings go straight
in. Terms: ArduPilot's libraries/SITL/SIM_JSON.
"""

import logging
import math
import select
import socket
import sys
from pathlib import Path

from flightdyn.physics.air import altitude_m
from flightdyn.plant import Plant
from native.errors import FirmwareRestartedError, FirmwareSilentError
from sitl.firmware.bridge import LOOK_S, Bridge, bound, give_up_soon
from sitl.firmware.launch import HOVER_THRUST, THRUST_CURVE, Launch, LaunchOptions, check_binary
from sitl.firmware.native.library import RESTARTED, Json, json_send, json_wait

_logger = logging.getLogger(__name__)

DEFAULT_PORT = 9002
LOOPS_HZ = 400  # of ArduCopter, where SCHED_LOOP_RATE does not say otherwise
_RATES_HZ = (250, 400, 500, 800, 1000)  # whole ticks of everything that the plant does
_DEFAULTS = "aerofed.parm"
NAME = b"ArduCopter V"  # of itself, to ground stations
_SCRIPT = b"#!"
_IP_RECVERR = 11  # Linux's option: a datagram that was refused is told of; not in `socket` yet
_RATE, _RATE_GAIN = {"P": 0.135, "I": 0.135, "D": 0.0036}, 0.5  # its defaults; our share of them


def slowest_rate_hz(loops_hz: float) -> int:
    """Return the tick rate (Hz) that ArduPilot needs to arm: 1.8 ticks a loop, 1000 Hz at most."""
    return next((rate for rate in _RATES_HZ if rate >= 1.8 * loops_hz), _RATES_HZ[-1])


RATE_HZ = slowest_rate_hz(LOOPS_HZ)


class ArduPilotBridge(Bridge):
    """Steps a plant for the ArduPilot that sends to `port`.

    It answers the first process that asks. If one asks from another port and counts from 0, as
    ArduPilot does after a reboot, `run` and `rest` raise FirmwareRestartedError.
    """

    def __init__(self, plant: Plant, *, port: int = DEFAULT_PORT) -> None:
        """Raises InputError where the plant has no sensors."""
        self._json = Json(answered=-1, length=-1)  # what goes between ArduPilot and here
        super().__init__(plant, self._json, port)
        self._baro_error_m = 0.0
        self._warned = False  # of datagrams that are not ArduPilot's

    @property
    def connected(self) -> bool:
        """Whether a firmware has asked for anything."""
        return bool(self._json.peer)

    def open(self) -> None:
        self._socket = bound(socket.SOCK_DGRAM, self._port)
        give_up_soon(self._socket)
        if sys.platform == "linux":  # elsewhere nobody tells, and one that is silent has ended
            self._socket.setsockopt(socket.IPPROTO_IP, _IP_RECVERR, 1)
        self._json.socket = self._socket.fileno()

    def run(self, ticks: int) -> int:
        plant = self.plant
        due = min(self._sensors.due, plant.due)
        ticks = min(ticks, max(due - plant.clock.tick, 1))
        done = self._stepped.json_run(ticks)
        if done == ticks:
            self._send()
        else:
            self._check(self._json.came)
        return done

    def rest(self) -> None:
        # It repeats itself each second while nobody answers: one of these is answered later.
        if select.select([self._json.socket], [], [], LOOK_S / 10)[0]:
            came = json_wait(self._stepped.at)
            self._check(came)
            self._json.asked |= came

    def deserted(self) -> bool:
        assert self._socket is not None
        address = (self._json.peer >> 16).to_bytes(4, sys.byteorder)
        peer = socket.inet_ntoa(address), socket.ntohs(self._json.peer & 0xFFFF)
        try:
            for _ in range(2):  # what follows the first one is refused where nobody is there
                self._socket.sendto(b"", peer)  # which ArduPilot reads as nothing
        except ConnectionRefusedError:
            return True
        return False

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _check(self, came: int) -> None:
        """Raise where ArduPilot has started anew; warn once of datagrams that are not its own."""
        if self._json.length >= 0 and not self._warned:
            self._warned = True
            _logger.warning(
                "UDP port %d: dropped what is no request of ArduPilot's JSON interface: %d bytes "
                "with the magic number %d; known are 40 with 18458 and 72 with 29569",
                *(self.port, self._json.length, self._json.magic),
            )
        if came == RESTARTED:
            raise FirmwareRestartedError("ArduPilot has started anew")

    def _send(self) -> None:
        """Answer the request: a line of JSON with the sensors' readings at this tick."""
        plant, sensors = self.plant, self._sensors
        if plant.clock.tick >= sensors.due:
            baro, _ = sensors.slow()
            sensors.fix()
            if baro is not None:
                true_m = altitude_m(plant.vehicle.pressure_pa())
                self._baro_error_m = altitude_m(baro.pressure_pa) - true_m
            n, e, _ = sensors.receiver.error_ned_m
            velocity = sensors.receiver.velocity_error_ned_mps
            self._json.errors[:] = (n, e, -self._baro_error_m, *velocity)
        json_send(self._stepped.at)


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
        "WPNAV_SPEED": 100 * options.cruise_mps,
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
