"""Aircraft in one world, each served to a firmware that somebody else starts."""

import asyncio
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType

from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import FlightError, InputError, LinkLostError
from mission.config.link import LinkConfig
from mission.config.models import RunConfig
from mission.flight.flyers.base import Say, check_url, station_links
from mission.flight.flyers.firmware import Milestones
from mission.flight.pilot.connection import located, until
from mission.flight.pilot.feed import Known
from mission.flight.serve.flight_logs import FlightLogs
from mission.flight.serve.separation import in_words, write_separation
from mission.flight.serve.vehicle import Served, area_of, check_free, make_vehicles, names_of
from sitl.autopilot.codec.orders import MissionItem
from sitl.block import following
from sitl.firmware import ardupilot, px4
from sitl.firmware.bridge import Bridge
from sitl.firmware.together import Bridged
from sitl.firmware.vehicle import plant_for
from sitl.pace import Simulation

_LOOK_S = 0.1  # wall time
_PATIENT = dict.fromkeys(("connect_timeout_s", "ready_timeout_s"), 1e6)
_TELL_OF_LISTS = ("total", "mission_id", "fence_id", "rally_points_id")
# Of the first instance, and how many the next one's is higher by: port of the simulator link, and
# link to record by, as both firmwares count.
_PORTS = {"px4": (px4.DEFAULT_PORT, 1), "ardupilot": (ardupilot.DEFAULT_PORT, 10)}
_UDP = "14540", "14550"  # where those of the built-in autopilot speak to, as with aerofed sitl
_HEARD = {"px4": ("udpin://0.0.0.0", 14030, 1), "ardupilot": ("tcpout://127.0.0.1", 5762, 10)}


@dataclass(frozen=True, eq=False)
class Seat:
    """An aircraft that awaits its firmware, or is flown by it."""

    name: str
    autopilot: str
    area: Area
    bridged: Bridged
    say: Say
    link: LinkConfig  # by which it is heard for its logs, where it has some
    logs: FlightLogs | None

    async def record(self) -> None:
        """Record the flights of each firmware that comes, one after the other."""
        assert self.logs is not None
        while True:
            await until(lambda: self.bridged.there)
            self.logs.began_ns = self.bridged.began_ns
            ended = partial(self._ended, self.bridged.plant)
            try:
                async with following(self.follow(self.logs), name="recorder"):
                    await until(ended)
            except (LinkLostError, FlightError) as error:
                self.say(f"{error}; this firmware is recorded no further")
                await until(ended)

    async def follow(self, logs: FlightLogs) -> None:
        """Write each flight of a firmware, as `aerofed sitl --logs` does, until cancelled: belief,
        modes and lists by its MAVLink, truth by our physics. The lists are downloaded whenever the
        firmware reports a change.

        Raises:
            LinkLostError: the link cannot be opened.
            InputError: the vehicle is too far from the area.
        """
        plant = self.bridged.plant
        with closing(logs):
            known = Known(self.bridged.truth.at, plant.faults.news)
            async with located(
                self.link, area=self.area, observers=(logs, Milestones(plant)), say=self.say,
                known=known,
            ) as (pilot, feed):  # fmt: skip
                feed.first_item = 0  # its lists are recorded as they are
                held: list[tuple[MissionItem, ...]] = [(), (), ()]
                said = None
                async for fields in pilot.messages.of("MISSION_CURRENT"):
                    tells = pilot.armed, [fields.get(name) for name in _TELL_OF_LISTS]
                    if tells != said and (lists := await pilot.lists()) is not None:
                        for kind, (items, before) in enumerate(zip(lists, held, strict=True)):
                            if repr(items) != repr(before):  # a NaN is no NaN's equal
                                logs.took(plant.t_ns, kind, items)
                        said, held = tells, lists

    def _ended(self, plant: Plant) -> bool:
        return not self.bridged.there or self.bridged.plant is not plant


