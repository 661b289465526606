"""One process at a time in a folder."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mission.base.errors import InputError
from mission.base.user_files import or_input_error


@contextmanager
def without_traces(folder: Path) -> Iterator[None]:
    """Context manager: if the block fails, remove those of a folder and its parents that are new
    and empty.
    """
    new = [one for one in (folder, *folder.parents) if not os.access(one, os.F_OK)]
    try:
        yield
    except BaseException:
        for one in new:
            with suppress(OSError):  # not empty, as mostly, or never made
                one.rmdir()
        raise


@contextmanager
def alone_in(folder: Path, lock: Path, *, who: str, chosen: bool = False) -> Iterator[None]:
    """Context manager: keep every other `who` out of a folder, by a lock on the file `lock`.

    The lock's folder is made where it is missing, and removed again where the lock is refused. The
    lock ends with the process; its holder may remove the folder. `who` names the kind of process
    in messages. `chosen`: the message suggests another folder.

    Raises:
        InputError: another one is at work there, or the file cannot be written or locked.
    """
    with without_traces(lock.parent):
        with or_input_error(folder, "cannot write"):
            new = not lock.exists()
            lock.parent.mkdir(parents=True, exist_ok=True)
            file = lock.open("a")
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # A file that was removed keeps nobody out who makes a new one.
                if not os.path.samestat(os.fstat(file.fileno()), lock.stat()):
                    raise BlockingIOError
            except (BlockingIOError, FileNotFoundError):
                another = ", or name another" if chosen else ""
                raise InputError(
                    f"{folder}: another {who} is at work in this folder; "
                    f"wait until it has ended{another}"
                ) from None
            except OSError as error:  # a file system without locks
                if new:
                    lock.unlink(missing_ok=True)
                raise InputError(f"{folder}: cannot lock {lock.name}: {error.strerror}") from None
            yield
