"""Which telemetry message is due when, in wall time."""

from collections.abc import Iterable, Mapping

from sitl.autopilot.values.enums import Message

DEFAULT_RATES_HZ: dict[Message, float] = {
    Message.HEARTBEAT: 1.0,
    Message.SYS_STATUS: 10.0,  # every run waits for one that says that it may begin
    Message.SYSTEM_TIME: 1.0,
    Message.GPS_RAW_INT: 5.0,
    Message.ATTITUDE: 10.0,
    Message.ATTITUDE_QUATERNION: 10.0,
    Message.LOCAL_POSITION_NED: 10.0,
    Message.GLOBAL_POSITION_INT: 10.0,
    Message.MISSION_CURRENT: 4.0,
    Message.VFR_HUD: 4.0,
    Message.ALTITUDE: 1.0,
    Message.BATTERY_STATUS: 1.0,
    Message.HOME_POSITION: 1.0,
    Message.EXTENDED_SYS_STATE: 2.0,
}
# What PX4 streams to a ground station (its mode "normal", and what it streams to MAVSDK's port
# where a script may wait for it): for a vehicle that stands by itself.
SERVED_RATES_HZ: dict[Message, float] = DEFAULT_RATES_HZ | {
    Message.SYS_STATUS: 2.0,
    Message.ATTITUDE: 15.0,
    Message.SCALED_PRESSURE: 1.0,
    Message.SERVO_OUTPUT_RAW: 1.0,
    Message.ATTITUDE_TARGET: 2.0,
    Message.POSITION_TARGET_LOCAL_NED: 1.5,
    Message.POSITION_TARGET_GLOBAL_INT: 1.0,
    Message.HIGHRES_IMU: 10.0,
    Message.ESTIMATOR_STATUS: 0.5,
    Message.WIND_COV: 0.5,
    Message.VIBRATION: 0.1,
    Message.GPS_GLOBAL_ORIGIN: 1.0,
    Message.ODOMETRY: 10.0,
    Message.ORBIT_EXECUTION_STATUS: 2.0,
}
MIN_INTERVAL_S = 0.002


class Streams:
    """Intervals of the messages and when each is due next."""

    def __init__(self, rates_hz: Mapping[Message, float] = DEFAULT_RATES_HZ) -> None:
        """`rates_hz`: what is streamed until somebody asks for something else."""
        self._usual_hz = rates_hz
        self._interval_s = {kind: 1.0 / rate for kind, rate in rates_hz.items()}
        self._next: dict[Message, float] = dict.fromkeys(self._interval_s, 0.0)

    def take_due(self, now: float, extra: Iterable[Message] = ()) -> list[Message]:
        """Messages to send now, in order of their numbers; `extra` are due in any case."""
        due = set(extra)
        due.update(kind for kind, when in self._next.items() if now >= when)
        for kind in due:
            interval = self._interval_s.get(kind)
            if interval is not None:
                # On the beat; but after a pause, or out of turn, from now on: there is no burst.
                beat = self._next[kind] + interval
                self._next[kind] = beat if now < beat <= now + interval else now + interval
        return sorted(due)

    def due(self) -> float:
        """When the next message is due; never later than the next heartbeat."""
        return min(self._next.values())

    def interval_s(self, kind: Message) -> float:
        """Interval of a message in seconds; -1 where it is not streamed."""
        return self._interval_s.get(kind, -1.0)

    def set_interval(self, kind: Message, interval_s: float, *, now: float) -> None:
        """Stream `kind` so often: 0 for the default rate, negative for not at all.

        The heartbeat keeps its rate: it is how others know that the vehicle lives.
        """
        if kind is Message.HEARTBEAT:
            return
        if interval_s == 0.0 and kind in self._usual_hz:
            interval_s = 1.0 / self._usual_hz[kind]
        if interval_s <= 0.0:
            self._interval_s.pop(kind, None)
            self._next.pop(kind, None)
        else:
            self._interval_s[kind] = max(interval_s, MIN_INTERVAL_S)
            self._next[kind] = now
