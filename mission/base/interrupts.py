"""Ctrl-C, and what stops a job politely: heard wherever the program happens to be."""

import _thread
import signal
import sys
import threading
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
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
    # had it ignored.
    for number in (signal.SIGTERM, signal.SIGHUP):
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

    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return asyncio.run(flight)  # Ctrl-C is somebody else's: a sweep's, say
    interrupted = False

    def interrupt(task: "asyncio.Future[T]") -> None:
        nonlocal interrupted
        if not interrupted:
            interrupted = True
            task.cancel()

    async def fly() -> "asyncio.Future[T]":
        task = asyncio.ensure_future(flight)
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, interrupt, task)
        await asyncio.wait((task,))
        if interrupted and _one_only:
            _go_deaf(asyncio.get_running_loop())
        return task

    ended = asyncio.run(fly())
    if interrupted and ended.cancelled():
        raise KeyboardInterrupt
    return ended.result()


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
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def end_deaf() -> None:
    """What there is to do is done: an interruption has nothing left to end."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _unraisable(lost: "sys.UnraisableHookArgs") -> None:
    if lost.exc_type is KeyboardInterrupt:
        again = threading.Timer(_AGAIN_S, _thread.interrupt_main)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(lost)
