"""Simulated time of firmwares that we start ourselves: it goes on as it is given."""

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from flightdyn.state import Vector
from native.errors import FirmwareRestartedError, FirmwareSilentError
from sitl.firmware.bridge import STALL_S, Bridge
from sitl.firmware.together import MOST, Bridged

_PAUSE_S = 0.25  # wall time that an ordered pace may run ahead by
_AHEAD_NS = 500_000_000  # of the newest telemetry that was heard: five of its intervals
_LISTEN_S = 0.001  # wall time between looks whether it was


class SharedClock(Bridged):
    """The clock of one firmware of several that we started ourselves, which is that of their world.

    Whoever orders a flight gives it time: whether it goes on, up to which instant, and how fast. It
    stands still unless `run` was called last, and goes on for all while it is given to one. All are
    stepped in one thread; any thread may give time. A firmware that has ended is not followed by
    another one; `error` says how.
    """

    def __init__(
        self,
        bridge: Bridge,
        listen: Callable[[], None],
        *,
        number: int,
        near_m: float,
        say: Callable[[str], None],
        speed: float = math.inf,
    ) -> None:
        """`bridge` is open; `listen` reads the telemetry that has come; `speed` is in simulated
        seconds per second, infinite: as fast as the firmware asks."""
        super().__init__(number, lambda: bridge, near_m=near_m, say=say)
        self._listen, self._speed = listen, speed
        self._slow_until = -math.inf  # wall time up to which the pace is that of wall time
        self._heard_ns: int | None = None  # time stamp of the newest telemetry
        self._may_run, self._until_ns = False, math.inf
        self.error: BaseException | None = None
        self.fall: list[tuple[int, Vector]] = []  # when and where it was without its firmware
        self.wake: Callable[[], None] = lambda: None  # of the world, which may be at rest

    def start(self) -> None:
        """Nothing: the world steps it."""

    def stop(self) -> None:
        """Close the bridge; may be called twice."""
        self.close()

    def run(self, until_ns: float = math.inf) -> None:
        """Let simulated time go on, up to an instant."""
        self._silent_since = None  # it was asked for nothing
        self._until_ns, self._may_run = until_ns, True
        self.wake()

    def rest(self) -> None:
        """Let simulated time stand still."""
        self._may_run = False

    @contextmanager
    def going(self, until_ns: float = math.inf, *, speed: float = math.inf) -> Iterator[None]:
        """Context manager: time goes on inside the block, up to an instant and no faster than
        `speed`, and after it as it did before."""
        went, before = self._may_run, (self._until_ns, self._speed)
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

    @property
    def moving(self) -> bool:
        return self._may_run and self.error is None and self.t_ns < self._until_ns

    def exchange_battery(self) -> None:
        """Put in a fresh battery, while time stands still."""
        self.plant.exchange_battery()
        self.truth.keep_battery(exchanged=True)

    def look(self) -> bool:
        """Take the firmware when it comes, and what it says while time stands still."""
        if self.error is not None:
            return False
        if self._bridge is not None and self._bridge.called():
            try:
                self._bridge.rest()
            except FirmwareRestartedError as error:
                self._leave(error)
        return super().look()

    def stride(self, until_ns: float = math.inf) -> bool:
        since_s = time.monotonic()
        while self._ahead and self.there:
            self._hear(since_s)
        moving = super().stride(until_ns)
        if self.error is not None and not self.plant.crashed:
            self.fall.append((self.t_ns, self.plant.truth.pos_ned_m))
        return moving

    @property
    def _ahead(self) -> bool:
        """Whether telemetry is to be read before time goes on."""
        return self._heard_ns is not None and self.t_ns > self._heard_ns + _AHEAD_NS

    def _hear(self, since_s: float) -> None:
        """Wait a moment for telemetry, which is waited for since a wall time."""
        self._listen()
        if time.monotonic() - since_s > STALL_S:
            told_s, now_s = (self._heard_ns or 0) / 1e9, self.t_ns / 1e9
            words = f"the newest is of t {told_s:.2f} s, and time waits for more at {now_s:.2f} s"
            self._leave(FirmwareSilentError(f"no telemetry for {STALL_S:g} s: {words}"))
        time.sleep(_LISTEN_S)

    def _leave(self, why: FirmwareSilentError) -> None:
        """Go on without the firmware: its motors are off."""
        self.error = why
        self._stand_alone()


class FirmwareClock(SharedClock):
    """The same of one that is alone, which is stepped in a thread of its own, at a given pace.

    Time goes on as it is given, and while `answers` is set and a station is answered. `truth` may
    be used at any time from any thread.
    """

    def __init__(self, bridge: Bridge, *, speed: float, processor: int | None = None) -> None:
        """`bridge` and `speed` as of `SharedClock`; the thread keeps to one `processor`, if told.

        A firmware that has come and then asks for nothing for `STALL_S` of wall time is stuck.
        """
        super().__init__(
            bridge, lambda: None, number=1, near_m=0.0, say=lambda _: None, speed=speed
        )
        self._processor = processor
        self._stopped = False
        self._thread = threading.Thread(target=self._turn, name="firmware clock", daemon=True)
        self.answers = False  # whether time goes on at wall pace while somebody is answered

    def start(self) -> None:
        """Start the thread; simulated time stands still until `run`."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the bridge."""
        self._stopped = True
        if self._thread.ident is not None:
            self._thread.join()
        self.close()

    def _turn(self) -> None:
        try:
            if self._processor is not None:
                os.sched_setaffinity(0, {self._processor})
            self._run_until_stopped()
        except BaseException as error:  # handed over to whoever waits for the vehicle
            self.error = error

    def _run_until_stopped(self) -> None:
        due_s = heard_s = time.monotonic()
        while not self._stopped and self.error is None:
            answers = self.answers and time.monotonic() < self._slow_until
            until_ns = math.inf if answers else self._until_ns if self._may_run else 0.0
            before_ns = self.t_ns
            if until_ns <= before_ns or not (self.there or self.look()):
                self._awaited.rest()
                due_s = heard_s = time.monotonic()
                continue
            if self._ahead:
                self._hear(heard_s)
                continue
            heard_s = time.monotonic()
            speed = self.pace(heard_s)
            self._most = MOST if math.isinf(speed) else self.plant.interval
            self.stride(until_ns)
            now_s = time.monotonic()
            # A machine that falls behind does not rush afterwards.
            due_s = max(due_s, now_s - (0.0 if math.isinf(speed) else _PAUSE_S))
            due_s += (self.t_ns - before_ns) * 1e-9 / speed
            if due_s > now_s:
                time.sleep(due_s - now_s)
