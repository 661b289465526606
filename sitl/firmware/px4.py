"""PX4 for our aircraft: the bridge, HIL messages over TCP in lockstep, and how PX4 is started, by
its own start-up script with two of its hooks.

PX4 connects to us. HIL_SENSOR carries its clock; until it has answered the first one with
HIL_ACTUATOR_CONTROLS it is booting, and time goes on at the pace of wall time; from then on each
tick waits for its answer. Terms: PX4's module simulator_mavlink.
"""

import fcntl
import math
import os
import shlex
import socket
import struct
import time
from pathlib import Path

from flightdyn.config import LimitsConfig
from flightdyn.physics.air import altitude_m, temperature_k
from flightdyn.physics.airframe.parameters import Airframe
from flightdyn.plant import Plant
from flightdyn.state import GeodeticPoint, GnssFix
from native.errors import FirmwareError, FirmwareRestartedError, FirmwareSilentError, LinkLostError
from sitl.autopilot.codec import units as u
from sitl.firmware.bridge import LOOK_S, Bridge, bound, give_up_soon
from sitl.firmware.launch import HOVER_THRUST, THRUST_CURVE, Launch, LaunchOptions, check_binary
from sitl.firmware.native.library import FREE_RUNNING, GONE, Hil, hil_send, hil_wait

DEFAULT_PORT = 4560  # of PX4's instance 0
_KELVIN = 273.15
_MAG, _BARO = 0x1C0, 0x1A00  # bits of HIL_SENSOR.fields_updated
_GPS = struct.Struct("<QiiiHHHhhhHBB")
_FIX_3D = 3
_UNKNOWN_COURSE = 65535
# A PX4 is known on a machine by its instance; the lower ones are for people who start it by hand.
INSTANCES = range(40, 240)
_LOCK = "/tmp/px4_lock-{}"
_OUR_LOCK = "/tmp/aerofed_px4_lock-{}"
_MODEL = "none_iris"  # PX4's airframe for a simulator that it is not told about
# With the default gains the rate loop of this airframe oscillates at 12 Hz: one unit of torque is
# 694 rad/s2 of roll, several times that of the vehicles they are for, its rotors lag 41 ms, and a
# tick at 250 Hz passes before the motors answer: no more than 1.02 times those gains is stable.
# A quarter leaves a gain margin of 12 dB.
_RATE_GAIN = 0.25
# Its start-up script takes the name of its folder from the shell and does not quote it, so that no
# path with a space would do. The shell believes this name, which is right in every process.
_HERE = "/proc/self/cwd"
_STREAMS_HZ = {
    "HEARTBEAT": 5,  # which alone tells that it holds, for the next order
    "SYS_STATUS": 2,
    "STATUSTEXT": 20,
    "ATTITUDE": 10,
    "ATTITUDE_QUATERNION": 10,
    "GLOBAL_POSITION_INT": 20,
    "GPS_RAW_INT": 2,
    "HOME_POSITION": 1,
    "EXTENDED_SYS_STATE": 5,
    "BATTERY_STATUS": 1,
    "ESTIMATOR_STATUS": 1,
    "VFR_HUD": 4,
}


