"""Ctrl-C, and what stops a job politely: heard wherever the program happens to be."""

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import asyncio

T = TypeVar("T")

# Long enough for the C code that called back to return to Python.
_AGAIN_S = 0.1

_one_only = False  # within `one_interruption`


def hear_interruptions() -> None:
    """Have SIGTERM and SIGHUP do what Ctrl-C does, and none be lost in a callback from C.

    An exception in such a callback has nobody to go to: Python prints it and goes on. An
    interruption is sent again instead.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A script's background job stays deaf to the terminal's Ctrl-C, but not to SIGTERM.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # From batch systems, containers, timeout(1); from a terminal that goes away, unless nohup has
    # had it ignored; from `_unraisable`.
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: _thread.interrupt_main())
    sys.unraisablehook = _unraisable


def run_flight(flight: Coroutine[Any, Any, T]) -> T:
    """Run a flight as `asyncio.run` does; however often Ctrl-C is pressed, it is ended once.

    asyncio raises KeyboardInterrupt in the midst of the ending at the second one, and MAVSDK taken
    down under its own threads ends the process by SIGABRT.

    Raises:
        KeyboardInterrupt: the flight was interrupted; when all of it has ended. Within
            `one_interruption` no other one is heard from then on.
    """
    import asyncio  # not while the program is loading

    here = threading.current_thread() is threading.main_thread()
    if here and signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return asyncio.run(flight)  # Ctrl-C is somebody else's: a sweep's, say
    interrupted = False

    def interrupt(task: "asyncio.Future[T]") -> None:
        nonlocal interrupted
        if not interrupted:
            interrupted = True
            task.cancel()

    async def fly() -> "asyncio.Future[T]":
        task, loop = asyncio.ensure_future(flight), asyncio.get_running_loop()
        if here:
            loop.add_signal_handler(signal.SIGINT, interrupt, task)
        else:  # signals are the main thread's
            _told.hear(lambda: loop.call_soon_threadsafe(interrupt, task))
        await asyncio.wait((task,))
        if here and interrupted and _one_only:
            _go_deaf(loop)
        return task

    ended = asyncio.run(fly())
    if interrupted and ended.cancelled():
        raise KeyboardInterrupt
    return ended.result()


def in_a_thread(work: Callable[[], T]) -> T:
    """What `work` gives, done in a thread of its own: here an event loop is running already.

    An interruption here ends the flight in it as it would have ended one here, once.
    """
    teller = _Teller()

    def told() -> T:
        _told.teller = teller
        return work()

    with ThreadPoolExecutor(1, thread_name_prefix="aerofed") as pool, _heard(teller):
        return pool.submit(told).result()


@contextmanager
def _heard(teller: "_Teller") -> Iterator[None]:
    """Ctrl-C goes to the teller for as long as the block runs.

    A loop that waits here has its own way with the signal, which comes to us too late: asyncio
    cancels its main task, and that waits for us.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    signal.signal(signal.SIGINT, lambda *_: teller.tell())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class _Teller:
    """Tells a flight in another thread of an interruption, also of one before it began."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._interrupt: Callable[[], object] | None = None
        self._interrupted = False

    def tell(self) -> None:
        """Interrupt the flight; called from the thread that hears signals."""
        with self._lock:
            self._interrupted = True
            if self._interrupt is not None:
                with suppress(RuntimeError):  # the flight's loop is closed: it has ended
                    self._interrupt()

    def hear(self, interrupt: Callable[[], object]) -> None:
        """Register the flight's interruption; called from its own thread."""
        with self._lock:
            self._interrupt = interrupt
            if self._interrupted:
                interrupt()


class _Told(threading.local):
    """Who tells the flight of this thread; nobody, where the thread is somebody else's."""

    teller: _Teller | None = None

    def hear(self, interrupt: Callable[[], object]) -> None:
        if self.teller is not None:
            self.teller.hear(interrupt)


_told = _Told()


def _go_deaf(loop: "asyncio.AbstractEventLoop") -> None:
    """Without an instant in which an interruption is heard: the loop sets Python's handler."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    loop.remove_signal_handler(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def one_interruption() -> Iterator[None]:
    """Once a flight in the block was interrupted, the block completes what it writes."""
    global _one_only
    _one_only = True
    try:
        yield
    finally:
        _one_only = False
        here = threading.current_thread() is threading.main_thread()
        if here and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def end_deaf() -> None:
    """What there is to do is done: an interruption has nothing left to end."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    # `python -m` takes an interruption within an `exec` of text, as dataclasses are made, for one
    # that nobody catches, and ends by SIGINT in the place of our exit code. The next `exec` clears
    # that.
    exec("")


def _unraisable(lost: "sys.UnraisableHookArgs") -> None:
    if lost.exc_type is KeyboardInterrupt:
        # By a signal, which wakes whoever sleeps or waits.
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    else:
        sys.__unraisablehook__(lost)
