"""The bridge to PX4: HIL messages over TCP, in lockstep.

PX4 connects to us. HIL_SENSOR carries its clock; until it has answered the first one with
HIL_ACTUATOR_CONTROLS it is booting, and time goes on at the pace of wall time; from then on each
tick waits for its answer. Terms: PX4's module simulator_mavlink.
"""

import socket
import time

from flightdyn.plant import Plant
from sitl.firmware.bridge import read, sensors_of
from sitl.firmware.errors import FirmwareError, FirmwareRestartedError
from sitl.firmware.hil import HilDecoder, HilEncoder
from sitl.firmware.sockets import bound, give_up_after

DEFAULT_PORT = 4560  # of PX4's instance 0
_LOOK_S = 0.1  # wall time after which a wait looks whether it is to go on
_OFF = (0.0, 0.0, 0.0, 0.0)


class Px4Bridge:
    """Steps a plant for the PX4 that connects to `port`."""

    def __init__(self, plant: Plant, *, port: int = DEFAULT_PORT) -> None:
        """Raises SitlInputError where the plant has no sensors."""
        self.plant = plant
        self._sensors = sensors_of(plant)
        self._port = port
        self._listener: socket.socket | None = None
        self._connection: socket.socket | None = None
        self._encoder = HilEncoder(plant.frame.origin)
        self._decoder = HilDecoder()
        self.booting = True  # it has answered nothing yet
        self._sent_us = 0  # PX4's clock, by the last frame
        self._answered_us = 0  # up to where it has answered
        self._paced_s = 0.0  # wall time of the last tick while PX4 boots
        self.motors = _OFF

    @property
    def connected(self) -> bool:
        """Whether a firmware has connected."""
        return self._connection is not None

    @property
    def port(self) -> int:
        """The port on which it listens."""
        assert self._listener is not None
        return int(self._listener.getsockname()[1])

    def open(self) -> None:
        self._listener = bound(socket.SOCK_STREAM, self._port)
        self._listener.listen(1)
        self._listener.settimeout(_LOOK_S)

    def tick(self) -> bool:
        connection = self._connection or self._accept()
        if connection is None or not (self.booting or self._answered(connection)):
            return False
        if self.booting:
            self._keep_pace()
        plant = self.plant
        plant.vehicle.drive(self.motors)
        plant.step()
        self._sent_us = t_us = plant.t_ns // 1000
        readings = read(plant, self._sensors)
        frames = self._encoder.sensor(t_us, readings.imu, readings.baro, readings.mag)
        if readings.fix is not None:
            place = plant.frame.to_geodetic(readings.fix.pos_ned_m)
            frames = self._encoder.gps(t_us, readings.fix, place) + frames
        try:
            connection.sendall(frames)
        except OSError as error:
            raise FirmwareRestartedError(f"PX4 has hung up: {error.strerror or error}") from None
        if self.booting:
            self._take(connection, socket.MSG_DONTWAIT)
        return True

    def rest(self) -> None:
        # PX4 is silent while its clock stands still.
        time.sleep(_LOOK_S / 10)

    def close(self) -> None:
        for sock in (self._connection, self._listener):
            if sock is not None:
                sock.close()
        self._connection = self._listener = None

    def _accept(self) -> socket.socket | None:
        assert self._listener is not None
        try:
            connection, _ = self._listener.accept()
        except TimeoutError:
            return None
        connection.settimeout(None)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        give_up_after(connection, _LOOK_S)
        self._connection = connection
        return connection

    def _answered(self, connection: socket.socket) -> bool:
        """Wait for the controls of the last tick, at most a moment."""
        if self._answered_us < self._sent_us:
            self._take(connection, 0)
        return self._answered_us >= self._sent_us

    def _take(self, connection: socket.socket, flags: int) -> None:
        try:
            data = connection.recv(4096, flags)
        except BlockingIOError:
            return
        except OSError as error:
            raise FirmwareRestartedError(f"PX4 has hung up: {error.strerror or error}") from None
        if not data:
            raise FirmwareRestartedError("PX4 has hung up")
        for controls in self._decoder.feed(data):
            if not controls.lockstep:
                raise FirmwareError(
                    "PX4 was built without lockstep: its clock is not ours (build px4_sitl_default)"
                )
            self.motors, self._answered_us = controls.motors, controls.t_us
            self.booting = False

    def _keep_pace(self) -> None:
        """Not faster than wall time: PX4 starts its modules in wall time."""
        due_s = self._paced_s + self.plant.dt_ns * 1e-9
        now_s = time.monotonic()
        if due_s > now_s:
            time.sleep(due_s - now_s)
        self._paced_s = max(due_s, now_s - 0.1)
