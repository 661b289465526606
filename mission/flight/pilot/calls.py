"""Calls into MAVSDK: their errors, their messages, and their end when they are interrupted."""

import asyncio
import logging
from collections.abc import Awaitable
from typing import TypeVar

from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel

logger = logging.getLogger(__name__)

Answer = TypeVar("Answer")

SETTLE_TIMEOUT_S = 10.0  # MAVSDK's own time-outs are shorter


async def settled(call: Awaitable[Answer]) -> Answer:
    """The result of a MAVSDK call. An interruption is raised when the call has ended.

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


def reason(error: MavsdkError) -> str:
    """MAVSDK's result alone, without the arguments of the call."""
    return str(error).partition(";")[0]


def log_mavsdk(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Take MAVSDK's own messages into ours; for `log_subscribe`."""
    # MAVSDK's complaints are for whoever debugs; what matters of them becomes our own errors.
    worth = logging.INFO if level in (LogLevel.WARN, LogLevel.ERROR) else logging.DEBUG
    logger.log(worth, "mavsdk: %s", message)
    return True
