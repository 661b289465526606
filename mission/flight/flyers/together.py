"""Several aircraft, each under our own autopilot and with a pilot of its own, in one world."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass

from mission.base.errors import AerofedError, FlightError
from mission.flight.flyers.base import HOLD_TIMEOUT_S, Attached, Fleet, FleetBackend, Flights
from mission.flight.flyers.built_in import BuiltInBackend, BuiltInFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.pilot.connection import connect
from sitl.links import RawLink
from sitl.pace import Simulation

_POLL_S = 0.002  # wall time


@dataclass
class WorldFleet(Fleet):
    """Flies several at once: their missions begin at one instant of the world's clock, and end when
    nobody moves any more."""

    simulation: Simulation

    async def fly(self, plans: Mapping[int, FlightPlan]) -> Flights:
        flyers = {number: self._flyer(number) for number in plans}
        for number, flyer in flyers.items():
            flyer.begin(plans[number])
        going = {n: flyer for n, flyer in flyers.items() if not plans[n].stands}
        # Time stands still until all have their orders, whoever is the first to get them.
        self.simulation.runs = "ordered"
        tasks = {n: asyncio.ensure_future(flyer.pilot.fly()) for n, flyer in going.items()}
        try:
            await _until(
                lambda: all(going[n].vehicle.moving or task.done() for n, task in tasks.items())
            )
            self.simulation.runs = "moving"
            await asyncio.gather(*tasks.values(), return_exceptions=True)
            # Who is lost may still be on its way down, and a failsafe may have begun.
            await _until(lambda: not self.simulation.world.moving)
        finally:
            self.simulation.runs = "moving"
            for task in tasks.values():
                task.cancel()
            await asyncio.gather(*tasks.values(), return_exceptions=True)
        lost = {}
        for number, flyer in flyers.items():
            error = tasks[number].exception() if number in tasks else None
            if isinstance(error, FlightError):
                lost[number] = error
            elif error is not None:
                raise error
            elif flyer.vehicle.aircraft.crashed:  # while it waited for the others
                lost[number] = FlightError("the aircraft is lost: it crashed as it waited")
        return Flights({n: flyer.end(plans[n]) for n, flyer in flyers.items()}, lost)

    def _flyer(self, number: int) -> BuiltInFlyer:
        flyer = self.aloft[number]
        assert isinstance(flyer, BuiltInFlyer)
        return flyer


async def _until(met: Callable[[], bool]) -> None:
    while not met():  # noqa: ASYNC110  of another thread's making
        await asyncio.sleep(_POLL_S)


@dataclass(frozen=True)
class WorldBackend(FleetBackend):
    """Backend of several aircraft in one world; opened once in a run."""

    @asynccontextmanager
    async def fleet(self, attached: Sequence[Attached]) -> AsyncIterator[Fleet]:
        """Connect a pilot to each vehicle; an interrupted flight is ended by orders to hold.

        Raises:
            InputError: two stand so near to each other that they touch.
            LinkLostError: a vehicle does not answer.
        """
        config = self.task.config
        speed = math.inf if config.link.speed == "max" else config.link.speed
        several = [one for one in self.several if isinstance(one, BuiltInBackend)]
        recorders = [one.observed(to) for one, to in zip(several, attached, strict=True)]
        links = [RawLink() for _ in several]
        vehicles = zip(self.names, several, links, strict=True)
        flown = {name: (one.vehicle, [link]) for name, one, link in vehicles}
        async with AsyncExitStack() as opened:
            simulation = await opened.enter_async_context(Simulation(flown, speed=speed))
            flyers = {}
            for number, (one, link, recorder) in enumerate(
                zip(several, links, recorders, strict=True)
            ):
                pilot = await opened.enter_async_context(
                    connect(link, stall_timeout_s=config.link.stall_timeout_s)
                )
                flyers[number] = one.flyer(pilot, recorder)
            try:
                yield WorldFleet(dict(flyers), simulation)
            except asyncio.CancelledError:
                for flyer in flyers.values():
                    if flyer.vehicle.moving:
                        with suppress(AerofedError, TimeoutError):
                            async with asyncio.timeout(HOLD_TIMEOUT_S):
                                await flyer.pilot.hold()
                raise
