"""MNIST and Fashion-MNIST: the IDX format, gzipped or not.

An IDX file of unsigned bytes is 0, 0, 0x08, the number of dimensions, each dimension as a
big-endian 32-bit integer, then the bytes.
"""

import gzip
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from fl.data.dataset import Dataset, Provenance, SourceFile, Split, checked
from fl.data.files import IDX_MD5, UNPACKING_ERRORS, md5, read_up_to, reading
from fl.errors import DataDamagedError, DataMissingError

CLASSES = 10
NAMES = (
    "train-images-idx3-ubyte",
    "train-labels-idx1-ubyte",
    "t10k-images-idx3-ubyte",
    "t10k-labels-idx1-ubyte",
)
WANTED = f"{', '.join(NAMES)}, each as .gz or unpacked, in the folder or in its sub-folder"
SUBFOLDERS = {
    "mnist": ("mnist", "MNIST", "MNIST/raw"),
    "fashion-mnist": ("fashion-mnist", "fashion", "FashionMNIST", "FashionMNIST/raw"),
}


def load(task: str, data_dir: Path) -> Dataset:
    """Load `task` ("mnist" or "fashion-mnist") from `data_dir` or its sub-folder."""
    folders = [data_dir / sub for sub in SUBFOLDERS[task]] + [data_dir]
    folder = next((f for f in folders if _find(f, NAMES[0]) is not None), None)
    if folder is None:
        raise DataMissingError(task, data_dir, f"{WANTED} {SUBFOLDERS[task][0]}/")
    files: list[SourceFile] = []
    arrays: dict[str, NDArray[np.uint8]] = {}
    for name in NAMES:
        path = _find(folder, name)
        if path is None:
            raise DataMissingError(task, folder, f"{name}.gz or {name}")
        content, arrays[name] = read(path, dimensions=3 if "idx3" in name else 1)
        files.append(_recognise(task, path, name, content))
    provenance = Provenance(str(folder), all(f.official for f in files), tuple(files))
    train, validation = (
        Split(
            arrays[f"{part}-images-idx3-ubyte"][..., np.newaxis],
            arrays[f"{part}-labels-idx1-ubyte"].astype(np.int64),
        )
        for part in ("train", "t10k")
    )
    return checked(task, train, validation, classes=CLASSES, provenance=provenance)


def read(path: Path, *, dimensions: int) -> tuple[bytes, NDArray[np.uint8]]:
    """The content of a file, unpacked if it is gzipped (its checksum is verified), and its array.

    Nothing is unpacked beyond what the header promises.

    Raises:
        DataDamagedError: it cannot be read, or is not what its header says.
    """
    start = 4 + 4 * dimensions
    opener = gzip.open if path.suffix == ".gz" else open
    with reading(path, "gzip", *UNPACKING_ERRORS), cast(IO[bytes], opener(path, "rb")) as stream:
        header = stream.read(start)
        shape = _shape(header, path=path, dimensions=dimensions)
        promised = int(np.prod(shape, dtype=object))
        body = read_up_to(stream, promised, path=path)
        more = bool(stream.read(1))
    if more or len(body) < promised:
        length = "more" if more else str(len(body))
        raise DataDamagedError(
            path,
            f"the header promises {'x'.join(map(str, shape))} = {promised} bytes, {length} follow",
        )
    return header + body, np.frombuffer(body, np.uint8).reshape(shape)


def _shape(header: bytes, *, path: Path, dimensions: int) -> tuple[int, ...]:
    if len(header) < 4 + 4 * dimensions:
        raise DataDamagedError(path, f"{len(header)} bytes are too few for an IDX header")
    magic = bytes((0, 0, 0x08, dimensions))
    if header[:4] != magic:
        raise DataDamagedError(
            path, f"the header starts with {header[:4].hex()}, not with {magic.hex()}"
        )
    return tuple(int(n) for n in np.frombuffer(header, ">u4", count=dimensions, offset=4))


def _find(folder: Path, name: str) -> Path | None:
    """Return the path of `name`.gz or `name`, or None; some mirrors have a dot before idx."""
    spellings = (name, name.replace("-idx", ".idx"))
    candidates = [folder / f"{s}{end}" for end in (".gz", "") for s in spellings]
    return next((path for path in candidates if path.is_file()), None)


def _recognise(task: str, path: Path, name: str, content: bytes) -> SourceFile:
    checksum = md5(content)
    for known, sums in IDX_MD5.items():
        if known != task and checksum == sums[name]:
            raise DataDamagedError(path, f"this is the file of {known}, not of {task}")
    return SourceFile(path.name, checksum, official=checksum == IDX_MD5[task][name])
