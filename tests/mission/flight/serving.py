"""`aerofed sitl` in a process of its own, for the tests that talk to it."""

import random
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from forked import Forked


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM, *, count: int = 1) -> int:
    """The first of `count` free ports in a row, below those that systems give to whoever asks for
    any: until it is used, no socket of another test gets it by chance."""
    while True:
        first = random.SystemRandom().randrange(20_000, 32_000)
        with ExitStack() as probes, suppress(OSError):
            for port in range(first, first + count):
                probe = probes.enter_context(socket.socket(socket.AF_INET, kind))
                probe.bind(("127.0.0.1", port))
            return first


@contextmanager
def served(*arguments: str) -> Iterator[Forked]:
    """Serve until the block ends; ending it by Ctrl-C must be a success without a word."""
    process = Forked("sitl", *arguments)
    try:
        while "Ctrl-C ends" not in (line := process.stdout.readline()):
            assert line, process.stderr.read()  # a line for each of several vehicles
        yield process
    except BaseException:
        process.send_signal(signal.SIGKILL)
        process.ended()
        raise
    process.send_signal(signal.SIGINT)
    code, _, errors = process.ended()
    assert (code, errors) == (0, ""), errors
