"""Ctrl-C, and what stops a job politely: heard wherever the program happens to be."""

import _thread
import signal
import sys
import threading

# Long enough for the C code that called back to return to Python.
_AGAIN_S = 0.1


def hear_interruptions() -> None:
    """Have SIGTERM do what Ctrl-C does, and neither be lost in a callback from C.

    An exception in such a callback (a compiler that hands over what it made, say) has nobody to
    go to: Python prints it and goes on. An interruption is sent again instead.
    """
    # Batch systems, containers and timeout(1) send SIGTERM.
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    sys.unraisablehook = _unraisable


def _unraisable(lost: "sys.UnraisableHookArgs") -> None:
    if lost.exc_type is KeyboardInterrupt:
        again = threading.Timer(_AGAIN_S, _thread.interrupt_main)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(lost)
