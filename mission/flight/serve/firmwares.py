"""Several aircraft in one world, served to firmwares that somebody else starts."""

import asyncio
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import FlightError, InputError, LinkLostError
from mission.config.link import LinkConfig
from mission.config.models import RunConfig
from mission.flight.flyers.base import Say, station_links
from mission.flight.pilot.connection import until
from mission.flight.serve.flight_logs import FlightLogs
from mission.flight.serve.separation import in_words, write_separation
from mission.flight.serve.vehicle import Served, area_of, check_free, make_vehicles, names_of
from mission.flight.serve.world import Recorder, bridge_to, where
from sitl.block import following
from sitl.firmware import ardupilot, px4
from sitl.firmware.bridge import Bridge
from sitl.firmware.together import Bridged
from sitl.pace import Simulation

_LOOK_S = 0.1  # wall time
# Of the first instance, and how many the next one's is higher by: port of the simulator link, and
# link to record by, as both firmwares count.
_PORTS = {"px4": (px4.DEFAULT_PORT, 1), "ardupilot": (ardupilot.DEFAULT_PORT, 10)}
_UDP = "14540", "14550"  # where those of the built-in autopilot speak to, as with aerofed sitl
_HEARD = {"px4": ("udpin://0.0.0.0", 14030, 1), "ardupilot": ("tcpout://127.0.0.1", 5762, 10)}


@dataclass(frozen=True, eq=False)
class Seat:
    """An aircraft and the port at which its firmware is awaited."""

    name: str
    autopilot: str
    port: int
    area: Area
    bridged: Bridged
    recorder: Recorder | None

    async def record(self, say: Say) -> None:
        """Record the flights of each firmware that comes, one after the other."""
        assert self.recorder is not None
        while True:
            await until(lambda: self.bridged.there)
            self.recorder.logs.began_ns = self.bridged.began_ns
            ended = partial(self._ended, self.bridged.plant)
            try:
                async with following(self.recorder.follow(self.bridged, say), name="recorder"):
                    await until(ended)
            except (LinkLostError, FlightError) as error:
                say(f"{error}; this firmware is recorded no further")
                await until(ended)

    def _ended(self, plant: Plant) -> bool:
        return not self.bridged.there or self.bridged.plant is not plant


