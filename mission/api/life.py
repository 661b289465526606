"""The thread of simulated vehicles, and what one of them and several do in it alike."""

import asyncio
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine
from contextlib import ExitStack
from numbers import Real
from typing import Any, ClassVar, Self, TypeVar

from mission.base.errors import AerofedError, InputError
from mission.flight.serve.hosts import LOOK_S, BuiltInWorld, FirmwareHost

T = TypeVar("T")


class Life:
    """The thread in which vehicles of one clock live, from `open` to `close`."""

    def __init__(self, world: BuiltInWorld | FirmwareHost) -> None:
        self.world = world
        self.clients = ExitStack()
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
            self.do(lambda: asyncio.wait_for(opened, None))
        except BaseException:
            self.close(cancel=True)
            raise

    @property
    def here(self) -> bool:
        """Whether it goes on, in this process."""
        return os.getpid() == self._pid and not self._loop.is_closed()

    def close(self, *, cancel: bool = False) -> None:
        """Close the clients, let the vehicles' life come to its end, or cancel it, and with it its
        thread, and complete the logs."""

        async def end() -> None:
            self._ended.set()
            if cancel:
                self._life.cancel()
                await asyncio.wait((self._life,))
            else:
                await self._life

        self.clients.close()
        try:
            self._in_thread(end())
        finally:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()
            for host in self.world.hosts:
                if host.logs is not None:
                    host.logs.close()

    async def _live(self, opened: "asyncio.Future[None]") -> None:
        async with self.world.alive():
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


class NotInTimeError(AerofedError, TimeoutError):
    """A condition was not met within the simulated time that it was given."""


class Simulated(ABC):
    """A vehicle or a fleet, as a context manager."""

    KIND: ClassVar[str]
    _life: Life

    def __enter__(self) -> Self:
        """Open the links.

        Raises:
            LinkLostError: one cannot be opened.
            InputError: they were opened before.
        """
        self._life.open()
        return self

    def __exit__(self, *_: object) -> None:
        """Close links and clients, and complete the logs; nothing in a process that was forked.

        Raises:
            FlightError: an aircraft had left the range of its physics.
        """
        if self._life.here:
            self._life.close()

    @property
    @abstractmethod
    def t_s(self) -> float:
        """Simulated seconds since all were switched on."""

    @abstractmethod
    def step(self, seconds: float) -> None:
        """Let simulated time pass for all."""

    @abstractmethod
    def _where(self) -> str:
        """Where all are, for an error's text."""

    def until(self, met: Callable[[Self], object], *, timeout_s: float = 60.0) -> None:
        """Let simulated time pass until `met` of this is true; it is asked each 0.1 s.

        Raises:
            NotInTimeError: `timeout_s` of simulated time were not enough.
            InputError: `met` is no function, or `timeout_s` no time.
            FlightError: an aircraft left the range of its physics.
        """
        if not callable(met) or not is_time(timeout_s):
            raise InputError(
                f"until({met!r}, timeout_s={timeout_s!r}): a function of the {self.KIND}, and "
                "simulated seconds, less than a million"
            )
        __tracebackhide__ = True  # from pytest, where `met` raises
        began_s = self.t_s
        while not met(self):
            if self.t_s - began_s >= timeout_s:
                limit_s = float(timeout_s)  # fractions have no format of numbers
                raise NotInTimeError(f"not within {limit_s:g} s of simulated time{self._where()}")
            self.step(LOOK_S)


def is_time(seconds: Any) -> bool:
    number = isinstance(seconds, Real) and not isinstance(seconds, bool)
    return number and bool(0 <= seconds < 1e6)
