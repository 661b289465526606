"""`aerofed sitl` in a process of its own, for the tests that talk to it."""

import multiprocessing
import os
import random
import signal
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from patience import HANG_S

from mission.cli import main


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


# Forks of a process that has loaded the program, which takes longer than what most tests ask of it.
LOADED = multiprocessing.get_context("forkserver")
LOADED.set_forkserver_preload(
    ["mission.cli", "mission.commands.sitl", "mission.flight.serve.vehicle"]
)


def _serve(arguments: Sequence[str], environment: dict[str, str], *streams: Connection) -> None:
    os.environ.update(environment)
    for number, stream in enumerate(streams, start=1):
        os.dup2(stream.fileno(), number)
        stream.close()
    sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1) for number in (1, 2))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main(["sitl", *arguments])


@contextmanager
def served(*arguments: str) -> Iterator[BaseProcess]:
    """Serve until the block ends; ending it by Ctrl-C must be a success without a word."""
    (said, out), (complained, err) = LOADED.Pipe(duplex=False), LOADED.Pipe(duplex=False)
    process = LOADED.Process(target=_serve, args=(arguments, dict(os.environ), out, err))
    with said, complained, closing(process):
        with out, err:
            process.start()
        with (
            os.fdopen(said.fileno(), closefd=False) as words,
            os.fdopen(complained.fileno(), closefd=False) as errors,
        ):
            try:
                while "Ctrl-C ends" not in (line := words.readline()):
                    assert line, errors.read()  # a line for each of several vehicles
                yield process
            except BaseException:
                process.kill()
                process.join()
                raise
            assert process.pid is not None
            os.kill(process.pid, signal.SIGINT)
            process.join(HANG_S)
            ended = process.exitcode, errors.read()
            assert ended == (0, ""), ended
