"""Kernels compiled before their first call, each module of them in a process of its own.

At a first call numba compiles on one core, one kernel after the other. A module of kernels has a
`rehearse()` that calls them with next to nothing to do: whether that needs the compiler says
whether they are on disk, and in another process it brings them there.
"""

import gc
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import Any

from numba.core import event

from fl.kernels.compiled import UNCACHED

logger = logging.getLogger(__name__)


class CompilerNeededError(Exception):
    """A kernel was called that has not been compiled yet."""


class _Refusal(event.Listener):  # type: ignore[misc]  # numba has no type information
    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def on_start(self, _: Any) -> None:
        if threading.get_ident() == self._thread:
            raise CompilerNeededError

    def on_end(self, _: Any) -> None: ...


@contextmanager
def without_compiler() -> Iterator[None]:
    """Let the block load kernels from disk, but compile none.

    Raises:
        CompilerNeededError: it called one that is not there.
    """
    with event.install_listener("numba:compile", _Refusal()):
        yield


def compile_ahead(modules: Sequence[str], notice: Callable[[], None]) -> None:
    """Have the kernels of these modules on disk; `notice` is called if that takes long.

    Where no folder can be written, or a process fails, they are left to their first call.
    """
    missing = [name for name in modules if not _on_disk(name)]
    if not missing or UNCACHED:
        return
    notice()
    with ExitStack() as running:
        children = [running.enter_context(_compiling(name)) for name in missing]
        for name, child in zip(missing, children, strict=True):
            _, said = child.communicate()
            if child.returncode:
                why = said.strip().rpartition("\n")[2] or f"exit code {child.returncode}"
                logger.warning("%s: its kernels are compiled at their first call: %s", name, why)


@contextmanager
def _compiling(name: str) -> Iterator[subprocess.Popen[str]]:
    """A process that rehearses a module, ended with the block."""
    with subprocess.Popen(
        [sys.executable, "-P", "-m", __name__, name],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    ) as child:  # fmt: skip
        try:
            yield child
        finally:
            child.kill()


def _on_disk(name: str) -> bool:
    try:
        with without_compiler():
            import_module(name).rehearse()
    except CompilerNeededError:
        return False
    return True


if __name__ == "__main__":
    gc.disable()  # a tenth of the time; what it would free ends with the process
    import_module(sys.argv[1]).rehearse()
