"""The simulated vehicle on its own, served to ground stations until somebody stops it."""

import asyncio
import math
import re
import signal
import socket
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from flightdyn.config import LimitsConfig
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import InputError, LinkLostError
from mission.config.area import AreaConfig
from mission.config.link import NETWORK_FORMS, LinkConfig
from mission.config.models import RunConfig
from mission.flight.flyers.base import station_links
from mission.flight.serve.flight_logs import FlightLogs
from mission.scenario.limits import guidance_of
from sitl.links import network_link
from sitl.logfolder import LogFolder
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

# Where PX4's simulators send to, and from where; a vehicle's number is added to the latter.
_OWN_PORTS = {14540: 14580, 14550: 18570}
_LAST_COUNTED = {"14540": 9}  # PX4's after it share the port of that one: the next is everybody's
_APART_M = 5.0  # homes, towards the east
_MOST, _LAST_PORT = 64, 65_535
_LAST_ID = 250
FIRST = "vehicle-1"


def link_url(text: str) -> str:
    """Return the URL of a link; a bare port is a ground station on this machine, as with PX4.

    Raises:
        InputError: it is neither a URL nor a port.
    """
    url = f"udpout://127.0.0.1:{text}" if text.isdecimal() else text
    try:
        network_link(url)
    except InputError:
        raise InputError(
            f"--udp {text}: neither a port from 1 to 65535 nor {NETWORK_FORMS}"
        ) from None
    return url


@dataclass(frozen=True, slots=True)
class Served:
    """One vehicle to serve, with the URLs of its links and the writer of its flight logs."""

    name: str  # by its number from 1; of its folder of logs, too
    vehicle: Vehicle
    area: Area  # with home where this one stands
    guidance: LimitsConfig
    urls: Mapping[str, int]  # where it speaks to, and from which port; 0: any
    logs: FlightLogs | None
    link: LinkConfig


def names_of(
    count: int | Sequence[str], *, instance: int = 0, each: Iterable[str] = ()
) -> list[str]:
    """Names of so many vehicles, numbered from `instance`, or those that are given; `each` names
    some of them.

    Raises:
        InputError: there are none or too many, or one stands twice or can name no folder.
    """
    if isinstance(count, Sequence):
        for i, name in enumerate(count):
            if not re.fullmatch(r"[A-Za-z0-9][\w.-]{0,39}", name):
                raise InputError(f"name {name!r}: letters, digits, '.', '_' and '-', 40 at most")
            if name in count[:i]:
                raise InputError(f"name {name!r} stands twice: give each vehicle one of its own")
        names = list(count)
    else:
        names = [_name(number) for number in range(instance, instance + min(count, _MOST + 1))]
    if not 1 <= len(names) <= _MOST:
        raise InputError(f"{count} vehicles: from 1 to {_MOST} in one world")
    if unknown := [name for name in each if name not in names]:
        raise InputError(f"no vehicle {unknown[0]!r} of these: {', '.join(names)}")
    return names


def make_vehicles(
    config: RunConfig,
    *,
    count: int | Sequence[str] = 1,
    each: Mapping[str, RunConfig] = MappingProxyType({}),
    udp: Sequence[str],
    logs: Path | None,
    instance: int = 0,
    in_step: bool = False,
) -> list[Served]:
    """Create so many vehicles, or those of these names, numbered from `instance`: number 0 at the
    configured home, each next one 5 m farther to the east, unless its configuration in `each` says
    where.

    System ids count up from the configured one; so do the port of the first of `udp`, as those of
    PX4's simulators do, and ports that listen, while all vehicles send to the others of `udp`.
    Each vehicle has random numbers of its own; number 0 has those of a single one. `logs`: folder
    for flight logs, with a subfolder for each of several vehicles. `in_step`: as of `Vehicle`.

    Raises:
        InputError: a setting of the vehicle is refused, or `count` or `udp` does not allow so many.
    """
    if instance < 0:
        raise InputError(f"--instance {instance}: the first vehicle's number, from 0")
    names = names_of(count, instance=instance, each=each)
    count = len(names)
    last_id = config.vehicle.system_id + instance + count - 1
    if last_id > _LAST_ID:
        raise InputError(
            f"{names[-1]} would have system id {last_id}: they end at {_LAST_ID}; begin with a "
            "lower vehicle.system_id or --instance, or take fewer vehicles"
        )
    if count > 1 and config.vehicle.parameter_file is not None:
        raise InputError(
            f"--count {count}: vehicle.parameter_file cannot be shared, each would save its own "
            "values over the others'; set vehicle.parameters instead"
        )
    urls = [_urls(udp, number) for number in range(instance, instance + count)]
    made = []
    for at, name in enumerate(names):
        folder = logs if logs is None or count == 1 else logs / name
        own = each.get(name, config)
        area = area_of(config.area, own.area, instance + at)
        made.append(_served(name, own, area, instance + at, urls[at], folder, in_step))
    return made


