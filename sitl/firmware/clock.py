"""Simulated time under a firmware: a thread that steps the plant whenever it may and is asked.

Recent true states are kept for readers that learn of an instant only after it has passed.
"""

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from flightdyn.frames import frozen, quaternion_from_euler, wrap_pi
from flightdyn.plant import Plant
from flightdyn.state import Kinematics, Moment
from native.errors import FirmwareSilentError
from sitl.firmware.bridge import STALL_S, Bridge
from sitl.firmware.native import library as native
from sitl.firmware.native.library import TruthRing

_BATTERY_EVERY = 5  # guidance intervals
_PAUSE_S = 0.25  # wall time that an ordered pace may run ahead by
_MOST = 1000  # ticks at once, where there is no pace to keep
_AHEAD_NS = 500_000_000  # of the newest telemetry that was heard: five of its intervals
LISTEN_S = 0.001  # wall time between looks whether it was


class TruthHistory:
    """Ring buffer of true states: the newest 4096 guidance intervals of a plant (82 s at 50 Hz).

    One thread writes, by `keep` in `bridge.c`; others may read at any time.
    """

    def __init__(self, plant: Plant, ring: TruthRing) -> None:
        """Begins with the truth of this instant; `ring` is where C keeps it."""
        self._plant = plant
        self._interval_ns = plant.interval * plant.dt_ns
        self._ring = ring
        self._first = self._ring.newest
        self._batteries = [plant.battery] * (native.KEPT // _BATTERY_EVERY + 1)
        self._battery = 0  # number of the newest
        self.keep_battery(exchanged=True)

    def keep_battery(self, *, exchanged: bool = False) -> None:
        """Store the battery's state in every fifth interval, or if it was exchanged."""
        number, rest = divmod(self._plant.t_ns, _BATTERY_EVERY * self._interval_ns)
        if rest == 0 or exchanged:
            self._batteries[number % len(self._batteries)] = self._plant.battery
            self._battery = number

    @property
    def newest(self) -> Moment:
        """The physical state at the end of the newest guidance interval."""
        last = self._ring.newest
        return self._between(last, last, self._ring.row_of(last)[0])

    def motors(self, t_ns: int) -> list[float]:
        """Return the four duty cycles (0..1) in force at an instant within the history."""
        interval = min(t_ns // self._interval_ns, self._ring.newest)
        duties: list[float] = self._ring.row_of(interval)[1][native.TRUTHS :].tolist()
        return duties

    def at(self, t_ns: int) -> Moment:
        """Return the true state at an instant, interpolated; extrapolated outside the history."""
        last = self._ring.newest
        # The oldest may be overwritten at any time.
        first = max(self._first, last - native.KEPT + 8)
        index = min(max(t_ns // self._interval_ns, first), last)
        return self._between(index, min(index + 1, last), t_ns)

    def _between(self, first: int, second: int, t_ns: int) -> Moment:
        (before_ns, before), (after_ns, after) = self._ring.row_of(first), self._ring.row_of(second)
        since_ns, gap_ns = t_ns - before_ns, after_ns - before_ns
        if since_ns <= 0 or gap_ns <= 0:
            share, motion = 0.0, before[:6].copy()
            motion[:3] += since_ns * 1e-9 * motion[3:]
        else:
            share = since_ns / gap_ns
            motion = before[:6] + share * (after[:6] - before[:6])
        interval, nearer = (second, after) if share > 0.5 else (first, before)
        roll, pitch, yaw, *rates = nearer[6:12].tolist()
        turned = frozen(quaternion_from_euler(roll, pitch, wrap_pi(yaw)))
        kinematics = Kinematics(t_ns, frozen(motion[:3]), frozen(motion[3:]), turned, frozen(rates))
        battery = self._batteries[
            min(interval // _BATTERY_EVERY, self._battery) % len(self._batteries)
        ]
        return Moment(kinematics, battery, frozen(nearer[12 : native.TRUTHS]))


class TimeGiven:
    """What simulated time is given by whoever orders a flight: whether it goes on, up to which
    instant, and how fast. It stands still unless `run` was called last; any thread may call all."""

    def __init__(self, speed: float = math.inf) -> None:
        """`speed` is in simulated seconds per second; infinite: as fast as the firmware asks."""
        self._speed = speed
        self._slow_until = -math.inf  # wall time up to which the pace is that of wall time
        self._heard_ns: int | None = None  # time stamp of the newest telemetry
        self._may_run = threading.Event()
        self._until_ns: float = math.inf
        self.error: BaseException | None = None

    def run(self, until_ns: float = math.inf) -> None:
        """Let simulated time go on, up to an instant."""
        self._until_ns = until_ns
        self._may_run.set()

    def rest(self) -> None:
        """Let simulated time stand still."""
        self._may_run.clear()

    @contextmanager
    def going(self, until_ns: float = math.inf, *, speed: float = math.inf) -> Iterator[None]:
        """Context manager: time goes on inside the block, up to an instant and no faster than
        `speed`, and after it as it did before."""
        went, before = self._may_run.is_set(), (self._until_ns, self._speed)
        self._speed = min(self._speed, speed)
        self.run(until_ns)
        try:
            yield
        finally:
            if not went:
                self.rest()  # first, or time would go on beyond `until_ns`
            self._until_ns, self._speed = before

    def cap_at_wall_pace(self, seconds: float) -> None:
        """Be no faster than wall time for the next `seconds` of it: somebody is being answered."""
        self._slow_until = time.monotonic() + seconds

    def heard(self, t_ns: int) -> None:
        """Note that telemetry of an instant was read. Time runs at most half a second ahead of it,
        so that nothing is missed if reading, or the firmware's sending, is slow.
        """
        self._heard_ns = max(t_ns, self._heard_ns or 0)

    def pace(self, now_s: float) -> float:
        """The speed at a wall time."""
        return self._speed if now_s >= self._slow_until else min(self._speed, 1.0)

    def _ahead(self, t_ns: int) -> bool:
        """Whether telemetry is to be read before time goes on from an instant."""
        return self._heard_ns is not None and t_ns > self._heard_ns + _AHEAD_NS

    def _unheard(self, t_ns: int, patience_s: float) -> FirmwareSilentError:
        return FirmwareSilentError(
            f"no telemetry for {patience_s:g} s: the newest is of t "
            f"{(self._heard_ns or 0) / 1e9:.2f} s, and time waits for more at {t_ns / 1e9:.2f} s"
        )


class FirmwareClock(TimeGiven):
    """Runs an open bridge in a thread of its own, at a given pace, and keeps recent true states.

    Time goes on as it is given, and while `answers` is set and a station is answered. `truth` may
    be used at any time from any thread.
    """

    def __init__(
        self,
        bridge: Bridge,
        *,
        speed: float,
        processor: int | None = None,
    ) -> None:
        """`speed` as for `TimeGiven`; the thread keeps to one `processor`, if told.

        A firmware that has come and then asks for nothing for `STALL_S` of wall time is stuck.
        """
        super().__init__(speed)
        self.plant: Plant = bridge.plant
        self._bridge = bridge
        self._processor = processor
        self.truth = TruthHistory(bridge.plant, bridge.truths)
        self._stopped = False
        self._thread = threading.Thread(target=self._turn, name="firmware clock", daemon=True)
        self.answers = False  # whether time goes on at wall pace while somebody is answered

    def start(self) -> None:
        """Start the thread; simulated time stands still until `run`."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the bridge."""
        self._stopped = True
        self._may_run.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._bridge.close()

    def exchange_battery(self) -> None:
        """Put in a fresh battery, while time stands still."""
        self.plant.exchange_battery()
        self.truth.keep_battery(exchanged=True)

    def _turn(self) -> None:
        try:
            if self._processor is not None:
                os.sched_setaffinity(0, {self._processor})
            self._run_until_stopped()
        except BaseException as error:  # handed over to whoever waits for the vehicle
            self.error = error

    def _run_until_stopped(self) -> None:
        bridge, plant, run = self._bridge, self.plant, self._bridge.run
        asked_s = paced_s = heard_s = time.monotonic()
        while not self._stopped:
            answers = self.answers and time.monotonic() < self._slow_until
            left_ns = max(0.0, self._until_ns - plant.t_ns) if self._may_run.is_set() else 0.0
            if not left_ns and not answers:
                bridge.rest()
                asked_s = paced_s = heard_s = time.monotonic()
                continue
            if self._ahead(plant.t_ns):
                if time.monotonic() - heard_s > STALL_S:
                    raise self._unheard(plant.t_ns, STALL_S)
                time.sleep(LISTEN_S)
                asked_s = time.monotonic()
                continue
            heard_s = time.monotonic()
            speed = self.pace(asked_s)
            most = _MOST if math.isinf(speed) else plant.interval
            if not answers and left_ns < most * plant.dt_ns:
                most = math.ceil(left_ns / plant.dt_ns)
            if ticks := run(most):
                self.truth.keep_battery()
                asked_s = time.monotonic()
                paced_s = self._keep_pace(ticks, speed, paced_s, asked_s)
            elif not bridge.connected:
                asked_s = time.monotonic()
            elif time.monotonic() - asked_s > STALL_S:
                raise FirmwareSilentError(
                    f"the firmware has asked for nothing for {STALL_S:g} s at t "
                    f"{plant.t_ns / 1e9:.2f} s"
                )

    def _keep_pace(self, ticks: int, speed: float, due_s: float, now_s: float) -> float:
        """Sleep as the pace asks after so many ticks; returns when the next are due."""
        if math.isinf(speed):
            return now_s
        # A machine that falls behind does not rush afterwards.
        due_s = max(due_s, now_s - _PAUSE_S) + ticks * self.plant.dt_ns * 1e-9 / speed
        if due_s > now_s:
            time.sleep(due_s - now_s)
        return due_s
