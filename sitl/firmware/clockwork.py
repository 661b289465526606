"""Simulated time under a firmware: a thread that steps the plant whenever it may and is asked."""

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from flightdyn.plant import Plant
from flightdyn.state import Moment
from sitl.firmware.bridge import STALL_S, Bridge
from sitl.firmware.errors import FirmwareSilentError
from sitl.firmware.past import Past

_PAUSE_S = 0.25  # wall time that an ordered pace may run ahead by
_MOST = 1000  # ticks at once, where there is no pace to keep


class Clockwork:
    """Runs an open bridge in a thread of its own, at a pace, with truth kept for a while.

    Time stands still unless `run` was called last. All but `run`, `rest` and `stop` may be called
    at any time from any thread.
    """

    def __init__(
        self,
        bridge: Bridge,
        *,
        speed: float,
        patience_s: float = STALL_S,
        processor: int | None = None,
    ) -> None:
        """`speed` is in simulated seconds per second; infinite: as fast as the firmware asks.

        A firmware that has come and then asks for nothing for `patience_s` of wall time is stuck.
        The thread keeps to one `processor`, if told.
        """
        self.plant: Plant = bridge.plant
        self._bridge = bridge
        self._speed, self._patience_s = speed, patience_s
        self._processor = processor
        self._slow_until = -math.inf  # wall time up to which the pace is that of wall time
        self._past = Past(bridge.plant, bridge.rows)
        self._may_run = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._turn, name="firmware clock", daemon=True)
        self.error: BaseException | None = None

    def start(self) -> None:
        """Begin; time stands still until `run`."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the bridge."""
        self._stopped = True
        self._may_run.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._bridge.close()

    def run(self) -> None:
        """Let time go on."""
        self._may_run.set()

    def rest(self) -> None:
        """Let time stand still."""
        self._may_run.clear()

    @contextmanager
    def going(self) -> Iterator[None]:
        """Time goes on inside the block and stands still after it."""
        self.run()
        try:
            yield
        finally:
            self.rest()

    @property
    def running(self) -> bool:
        """Whether time goes on."""
        return self._may_run.is_set()

    def at_wall_pace(self, seconds: float) -> None:
        """Be no faster than wall time for the next `seconds` of it: somebody is being answered."""
        self._slow_until = time.monotonic() + seconds

    def exchange_battery(self) -> None:
        """Put in a fresh battery, while time stands still."""
        self.plant.exchange_battery(armed=False)
        self._past.keep_battery(exchanged=True)

    @property
    def now(self) -> Moment:
        """The newest truth, a guidance interval old at most."""
        return self._past.newest

    def at(self, t_ns: int) -> Moment:
        """The truth at an instant; see `Past.at`."""
        return self._past.at(t_ns)

    def _turn(self) -> None:
        try:
            if self._processor is not None:
                os.sched_setaffinity(0, {self._processor})
            self._run_until_stopped()
        except BaseException as error:  # handed over to whoever waits for the vehicle
            self.error = error

    def _run_until_stopped(self) -> None:
        bridge, plant, run = self._bridge, self.plant, self._bridge.run
        asked_s = paced_s = time.monotonic()
        while not self._stopped:
            if not self._may_run.is_set():
                bridge.rest()
                asked_s = paced_s = time.monotonic()
                continue
            speed = self._speed if asked_s >= self._slow_until else min(self._speed, 1.0)
            if ticks := run(_MOST if math.isinf(speed) else plant.interval):
                self._past.keep_battery()
                asked_s = time.monotonic()
                paced_s = self._keep_pace(ticks, speed, paced_s, asked_s)
            elif not bridge.connected:
                asked_s = time.monotonic()
            elif time.monotonic() - asked_s > self._patience_s:
                raise FirmwareSilentError(
                    f"the firmware has asked for nothing for {self._patience_s:g} s at t "
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