def area_of(common: AreaConfig, own: AreaConfig, number: int) -> Area:
    """The area of a vehicle, which has one ground with the others: at a home of its own, or so
    many times 5 m east of the common one."""
    area = common.build()
    if own.home != common.home:
        north, east, _ = area.frame.to_ned(
            own.home.lat_deg, own.home.lon_deg, own.home.alt_msl_m
        ).tolist()
        return Area(area.site, (area.home_m[0] + east, area.home_m[1] + north), own.home)
    x, y = own.home_m
    if own.home_m == common.home_m:
        x += number * _APART_M
    return area if (x, y) == area.home_m else area.site.from_home((x, y))


def _urls(udp: Sequence[str], number: int) -> dict[str, int]:
    """Where a vehicle speaks to, and from which port; 0 for any."""
    found: dict[str, int] = {}
    for at, text in enumerate(udp):
        alone = at == 0 or text.startswith(("udpin://", "tcpin://"))
        url = link_url(_counted_up(text, number) if alone else text)
        if url in found:
            raise InputError(
                f"--udp {text}: {_name(number)} speaks there already; ports count up from the "
                f"first, {udp[0]}, and the others are for all vehicles"
            )
        own = _OWN_PORTS.get(int(text), 0) if text.isdecimal() else 0
        found[url] = own + number if own else 0
    return found


def check_free(served: Sequence[Served]) -> None:
    """Raise LinkLostError if a UDP port is taken, as by another vehicle of PX4's or ours."""
    for port in (port for one in served for port in one.urls.values() if port):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                raise LinkLostError(
                    f"UDP port {port} is taken{_holder(port)}: a vehicle is there already; "
                    "--instance 1 (2, 3, ...) has ports and a system id of its own"
                ) from None


def _holder(port: int) -> str:
    """Whose a UDP port is, for people; empty where the system does not tell."""
    with suppress(OSError):
        rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
        inodes = [row[9] for row in rows if int(row[1].rpartition(":")[2], 16) == port]
        for descriptor in Path("/proc").glob("[0-9]*/fd/*"):
            with suppress(OSError):
                if descriptor.readlink().name in {f"socket:[{inode}]" for inode in inodes}:
                    process = descriptor.parents[1]
                    return f" by process {process.name} ({(process / 'comm').read_text().strip()})"
    return ""


def _name(i: int) -> str:
    return f"vehicle-{i + 1}"


def _served(
    name: str,
    config: RunConfig,
    area: Area,
    i: int,
    urls: Mapping[str, int],
    logs: Path | None,
    in_step: bool,
) -> Served:
    """The vehicle number `i`, from 0."""
    recorder = None if logs is None else FlightLogs(logs, area=area)
    vehicle = Vehicle(
        config.vehicle.model_copy(update={"system_id": config.vehicle.system_id + i}),
        home=area.home,
        streams=RandomStreams(config.seed).of_vehicle(i),
        obstacles=area.obstacles,
        observers=() if recorder is None else (recorder,),
        logs=None
        if logs is None or recorder is None
        else LogFolder(logs, being_written=lambda: recorder.being_written),
        orders=recorder,
        standalone=True,
        in_step=in_step,
    )
    guidance = guidance_of(config.vehicle)
    return Served(name, vehicle, area, guidance, urls, recorder, config.link)


def _counted_up(text: str, i: int) -> str:
    """An address with its port `i` higher, over TCP `10 i`, as ArduPilot's simulators have it."""
    start, colon, port = text.rpartition(":")
    step = 10 if start.startswith("tcp") else 1
    i = min(i, _LAST_COUNTED.get(text, i))
    if not port.isdecimal():
        return text
    if (counted := int(port) + i * step) > _LAST_PORT >= int(port):
        raise InputError(
            f"--udp {text}: {_name(i)} would be on port {counted}, beyond {_LAST_PORT}; give a "
            "lower port, or fewer vehicles"
        )
    return f"{start}{colon}{counted}"


def serve(
    served: Sequence[Served], *, speed: float, say: Callable[[str], None], first: str
) -> None:
    """Serve the vehicles on their URLs until the process gets SIGINT, SIGTERM or SIGHUP.

    `speed` is in simulated seconds per second; infinite: as fast as possible. `say` gets the
    line `first` and one for each vehicle once all links are open.

    Raises:
        LinkLostError: a link cannot be opened, or a vehicle of another process is there.
        FlightError: a simulated aircraft left the range of its physics.
    """
    check_free(served)
    try:
        asyncio.run(_serve(served, speed=speed, say=say, first=first))
    finally:
        for one in served:
            if one.logs is not None:
                one.logs.close()


async def _serve(
    served: Sequence[Served], *, speed: float, say: Callable[[str], None], first: str
) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in signals:
        loop.add_signal_handler(number, stop.set)
    pace = "as fast as possible" if math.isinf(speed) else f"at {speed:g}x real time"
    try:
        wired = {one.name: (one.vehicle, station_links(one.link, one.urls)) for one in served}
        async with Simulation(wired, speed=speed, runs="always"):
            say(first)
            for one in served:
                home = one.vehicle.aircraft.frame.origin
                end = "; Ctrl-C ends" if one is served[-1] else ""
                say(
                    f"{one.name} at {home.lat_deg:.7f}, {home.lon_deg:.7f}, "
                    f"{home.alt_msl_m:g} m, {pace}, MAVLink on {', '.join(one.urls)}{end}"
                )
            await stop.wait()
    finally:
        for number in signals:
            loop.remove_signal_handler(number)
