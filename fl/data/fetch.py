"""Data sets from their official locations, verified by checksum; and a check of a data folder."""

import gzip
import http.client
import os
import tempfile
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fl.data.files import CIFAR_ARCHIVE_MD5, IDX_MD5, LARGEST_BYTES, UNPACKING_ERRORS, md5
from fl.data.idx import NAMES
from fl.data.load import load
from fl.errors import FETCHED, DataDamagedError, DataMissingError, FetchError
from native.errors import SettingError, first_line

CHUNK = 1 << 18
TIMEOUT_S = 30.0
CIFAR_ARCHIVE = "cifar-10-python.tar.gz"

# Where the data sets' authors, or the mirrors they are commonly taken from, keep them. MNIST's
# own page no longer serves the files; the checksum is what makes a copy official.
LOCATIONS: Mapping[str, str] = {
    "mnist": "https://ossci-datasets.s3.amazonaws.com/mnist/",
    "fashion-mnist": "http://fashion-mnist.s3-website.eu-central-1.amazonaws.com/",
    "cifar10": "https://www.cs.toronto.edu/~kriz/",
}

Progress = Callable[[str, int, int | None], None]  # file, bytes so far, bytes altogether


@dataclass(frozen=True)
class TaskCheck:
    """Check of a data folder: whether one task's files are there, and whether they are whole."""

    task: str
    status: Literal["official", "intact", "missing", "damaged"]
    detail: str


def fetch(
    task: str,
    data_dir: Path,
    *,
    locations: Mapping[str, str] = LOCATIONS,
    progress: Progress | None = None,
) -> tuple[Path, ...]:
    """Download `task` into its sub-folder of `data_dir`; return the paths, new or already there.

    A file is put in place only after its checksum was found right, and one that is there and
    right is left alone. Raises `FetchError` naming the address.
    """
    if task not in locations:
        raise SettingError("task", task, f"can be fetched: {', '.join(locations)}")
    if task == "cifar10":
        wanted = {CIFAR_ARCHIVE: CIFAR_ARCHIVE_MD5[CIFAR_ARCHIVE]}
    else:
        wanted = {f"{name}.gz": IDX_MD5[task][name] for name in NAMES}
    folder = data_dir / task
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingError(
            "data_dir", str(data_dir), f"cannot be written: {error.strerror}"
        ) from error
    paths = []
    for name, checksum in wanted.items():
        path = folder / name
        if not (path.is_file() and _sum_of(path) == checksum):
            download(locations[task] + name, path, checksum=checksum, progress=progress)
        paths.append(path)
    return tuple(paths)


def check(data_dir: Path, *, tasks: tuple[str, ...] = FETCHED) -> tuple[TaskCheck, ...]:
    """Read every task from `data_dir` as a run would, and say what was found."""
    found = []
    for task in tasks:
        try:
            dataset = load(task, data_dir=data_dir)
        except DataMissingError as error:
            found.append(TaskCheck(task, "missing", str(error)))
        except DataDamagedError as error:
            found.append(TaskCheck(task, "damaged", str(error)))
        else:
            source = dataset.provenance
            found.append(
                TaskCheck(
                    task,
                    "official" if source.official else "intact",
                    f"{source.source}: {len(dataset.train.labels)} training,"
                    f" {len(dataset.validation.labels)} validation images",
                )
            )
    return tuple(found)


def download(
    url: str,
    path: Path,
    *,
    checksum: str | None,
    sum_of: Callable[[Path], str] | None = None,
    progress: Progress | None = None,
    mode: int = 0o644,
) -> str:
    """Download `url` to `path`, whole and with the wanted `checksum` (None: any), or not at all.

    Returns its checksum, of which `sum_of` may raise what forbids the file.

    Raises:
        FetchError: names the address.
    """
    part = ""
    try:
        handle, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as out:
            for piece, done, total in _pieces(url):
                out.write(piece)
                if progress is not None:
                    progress(path.name, done, total)
        Path(part).chmod(mode)
        got = (sum_of or _sum_of)(Path(part))
        if checksum not in (None, got):
            raise FetchError(url, f"its checksum is {got or 'unreadable'}, wanted is {checksum}")
        Path(part).replace(path)
        return got
    except OSError as error:
        raise FetchError(url, f"cannot be stored as {path}: {error.strerror}") from error
    finally:
        if part:
            Path(part).unlink(missing_ok=True)


def _pieces(url: str) -> Iterator[tuple[bytes, int, int | None]]:
    """What a server sends, with bytes so far and altogether, where it says those.

    Raises:
        FetchError: it cannot be reached, or answers anything but a whole file.
    """
    done = 0
    try:
        # The addresses are constants of this module (or a caller's own).
        with urllib.request.urlopen(url, timeout=TIMEOUT_S) as source:
            total = getattr(source, "length", None)  # it counts down; None for FTP, too
            if source.status != http.HTTPStatus.OK:
                raise FetchError(url, f"the server answers {source.status} {source.reason}")
            while piece := source.read(CHUNK):
                done += len(piece)
                if done > LARGEST_BYTES:
                    raise FetchError(url, f"the server sends more than {LARGEST_BYTES} bytes")
                yield piece, done, total
    except urllib.error.HTTPError as error:
        raise FetchError(url, f"the server answers {error.code} {error.reason}") from error
    except OSError as error:
        reason = getattr(error, "reason", error)
        words = getattr(reason, "strerror", None) or reason
        raise FetchError(url, f"{words}; is there a network?") from error
    except (http.client.HTTPException, ValueError, OverflowError) as error:
        raise FetchError(url, f"no answer that can be read: {first_line(error)}") from error
    if total not in (None, done):
        raise FetchError(url, f"the server promised {total} bytes and sent {done}; try again")


def _sum_of(path: Path) -> str:
    """MD5 sum of an IDX file's unpacked content, or of an archive; '' where it is unreadable."""
    try:
        content = path.read_bytes()
        return md5(gzip.decompress(content) if "idx" in path.name else content)
    except (OSError, *UNPACKING_ERRORS):
        return ""