def serve_world_of(
    config: RunConfig,
    autopilots: Sequence[str],
    built_in: int,
    *,
    each: Mapping[str, RunConfig],
    speed: float,
    say: Say,
    logs: Path | None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Serve an aircraft to each of `autopilots`, "px4" or "ardupilot", and so many under the
    built-in autopilot, in one world, side by side, called vehicle-1, vehicle-2, ... in that order.

    Each firmware is awaited at the port of its instance, which counts its own kind. Time begins
    when all have come, and waits for the slowest at each guidance interval. A firmware that ends
    leaves its aircraft with its motors off, and the others flying. Ends when `stop` says so, or by
    KeyboardInterrupt; then says how near each pair came, and writes that beside the flight logs.

    `each`: the configurations of single vehicles, by name; `logs`: folder for flight logs, with a
    subfolder for each vehicle; `speed`: simulated seconds per second.

    Raises:
        InputError: a setting of an aircraft is refused, or two are so near that they touch.
        LinkLostError: a port or link cannot be had.
        FlightError: what came is no such firmware, or an aircraft left its physics.
    """
    firmwares = len(autopilots)
    names = names_of(firmwares + built_in)
    if unknown := [name for name in each if name not in names]:
        raise InputError(f"no vehicle {unknown[0]!r} of these: {', '.join(names)}")
    ours: list[Served] = []
    if built_in:
        folder = logs if logs is None or built_in > 1 else logs / names[-1]
        own = {name: one for name, one in each.items() if name in names[firmwares:]}
        ours = make_vehicles(
            config, count=built_in, each=own, udp=_UDP, logs=folder, instance=firmwares
        )
    with ExitStack() as opened:
        seats = _seats(config, autopilots, names, each, logs, say, opened)
        _serve(config.link, seats, ours, speed, say, logs, stop)


def _seats(
    config: RunConfig,
    autopilots: Sequence[str],
    names: Sequence[str],
    each: Mapping[str, RunConfig],
    logs: Path | None,
    say: Say,
    opened: ExitStack,
) -> list[Seat]:
    seats: list[Seat] = []
    place = RandomStreams(config.seed)
    for number, autopilot in enumerate(autopilots):
        name, instance = names[number], autopilots[:number].count(autopilot)
        own = each.get(name, config)
        if own.vehicle.traffic != "off":
            raise InputError(
                f"vehicle.traffic = {own.vehicle.traffic!r}: a firmware cannot be told of others; "
                "leave it out, or set it of one of --built-in by its name"
            )
        area, said = area_of(config.area, own.area, number), partial(_say, say, name)
        first, step = _PORTS[autopilot]
        port = first + step * instance
        make = partial(
            _opened, own, autopilot, port, told=logs is not None, area=area,
            streams=place.of_one(f"vehicle/{number}") if number else place,
        )  # fmt: skip
        bridged = Bridged(number + 1, make, near_m=own.vehicle.near_m, say=said)
        opened.callback(bridged.close)
        recorder = None
        if logs is not None:
            written = FlightLogs(logs / name, area=area)
            recorder = Recorder(area, own.link, _heard_at(autopilot, instance), written)
        seats.append(Seat(name, autopilot, port, area, bridged, recorder))
    return seats


def _opened(*where: Any, **how: Any) -> Bridge:
    bridge = bridge_to(*where, **how)
    bridge.open()
    return bridge


def _heard_at(autopilot: str, instance: int) -> str:
    """Where a firmware is heard that nobody else is listening to there."""
    url, port, step = _HEARD[autopilot]
    return f"{url}:{port + step * instance}"


def _say(say: Say, name: str, text: str) -> None:
    say(f"{name}: {text}")


def _serve(
    link: LinkConfig,
    seats: Sequence[Seat],
    built_in: Sequence[Served],
    speed: float,
    say: Say,
    logs: Path | None,
    stop: Callable[[], bool],
) -> None:
    check_free(built_in)
    wired = {one.name: (one.vehicle, station_links(link, one.urls)) for one in built_in}
    beside = {seat.name: seat.bridged for seat in seats}
    simulation = Simulation(wired, beside=beside, speed=speed, runs="ordered")
    try:
        with _recorded(seats, say) as failed:
            asyncio.run(_run(simulation, seats, built_in, say, lambda: stop() or failed()))
    finally:
        for one in built_in:
            if one.logs is not None:
                one.logs.close()
        for line in in_words(simulation.world):
            say(line)
        if logs is not None:
            areas = {seat.name: seat.area for seat in seats}
            areas |= {one.name: one.area for one in built_in}
            write_separation(logs, simulation.world, areas)


@contextmanager
def _recorded(seats: Sequence[Seat], say: Say) -> Iterator[Callable[[], bool]]:
    """Record flights in a thread, so that stepping keeps nobody from being heard. Yields whether
    that has failed; why is raised at the end."""
    ended = threading.Event()

    async def record() -> None:
        async with AsyncExitStack() as beside:
            for seat in seats:
                if seat.recorder is not None:
                    work = seat.record(partial(_say, say, seat.name))
                    await beside.enter_async_context(following(work, name="recorder"))
            await until(ended.is_set)

    with ThreadPoolExecutor(1, thread_name_prefix="recorder") as pool:
        work = pool.submit(asyncio.run, record())
        try:
            yield work.done
        finally:
            ended.set()
        work.result()


async def _run(
    simulation: Simulation,
    seats: Sequence[Seat],
    built_in: Sequence[Served],
    say: Say,
    stop: Callable[[], bool],
) -> None:
    there, world = set[Seat](), simulation.world
    async with simulation:
        for one in built_in:
            say(f"{one.name} {where(one.vehicle.aircraft)}, MAVLink on {', '.join(one.urls)}")
        for seat in seats:
            end = "; Ctrl-C ends" if seat is seats[-1] else ""
            say(
                f"{seat.name} {where(seat.bridged.plant)}, "
                f"waiting for {seat.autopilot} on port {seat.port}{end}"
            )
        told = 0
        while not stop():
            for seat in seats:
                came = seat.bridged.look()
                if came and seat not in there:
                    say(f"{seat.name}: {seat.autopilot} has come")
                    there.add(seat)
                elif not came:
                    there.discard(seat)
            if len(there) == len(seats) and simulation.runs != "always":
                say("all have come: time begins")
                simulation.go_on()
            for t_ns, *pair in world.collisions[told:]:
                names = (world.names[number] for number in pair)
                say(f"{' and '.join(names)} have collided at {t_ns * 1e-9:.2f} s")
            told = len(world.collisions)
            await asyncio.sleep(_LOOK_S)
