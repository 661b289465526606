"""CIFAR-10: Python or binary batches, in a tar archive or extracted.

A binary batch is n records of a label byte and 3072 pixel bytes. A Python batch is a pickled
dictionary with "data" (n, 3072) uint8 and "labels". A pickle is a program: only the official
batches, known by their MD5 sums, are unpickled. Pixels run channel, row, column.
"""

import bz2
import gzip
import lzma
import pickle
import tarfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from fl.data.dataset import Dataset, Provenance, SourceFile, Split, checked
from fl.data.files import CIFAR_ARCHIVE_MD5, CIFAR_BATCH_MD5, Bounded, md5, read_up_to, reading
from fl.errors import DataDamagedError, DataLayoutError, DataMissingError

CLASSES = 10
PIXELS = 3 * 32 * 32
TEST = "test_batch"
BATCHES = (*(f"data_batch_{i}" for i in range(1, 6)), TEST)
Batch = tuple[NDArray[np.uint8], NDArray[np.int64]]  # pixels (n, 3072), labels (n,)
WANTED = (
    "cifar-10-python.tar.gz, cifar-10-binary.tar.gz (any cifar-10*.tar*), or the extracted"
    " cifar-10-batches-py or cifar-10-batches-bin, in the folder or in its sub-folder cifar10/"
)


def load(data_dir: Path) -> Dataset:
    """CIFAR-10 from `data_dir` or its sub-folder: extracted batches first, then archives."""
    folders = [data_dir, data_dir / "cifar10"]
    for folder in folders:
        for place in (folder, folder / "cifar-10-batches-py", folder / "cifar-10-batches-bin"):
            if any((place / name).is_file() for name in (TEST, f"{TEST}.bin")):
                return _decode(place, _read_folder(place))
    for folder in folders:
        for archive in sorted(folder.glob("cifar-10*.t*"), key=lambda p: (len(p.name), p.name)):
            if archive.is_file():
                official = md5(archive.read_bytes()) in CIFAR_ARCHIVE_MD5.values()
                return _decode(archive, read_archive(archive), official=official)
    raise DataMissingError("cifar10", data_dir, WANTED)


def read_archive(path: Path) -> dict[str, bytes]:
    """The batches in a tar archive of any compression, by file name; nothing is extracted.

    The archive is read to its last byte, so that the checksum of its compression is verified.
    What unpacks to more than `LARGEST_BYTES` is refused.
    """
    batches: dict[str, bytes] = {}
    damage = tarfile.TarError, EOFError, zlib.error, lzma.LZMAError
    with reading(path, "archive", *damage), path.open("rb") as raw, _unpacked(raw) as unpacked:
        stream = Bounded(unpacked, path=path)
        with tarfile.open(fileobj=cast(IO[bytes], stream), mode="r:") as archive:
            for member in archive:
                name = member.name.rpartition("/")[2]
                if member.isfile() and name.removesuffix(".bin") in BATCHES:
                    content = archive.extractfile(member)
                    if content is not None:
                        batches[name] = read_up_to(content, member.size, path=path)
        stream.exhaust()
    return batches


def decode_python(name: str, content: bytes, *, path: str) -> Batch:
    """Unpickle the official batch of that name. Raises DataLayoutError for any other content."""
    if md5(content) != CIFAR_BATCH_MD5[name]:
        raise DataLayoutError(
            path,
            f"not the official batch (its MD5 sum is {md5(content)}), and pickles of others are "
            "not opened, as they may run anything: give the binary version, cifar-10-batches-bin",
        )
    batch = pickle.loads(content, encoding="latin-1")
    return batch["data"], np.asarray(batch["labels"], dtype=np.int64)


def decode_binary(content: bytes, *, path: str) -> Batch:
    """Pixels (n, 3072) of uint8 and labels (n,) of a batch in the binary version.

    Raises:
        DataDamagedError: it is cut short, or holds a label beyond 9.
    """
    if len(content) % (PIXELS + 1):
        raise DataDamagedError(
            path, f"{len(content)} bytes are no whole number of {PIXELS + 1}-byte records"
        )
    records = np.frombuffer(content, np.uint8).reshape(-1, PIXELS + 1)
    pixels, labels = records[:, 1:], records[:, 0].astype(np.int64)
    if len(labels) and labels.max() >= CLASSES:
        raise DataDamagedError(path, f"holds a label {labels.max()}, the classes are 0 to 9")
    return pixels, labels


def _decode(source: Path, batches: dict[str, bytes], *, official: bool = False) -> Dataset:
    """Decode all batches into a data set; `official`: their archive has its official MD5 sum."""
    binary = f"{TEST}.bin" in batches
    names = [f"{name}.bin" if binary else name for name in BATCHES]
    if lacking := [name for name in names if name not in batches]:
        raise DataDamagedError(source, f"lacks {', '.join(lacking)}")
    files = tuple(SourceFile(name, md5(batches[name]), official or not binary) for name in names)
    parts = [
        decode_binary(batches[name], path=f"{source}: {name}")
        if binary
        else decode_python(name, batches[name], path=f"{source}: {name}")
        for name in names
    ]
    provenance = Provenance(str(source), all(file.official for file in files), files)
    train, validation = _split(parts[:-1]), _split(parts[-1:])
    return checked("cifar10", train, validation, classes=CLASSES, provenance=provenance)


def _split(parts: Sequence[Batch]) -> Split:
    count = sum(len(labels) for _, labels in parts)
    images = np.empty((count, 32, 32, 3), dtype=np.uint8)
    start = 0
    for pixels, labels in parts:
        images[start : start + len(labels)] = pixels.reshape(-1, 3, 32, 32).transpose(0, 2, 3, 1)
        start += len(labels)
    return Split(images, np.concatenate([labels for _, labels in parts]))


def _read_folder(folder: Path) -> dict[str, bytes]:
    batches: dict[str, bytes] = {}
    for name in (*BATCHES, *(f"{name}.bin" for name in BATCHES)):
        path = folder / name
        if path.is_file():
            with reading(path):
                batches[name] = path.read_bytes()
    return batches


def _unpacked(raw: IO[bytes]) -> IO[bytes]:
    start = raw.read(2)
    raw.seek(0)
    openers: dict[bytes, Callable[[IO[bytes]], object]] = {
        b"\x1f\x8b": gzip.open,
        b"\xfd7": lzma.open,
        b"BZ": bz2.open,
    }
    return cast(IO[bytes], openers[start](raw)) if start in openers else raw
