"""Flights of plan files by several vehicles of one world, from instants of its clock."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from mission.base.errors import AerofedError
from mission.flight.missions.plan_check import CheckedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.pilot.connection import connect
from sitl.links import RawLink
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

START_S = 0.1  # simulated time between looks whether all have started up
_POLL_S = 0.002  # wall time


@dataclass(frozen=True, eq=False)
class Departure:
    """The flight of a plan, which lies around home, by one vehicle, from the ground to the ground;
    so many simulated seconds after the first one. `begins` is told when (ns)."""

    vehicle: Vehicle
    link: RawLink
    plan: PlanFile
    path: CheckedPath
    stall_timeout_s: float
    after_s: float = 0.0
    begins: Callable[[int], None] = lambda _: None


async def start_up(simulation: Simulation, vehicles: Sequence[Vehicle]) -> None:
    """Let ordered time run until these vehicles, on the ground, have started up."""
    while any(vehicle.moving for vehicle in vehicles):
        await simulation.run_to(simulation.world.t_ns + round(START_S * 1e9))


async def fly_together(
    simulation: Simulation, departures: Mapping[str, Departure]
) -> Mapping[str, AerofedError]:
    """Fly all, by the vehicles' names; what goes wrong with one ends its flight only.

    Simulated time stands still until all are prepared, and whenever one has come to rest and waits
    for its pilot: so nothing depends on who is the first to be ordered. Returns the errors.
    """
    before, world = simulation.runs, simulation.world
    simulation.runs = "ordered"
    await start_up(simulation, [each.vehicle for each in departures.values()])
    begin_ns = world.t_ns
    ready = {name: asyncio.Event() for name in departures}
    turn = {name: asyncio.Event() for name in departures}

    async def flown(name: str, given: Departure) -> None:
        async def prepared() -> None:
            ready[name].set()
            await turn[name].wait()
            given.begins(given.vehicle.t_ns)

        try:
            async with connect(given.link, stall_timeout_s=given.stall_timeout_s) as pilot:
                pilot.waits = partial(simulation.waits, given.vehicle)
                pilot.denied = lambda: given.vehicle.denied
                await pilot.fly_plan(given.plan, returns=given.path.returns, starts=prepared)
        finally:
            simulation.piloted.discard(given.vehicle)

    async def until(met: Callable[[], bool], task: "asyncio.Task[None]") -> None:
        while not (met() or task.done()):  # noqa: ASYNC110  of another thread's making
            await asyncio.sleep(_POLL_S)

    tasks = {name: asyncio.ensure_future(flown(name, each)) for name, each in departures.items()}
    try:
        for name, task in tasks.items():
            await until(ready[name].is_set, task)
        for name, given in sorted(departures.items(), key=lambda item: item[1].after_s):
            await simulation.run_to(begin_ns + round(given.after_s * 1e9))
            turn[name].set()
            await until(lambda vehicle=given.vehicle: vehicle.moving, tasks[name])  # type: ignore[misc]
            if not tasks[name].done():
                simulation.piloted.add(given.vehicle)
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
    errors = {name: task.exception() for name, task in tasks.items()}
    for error in errors.values():
        if error is not None and not isinstance(error, AerofedError):
            raise error
    return {name: error for name, error in errors.items() if isinstance(error, AerofedError)}
