"""The simulated vehicle on its own, served to ground stations until somebody stops it."""

import asyncio
import math
import signal
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import InputError
from mission.config.models import LinkConfig, RunConfig
from mission.flight.failures import of_a_vehicle, of_settings
from mission.flight.ground_stations import station_links
from mission.flight.serve.flight_logs import FlightLogs
from mission.scenario.limits import guidance_of
from sitl.errors import LinkError
from sitl.links import UdpLink
from sitl.logfolder import LogFolder
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

_APART_M = 5.0  # homes, towards the east
_MOST = 64
_LAST_ID = 250


def link_url(text: str) -> str:
    """A bare port is a ground station on this machine, as PX4's simulator has it; or a URL.

    Raises:
        InputError: neither.
    """
    url = f"udpout://127.0.0.1:{text}" if text.isdecimal() else text
    try:
        UdpLink(url)
    except LinkError:
        raise InputError(
            f"--udp {text}: neither a port from 1 to 65535 nor udpin://HOST:PORT or "
            "udpout://HOST:PORT"
        ) from None
    return url


@dataclass(frozen=True, slots=True)
class Served:
    """One vehicle, where it speaks, and what writes its flights."""

    vehicle: Vehicle
    area: Area  # with home where this one stands
    guidance: LimitsConfig
    urls: tuple[str, ...]
    logs: FlightLogs | None
    link: LinkConfig


def make_vehicles(
    config: RunConfig, *, count: int, udp: Sequence[str], logs: Path | None, in_step: bool = False
) -> list[Served]:
    """`count` vehicles side by side, the first at the configured home, each farther to the east.

    System ids count up from the configured one, and ports from the first of `udp`, as those of
    PX4's simulators do; the others of `udp` are spoken to by all. Each vehicle has random numbers
    of its own, those of the first are a single one's. `logs`: where flights are written to; of
    several vehicles each has a folder within. `in_step`: as of `Vehicle`.

    Raises:
        InputError: a setting of the vehicle is refused, or they are more than there are numbers.
    """
    first_id = config.vehicle.system_id
    if not 1 <= count <= _MOST or first_id + count - 1 > _LAST_ID:
        raise InputError(
            f"--count {count}: from 1 to {_MOST} vehicles, and system ids up to {_LAST_ID}"
        )
    if count > 1 and config.vehicle.parameter_file is not None:
        raise InputError(
            f"--count {count}: vehicle.parameter_file cannot be shared, each would save its own "
            "values over the others'; set vehicle.parameters instead"
        )
    return [_served(config, i, udp, _own(logs, i, count), in_step) for i in range(count)]


def _own(logs: Path | None, i: int, count: int) -> Path | None:
    return logs if logs is None or count == 1 else logs / f"vehicle-{i + 1}"


def _served(
    config: RunConfig, i: int, udp: Sequence[str], logs: Path | None, in_step: bool
) -> Served:
    """The vehicle number `i`, from 0."""
    streams = RandomStreams(config.seed)
    if i > 0:
        streams = RandomStreams(streams.seed(f"vehicle/{i}"))
    area = config.area.build()
    area = replace(area, home=area.frame.to_geodetic(np.array([0.0, i * _APART_M, 0.0])))
    recorder = None if logs is None else FlightLogs(logs, area=area)
    with of_settings():
        vehicle = Vehicle(
            config.vehicle.model_copy(update={"system_id": config.vehicle.system_id + i}),
            home=area.home,
            streams=streams,
            observers=() if recorder is None else (recorder,),
            logs=None
            if logs is None or recorder is None
            else LogFolder(logs, being_written=lambda: recorder.being_written),
            orders=recorder,
            standalone=True,
            in_step=in_step,
        )
    urls = [link_url(_counted_up(text, i) if at == 0 else text) for at, text in enumerate(udp)]
    return Served(vehicle, area, guidance_of(config.vehicle), tuple(urls), recorder, config.link)


def _counted_up(text: str, i: int) -> str:
    """An address with its port `i` higher."""
    start, colon, port = text.rpartition(":")
    return f"{start}{colon}{int(port) + i}" if port.isdecimal() else text


def serve(served: Sequence[Served], *, speed: float, say: Callable[[str], None]) -> None:
    """Serve the vehicles on their URLs until the process gets SIGINT, SIGTERM or SIGHUP.

    `speed` is in simulated seconds per second; infinite: as fast as possible. `say` gets a line
    for each vehicle once all links are open.

    Raises:
        LinkLostError: a link cannot be opened.
        FlightError: a simulated aircraft left the range of its physics.
    """
    try:
        with of_a_vehicle():
            asyncio.run(_serve(served, speed=speed, say=say))
    finally:
        for one in served:
            if one.logs is not None:
                one.logs.close()


async def _serve(served: Sequence[Served], *, speed: float, say: Callable[[str], None]) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in signals:
        loop.add_signal_handler(number, stop.set)
    pace = "as fast as possible" if math.isinf(speed) else f"at {speed:g}x real time"
    try:
        async with AsyncExitStack() as running:
            for one in served:
                links = station_links(one.link, one.urls)
                await running.enter_async_context(
                    Simulation(one.vehicle, *links, speed=speed, runs="always")
                )
            for i, one in enumerate(served):
                home = one.vehicle.aircraft.frame.origin
                name = "vehicle" if len(served) == 1 else f"vehicle {i + 1}"
                end = "; Ctrl-C ends" if one is served[-1] else ""
                say(
                    f"{name} at {home.lat_deg:.7f}, {home.lon_deg:.7f}, "
                    f"{home.alt_msl_m:g} m, {pace}, MAVLink on {', '.join(one.urls)}{end}"
                )
            await stop.wait()
    finally:
        for number in signals:
            loop.remove_signal_handler(number)
