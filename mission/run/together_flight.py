"""One `aerofed fly` of several plans: a vehicle for each in one world, and a folder for each."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flightdyn.random import RandomStreams
from mission.base.console import RunConsole
from mission.base.errors import AerofedError, InputError
from mission.base.record_file import RecordFile
from mission.base.run_folder import RunFolder, write_atomically
from mission.config.models import RunConfig
from mission.flight.flyers.base import station_links
from mission.flight.flyers.built_in import BuiltInBackend, simulated_vehicle
from mission.flight.missions.plan_file import read_plan_file
from mission.flight.serve.separation import SEPARATION, in_words, write_separation
from mission.flight.serve.together import Departure, fly_together
from mission.flight.serve.vehicle import names_of
from mission.run.budget import RunTotals
from mission.run.plan_flight import Order, PlanFlight, order_of, recording
from mission.run.progress import Progress
from mission.run.recorded import Around, Outcome, Summary, fly_recorded
from sitl.links import RawLink
from sitl.pace import Simulation


def fly_plans(
    config: RunConfig,
    sources: Sequence[Path],
    path: Path,
    around: Around,
    *,
    after_s: float = 0.0,
    each: Mapping[str, RunConfig],
) -> int:
    """Fly each plan by a vehicle of its own, vehicle-1, vehicle-2 and on in their order, and leave
    at `path` a folder of each and `separation.json`. Returns the exit code.

    `after_s`: by how many simulated seconds each begins after the one before it; `each`: the
    configurations of single ones, by name.

    Raises:
        InputError: a plan is damaged or holds what may not be flown, or two homes are too near to
            each other; nothing is written then.
        FlightError, LinkLostError: the flight of a vehicle failed; the others flew theirs.
    """
    names = names_of(len(sources), each=each)
    with ExitStack() as opened:
        with around.stopwatch("setup"):
            backends, orders = dict[str, BuiltInBackend](), dict[str, Order]()
            for at, (name, source) in enumerate(zip(names, sources, strict=True)):
                own = each.get(name, config)
                if own.link.kind != "in_process" or own.vehicle.autopilot != "built-in":
                    raise InputError(
                        f"{len(sources)} plans: flown by the built-in autopilot, in this process; "
                        "leave out --vehicle, link.kind and vehicle.autopilot, or fly one plan"
                    )
                vehicle = own.vehicle.model_copy(update={"system_id": own.vehicle.system_id + at})
                own = own.model_copy(update={"vehicle": vehicle})
                orders[name] = order = order_of(own, read_plan_file(source))
                streams = RandomStreams(config.seed).of_vehicle(at)
                task = replace(order.task, streams=streams)
                made = simulated_vehicle(vehicle, area=order.area, streams=streams)
                backends[name] = BuiltInBackend(task, made)
            links = {name: RawLink() for name in names}
            speed = math.inf if config.link.speed == "max" else config.link.speed
            simulation = Simulation(
                {
                    name: (backend.vehicle, [links[name], *station_links(config.link)])
                    for name, backend in backends.items()
                },
                speed=speed,
                runs="ordered",
            )
            folder = RunFolder(path)
            opened.enter_context(folder.taken())
            folders = {name: RunFolder(path / name) for name in names}
            for name, one in folders.items():
                one.path.mkdir()
                write_atomically(one.config, orders[name].config.to_toml())
                write_atomically(one.path / orders[name].plan.path.name, orders[name].plan.content)
        about: dict[str, Any] = {"seed": config.seed, "resumable": False,
                 "position_source": BuiltInBackend.position_source}  # fmt: skip
        summaries = {
            name: Summary(folders[name], name=name, plan=source.name, **about)
            for name, source in zip(names, sources, strict=True)
        }
        summary = Summary(folder, name=path.name, vehicles=names, **about)

        @contextmanager
        def opening() -> Iterator["_Flights"]:
            with ExitStack() as stack:
                flights = {
                    name: stack.enter_context(
                        recording(orders[name], backends[name], folders[name], around, (),
                                  progress=Progress())
                    )
                    for name in names
                }  # fmt: skip
                yield _Flights(flights, links, simulation, summaries, around, after_s, path)

        return fly_recorded(opening(), summary, replace(around, figures=False))


@dataclass
class _Flights:
    """The flights of several plan files in one world."""

    flights: Mapping[str, PlanFlight]
    links: Mapping[str, RawLink]
    simulation: Simulation
    summaries: Mapping[str, Summary]
    around: Around
    after_s: float
    path: Path
    totals: RunTotals = field(default_factory=RunTotals)
    errors: Mapping[str, AerofedError] = field(default_factory=dict)

    @property
    def files(self) -> Sequence[RecordFile]:
        """The logs."""
        return [file for flight in self.flights.values() for file in flight.files]

    async def run(self) -> None:
        """Fly all, from the first take-off to the last landing."""
        departures = {}
        for at, (name, flight) in enumerate(self.flights.items()):
            backend = flight.backend
            assert isinstance(backend, BuiltInBackend)
            vehicle = backend.vehicle
            for observer in flight.attached.observers:
                vehicle.add_observer(observer)
            departures[name] = Departure(
                vehicle, self.links[name], flight.order.plan, flight.order.path,
                stall_timeout_s=backend.task.config.link.stall_timeout_s,
                after_s=at * self.after_s, begins=flight.begins,
            )  # fmt: skip
        world = self.simulation.world
        try:
            with self.around.stopwatch("fly"):
                async with self.simulation:
                    self.errors = await fly_together(self.simulation, departures)
        finally:
            self.totals.sim_s = world.t_ns / 1e9
            for flight in self.flights.values():
                flight.totals.sim_s = self.totals.sim_s
            areas = {name: flight.order.area for name, flight in self.flights.items()}
            write_separation(self.path, world, areas)
        for name, flight in self.flights.items():
            flight.ended = name not in self.errors
        if self.errors:
            first = next(iter(self.errors.values()))
            raise first.in_words("; ".join(f"{name}: {why}" for name, why in self.errors.items()))

    def conclude(self, summary: Summary) -> None:
        """Compare each flight with its plan, and complete the vehicles' folders.

        Raises:
            FlightError: a plan was flown to its end, and its last place never reached.
            KeyboardInterrupt: pictures were interrupted; those of further vehicles are left out.
        """
        ends, interrupted = {}, False
        for name, flight in self.flights.items():
            own, outcome, concluded = self.summaries[name], Outcome(), False
            with outcome.flight():
                if name in self.errors:
                    raise self.errors[name]
                if not flight.ended:
                    raise KeyboardInterrupt  # all were
            with outcome.aside("figures"):
                if self.around.figures and not interrupted:
                    from mission.figures.run import draw_run

                    draw_run(own.folder.path)
                flight.conclude(own)
                concluded = True
            interrupted |= not concluded and outcome.error is None
            own.ended(outcome, flight.totals, self.around.stopwatch)
            self.totals.flown_m += flight.totals.flown_m
            ends[name] = outcome
        summary.add(separation=SEPARATION)
        for name, outcome in ends.items():
            if outcome.error is not None and name not in self.errors:
                raise outcome.error.in_words(f"{name}: {outcome.error}")
        if interrupted:
            raise KeyboardInterrupt

    def show(self, console: RunConsole) -> None:
        """Print how near they came."""
        for line in in_words(self.simulation.world):
            console.say(line)
