"""The bridge to ArduPilot: its JSON interface over UDP.

ArduPilot asks with the pulses of its motors and waits for a state, one datagram each way a tick.
It makes GNSS, barometer and compass itself, from position, velocity and attitude: so these are
handed over with the errors of our receiver and barometer, and only the IMU's readings go straight
in. Terms: ArduPilot's libraries/SITL/SIM_JSON.
"""

import logging
import select
import socket

from flightdyn.physics.atmosphere import altitude_m
from flightdyn.plant import Plant
from sitl.errors import FirmwareRestartedError
from sitl.firmware.bridge import LOOK_S, Bridge, bound, give_up_soon
from sitl.firmware.native.library import RESTARTED, Json, json_send, json_wait

_logger = logging.getLogger(__name__)

DEFAULT_PORT = 9002
LOOPS_HZ = 400  # of ArduCopter, where SCHED_LOOP_RATE does not say otherwise
_RATES_HZ = (250, 400, 500, 800, 1000)  # whole ticks of everything that the plant does


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
