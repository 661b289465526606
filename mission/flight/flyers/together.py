"""Several aircraft in one world, each with a pilot of its own: under our own autopilot, or under
firmwares that are started for them."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from functools import partial

from mission.base.errors import FlightError, LinkLostError, UnansweredError
from mission.flight.flyers.base import Attached, Fleet, FleetBackend, Flights, Flyer
from mission.flight.flyers.built_in import BuiltInBackend, BuiltInFlyer, held_at_interruption
from mission.flight.flyers.firmware import FirmwareBackend, FirmwareFlyer, silent
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.pilot.connection import connect, until
from sitl.block import following
from sitl.firmware.clock import SharedClock
from sitl.links import RawLink
from sitl.pace import Simulation

_POLL_S = 0.002  # wall time
_LOOK_S = 0.05  # wall time between looks at firmwares while time stands still


@dataclass
class WorldFleet(Fleet):
    """Flies several at once: their missions begin at one instant of the world's clock, and end when
    nobody moves any more."""

    simulation: Simulation

    async def fly(self, plans: Mapping[int, FlightPlan]) -> Flights:
        flyers = {number: self._flyer(number) for number in plans}
        for number, flyer in flyers.items():
            flyer.begin(plans[number])
        # Time stands still until all of ours have their orders, whoever is the first to get them;
        # firmwares take some of it for theirs.
        self.simulation.runs = "ordered"
        ours = {
            number: flyer
            for number, flyer in flyers.items()
            if isinstance(flyer, BuiltInFlyer) and not plans[number].stands
        }
        tasks = {n: asyncio.ensure_future(flyer.order(plans[n])) for n, flyer in ours.items()}
        try:
            await until(
                lambda: all(ours[n].vehicle.moving or task.done() for n, task in tasks.items()),
                poll_s=_POLL_S,
            )
            self.simulation.runs = "moving"
            for n, flyer in flyers.items():
                if isinstance(flyer, FirmwareFlyer):
                    tasks[n] = asyncio.ensure_future(flyer.order(plans[n]))
            await asyncio.gather(*tasks.values(), return_exceptions=True)
            # Who is lost may still be on its way down, and a failsafe may have begun.
            await until(lambda: not self.simulation.world.moving, poll_s=_POLL_S)
        finally:
            self.simulation.runs = "moving"
            for task in tasks.values():
                task.cancel()
            await asyncio.gather(*tasks.values(), return_exceptions=True)
        lost = {}
        for number, flyer in flyers.items():
            error = tasks[number].exception() if number in tasks else None
            if error is None or isinstance(error, UnansweredError):
                error = flyer.lost or error  # while it waited for the others, or gave no answer
            if isinstance(error, FlightError | LinkLostError):
                lost[number] = error
            elif error is not None:
                raise error
        return Flights({n: flyer.end(plans[n]) for n, flyer in flyers.items()}, lost)

    def _flyer(self, number: int) -> BuiltInFlyer | FirmwareFlyer:
        flyer = self.aloft[number]
        assert isinstance(flyer, BuiltInFlyer | FirmwareFlyer)
        return flyer


@dataclass(frozen=True)
class WorldBackend(FleetBackend):
    """Backend of several aircraft in one world; opened once in a run."""

    @asynccontextmanager
    async def fleet(self, attached: Sequence[Attached]) -> AsyncIterator[Fleet]:
        """Start the firmwares, and connect a pilot to each vehicle; an interrupted flight is ended
        by orders to hold.

        Raises:
            InputError: two stand so near to each other that they touch.
            LinkLostError: a vehicle does not answer, a firmware cannot be started, or dies.
            FlightError: a firmware cannot be flown.
        """
        link = self.task.config.link
        most = math.inf if link.speed == "max" else link.speed
        async with AsyncExitStack() as opened:
            firmwares = await self._started(attached, opened)
            clocks = {name: one.clock for name, one in firmwares.items()}
            ours = {
                name: (one, one.observed(to), RawLink())
                for name, one, to in zip(self.names, self.several, attached, strict=True)
                if isinstance(one, BuiltInBackend)
            }
            simulation = await opened.enter_async_context(
                Simulation(
                    {name: (one.vehicle, [raw]) for name, (one, _, raw) in ours.items()},
                    beside=clocks,
                    speed=partial(_pace, most, tuple(clocks.values())),
                )
            )
            flyers = dict[int, Flyer]()
            for number, name in enumerate(self.names):
                if name in firmwares:
                    clocks[name].wake = simulation.wake
                    flyers[number] = await firmwares[name].connected(opened)
                else:
                    one, recorder, raw = ours[name]
                    pilot = await opened.enter_async_context(
                        connect(raw, stall_timeout_s=link.stall_timeout_s)
                    )
                    flyers[number] = one.flyer(pilot, recorder)
            own = (flyer for flyer in flyers.values() if isinstance(flyer, BuiltInFlyer))
            async with held_at_interruption(*own):
                yield WorldFleet(dict(flyers), simulation)

    async def _started(
        self, attached: Sequence[Attached], opened: AsyncExitStack
    ) -> dict[str, "_Started"]:
        """Start each firmware, by the names of aircraft, and wait until all have come."""
        each = zip(self.names, self.several, attached, strict=True)
        firmwares = {
            name: _Started(name, number, one, to)
            for number, (name, one, to) in enumerate(each, 1)
            if isinstance(one, FirmwareBackend)
        }
        for one in firmwares.values():
            await one.start(opened)
        if firmwares:
            await opened.enter_async_context(following(_look(firmwares), name="firmwares"))
        for one in firmwares.values():
            await one.come()
        return firmwares


class _Started:
    """A firmware of several, from its start to its flyer; what goes wrong has both their names."""

    def __init__(
        self, name: str, number: int, backend: FirmwareBackend, attached: Attached
    ) -> None:
        near_m = backend.task.config.vehicle.near_m
        share = partial(SharedClock, number=number, near_m=near_m, say=attached.say)
        self._words = f"{name}: {backend.name} at its start"
        self._backend, self._attached = backend, attached
        self._wired = backend.wired(attached, shared=share)

    @property
    def clock(self) -> SharedClock:
        return self._wired.vehicle.clock

    async def start(self, opened: AsyncExitStack) -> None:
        with self._named():
            await opened.enter_async_context(self._wired.vehicle)

    async def come(self) -> None:
        """Wait until it asks for the first tick."""
        config, failure = self._backend.task.config, self._wired.vehicle.failure
        with self._named():
            try:
                async with asyncio.timeout(config.link.connect_timeout_s):
                    await until(lambda: self.clock.there or failure() is not None)
            except TimeoutError:
                raise silent(self._wired, config) from None
            if (error := failure()) is not None:
                raise error

    async def connected(self, opened: AsyncExitStack) -> FirmwareFlyer:
        with self._named():
            flyer = self._backend.flyer(self._wired, self._attached)
            return await opened.enter_async_context(flyer)

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except (FlightError, LinkLostError) as error:
            raise error.in_words(f"{self._words}: {error}") from error.__cause__


async def _look(firmwares: Mapping[str, _Started]) -> None:
    """Take what firmwares say while time stands still, and them when they come."""
    while True:
        for one in firmwares.values():
            one.clock.look()
        await asyncio.sleep(_LOOK_S)


def _pace(most: float, clocks: Sequence[SharedClock]) -> float:
    """The speed of a world, in which somebody may be answered."""
    now_s = time.monotonic()
    return min([most, *(clock.pace(now_s) for clock in clocks)])
