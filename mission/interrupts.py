"""Ctrl-C, and what stops a job politely: heard wherever the program happens to be."""

import _thread
import signal
import sys
import threading

# Long enough for the C code that called back to return to Python.
_AGAIN_S = 0.1


def hear_interruptions() -> None:
    """Have SIGTERM do what Ctrl-C does, and neither be lost in a callback from C.

    An exception in such a callback has nobody to go to: Python prints it and goes on. An
    interruption is sent again instead.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A script's background job stays deaf to the terminal's Ctrl-C, but not to SIGTERM.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # From batch systems, containers, timeout(1).
    signal.signal(signal.SIGTERM, lambda *_: _thread.interrupt_main())
    sys.unraisablehook = _unraisable


def _unraisable(lost: "sys.UnraisableHookArgs") -> None:
    if lost.exc_type is KeyboardInterrupt:
        again = threading.Timer(_AGAIN_S, _thread.interrupt_main)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(lost)
