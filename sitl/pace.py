"""Pacing of simulated time against wall time: still, ordered, or at a multiple of real time."""

import asyncio
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from itertools import groupby
from operator import itemgetter
from types import MappingProxyType
from typing import Literal, Self, TypeAlias

from sitl.block import following
from sitl.links import Link, RawLink
from sitl.vehicle import Vehicle
from sitl.world import Flown, World

_STRETCH_S = 0.02  # wall time between looks at the links
_FLAT_OUT_S = 0.05  # and where time runs as fast as it can: half of telemetry's interval
_BREATH_S = 0.001  # then: MAVSDK's threads need this one's lock to hand on what they heard
_OUTSIDE_NS = 10**9  # simulated time then, where somebody outside gives orders in flight, too


# When simulated time runs: while a manoeuvre is under way, always, or as far as `run_to` says.
Runs: TypeAlias = Literal["moving", "always", "ordered"]


class Simulation:
    """Runs a vehicle, or a world of them, in the event loop: an asynchronous context manager.

    Simulated time stands still or runs, as `runs` says, which may change; at `speed` times real
    time (infinite: as fast as possible). Messages are exchanged in wall time throughout, so that
    the vehicle never falls silent.
    """

    def __init__(
        self,
        flown: Vehicle | Mapping[str, tuple[Vehicle, Sequence[Link]]],
        *links: Link,
        beside: Mapping[str, Flown] = MappingProxyType({}),
        speed: float | Callable[[], float] = math.inf,
        runs: Runs = "moving",
    ) -> None:
        """`flown`: a vehicle with its `links`, or several by name, each with its own; `beside`:
        what else is in their world, before them; `speed`: a number, or what gives it.

        Raises:
            InputError: two stand so near to each other that they touch.
        """
        if not callable(speed) and not speed > 0:
            raise ValueError(f"speed = {speed}: must be positive")
        if not isinstance(flown, Mapping):
            flown = {"vehicle": (flown, links)}
        self.world = World({**beside, **{name: vehicle for name, (vehicle, _) in flown.items()}})
        self._ports = tuple(flown.values())
        self._links = [link for _, own in self._ports for link in own]
        self.piloted: set[Vehicle] = set()  # ordered time stands still while one does not move
        outside = not all(isinstance(link, RawLink) for link in self._links)
        self._most_ns = _OUTSIDE_NS if outside else math.inf
        self._pace = speed if callable(speed) else lambda: speed
        self.runs: Runs = runs
        self._ordered_ns: float = self.world.t_ns
        self._wake = asyncio.Event()
        self._there = asyncio.Event()
        self._open = AsyncExitStack()
        self._on_time = -math.inf  # wall time at which the present simulated time is due

    async def __aenter__(self) -> Self:
        """Open the links and start.

        Raises:
            LinkLostError: a link cannot be opened; none is left open.
        """
        async with AsyncExitStack() as opened:
            for link in self._links:
                opened.callback(link.close)
                link.open(self._wake.set)
            await opened.enter_async_context(following(self._run(), name="simulation"))
            self._open = opened.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop and close the links; an error of the simulation ends the block that it failed in."""
        await self._open.aclose()

    def go_on(self) -> None:
        """Let simulated time run from now on."""
        self.runs = "always"
        self.wake()

    def wake(self) -> None:
        """Look at once whether time is to run."""
        self._wake.set()

    async def run_to(self, t_ns: float) -> None:
        """Let simulated time run up to `t_ns`, with `runs` = "ordered", and stand still there; to
        infinity, as long as somebody is `piloted`.

        What was sent to the vehicle before the call is handled before time runs. Where this is
        cancelled, time stands still at once.
        """
        self._ordered_ns = t_ns
        self._there.clear()
        self._wake.set()
        try:
            await self._there.wait()
        finally:
            self._ordered_ns = self.world.t_ns

    def waits(self, vehicle: Vehicle) -> bool:
        """Whether a vehicle on its way stands still because the pilot of another is waited for."""
        return vehicle.moving and not all(each.moving for each in self.piloted)

    @property
    def _goes_on(self) -> bool:
        """Whether simulated time runs."""
        if self.runs == "ordered":
            bound = bool(self.piloted) or self._ordered_ns < math.inf
            return bound and not self._arrived and all(each.moving for each in self.piloted)
        return self.runs == "always" or self.world.moving

    @property
    def _arrived(self) -> bool:
        return self.world.t_ns >= self._ordered_ns

    async def _run(self) -> None:
        while True:
            self._exchange()
            if self._goes_on:
                await self._advance()
            else:
                if self._arrived:
                    self._there.set()
                await self._idle()

    def _exchange(self) -> None:
        """Take what has arrived and send what is due."""
        self._wake.clear()
        now = time.monotonic()
        for vehicle, links in self._ports:
            for link in links:
                for sender, datagram in link.receive():
                    vehicle.receive(datagram, now, (link, sender))
                if link.newcomers():
                    vehicle.greet()
            for place, group in groupby(vehicle.outgoing(now), key=itemgetter(0)):
                frames = [frame for _, frame in group]
                for link, to in [(link, None) for link in links] if place is None else [place]:
                    link.send(frames, to)

    def _due(self) -> float:
        """The wall time at which somebody has something to say at the latest."""
        return min((vehicle.due() for vehicle, _ in self._ports), default=math.inf)

    async def _idle(self) -> None:
        """Wait for a message or for the next telemetry."""
        timeout = self._due() - time.monotonic()
        if timeout <= 0:
            await asyncio.sleep(0)
            return
        try:
            async with asyncio.timeout(timeout):
                await self._wake.wait()
        except TimeoutError:
            pass

    async def _advance(self) -> None:
        """Run a stretch of simulated time, then pause as the pace asks."""
        began, speed = time.monotonic(), self._pace()
        if math.isinf(speed):
            self._run_until(began + _FLAT_OUT_S)
            await asyncio.sleep(_BREATH_S if self._goes_on else 0.0)
        else:
            # No more than until telemetry is due. A machine that falls behind does not rush later.
            sim_s = self._run_for(min(_STRETCH_S, self._due() - began) * speed, began + _FLAT_OUT_S)
            self._on_time = max(self._on_time, began - _STRETCH_S) + sim_s / speed
            await asyncio.sleep(max(0.0, self._on_time - time.monotonic()))

    def _run_until(self, wall_s: float) -> None:
        """Run as fast as possible up to a wall time, or as far as time goes on."""
        world, now = self.world, time.monotonic
        ordered_ns = self._ordered_ns if self.runs == "ordered" else math.inf
        until_ns = min(world.t_ns + self._most_ns, ordered_ns)
        world.stride(ordered_ns)
        while self._goes_on and now() < wall_s and world.t_ns < until_ns:
            world.stride(ordered_ns)

    def _run_for(self, sim_s: float, wall_s: float) -> float:
        """Run about `sim_s`, less if the manoeuvre ends or a wall time is over, as where a firmware
        asks for nothing; return the simulated seconds run."""
        world = self.world
        before_ns = world.t_ns
        until_ns = before_ns + sim_s * 1e9
        world.step()
        while self._goes_on and world.t_ns < until_ns and time.monotonic() < wall_s:
            world.step()
        return (world.t_ns - before_ns) * 1e-9