def serve_world(
    config: RunConfig,
    autopilots: Sequence[str],
    built_in: int = 0,
    *,
    each: Mapping[str, RunConfig] = MappingProxyType({}),
    port: int | None = None,
    mavlink: str | None = None,
    speed: float,
    say: Say,
    logs: Path | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Serve an aircraft to each of `autopilots`, "px4" or "ardupilot", and so many under the
    built-in autopilot, in one world, side by side, called vehicle-1, vehicle-2, ... in that order.

    Each firmware is awaited at the port of its instance, which counts its own kind. Time begins
    when all have come, and waits for the slowest at each guidance interval. A firmware that ends
    leaves its aircraft with its motors off, and the others flying; the next one finds it at home.
    Ends when `stop` says so, or by KeyboardInterrupt; then says how near each pair came, and writes
    that beside the flight logs.

    `each`: the configurations of single vehicles, by name; `logs`: folder for flight logs, with a
    subfolder for each of several; `speed`: simulated seconds per second. `port` and `mavlink`, of
    one alone: where its firmware is awaited, and heard for its logs. However long one alone asks
    for nothing, as in a debugger, it is waited for.

    Raises:
        InputError: a setting of an aircraft is refused, or two are so near that they touch.
        LinkLostError: a port or link cannot be had.
        FlightError: what came is no such firmware, or an aircraft left its physics.
    """
    firmwares = len(autopilots)
    names = names_of(firmwares + built_in, each=each)
    ours: list[Served] = []
    if built_in:
        folder = logs if logs is None or built_in > 1 else logs / names[-1]
        own = {name: one for name, one in each.items() if name in names[firmwares:]}
        ours = make_vehicles(
            config, count=built_in, each=own, udp=_UDP, logs=folder, instance=firmwares
        )
    with ExitStack() as opened:
        seats = _seats(config, autopilots, names, each, port, mavlink, say, logs, opened)
        _serve(config.link, seats, ours, speed, say, logs, stop)


def _seats(
    config: RunConfig,
    autopilots: Sequence[str],
    names: Sequence[str],
    each: Mapping[str, RunConfig],
    port: int | None,
    mavlink: str | None,
    say: Say,
    logs: Path | None,
    opened: ExitStack,
) -> list[Seat]:
    seats: list[Seat] = []
    alone = len(names) == 1
    for number, autopilot in enumerate(autopilots):
        name, instance = names[number], autopilots[:number].count(autopilot)
        own = each.get(name, config)
        if own.vehicle.traffic != "off" and not alone:
            raise InputError(
                f"vehicle.traffic = {own.vehicle.traffic!r}: a firmware cannot be told of others; "
                "leave it out, or set it of one of --built-in by its name"
            )
        area, said = area_of(config.area, own.area, number), say if alone else _of(name, say)
        first, step = _PORTS[autopilot]
        make = partial(
            _opened, own, autopilot, port or first + step * instance, told=logs is not None,
            area=area, streams=RandomStreams(config.seed).of_vehicle(number),
        )  # fmt: skip
        bridged = Bridged(number + 1, make, near_m=own.vehicle.near_m, say=said, alone=alone)
        opened.callback(bridged.close)
        url, first, step = _HEARD[autopilot]  # where nobody else is listening
        heard = mavlink or f"{url}:{first + step * instance}"
        link = own.link.model_copy(update={**_PATIENT, "url": heard})
        written = None
        if logs is not None:
            check_url(heard, "the link to record by")
            written = FlightLogs(logs if alone else logs / name, area=area)
        called = "aircraft" if alone else name
        seats.append(Seat(called, autopilot, area, bridged, said, link, written))
    return seats


def _of(name: str, say: Say) -> Say:
    return lambda text: say(f"{name}: {text}")


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
        with _recorded(seats) as failed:
            asyncio.run(_run(simulation, seats, built_in, say, lambda: stop() or failed()))
    finally:
        for one in built_in:
            if one.logs is not None:
                one.logs.close()
        for line in in_words(simulation.world):
            say(line)
        if logs is not None and len(simulation.world.names) > 1:
            areas = {seat.name: seat.area for seat in seats}
            areas |= {one.name: one.area for one in built_in}
            write_separation(logs, simulation.world, areas)


@contextmanager
def _recorded(seats: Sequence[Seat]) -> Iterator[Callable[[], bool]]:
    """Record flights in a thread, so that stepping keeps nobody from being heard. Yields whether
    that has failed; why is raised at the end."""
    ended = threading.Event()

    async def record() -> None:
        async with AsyncExitStack() as beside:
            for seat in seats:
                if seat.logs is not None:
                    await beside.enter_async_context(following(seat.record(), name="recorder"))
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
    world, told, begun = simulation.world, 0, False
    flying: dict[Seat, Plant] = {}  # while its firmware is there
    async with simulation:
        for one in built_in:
            say(f"{one.name} {_where(one.vehicle.aircraft)}, MAVLink on {', '.join(one.urls)}")
        for seat in seats:
            end = "; Ctrl-C ends" if seat is seats[-1] else ""
            say(
                f"{seat.name} {_where(seat.bridged.plant)}, "
                f"waiting for {seat.autopilot} on port {seat.bridged.port}{end}"
            )
        while not stop():
            for seat in seats:
                if not seat.bridged.look():
                    flying.pop(seat, None)
                elif flying.get(seat) is not seat.bridged.plant:
                    flying[seat] = seat.bridged.plant
                    seat.say(f"{seat.autopilot} has come")
            if len(flying) == len(seats) and not begun:
                begun = True
                if len(world.names) > 1:
                    say("all have come: time begins")
            if begun and (flying or built_in):
                simulation.go_on()
            else:  # nobody is there to fly
                simulation.runs = "ordered"
            for t_ns, *pair in world.collisions[told:]:
                names = (world.names[number] for number in pair)
                say(f"{' and '.join(names)} have collided at {t_ns * 1e-9:.2f} s")
            told = len(world.collisions)
            await asyncio.sleep(_LOOK_S)


def _where(plant: Plant) -> str:
    """Where an aircraft stands, and at what rate it is stepped."""
    home, rate_hz = plant.frame.origin, 1e9 / plant.dt_ns
    return f"at {home.lat_deg:.7f}, {home.lon_deg:.7f}, {home.alt_msl_m:g} m, {rate_hz:g} Hz"


def _opened(
    config: RunConfig, autopilot: str, port: int, *, told: bool, area: Area, streams: RandomStreams
) -> Bridge:
    """Open a bridge to a firmware that comes to `port`, with the configured aircraft at the area's
    home; `told`: whether the firmware is heard by MAVLink.

    Raises:
        InputError: a setting of the aircraft is refused.
        LinkLostError: the port cannot be had.
    """
    # Not validated: its firmware is somebody else's.
    vehicle = config.vehicle.model_copy(update={"autopilot": autopilot})
    for fault in config.vehicle.aircraft.faults:
        if autopilot == "ardupilot" and fault.kind == "gnss_off":
            raise InputError(
                "vehicle.aircraft.faults: gnss_off: ArduPilot's JSON interface cannot leave "
                "positions out; set its parameter SIM_GPS1_ENABLE to 0 yourself"
            )
        if fault.after is not None and not told:
            raise InputError(
                f"vehicle.aircraft.faults: after = {fault.after!r}: aerofed world is told when "
                "that is with --logs only; leave it out, and at_s counts from the start"
            )
    plant = plant_for(vehicle, home=area.home, streams=streams, obstacles=area.obstacles)
    kind = px4.Px4Bridge if autopilot == "px4" else ardupilot.ArduPilotBridge
    bridge: Bridge = kind(plant, port=port)
    bridge.open()
    return bridge
