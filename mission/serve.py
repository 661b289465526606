"""The simulated vehicle on its own, served to ground stations until somebody stops it."""

import asyncio
import math
import signal
from collections.abc import Callable, Sequence

from flightdyn.errors import FlightDynamicsError, FlightInputError
from flightdyn.random import RandomStreams
from mission.config import RunConfig
from mission.errors import FlightError, InputError, LinkLostError
from sitl.errors import LinkError, SitlInputError
from sitl.links import UdpLink
from sitl.pace import Simulation
from sitl.vehicle import Vehicle


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


def make_vehicle(config: RunConfig) -> Vehicle:
    """The configured vehicle on the ground at the configured home.

    Raises:
        InputError: a setting of the vehicle is refused.
    """
    try:
        return Vehicle(
            config.vehicle,
            home=config.area.build().home,
            streams=RandomStreams(config.seed),
            may_reboot=True,
        )
    except (SitlInputError, FlightInputError) as error:
        raise InputError(str(error)) from None


def serve(
    vehicle: Vehicle, links: Sequence[UdpLink], *, speed: float, say: Callable[[str], None]
) -> None:
    """Serve the vehicle on every link until the process gets SIGINT, SIGTERM or SIGHUP.

    `speed` is in simulated seconds per second; infinite: as fast as possible. `say` gets one
    line once all links are open.

    Raises:
        LinkLostError: a link cannot be opened.
        FlightError: the simulated aircraft left the range of its physics.
    """
    try:
        asyncio.run(_serve(vehicle, links, speed=speed, say=say))
    except LinkError as error:
        raise LinkLostError(str(error)) from None
    except FlightDynamicsError as error:
        raise FlightError(f"the simulated aircraft failed: {error}") from error


async def _serve(
    vehicle: Vehicle, links: Sequence[UdpLink], *, speed: float, say: Callable[[str], None]
) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in signals:
        loop.add_signal_handler(number, stop.set)
    try:
        async with Simulation(vehicle, *links, speed=speed, free_running=True):
            home = vehicle.aircraft.frame.origin
            pace = "as fast as possible" if math.isinf(speed) else f"at {speed:g}x real time"
            where = ", ".join(link.url for link in links)
            say(
                f"vehicle at {home.lat_deg:.7f}, {home.lon_deg:.7f}, "
                f"{home.alt_msl_m:g} m, {pace}, MAVLink on {where}; Ctrl-C ends"
            )
            await stop.wait()
    finally:
        for number in signals:
            loop.remove_signal_handler(number)
