"""Aircraft under firmwares in a world with others: time waits for the slowest."""

import math
import time
from collections.abc import Callable

from flightdyn.plant import Plant
from flightdyn.state import Vector
from native.errors import FirmwareRestartedError, FirmwareSilentError
from sitl.autopilot.codec.traffic import Transponder
from sitl.firmware.bridge import STALL_S, Bridge
from sitl.firmware.clock import LISTEN_S, TimeGiven, TruthHistory

_AIRBORNE_M = 0.2  # above home
_MOST = 1000  # ticks of one alone at once


class Bridged:
    """An aircraft of a world that a firmware flies which somebody else starts: a `Flown`.

    While no firmware is there its motors are off: it stands, or falls. A firmware that comes finds
    an aircraft at home, and its own time begins.
    """

    waited_for = True
    traffic = "off"  # a firmware cannot be told of others

    def __init__(
        self,
        number: int,
        bridge: Callable[[], Bridge],
        *,
        near_m: float,
        say: Callable[[str], None],
        alone: bool = False,
    ) -> None:
        """`number`: of the vehicle, from 1; `bridge` opens one to a firmware that is still to come,
        with an aircraft at home; `alone` in its world, one that asks for nothing is waited for.

        Raises:
            InputError: a setting of the aircraft is refused.
            LinkLostError: the port cannot be had.
        """
        self.near_m = near_m
        self._number, self._make, self._say, self._alone = number, bridge, say, alone
        self._bridge: Bridge | None = None
        self._awaited = bridge()
        self.plant: Plant = self._awaited.plant
        self.truth = TruthHistory(self.plant, self._awaited.truths)
        self.began_ns = 0  # time of the world at which that of this firmware began
        self._silent_since: float | None = None  # wall time

    @property
    def port(self) -> int:
        """The port on which a firmware is awaited, or is."""
        return (self._bridge or self._awaited).port

    @property
    def moving(self) -> bool:
        """Whether time is to go on for it."""
        return True

    @property
    def aircraft(self) -> Plant:
        """The one that flies, or lies, while the next one awaits its firmware."""
        return self.plant

    @property
    def t_ns(self) -> int:
        """Simulated time of the firmware that is or was there."""
        return self.plant.t_ns

    @property
    def there(self) -> bool:
        """Whether a firmware is there."""
        return self._bridge is not None

    def look(self) -> bool:
        """Take a firmware that has come, and say whether one is there; while time stands still."""
        if self._bridge is None and self._awaited.called():
            self._awaited.rest()
            if self._awaited.connected:
                self.began_ns += self.t_ns
                self.plant = self._awaited.plant
                self.truth = TruthHistory(self.plant, self._awaited.truths)
                self._bridge, self._silent_since = self._awaited, None
        return self.there

    def step(self) -> bool:
        """Run one guidance interval."""
        return self.stride(self.t_ns + self.plant.interval * self.plant.dt_ns)

    def stride(self, until_ns: float = math.inf) -> bool:
        """Run on as far as the firmware asks for it, for a guidance interval at most if others may
        be near.

        Raises:
            FirmwareError: the firmware runs on a clock of its own.
            ModelDivergedError: the physics has left the numbers.
        """
        plant = self.plant
        ticks = _MOST if self._alone else plant.interval
        if until_ns < math.inf:
            ticks = min(ticks, math.ceil((until_ns - plant.t_ns) / plant.dt_ns))
        if self._bridge is None:
            for _ in range(ticks):
                plant.step()
        else:
            self._fly(self._bridge, ticks)
        return True

    def _fly(self, bridge: Bridge, ticks: int) -> None:
        try:
            done = bridge.run(ticks)
        except FirmwareRestartedError as error:
            self._leave(error)
            return
        now_s = time.monotonic()
        if done:
            self.truth.keep_battery()
        self._silent_since = None if done or self._alone else self._silent_since or now_s
        if not done and bridge.deserted():
            self._leave(FirmwareRestartedError("its firmware has ended"))
        elif self._silent_since is not None and now_s - self._silent_since > STALL_S:
            self._leave(
                FirmwareSilentError(f"its firmware has asked for nothing for {STALL_S:g} s")
            )

    def _leave(self, why: FirmwareSilentError) -> None:
        """Go on without the firmware, and wait for another one."""
        self._say(f"{why} after {self.t_ns * 1e-9:.1f} s: its motors are off until one comes again")
        self._stand_alone()
        self._awaited = self._make()

    def _stand_alone(self) -> None:
        self.close()
        self.plant.vehicle.drive((0.0,) * 4)

    def close(self) -> None:
        """Stop; may be called twice."""
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None
        self._awaited.close()

    def told(self, text: str, severity: int) -> None:  # noqa: ARG002
        """Tell people; a firmware cannot be told."""
        self._say(text)

    def transponder(self, name: str) -> Transponder:
        """What it tells others of itself, by the truth: what its firmware believes is not known."""
        state, plant = self.plant.truth, self.plant
        height_m = -float(state.pos_ned_m[2])
        return Transponder(
            name, self._number, time.time_ns() // 1000, plant.frame.to_geodetic(state.pos_ned_m),
            height_m, state.vel_ned_mps, height_m > _AIRBORNE_M,
        )  # fmt: skip

    def overhear(self, said: Transponder) -> None:
        """Nothing: a firmware cannot be told of others."""


class SharedClock(TimeGiven, Bridged):
    """The clock of one firmware of several that we started ourselves, which is that of their world.

    Time goes on for all while it is given to one. All are called in one thread. A firmware that
    has ended is not followed by another one; `error` says how.
    """

    def __init__(
        self,
        bridge: Bridge,
        listen: Callable[[], None],
        *,
        number: int,
        near_m: float,
        say: Callable[[str], None],
    ) -> None:
        """`bridge` is open; `listen` reads the telemetry that has come."""
        TimeGiven.__init__(self)
        Bridged.__init__(self, number, lambda: bridge, near_m=near_m, say=say)
        self._listen = listen
        self.fall: list[tuple[int, Vector]] = []  # when and where it was without its firmware
        self.wake: Callable[[], None] = lambda: None  # of the world, which may be at rest

    def start(self) -> None:
        """Nothing: the world steps it."""

    def stop(self) -> None:
        """Close the bridge; may be called twice."""
        self.close()

    def run(self, until_ns: float = math.inf) -> None:
        super().run(until_ns)
        self.wake()

    @property
    def moving(self) -> bool:
        return self._may_run.is_set() and self.error is None and self.t_ns < self._until_ns

    def exchange_battery(self) -> None:
        """Put in a fresh battery."""
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
        while self._ahead(self.t_ns) and self.there:
            self._listen()
            if time.monotonic() - since_s > STALL_S:
                self._leave(self._unheard(self.t_ns, STALL_S))
            time.sleep(LISTEN_S)
        moving = super().stride(until_ns)
        if self.error is not None and not self.plant.crashed:
            self.fall.append((self.t_ns, self.plant.truth.pos_ned_m))
        return moving

    def _leave(self, why: FirmwareSilentError) -> None:
        """Go on without the firmware: its motors are off."""
        self.error = why
        self._stand_alone()
