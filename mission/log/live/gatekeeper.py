"""Keeps foreign web pages off a WebSocket server on this machine.

Any page in the user's browser may open a WebSocket to 127.0.0.1; all that tells it from the viewer
is the Origin that the browser sends. The viewer's server does not look at it, so this does, in
front of it.
"""

import asyncio
import threading
from collections.abc import Collection
from contextlib import suppress
from typing import Self
from urllib.parse import urlsplit

from mission.base.errors import LinkLostError

# Foxglove's and Lichtblick's web and desktop applications; pages of this machine and programs
# that are no browser (which send no Origin) are let in, too.
ORIGINS = frozenset({"https://app.foxglove.dev", "https://studio.foxglove.dev", "file://"})
_OWN = frozenset({"localhost", "127.0.0.1", "::1"})
_HEAD_BYTES = 8192
_HEAD_S = 10.0  # wall time for the first words of a visitor
_VISITORS = 16
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


def admitted(head: bytes, origins: Collection[str] = ORIGINS) -> bool:
    """Whether the head of an HTTP request comes from where a viewer may be."""
    lines = head.decode("latin-1").split("\r\n")[1:]
    fields = [line.partition(":") for line in lines]
    named = [value.strip() for name, _, value in fields if name.strip().lower() == "origin"]
    if not named:
        return True
    try:
        host = urlsplit(named[0]).hostname
    except ValueError:
        return False
    return len(named) == 1 and (named[0] in origins or host in _OWN)


class Gatekeeper:
    """Listens at an address, and passes on to another whoever is admitted; in a thread."""

    def __init__(self, host: str, port: int, *, upstream: tuple[str, int]) -> None:
        """Start; port 0 takes a free one.

        Raises:
            LinkLostError: the port is in use or may not be opened.
        """
        self._upstream = upstream
        self._loop = asyncio.new_event_loop()
        self._visits: set[asyncio.Task[None]] = set()
        try:
            self._server = self._loop.run_until_complete(
                asyncio.start_server(self._visit, host, port, limit=_HEAD_BYTES)
            )
        except (OSError, OverflowError) as error:
            self._loop.close()
            reason = getattr(error, "strerror", None) or str(error)
            if "in use" in reason:
                reason = "the port is in use"
            raise LinkLostError(f"live view: cannot serve on {host}:{port}: {reason}") from None
        self.port = int(self._server.sockets[0].getsockname()[1])
        self._thread = threading.Thread(target=self._loop.run_forever, name="live", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop; whoever is there is sent away. Closing twice is fine."""
        if self._loop.is_closed():
            return
        asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _stop(self) -> None:
        self._server.close()
        for visit in self._visits:
            visit.cancel()
        await asyncio.gather(*self._visits, return_exceptions=True)

    async def _visit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._visits.add(task)
        try:
            # A visitor that leaves, says nothing or talks nonsense is no error of the run's.
            with suppress(OSError, TimeoutError, asyncio.IncompleteReadError, ValueError):
                await self._receive(reader, writer)
        except asyncio.CancelledError:
            pass
        finally:
            self._visits.discard(task)
            writer.close()

    async def _receive(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.timeout(_HEAD_S):
            try:
                head = await reader.readuntil(b"\r\n\r\n")
            except asyncio.LimitOverrunError:
                head = b""
        if not head or not admitted(head) or len(self._visits) > _VISITORS:
            writer.write(_REFUSAL)
            await writer.drain()
            return
        inner_reader, inner_writer = await asyncio.open_connection(*self._upstream)
        inner_writer.write(head)
        there = asyncio.create_task(_pass_on(reader, inner_writer))
        back = asyncio.create_task(_pass_on(inner_reader, writer))
        try:
            await asyncio.wait((there, back), return_when=asyncio.FIRST_COMPLETED)
        finally:
            inner_writer.close()
            there.cancel()
            back.cancel()
            await asyncio.gather(there, back, return_exceptions=True)


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(1 << 16):
        writer.write(data)
        await writer.drain()
