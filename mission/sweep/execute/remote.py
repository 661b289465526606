"""One run of a sweep on a machine that sees no folder of the sweep: bytes come and go."""

import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from mission.base.errors import InputError
from mission.base.folder_lock import alone_in
from mission.base.run_folder import RunFolder
from mission.sweep.execute.parcels import Files, Kept, Part, kept, parts
from mission.sweep.execute.worker import RunEnd, RunOrder, execute

KEEP_S = 2.0  # between two looks at how far the run is
_PREFIX = "aerofed-run-"


def fly_here(order: RunOrder, brought: Files) -> Iterator[Kept | Part | RunEnd]:
    """Fly a run in a folder of this machine that lasts as long; its end comes last.

    `brought` is what there is of the run already.

    Raises:
        Exception: whatever the run raised that is no error of the application.
    """
    with _own_folder() as home:
        folder = RunFolder(home / order.folder.name)
        for name, data in brought:
            path = folder.path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        local = replace(order, folder=folder.path, working_dir=Path.cwd())
        flight, told = _in_a_thread(local), None
        while not flight.done():
            found = kept(folder)
            if found is not None and found != told:
                told = found
                yield found
            with suppress(TimeoutError):
                flight.result(KEEP_S)
        end = flight.result()
        if folder.path.is_dir():
            yield from parts(folder.path)
    yield end if end.exit_code == 0 else _as_seen_there(end, folder.path, order.folder)


def _in_a_thread(order: RunOrder) -> "Future[RunEnd]":
    future: Future[RunEnd] = Future()

    def work() -> None:
        try:
            future.set_result(execute(order))
        except BaseException as error:
            future.set_exception(error)

    # A daemon: Ray ends the process without waiting for a run that nobody wants any more.
    threading.Thread(target=work, name="run", daemon=True).start()
    return future


def _as_seen_there(end: RunEnd, here: Path, there: Path) -> RunEnd:
    """The end in words for whoever has the run in another folder."""
    message = end.message.replace(str(here), str(there))
    return replace(end, message=f"{message} (on machine {socket.gethostname()})")


@contextmanager
def _own_folder() -> Iterator[Path]:
    """A new folder, removed afterwards; those of processes that were killed go now."""
    top = Path(tempfile.gettempdir())
    for old in top.glob(f"{_PREFIX}*"):
        with suppress(InputError), _locked(old):  # unless somebody flies in it
            shutil.rmtree(old, ignore_errors=True)
    made = Path(tempfile.mkdtemp(prefix="aerofed-new-"))
    with _locked(made):
        # Locked before it has its name: nobody takes it for a folder that was left.
        path = made.rename(top / f"{_PREFIX}{time.time_ns():x}-{made.name[-8:]}")
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)


def _locked(folder: Path) -> AbstractContextManager[None]:
    return alone_in(folder, folder / ".lock", who="run")
