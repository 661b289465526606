"""The bridge to PX4: HIL messages over TCP, in lockstep.

PX4 connects to us. HIL_SENSOR carries its clock; until it has answered the first one with
HIL_ACTUATOR_CONTROLS it is booting, and time goes on at the pace of wall time; from then on each
tick waits for its answer. Terms: PX4's module simulator_mavlink.
"""

import math
import os
import socket
import struct
import time

from flightdyn.physics.atmosphere import altitude_m, temperature_k
from flightdyn.plant import Plant
from flightdyn.state import GeodeticPoint, GnssFix
from sitl.autopilot.codec import units as u
from sitl.errors import FirmwareError, FirmwareRestartedError
from sitl.firmware.bridge import LOOK_S, Bridge, bound, give_up_soon
from sitl.firmware.native.library import FREE_RUNNING, GONE, Hil, hil_send, hil_wait

DEFAULT_PORT = 4560  # of PX4's instance 0
_KELVIN = 273.15
_MAG, _BARO = 0x1C0, 0x1A00  # bits of HIL_SENSOR.fields_updated
_GPS = struct.Struct("<QiiiHHHhhhHBB")
_FIX_3D = 3
_UNKNOWN_COURSE = 65535


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
        # PX4 is silent while its clock stands still.
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
