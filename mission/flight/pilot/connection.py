"""From a MAVSDK URL to a pilot for the vehicle that answers there, and until it can be flown: its
position is known and near the area."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from functools import cache

import numpy as np
from mavsdk.asyncio import Configuration, Mavsdk
from mavsdk.autopilot import Autopilot
from mavsdk.component_type import ComponentType
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe

from mission.base.area import Area
from mission.base.errors import FlightError, InputError, LinkLostError
from mission.config.link import LinkConfig
from mission.flight.pilot.dialects import ARDUPILOT, PX4
from mission.flight.pilot.feed import Known, TelemetryFeed
from mission.flight.pilot.pilot import Pilot
from sitl.block import following
from sitl.links import RawLink
from sitl.observer import VehicleObserver

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 10.0  # of a vehicle in this process or on this machine
FARTHEST_M = 5_000.0  # the vehicle from the area's home, before anything flies
PATIENT_S = 3.0  # wall time before people are told what is waited for
POLL_S = 0.05  # wall time between looks at what telemetry has said


class NoVehicleError(LinkLostError):
    """No autopilot answered at the URL in time."""


@asynccontextmanager
async def connect(
    at: str | RawLink, *, stall_timeout_s: float = 30.0, timeout_s: float = CONNECT_TIMEOUT_S
) -> AsyncIterator[Pilot]:
    """Open a MAVSDK connection and yield a pilot for the first autopilot on it.

    `at`: MAVSDK's URL, or the other end of a vehicle's link in this process.

    Raises:
        LinkLostError: the connection cannot be opened.
        NoVehicleError: no autopilot answers on it within `timeout_s` of wall time.
    """
    raw_link, url = (None, at) if isinstance(at, str) else (at, "raw://")
    _take_log()
    station = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(station) as mavsdk:
        try:
            await mavsdk.add_any_connection(url)
        except MavsdkError as error:
            raise LinkLostError(f"cannot open {url}: {_why(error)}") from None
        if raw_link is not None:
            # The asyncio wrapper of mavsdk 4.1 does not pass the two calls on that this needs.
            core = mavsdk._mavsdk
            core.subscribe_raw_bytes_to_be_sent(raw_link.feed)
            raw_link.attach(core.pass_received_raw_bytes)
        try:
            system = await mavsdk.first_autopilot(timeout_s=timeout_s)
            if system is None:
                raise NoVehicleError(f"no vehicle answered on {url} in {timeout_s:g} s")
            kind = await system.autopilot_type()
            dialect = ARDUPILOT if kind == Autopilot.ARDUPILOT else PX4
            pilot = Pilot(system, dialect=dialect, stall_timeout_s=stall_timeout_s)
            if dialect is ARDUPILOT:
                await pilot.messages.know_ardupilot()
            async with following(pilot.watch.run(), name="telemetry"):
                yield pilot
        finally:
            if raw_link is not None:
                raw_link.detach()


def _why(error: MavsdkError) -> str:
    """MAVSDK's word for what keeps it from opening a connection, in small letters."""
    return str(error).rpartition(": ")[2].replace("_", " ").lower()


@cache
def _take_log() -> None:
    """Take MAVSDK's messages, once: another MAVSDK of this process may be calling what took them
    before, which `log_subscribe` frees."""
    log_subscribe(_log_mavsdk)


def _log_mavsdk(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Take MAVSDK's own messages into ours; for `log_subscribe`."""
    # MAVSDK's complaints are for whoever debugs; what matters of them becomes our own errors.
    worth = logging.INFO if level in (LogLevel.WARN, LogLevel.ERROR) else logging.DEBUG
    logger.log(worth, "mavsdk: %s", message)
    return True


@asynccontextmanager
async def located(
    link: LinkConfig,
    *,
    area: Area,
    observers: Sequence[VehicleObserver],
    say: Callable[[str], None],
    raw_link: RawLink | None = None,
    known: Known | None = None,
) -> AsyncIterator[tuple[Pilot, TelemetryFeed]]:
    """Context manager: connect to a vehicle, wait for its position, give its pilot and feed.

    It is at the other end of `raw_link` where one is given, else at `link.url`.

    Raises:
        LinkLostError: no autopilot there in time.
        FlightError: it does not come to know where it is.
        InputError: it is farther than `FARTHEST_M` from the area's home.
    """
    async with connect(
        raw_link or link.url, stall_timeout_s=link.stall_timeout_s, timeout_s=link.connect_timeout_s
    ) as pilot:
        feed = TelemetryFeed(pilot, area=area, observers=observers, known=known)
        pilot.clock = lambda: feed.now_s
        async with following(feed.watch(), name="telemetry feed"):
            await feed.ask()
            await _locate(feed, area, timeout_s=link.ready_timeout_s, say=say)
            yield pilot, feed


async def _locate(
    feed: TelemetryFeed, area: Area, *, timeout_s: float, say: Callable[[str], None]
) -> None:
    """Wait for the first valid position; refuse one beyond `FARTHEST_M` from the area's home."""
    said = asyncio.get_running_loop().call_later(
        PATIENT_S,
        lambda: say(
            f"waiting for the vehicle's position ({feed.readiness.missing or 'not told yet'})"
        ),
    )
    try:
        async with asyncio.timeout(timeout_s):
            place = await feed.first
    except TimeoutError:
        raise FlightError(
            f"the vehicle has not come to know in {timeout_s:g} s where it is "
            f"(link.ready_timeout_s): {feed.readiness.missing or 'it sends no position'}"
        ) from None
    finally:
        said.cancel()
    away = area.frame.to_ned(place.lat_deg, place.lon_deg, place.alt_msl_m)
    away_m = float(np.linalg.norm(away))
    if away_m > FARTHEST_M:
        raise InputError(
            f"the vehicle stands {away_m / 1e3:.0f} km from the area: set area.home_lat_deg and "
            f"area.home_lon_deg near {place.lat_deg:.4f}, {place.lon_deg:.4f}, or move the vehicle"
        )


async def until_ready(pilot: Pilot, feed: TelemetryFeed, *, timeout_s: float) -> None:
    """Wait until the vehicle knows where it is and says that it can be armed.

    Raises:
        FlightError: not in time; says what is missing.
    """
    try:
        async with asyncio.timeout(timeout_s):
            await until(lambda: not feed.readiness.missing and pilot.watch.armable)
    except TimeoutError:
        said = pilot.watch.last_warning
        why = feed.readiness.missing or (f"it said: {said}" if said else "it does not say why")
        raise FlightError(
            f"the vehicle cannot be armed after {timeout_s:g} s (link.ready_timeout_s): {why}"
        ) from None


async def until(met: Callable[[], bool], *, poll_s: float = POLL_S) -> None:
    """Wait for a condition that telemetry may meet; `poll_s`: wall time between looks."""
    while not met():  # noqa: ASYNC110  of another thread's making
        await asyncio.sleep(poll_s)
