"""Aircraft that a firmware flies, in a world that waits for the slowest, and their recent truth."""

import math
import time
from collections.abc import Callable

from flightdyn.frames import frozen, quaternion_from_euler, wrap_pi
from flightdyn.plant import Plant
from flightdyn.state import Kinematics, Moment
from native.errors import FirmwareRestartedError, FirmwareSilentError
from sitl.autopilot.codec.traffic import Transponder
from sitl.firmware.bridge import STALL_S, Bridge
from sitl.firmware.native import library as native
from sitl.firmware.native.library import TruthRing

_AIRBORNE_M = 0.2  # above home
_BATTERY_EVERY = 5  # guidance intervals
MOST = 1000  # ticks at once, of one alone that has no pace to keep


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
        self._most = MOST if alone else self.plant.interval  # ticks at once
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
        awaited = self._awaited
        if self._bridge is None and awaited.called():
            awaited.rest()
        if self._bridge is None and awaited.connected:
            self.began_ns += self.t_ns
            if self.plant is not awaited.plant:
                self.plant, self.truth = awaited.plant, TruthHistory(awaited.plant, awaited.truths)
            self._bridge, self._silent_since = awaited, None
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
        plant, ticks = self.plant, self._most
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
