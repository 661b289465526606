"""Calls into MAVSDK, and what its plugins lack: messages as fields, commands to one vehicle."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, TypeVar

from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from sitl.autopilot.codec.orders import Fields

logger = logging.getLogger(__name__)

Answer = TypeVar("Answer")

SETTLE_TIMEOUT_S = 10.0  # MAVSDK's own time-outs are shorter
ACCEPTED = 0  # MAV_RESULT
SET_MESSAGE_INTERVAL = 511
DO_SET_MODE = 176
CUSTOM_MODE = 1.0  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED

# MAVSDK brings the common messages only. From ardupilotmega.xml of pymavlink 2.4.50.
_ARDUPILOT = """<?xml version="1.0"?>
<mavlink><messages><message id="193" name="EKF_STATUS_REPORT">
<description>EKF Status message including flags and variances.</description>
<field type="uint16_t" name="flags">Flags.</field>
<field type="float" name="velocity_variance">Velocity variance.</field>
<field type="float" name="pos_horiz_variance">Horizontal Position variance.</field>
<field type="float" name="pos_vert_variance">Vertical Position variance.</field>
<field type="float" name="compass_variance">Compass variance.</field>
<field type="float" name="terrain_alt_variance">Terrain Altitude variance.</field>
<extensions/>
<field type="float" name="airspeed_variance">Airspeed variance.</field>
</message></messages></mavlink>"""


async def settled(call: Awaitable[Answer]) -> Answer:
    """Await a MAVSDK call; a cancellation is raised only when the call has ended.

    The call runs in a thread, and MAVSDK must not be taken down under it: both would wait for
    ever.
    """
    running = asyncio.ensure_future(call)
    try:
        return await asyncio.shield(running)
    except asyncio.CancelledError:
        await asyncio.wait((running,), timeout=SETTLE_TIMEOUT_S)
        if running.done() and not running.cancelled():
            running.exception()  # seen, so that nobody reports it as forgotten
        raise


async def follow(*streams: tuple[AsyncIterator[Any], Callable[[Any], None]]) -> None:
    """Hand everything that each stream brings to its taker, until cancelled."""

    async def each(stream: AsyncIterator[Any], take: Callable[[Any], None]) -> None:
        async for one in stream:
            take(one)

    async with asyncio.TaskGroup() as group:
        for stream, take in streams:
            group.create_task(each(stream, take))


def reason(error: MavsdkError) -> str:
    """MAVSDK's result alone, without the arguments of the call."""
    return str(error).partition(";")[0]


class Messages:
    """The messages that one vehicle sends, by name, and the commands that it acknowledges."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._direct = MavlinkDirectAsync(system)

    async def know_ardupilot(self) -> None:
        """Learn the messages that only ArduPilot sends."""
        await settled(self._direct.load_custom_xml(_ARDUPILOT))

    async def of(self, name: str) -> AsyncIterator[Fields]:
        """The fields of every message of that name from now on."""
        async for message in self._direct.subscribe_message(name):
            yield json.loads(message.fields_json)

    async def command(self, number: int, *params: float) -> int | None:
        """Send a MAV_CMD; return the MAV_RESULT of its acknowledgement, None if none came."""
        target = await self._system.get_system_id()
        values = (*params, *(0.0,) * 7)[:7]
        fields = {
            "target_system": target,
            "target_component": 1,
            "confirmation": 0,
            "command": number,
            **{f"param{index}": value for index, value in enumerate(values, start=1)},
        }
        order = MavlinkMessage("COMMAND_LONG", 0, 0, target, 1, json.dumps(fields))
        try:
            answer = await settled(self._direct.send_command(order))
        except MavsdkError as error:
            logger.info("no answer to command %d: %s", number, error)
            return None
        return int(json.loads(answer.fields_json)["result"])

    async def stream(self, number: int, rate_hz: float) -> bool:
        """Request a message at a rate; return whether the vehicle agreed."""
        result = await self.command(SET_MESSAGE_INTERVAL, number, 1e6 / rate_hz)
        if result != ACCEPTED:
            logger.info("the vehicle refuses to stream message %d: %s", number, result)
        return result == ACCEPTED