class Px4Bridge(Bridge):
    """Steps a plant for the PX4 that connects to `port`."""

    def __init__(self, plant: Plant, *, port: int = DEFAULT_PORT, lock: int | None = None) -> None:
        """`lock` is a descriptor that is closed with the bridge.

        Raises:
            InputError: the plant has no sensors.
        """
        self._hil = Hil()  # what goes between PX4 and here
        super().__init__(plant, self._hil, port)
        self._hil.sensor.temperature_c = temperature_k(plant.frame.origin.alt_msl_m) - _KELVIN
        self._lock = lock
        self._connection: socket.socket | None = None
        self.booting = True  # it has answered nothing yet
        self._paced_s = 0.0  # wall time of the last tick while PX4 boots

    @property
    def motors(self) -> tuple[float, ...]:
        """Duty cycles (0..1) of the four motors as PX4 wants them, all 0 while disarmed: front
        right, rear left, front left, rear right.
        """
        return tuple(self._hil.motors)

    @property
    def connected(self) -> bool:
        """Whether a firmware has connected."""
        return self._connection is not None

    def open(self) -> None:
        self._socket = bound(socket.SOCK_STREAM, self._port)
        self._socket.listen(1)
        self._socket.settimeout(LOOK_S)

    def run(self, ticks: int) -> int:
        if self.booting:
            return self._boot()
        ticks = min(ticks, self._ticks_to_next())
        done = self._stepped.hil_run(ticks)
        if done == ticks:
            self._send()
        else:
            self._check(self._hil.came)
        return done

    def _boot(self) -> int:
        """Step once at most, at the pace of wall time, while PX4 starts and asks for no tick."""
        if self._connection is None and not self._accept():
            return 0
        self._keep_pace()
        self._check(hil_wait(self._stepped.at, False))
        if self._hil.left:  # the kernel takes no more for now
            return 0
        self._stepped.hil_tick()
        self._send()
        self._check(hil_wait(self._stepped.at, False))
        self.booting = self._hil.answered_us == 0
        return 1

    def _ticks_to_next(self) -> int:
        """Ticks until a sensor other than the IMU, or the plant, is due; at least 1."""
        plant, sensors = self.plant, self._sensors
        ticks = min(sensors.due, plant.due) - plant.clock.tick
        fix_ns = sensors.receiver.due_ns - plant.t_ns
        if fix_ns < ticks * plant.dt_ns:
            ticks = math.ceil(fix_ns / plant.dt_ns)
        return max(ticks, 1)

    def _send(self) -> None:
        """Send HIL_SENSOR of this tick, after HIL_GPS where a solution is due."""
        sensors, t_ns = self._sensors, self.plant.t_ns
        if self.plant.clock.tick >= sensors.due:
            self._read_slow()
        gps = None
        if t_ns >= sensors.receiver.due_ns and (fix := sensors.fix()) is not None:
            gps = gps_payload(t_ns // 1000, fix, self.plant.frame.to_geodetic(fix.pos_ned_m))
        self._check(hil_send(self._stepped.at, gps))

    def _read_slow(self) -> None:
        """Read barometer and magnetometer, if they are due, into the next HIL_SENSOR."""
        says = self._hil.sensor
        baro, mag = self._sensors.slow()
        if mag is not None:
            says.fields |= _MAG
            says.field_gauss[:] = mag.field_frd_gauss
        if baro is not None:
            says.fields |= _BARO
            says.pressure_hpa = baro.pressure_pa / 100
            says.height_m = altitude_m(baro.pressure_pa)

    def _check(self, came: int) -> None:
        """Raise an error where the call of C that gave `came` says that PX4 cannot be flown."""
        if came == GONE:
            why = f": {os.strerror(self._hil.error)}" if self._hil.error else ""
            raise FirmwareRestartedError(f"PX4 has hung up{why}")
        if came == FREE_RUNNING:
            raise FirmwareError(
                "PX4 was built without lockstep: its clock is not ours (build px4_sitl_default)"
            )

    def rest(self) -> None:
        if self._connection is None:
            self._accept()
        else:  # PX4 is silent while its clock stands still
            time.sleep(LOOK_S / 10)

    def close(self) -> None:
        for sock in (self._connection, self._socket):
            if sock is not None:
                sock.close()
        self._connection = self._socket = None
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _accept(self) -> bool:
        assert self._socket is not None
        try:
            connection, _ = self._socket.accept()
        except TimeoutError:
            return False
        connection.settimeout(None)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        give_up_soon(connection)
        self._connection = connection
        self._hil.socket = connection.fileno()
        return True

    def _keep_pace(self) -> None:
        """Sleep to keep wall-time pace, because PX4 starts its modules in wall time."""
        due_s = self._paced_s + self.plant.dt_ns * 1e-9
        now_s = time.monotonic()
        if due_s > now_s:
            time.sleep(due_s - now_s)
        self._paced_s = max(due_s, now_s - 0.1)


def gps_payload(t_us: int, fix: GnssFix, place: GeodeticPoint) -> bytes:
    """Pack HIL_GPS at a time (us) of PX4's clock; `place` is the geodetic position of `fix`."""
    n, e, d = fix.vel_ned_mps.tolist()
    return _GPS.pack(
        t_us,
        u.deg_e7(place.lat_deg),
        u.deg_e7(place.lon_deg),
        u.mm(place.alt_msl_m),
        u.ucm_s(fix.std_horizontal_m),  # cm here: 65535 is not known, as of a speed
        u.ucm_s(fix.std_vertical_m),
        u.ucm_s(math.hypot(n, e)),
        u.cm_s(n),
        u.cm_s(e),
        u.cm_s(d),
        _UNKNOWN_COURSE,
        _FIX_3D,
        min(fix.satellites, 254),  # 255: not known
    )


def px4_launch(options: LaunchOptions, plant: Plant) -> Launch:
    """Open a bridge for a free PX4 instance and prepare PX4 for it.

    Raises:
        LinkLostError: no instance is free.
        FirmwareSilentError: see `etc_of`.
    """
    binary = options.vehicle.firmware.path
    assert binary is not None
    etc = etc_of(binary)
    instance, bridge = _free_instance(plant)
    how = ("-d", "-i", str(instance), str(etc), "-w", ".")
    argv = (str(binary.resolve()), *how, *options.vehicle.firmware.arguments)
    return Launch(
        bridge,
        argv,
        files={"px4-rc.params": _parameters(options, plant), "px4-rc.mavlink": _mavlink(options)},
        # Its folder, where these files are, comes before its own scripts: as the firmware sees it,
        # which a path that is relative to us would lead nowhere.
        env={
            "PX4_SIM_MODEL": _MODEL,
            "PWD": _HERE,
            "PATH": f".{os.pathsep}{os.environ.get('PATH', os.defpath)}",
        },
    )


def etc_of(binary: Path) -> Path:
    """Return the folder of PX4's scripts, beside the binary's own folder.

    Raises:
        FirmwareSilentError: there is no binary, or no such folder.
    """
    check_binary(binary)
    etc = binary.resolve().parent.parent / "etc"
    if not (etc / "init.d-posix" / "rcS").is_file():
        raise FirmwareSilentError(
            f"vehicle.firmware.path = {binary}: this is not PX4: {etc}/init.d-posix/rcS is "
            "missing, which PX4's build puts beside the folder of its binary"
        )
    return etc


def _free_instance(plant: Plant) -> tuple[int, Px4Bridge]:
    """Find a PX4 instance whose port and lock are free, and open its bridge.

    A PX4 takes its lock after it has been started, and ports are one network namespace's; a lock
    of our own, which the bridge holds, keeps two runs apart until then.
    """
    for instance in INSTANCES:
        if (theirs := _hold(_LOCK.format(instance))) is None:
            continue
        os.close(theirs)
        if (ours := _hold(_OUR_LOCK.format(instance))) is None:
            continue
        bridge = Px4Bridge(plant, port=DEFAULT_PORT + instance, lock=ours)
        try:
            bridge.open()
        except LinkLostError:
            bridge.close()
            continue
        return instance, bridge
    first, last = INSTANCES[0] + DEFAULT_PORT, INSTANCES[-1] + DEFAULT_PORT
    raise LinkLostError(f"no TCP port from {first} to {last} is free for another PX4")


def _hold(path: str) -> int | None:
    """Lock a file and return its descriptor; None if somebody else has locked it."""
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except OSError:
        return None  # another user's
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return None
    return lock


def _mavlink(options: LaunchOptions) -> str:
    port = options.its_port
    start = f"mavlink start -x -u {port} -r 4000000 -f -m custom -o {options.our_port}"
    streams = (f"mavlink stream -u {port} -s {k} -r {v}" for k, v in _STREAMS_HZ.items())
    return "\n".join(("#!/bin/sh", start, *streams, ""))


def _parameters(options: LaunchOptions, plant: Plant) -> str:
    vehicle = options.vehicle
    values: dict[str, float] = {"MAV_SYS_ID": vehicle.system_id}
    values |= airframe_parameters(options, plant) | vehicle.firmware.parameters
    return "\n".join(
        ("#!/bin/sh", *(f"param set {shlex.quote(k)} {_number(v)}" for k, v in values.items()), "")
    )


def _number(value: float) -> str:
    """Format a value for `param set`, which takes no decimal point for an integer parameter."""
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def airframe_parameters(options: LaunchOptions, plant: Plant) -> dict[str, float]:
    """Return PX4's parameters for our aircraft: airframe, sensors and limits."""
    aircraft = options.vehicle.aircraft
    limits, gnss = aircraft.limits, aircraft.sensors.gnss
    fast = min(20.0, max(limits.speed_mps, options.speed_mps))  # PX4 takes 20 m/s at most
    return {
        **_geometry(plant.vehicle.airframe),
        "THR_MDL_FAC": THRUST_CURVE,
        "MC_ROLLRATE_K": _RATE_GAIN,
        "MC_PITCHRATE_K": _RATE_GAIN,
        "EKF2_GPS_DELAY": round(gnss.delay_s * 1e3),
        # The receiver's error drifts more at rest than PX4 lets pass before take-off; the checks
        # of satellites, accuracy and speed stay.
        "EKF2_GPS_CHECK": 0b0000011111,
        "MPC_XY_VEL_MAX": fast,
        "MPC_XY_CRUISE": min(fast, options.cruise_mps),
        "MPC_ACC_HOR": min(max(limits.acceleration_mps2, 2.0), 15.0),
        "MPC_JERK_AUTO": _jerk(limits),
        "MPC_TILTMAX_AIR": min(max(limits.tilt_deg, 20.0), 89.0),
        "MPC_Z_VEL_MAX_UP": limits.climb_mps,
        "MPC_Z_V_AUTO_UP": limits.climb_mps,
        "MPC_Z_VEL_MAX_DN": min(limits.descent_mps, 4.0),
        "MPC_Z_V_AUTO_DN": min(limits.descent_mps, 4.0),
        "MPC_THR_HOVER": HOVER_THRUST,
        "SIM_BAT_ENABLE": 0,  # the aircraft's own battery is reported to it
        # PX4 takes no flight time from a battery that is reported to it, and reads that as none
        # left. Nothing shall be done then, and not after a hold, in which somebody may take over.
        "COM_FLTT_LOW_ACT": 0,
        "COM_FAIL_ACT_T": 0,
        "SDLOG_MODE": -1,  # the run's own log holds the flight
    }


def _jerk(limits: LimitsConfig) -> float:
    """Return the jerk limit (m/s3) for missions, in the range that PX4 takes."""
    return min(max(limits.acceleration_mps2 / max(limits.smoothing_s, 0.1), 1.0), 80.0)


def _geometry(airframe: Airframe) -> dict[str, float]:
    """Return PX4's rotor geometry parameters: arms at 45 degrees, in the airframe's order."""
    arm = airframe.arm_m / math.sqrt(2)
    places = ((arm, arm, 1), (-arm, -arm, 1), (arm, -arm, -1), (-arm, arm, -1))
    values: dict[str, float] = {}
    for rotor, (x, y, turns) in enumerate(places):
        values |= {
            f"CA_ROTOR{rotor}_PX": x,
            f"CA_ROTOR{rotor}_PY": y,
            f"CA_ROTOR{rotor}_KM": turns * airframe.torque_per_thrust_m,
        }
    return values
