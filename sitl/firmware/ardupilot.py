"""The bridge to ArduPilot: its JSON interface over UDP.

ArduPilot asks with the pulses of its motors and waits for a state, one datagram each way a tick.
It makes GNSS, barometer and compass itself, from position, velocity and attitude: so these are
handed over with the errors of our receiver and barometer, and only the IMU's readings go straight
in. Terms: ArduPilot's libraries/SITL/SIM_JSON.
"""

import socket
import struct
from contextlib import suppress

from flightdyn.physics.atmosphere import altitude_m
from flightdyn.plant import Plant
from sitl.firmware.bridge import Readings, read, sensors_of
from sitl.firmware.errors import FirmwareError, FirmwareRestartedError
from sitl.firmware.sockets import bound, give_up_after

DEFAULT_PORT = 9002
MIN_RATE_HZ = 720  # its inertial sensors want 1.8 samples for each of its loops, at 400 Hz
RATE_HZ = 800  # the slowest above that is a whole number of ticks of everything
_LOOK_S = 0.1  # wall time after which a wait looks whether it is to go on
_REQUEST = struct.Struct("<HHI4H")  # magic number, rate, count, pulses of the first motors
_SIZES = {18458: 8 + 16 * 2, 29569: 8 + 32 * 2}  # by magic number
_IDLE_US, _SPAN_US = 1000, 1000
_STATE = (
    '\n{"timestamp":%.6f,"imu":{"gyro":[%.8f,%.8f,%.8f],"accel_body":[%.7f,%.7f,%.7f]},'
    '"position":[%.5f,%.5f,%.5f],"velocity":[%.5f,%.5f,%.5f],'
    '"attitude":[%.7f,%.7f,%.7f],"no_time_sync":1}\n'
)


class ArduPilotBridge:
    """Steps a plant for the ArduPilot that sends to `port`."""

    def __init__(self, plant: Plant, *, port: int = DEFAULT_PORT) -> None:
        """Raises SitlInputError where the plant has no sensors."""
        self.plant = plant
        self._sensors = sensors_of(plant)
        self._port = port
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None
        self._frame = -1  # that was answered last
        self._waiting: bytes | None = None  # a request that came while time stood still
        self._reply = b""
        self._baro_error_m = 0.0

    @property
    def connected(self) -> bool:
        """Whether a firmware has asked for anything."""
        return self._peer is not None

    @property
    def port(self) -> int:
        """The port on which it listens."""
        assert self._socket is not None
        return int(self._socket.getsockname()[1])

    def open(self) -> None:
        self._socket = bound(socket.SOCK_DGRAM, self._port)
        give_up_after(self._socket, _LOOK_S)

    def tick(self) -> bool:
        request, self._waiting = self._waiting or self._receive(), None
        if request is None:
            return False
        frame, motors = self._parse(request)
        if frame == self._frame:
            self._send(self._reply)  # ours was lost: the same again, no step
            return False
        if frame < self._frame:
            raise FirmwareRestartedError("ArduPilot has started anew")
        self._frame = frame
        plant = self.plant
        plant.vehicle.drive(motors)
        plant.step()
        self._reply = self._state(read(plant, self._sensors))
        self._send(self._reply)
        return True

    def rest(self) -> None:
        # It repeats itself each second while nobody answers: one of these is answered later.
        self._waiting = self._receive() or self._waiting

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _receive(self) -> bytes | None:
        assert self._socket is not None
        try:
            if self._peer is not None:
                return self._socket.recv(256)
            request, self._peer = self._socket.recvfrom(256)
            self._socket.connect(self._peer)  # nobody else is heard from now on
        except (BlockingIOError, ConnectionError):
            return None
        return request

    def _send(self, reply: bytes) -> None:
        assert self._socket is not None
        with suppress(ConnectionError):  # it has just ended, which its process says better
            self._socket.send(reply)

    def _parse(self, request: bytes) -> tuple[int, tuple[float, ...]]:
        """Its count, and the duty cycles of the motors."""
        size = len(request)
        if size < _REQUEST.size:
            raise FirmwareError(f"no request of ArduPilot's JSON interface: {size} bytes")
        magic, _, count, a, b, c, d = _REQUEST.unpack_from(request)
        if _SIZES.get(magic) != size:
            raise FirmwareError(
                f"no request of ArduPilot's JSON interface: {size} bytes with the magic number "
                f"{magic}; known are {', '.join(map(str, _SIZES))}"
            )
        return count, (
            (a - _IDLE_US) / _SPAN_US,
            (b - _IDLE_US) / _SPAN_US,
            (c - _IDLE_US) / _SPAN_US,
            (d - _IDLE_US) / _SPAN_US,
        )

    def _state(self, readings: Readings) -> bytes:
        vehicle, receiver = self.plant.vehicle, self._sensors.receiver
        (n, e, d), (en, ee, _) = vehicle.position_ned(), receiver.error_ned_m
        if readings.baro is not None:
            true_m = altitude_m(vehicle.pressure_pa())
            self._baro_error_m = altitude_m(readings.baro.pressure_pa) - true_m
        (vn, ve, vd), (un, ue, ud) = vehicle.velocity_ned(), receiver.velocity_error_ned_mps
        text = _STATE % (
            self.plant.t_ns * 1e-9,
            *readings.imu,
            n + en, e + ee, d - self._baro_error_m,
            vn + un, ve + ue, vd + ud,
            *vehicle.euler(),
        )  # fmt: skip
        return text.encode()
