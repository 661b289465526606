"""Sending in wall time: telemetry at its rates, what was requested once, long answers in bursts."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import CommandOrder, Outbox, Peer
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.autopilot.codec.units import int32
from sitl.autopilot.protocol.commands import Commands, RefusedError, UnsupportedError

DEFAULT_RATES_HZ: dict[int, float] = {
    mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mav.MAVLINK_MSG_ID_SYS_STATUS: 10.0,  # every run waits for one that says that it may begin
    mav.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mav.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 10.0,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mav.MAVLINK_MSG_ID_MISSION_CURRENT: 4.0,
    mav.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mav.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mav.MAVLINK_MSG_ID_HOME_POSITION: 1.0,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
}
# What PX4 streams to a ground station (its mode "normal", and what it streams to MAVSDK's port
# where a script may wait for it): for a vehicle that stands by itself.
SERVED_RATES_HZ: dict[int, float] = DEFAULT_RATES_HZ | {
    mav.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    mav.MAVLINK_MSG_ID_ATTITUDE: 15.0,
    mav.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 1.0,
    mav.MAVLINK_MSG_ID_ATTITUDE_TARGET: 2.0,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 1.5,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.0,
    mav.MAVLINK_MSG_ID_HIGHRES_IMU: 10.0,
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
    mav.MAVLINK_MSG_ID_WIND_COV: 0.5,
    mav.MAVLINK_MSG_ID_VIBRATION: 0.1,
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
    mav.MAVLINK_MSG_ID_ODOMETRY: 10.0,
    mav.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: 2.0,
}


class Streams:
    """Telemetry scheduler: the interval of each message, and when it is due next."""

    def __init__(
        self, outbox: Outbox, rates_hz: Mapping[int, float], *, silent: Callable[[int], bool]
    ) -> None:
        """`rates_hz`: the default rates, by message number, until a station sets others; `silent`:
        whether a message has nothing to say now."""
        self._outbox, self._silent = outbox, silent
        self._usual_hz = rates_hz
        self._interval_s = {kind: 1.0 / rate for kind, rate in rates_hz.items()}
        self._next = dict.fromkeys(self._interval_s, 0.0)
        self._asked: set[int] = set()  # to be sent once
        home, version = mav.MAVLINK_MSG_ID_HOME_POSITION, mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        self.commands: Commands = {
            mav.MAV_CMD_GET_HOME_POSITION: lambda _: self._asked.add(home),
            mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda order: self._asked.update(
                () if order.params[0] == 0.0 else (version,)
            ),
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mav.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mav.MAV_CMD_GET_MESSAGE_INTERVAL: lambda order: self._tell_interval(order.params[0]),
        }

    def take_due(self, now: float, extra: Iterable[int] = ()) -> list[int]:
        """Return the sorted numbers of the messages due at `now` (s); `extra` are due anyway."""
        due = self._asked.union(extra)
        self._asked.clear()
        due.update(kind for kind, when in self._next.items() if now >= when)
        for kind in due:
            interval = self._interval_s.get(kind)
            if interval is not None:
                # On the beat; but after a pause, or out of turn, from now on: there is no burst.
                beat = self._next[kind] + interval
                self._next[kind] = beat if now < beat <= now + interval else now + interval
        return sorted(due)

    def due(self) -> float:
        """Return the time (s) of the next due message; never later than the next heartbeat."""
        return min(self._next.values())

    def _request_message(self, order: CommandOrder) -> None:
        if order.params[0] == mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            self._tell_interval(order.params[1])
        elif self._silent(kind := _telemetry(order)):
            raise RefusedError("there is nothing to say now", mav.MAV_RESULT_TEMPORARILY_REJECTED)
        else:
            self._asked.add(kind)

    def _set_interval(self, order: CommandOrder) -> None:
        """Set the interval (us) of a message: 0 for the default rate, negative stops it."""
        kind, interval_s = _telemetry(order), order.params[1] * 1e-6
        if kind == mav.MAVLINK_MSG_ID_HEARTBEAT:
            raise RefusedError("it keeps its rate: by it others know that the vehicle lives")
        if interval_s == 0.0 and kind in self._usual_hz:
            interval_s = 1.0 / self._usual_hz[kind]
        if interval_s <= 0.0:
            self._interval_s.pop(kind, None)
            self._next.pop(kind, None)
        else:
            self._interval_s[kind] = interval_s
            self._next[kind] = 0.0  # at once

    def _tell_interval(self, number: float) -> None:
        """Say the interval (us) of a message: -1 while it is not streamed, 0 if it never is."""
        if not 0 <= number <= 65535 or number % 1:
            raise RefusedError(f"message {number:g}: a number from 0 to 65535")
        interval_us = -1 if number in TELEMETRY else 0
        if number in self._interval_s:
            interval_us = int32(self._interval_s[int(number)] * 1e6)
        self._outbox.append(mav.MAVLink_message_interval_message(int(number), interval_us))


def _telemetry(order: CommandOrder) -> int:
    """Return the number of the message a command names; UnsupportedError if it is not sent."""
    number = order.params[0]
    if number not in TELEMETRY:
        raise UnsupportedError
    return int(number)


class Burst:
    """Sends `at_once` messages of an iterator every `every_s` (s), to spare receive buffers.

    None in place of a message counts as one, and sends nothing: it stands for work done.
    """

    def __init__(self, outbox: Outbox, *, at_once: int, every_s: float) -> None:
        self._outbox = outbox
        self._at_once, self._every_s = at_once, every_s
        self._messages: Iterator[mav.MAVLink_message | None] = iter(())
        self._next = math.inf
        self._to: Peer | None = None

    def start(
        self, messages: Iterator[mav.MAVLink_message | None], now: float, to: Peer | None = None
    ) -> None:
        """Send these messages from `now` (s) on, in place of those left; to everybody, or `to`."""
        self._messages, self._next, self._to = messages, now, to

    def stop(self) -> None:
        """Drop the messages that are left."""
        self._messages, self._next = iter(()), math.inf

    def poll(self, now: float) -> None:
        """Send the messages that are due at `now` (s)."""
        if now >= self._next:
            made = list(islice(self._messages, self._at_once))
            for message in made:
                if message is not None:
                    self._outbox.append(message, self._to)
            self._next = now + self._every_s if len(made) == self._at_once else math.inf

    def due(self) -> float:
        """Return the time (s) at which `poll` has something to do; infinite for never."""
        return self._next
