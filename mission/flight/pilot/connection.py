"""From a MAVSDK URL to a pilot for the vehicle that answers there."""

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from mavsdk.asyncio import Configuration, Mavsdk
from mavsdk.autopilot import Autopilot
from mavsdk.component_type import ComponentType
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe

from mission.base.errors import LinkLostError
from mission.flight.pilot.dialects import ARDUPILOT, PX4
from mission.flight.pilot.pilot import Pilot
from sitl.block import following
from sitl.links import RawLink

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 10.0  # of a vehicle in this process or on this machine


class NoVehicleError(LinkLostError):
    """No autopilot answered at the URL in time."""


@asynccontextmanager
async def connect(
    at: str | RawLink,
    *,
    stall_timeout_s: float = 30.0,
    timeout_s: float = CONNECT_TIMEOUT_S,
) -> AsyncIterator[Pilot]:
    """Open a MAVSDK connection and yield a pilot for the first autopilot on it.

    `at`: MAVSDK's URL, or the other end of a vehicle's link in this process.

    Raises:
        LinkLostError: the connection cannot be opened.
        NoVehicleError: no autopilot answers on it within `timeout_s` of wall time.
    """
    raw_link, url = (None, at) if isinstance(at, str) else (at, "raw://")
    log_subscribe(_log_mavsdk)
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


def _log_mavsdk(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Take MAVSDK's own messages into ours; for `log_subscribe`."""
    # MAVSDK's complaints are for whoever debugs; what matters of them becomes our own errors.
    worth = logging.INFO if level in (LogLevel.WARN, LogLevel.ERROR) else logging.DEBUG
    logger.log(worth, "mavsdk: %s", message)
    return True
