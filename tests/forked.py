"""`aerofed` in processes of its own that need not load it: forks of one that has.

Loading takes longer than what most tests ask of such a process.
"""

import multiprocessing
import multiprocessing.forkserver
import os
import signal
import sys
from itertools import count
from multiprocessing.connection import Connection
from typing import Any

import loaded  # noqa: F401  # and here: JSBSim is told in the environment to be silent
import pytest
import undrawn
from patience import HANG_S

from mission.cli import main

_PATH = tuple(sys.path)
_LOADED = multiprocessing.get_context("forkserver")
_LOADED.set_forkserver_preload(["loaded"])


def _aerofed(
    words: tuple[str, ...],
    environment: dict[str, str],
    *streams: Connection,
    path: tuple[str, ...],
    pictures: bool,
    at_ctrl_c: Any,
    killed_at: int,
) -> None:
    for number, stream in enumerate(streams, start=1):
        os.dup2(stream.fileno(), number)
        stream.close()
    sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1) for number in (1, 2))
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:] = path  # without folders that tests of the other process have taken code from
    signal.signal(signal.SIGINT, at_ctrl_c)
    if not pictures:
        undrawn.stand_in()
    if killed_at:
        os.fsync = _deadly(os.fsync, killed_at)
    main(words)


def _deadly(fsync: Any, nth: int) -> Any:
    calls = count(1)

    def deadly(file: int) -> None:
        if next(calls) == nth:
            os.kill(os.getpid(), signal.SIGKILL)
        fsync(file)

    return deadly


class Forked:
    """`aerofed WORDS`, with the folder and the environment of here, its `pictures` of runs, and
    what it does at Ctrl-C until it says itself. It is killed when it is about to have its nth
    write on the disk: `killed_at`, from 1."""

    def __init__(
        self,
        *words: str,
        pictures: bool = False,
        at_ctrl_c: Any = signal.default_int_handler,
        killed_at: int = 0,
    ) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PYTHONPATH", os.pathsep.join(_PATH))  # where `loaded` is found
            multiprocessing.forkserver.ensure_running()
        (said, out), (complained, err) = (_LOADED.Pipe(duplex=False) for _ in range(2))
        self._process = _LOADED.Process(
            target=_aerofed, args=(words, dict(os.environ), out, err),
            kwargs={
                "path": _PATH, "pictures": pictures, "at_ctrl_c": at_ctrl_c, "killed_at": killed_at
            },
        )  # fmt: skip
        with said, complained, out, err:
            self._process.start()
            self.stdout, self.stderr = (
                os.fdopen(os.dup(stream.fileno())) for stream in (said, complained)
            )
        assert self._process.pid is not None
        self.pid = self._process.pid

    def poll(self) -> int | None:
        """The exit code, less than zero by a signal, of a process that has ended."""
        return self._process.exitcode

    def send_signal(self, number: signal.Signals) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def ended(self) -> tuple[int | None, str, str]:
        """Its exit code, and what it printed and has not been read, once it has ended."""
        with self.stdout, self.stderr:
            self._process.join(HANG_S)
            if self.poll() is None:
                self._process.kill()
            return self.poll(), self.stdout.read(), self.stderr.read()
