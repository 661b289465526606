"""CIFAR-10: Python or binary batches, in a tar archive or extracted.

A Python batch is a pickled dictionary with "data" (n, 3072) uint8 and "labels"; a binary batch
is n records of a label byte and 3072 pixel bytes. Pixels run channel, row, column.
"""

import bz2
import gzip
import lzma
import tarfile
import zlib
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from fl.data.batch_pickle import BatchPickleError, load_batch
from fl.data.bounded import Bounded, read_exactly
from fl.data.dataset import Dataset, Provenance, SourceFile, Split, checked
from fl.data.official import CIFAR_ARCHIVE_MD5, CIFAR_BATCH_MD5, md5
from fl.errors import DataDamagedError, DataMissingError

CLASSES = 10
PIXELS = 3 * 32 * 32
TRAIN = tuple(f"data_batch_{i}" for i in range(1, 6))
TEST = "test_batch"
BATCHES = (*TRAIN, TEST)
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
                return _decode(place, _read_folder(place), archive_md5=None)
    for folder in folders:
        for archive in sorted(folder.glob("cifar-10*.t*"), key=lambda p: (len(p.name), p.name)):
            if archive.is_file():
                return _decode(archive, read_archive(archive), archive_md5=_md5_of(archive))
    raise DataMissingError("cifar10", data_dir, WANTED)


def read_archive(path: Path) -> dict[str, bytes]:
    """The batches in a tar archive of any compression, by file name; nothing is extracted.

    The archive is read to its last byte, so that the checksum of its compression is verified.
    What unpacks to more than `LARGEST_BYTES` is refused.
    """
    batches: dict[str, bytes] = {}
    try:
        with path.open("rb") as raw, _unpacked(raw) as unpacked:
            stream = Bounded(unpacked, path=path)
            with tarfile.open(fileobj=cast(IO[bytes], stream), mode="r:") as archive:
                for member in archive:
                    name = member.name.rpartition("/")[2]
                    if member.isfile() and name.removesuffix(".bin") in BATCHES:
                        content = archive.extractfile(member)
                        if content is not None:
                            batches[name] = read_exactly(content, member.size, path=path)
            stream.exhaust()
    except (tarfile.TarError, EOFError, zlib.error, lzma.LZMAError) as error:
        raise DataDamagedError(path, f"archive: {error}") from error
    except OSError as error:
        raise DataDamagedError(path, error.strerror or str(error)) from error
    except MemoryError:
        raise DataDamagedError(path, "takes more memory than there is") from None
    return batches


def decode_python(content: bytes, *, path: str) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """(pixels (n, 3072), labels (n,)) of a pickled batch, without running anything from it."""
    try:
        batch = load_batch(content)
    except BatchPickleError as error:
        raise DataDamagedError(path, f"not a CIFAR-10 batch: {error}") from error
    lacking = [key for key in ("data", "labels") if key not in batch]
    if lacking:
        raise DataDamagedError(path, f"not a CIFAR-10 batch: it lacks {', '.join(lacking)}")
    pixels, labels = batch["data"], batch["labels"]
    if not isinstance(pixels, np.ndarray):
        raise DataDamagedError(path, "its data are no array of bytes")
    if pixels.ndim != 2 or pixels.shape[1] != PIXELS:
        raise DataDamagedError(path, f"its data are {pixels.shape}, not (n, {PIXELS})")
    if not isinstance(labels, list) or not all(type(label) is int for label in labels):
        raise DataDamagedError(path, "its labels are no list of integers")
    if not all(0 <= label <= 255 for label in labels):
        raise DataDamagedError(path, "its labels do not fit into bytes")
    if len(labels) != len(pixels):
        raise DataDamagedError(path, f"{len(pixels)} images, but {len(labels)} labels")
    return pixels, np.asarray(labels, dtype=np.int64)


def decode_binary(content: bytes, *, path: str) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """(pixels (n, 3072), labels (n,)) of a binary batch."""
    if len(content) % (PIXELS + 1):
        raise DataDamagedError(
            path, f"{len(content)} bytes are no whole number of {PIXELS + 1}-byte records"
        )
    records = np.frombuffer(content, np.uint8).reshape(-1, PIXELS + 1)
    return records[:, 1:], records[:, 0].astype(np.int64)


def _decode(source: Path, batches: dict[str, bytes], *, archive_md5: str | None) -> Dataset:
    binary = f"{TEST}.bin" in batches
    suffix = ".bin" if binary else ""
    lacking = [f"{name}{suffix}" for name in BATCHES if f"{name}{suffix}" not in batches]
    if lacking:
        raise DataDamagedError(source, f"lacks {', '.join(lacking)}")
    decoder = decode_binary if binary else decode_python
    known_archive = archive_md5 in CIFAR_ARCHIVE_MD5.values()
    files: list[SourceFile] = []
    parts = {}
    for name in BATCHES:
        content = batches[f"{name}{suffix}"]
        found = md5(content)
        official = known_archive or (not binary and found == CIFAR_BATCH_MD5[name])
        files.append(SourceFile(f"{name}{suffix}", found, official))
        pixels, labels = decoder(content, path=f"{source}: {name}{suffix}")
        if len(labels) and not 0 <= labels.min() <= labels.max() < CLASSES:
            raise DataDamagedError(
                f"{source}: {name}{suffix}",
                f"labels from {labels.min()} to {labels.max()}, the classes are 0 to 9",
            )
        parts[name] = (pixels, labels)
    provenance = Provenance(str(source), all(f.official for f in files), tuple(files))
    return checked(
        "cifar10",
        _split([parts[name] for name in TRAIN]),
        _split([parts[TEST]]),
        classes=CLASSES,
        provenance=provenance,
    )


def _split(parts: list[tuple[NDArray[np.uint8], NDArray[np.int64]]]) -> Split:
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
            try:
                batches[name] = path.read_bytes()
            except OSError as error:
                raise DataDamagedError(path, error.strerror or str(error)) from error
    return batches


def _unpacked(raw: IO[bytes]) -> IO[bytes]:
    start = raw.read(2)
    raw.seek(0)
    if start == b"\x1f\x8b":
        return cast(IO[bytes], gzip.open(raw))
    if start == b"\xfd7":
        return cast(IO[bytes], lzma.open(raw))
    if start == b"BZ":
        return cast(IO[bytes], bz2.open(raw))
    return raw


def _md5_of(path: Path) -> str:
    return md5(path.read_bytes())
