"""The thread of simulated vehicles."""

import asyncio
import os
import threading
from collections.abc import Callable, Coroutine
from contextlib import AbstractAsyncContextManager
from typing import Any, TypeVar

from mission.base.errors import InputError

T = TypeVar("T")


class Life:
    """The thread in which vehicles of one clock live, from `open` to `close`."""

    def __init__(self, alive: Callable[[], AbstractAsyncContextManager[None]]) -> None:
        self._alive = alive
        self._pid = 0  # of the process that opened it

    def open(self) -> None:
        """Open the links.

        Raises:
            LinkLostError: one cannot be opened.
            InputError: it was opened before.
        """
        if self._pid:
            raise InputError("a vehicle is opened once; aerofed.vehicle() makes another")
        self._pid = os.getpid()
        self._loop = asyncio.new_event_loop()
        opened, self._ended = self._loop.create_future(), asyncio.Event()
        self._life = self._loop.create_task(self._live(opened))
        self._thread = threading.Thread(target=self._loop.run_forever, name="vehicle", daemon=True)
        self._thread.start()
        try:
            self.do(lambda: _result(opened))
        except BaseException:
            self.close(cancel=True)
            raise

    @property
    def here(self) -> bool:
        """Whether it goes on, in this process."""
        return os.getpid() == self._pid and not self._loop.is_closed()

    def close(self, *, cancel: bool = False) -> None:
        """Let the vehicle's life come to its end, or cancel it, and with it its thread."""

        async def end() -> None:
            self._ended.set()
            if cancel:
                self._life.cancel()
                await asyncio.wait((self._life,))
            else:
                await self._life

        try:
            self._in_thread(end())
        finally:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()

    async def _live(self, opened: "asyncio.Future[None]") -> None:
        async with self._alive():
            opened.set_result(None)
            await self._ended.wait()

    def _in_thread(self, work: Coroutine[Any, Any, T]) -> T:
        """Do `work` in the vehicle's thread; an interruption cancels it, and waits for its end."""
        ended, tasks = threading.Event(), list[asyncio.Task[T]]()

        def begin() -> None:
            tasks.append(self._loop.create_task(work))
            tasks[0].add_done_callback(lambda _: ended.set())

        self._loop.call_soon_threadsafe(begin)
        try:
            ended.wait()
        except BaseException:
            self._loop.call_soon_threadsafe(lambda: tasks[0].cancel())
            ended.wait()
            raise
        return tasks[0].result()

    def check_open(self) -> None:
        if not self._pid or self._loop.is_closed():
            raise InputError(
                "the vehicle is not open: it is used inside `with aerofed.vehicle() as vehicle:`"
            )
        if os.getpid() != self._pid:
            raise InputError(
                "the vehicle is in the process from which this one was forked; open one here"
            )

    def do(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Do `work` in the vehicle's thread, while it lives."""

        async def beside_life() -> T:
            task = asyncio.ensure_future(work())
            try:
                await asyncio.wait((task, self._life), return_when=asyncio.FIRST_COMPLETED)
            finally:
                task.cancel()
                await asyncio.wait((task,))
            if task.cancelled():
                self._life.result()
            return task.result()

        self.check_open()
        return self._in_thread(beside_life())

    def look(self, at: Callable[[], T]) -> T:
        """Read something between two steps of the physics."""

        async def look() -> T:
            return at()

        return self.do(look)


async def _result(future: "asyncio.Future[T]") -> T:
    return await future
