"""Handling of Ctrl-C, SIGTERM and SIGHUP, wherever the program happens to be."""

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from mission.base.errors import INTERRUPTED

if TYPE_CHECKING:
    import asyncio

T = TypeVar("T")
P = ParamSpec("P")

# Long enough for the C code that called back to return to Python.
_AGAIN_S = 0.1
# Two signals within it are one: timeout(1) sends its own to us and to our process group.
_SECOND_AFTER_S = 1.0
BACKGROUND = "aerofed-work"  # begins the names of threads whose work may be left alone


@dataclass(eq=False)
class _Ending:
    """The flights of a block of code, which an interruption cancels in an orderly way."""

    patient: bool  # one that comes before a flight ends it as it begins
    flights: dict["asyncio.Task[Any]", "asyncio.AbstractEventLoop"] = field(default_factory=dict)
    at_s: float | None = None  # of the first interruption, monotonic

    def interrupt(self, *_: object) -> None:
        """Handle a signal: end the flights; the second one in a program ends the process."""
        now_s = time.monotonic()
        if self.at_s is not None:
            if _is_program and now_s - self.at_s > _SECOND_AFTER_S:
                # What was written has been handed to the system: it is kept, as by a SIGKILL.
                end_process("aerofed: interrupted again: ended at once")
            return
        self.at_s = now_s
        for task, loop in list(self.flights.items()):
            with suppress(RuntimeError):  # its loop is closed: it has ended
                loop.call_soon_threadsafe(task.cancel)
        if not (self.flights or self.patient):
            raise KeyboardInterrupt


_is_program = False  # whether signals and the end of the process are ours to handle
_endings: list[_Ending] = []  # the last one is interrupted


def hear_interruptions() -> None:
    """Install handlers: SIGTERM and SIGHUP act as Ctrl-C, and none is lost in a callback from C.

    An exception in such a callback reaches no caller: Python prints it and goes on. An
    interruption is sent again instead.
    """
    global _is_program
    _is_program = True
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


@contextmanager
def ending_flights(*, patient: bool = False) -> Iterator[None]:
    """Context manager: an interruption cancels the flights of the block once; the block goes on.

    In a program a second one ends the process. Before a flight it is a KeyboardInterrupt, or, in a
    `patient` block, ends the flight as it begins. It has no effect outside the main thread, or
    where other code handles Ctrl-C, such as a sweep.
    """
    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler or (patient and callable(before))
    if not ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    ending = _Ending(patient)
    _endings.append(ending)
    signal.signal(signal.SIGINT, ending.interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _endings.remove(ending)


def run_flight(flight: Coroutine[Any, Any, T]) -> T:
    """Run a flight as `asyncio.run` does; an interruption cancels it, once.

    asyncio's own handler raises KeyboardInterrupt at a second one, amid the cancellation, and
    MAVSDK taken down under its own threads ends the process by SIGABRT.

    Raises:
        KeyboardInterrupt: the flight was interrupted; raised once all of it has ended.
    """
    import asyncio  # not while the program is loading

    async def fly() -> "asyncio.Task[T]":
        task = asyncio.ensure_future(flight)
        # Where KeyboardInterrupt leaves the loop, nobody asks how the task ended; left unasked, it
        # complains once it is collected, in the midst of anything.
        task.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
        ending = _endings[-1] if _endings else _Ending(patient=True)
        ending.flights[task] = asyncio.get_running_loop()
        try:
            if ending.at_s is not None:
                task.cancel()
            await asyncio.wait((task,))
        finally:
            del ending.flights[task]
        return task

    with nullcontext() if _endings else ending_flights():
        ended = asyncio.run(fly())
    if ended.cancelled():
        raise KeyboardInterrupt
    return ended.result()


def in_a_thread(work: Callable[[], T]) -> T:
    """Run `work` in a thread and return its result, for callers inside a running event loop.

    An interruption cancels the flight in that thread, once.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="aerofed") as pool, ending_flights(patient=True):
        return pool.submit(work).result()


async def in_background(work: Callable[P, T], *given: P.args, **named: P.kwargs) -> T:
    """Run `work` in a daemon thread and await its result, so that the event loop goes on.
    Cancelling does not stop the thread: nothing can stop a researcher's own code."""
    import asyncio

    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()

    def tell(how: Callable[[Any], None], what: object) -> None:
        with suppress(RuntimeError):  # the loop is closed: nobody waits any longer
            loop.call_soon_threadsafe(lambda: None if future.done() else how(what))

    def run() -> None:
        try:
            tell(future.set_result, work(*given, **named))
        except BaseException as error:
            tell(future.set_exception, error)

    threading.Thread(target=run, name=BACKGROUND, daemon=True).start()
    return await future


def end_process(line: str = "", code: int = INTERRUPTED) -> None:
    """End the process now, whatever its threads are at; `line` goes to standard error."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.stderr.write(f"{line}\n" if line else "")
        sys.stderr.flush()
    os._exit(code)


def prepare_exit(code: int) -> None:
    """Ignore Ctrl-C from now on: all work is done. Return, for the caller to exit with `code`.

    Where work of `in_background` still runs, end the process here instead of waiting for it.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if any(thread.name.startswith(BACKGROUND) for thread in threading.enumerate()):
        end_process(code=code)
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
