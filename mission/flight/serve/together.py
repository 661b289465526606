"""Flights of several vehicles of one world, from instants of its clock."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass

from mission.base.errors import AerofedError
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

START_S = 0.1  # simulated time between looks whether all have started up
_POLL_S = 0.002  # wall time


@dataclass(frozen=True, eq=False)
class Sortie:
    """The flight of one vehicle: `fly` awaits what it is given before it arms."""

    name: str
    vehicle: Vehicle
    fly: Callable[[Callable[[], Awaitable[object]]], Awaitable[object]]
    after_s: float = 0.0


async def start_up(simulation: Simulation, vehicles: Sequence[Vehicle]) -> None:
    """Let ordered time run until these vehicles, on the ground, have started up."""
    while any(vehicle.moving for vehicle in vehicles):
        await simulation.run_to(simulation.world.t_ns + round(START_S * 1e9))


async def fly_together(
    simulation: Simulation, sorties: Sequence[Sortie]
) -> Mapping[str, AerofedError]:
    """Fly all, each from its instant on; what goes wrong with one ends its flight only.

    Simulated time stands still until all are prepared, and whenever one has come to rest and waits
    for its pilot: so nothing depends on who is the first to be ordered. Returns the errors.
    """
    before, world = simulation.runs, simulation.world
    simulation.runs = "ordered"
    await start_up(simulation, [sortie.vehicle for sortie in sorties])
    begin_ns = world.t_ns
    ready = {sortie: asyncio.Event() for sortie in sorties}
    turn = {sortie: asyncio.Event() for sortie in sorties}

    async def flown(sortie: Sortie) -> None:
        def prepared() -> Awaitable[object]:
            ready[sortie].set()
            return turn[sortie].wait()

        try:
            await sortie.fly(prepared)
        finally:
            simulation.piloted.discard(sortie.vehicle)

    async def until(met: Callable[[], bool], task: "asyncio.Task[None]") -> None:
        while not (met() or task.done()):  # noqa: ASYNC110  of another thread's making
            await asyncio.sleep(_POLL_S)

    tasks = {sortie: asyncio.ensure_future(flown(sortie)) for sortie in sorties}
    try:
        for sortie, task in tasks.items():
            await until(ready[sortie].is_set, task)
        for sortie in sorted(sorties, key=lambda each: each.after_s):
            await simulation.run_to(begin_ns + round(sortie.after_s * 1e9))
            turn[sortie].set()
            await until(lambda vehicle=sortie.vehicle: vehicle.moving, tasks[sortie])  # type: ignore[misc]
            if not tasks[sortie].done():
                simulation.piloted.add(sortie.vehicle)
        on = asyncio.ensure_future(simulation.run_to(float("inf")))
        try:
            await asyncio.wait(tasks.values())
        finally:
            on.cancel()
            await asyncio.wait((on,))
    finally:
        for task in tasks.values():
            task.cancel()
        await asyncio.wait(tasks.values())
        simulation.runs = before
    errors = {sortie.name: task.exception() for sortie, task in tasks.items()}
    for error in errors.values():
        if error is not None and not isinstance(error, AerofedError):
            raise error
    return {name: error for name, error in errors.items() if isinstance(error, AerofedError)}
