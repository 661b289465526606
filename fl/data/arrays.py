"""Plain arrays as a data set: images or features, labels, and who owns what."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fl.arrays import frozen
from fl.data.dataset import Dataset, Pixels, Provenance, SourceFile, Split, checked
from fl.errors import DataDamagedError, DataLayoutError
from fl.plugins import PlugIn

MOST_CLASSES = 2**16


@dataclass(frozen=True)
class Samples:
    """A classification task as arrays; `factory(data_dir) -> Samples` gives one's own.

    `data_dir` is the folder of --data-dir, or None. Samples are images, (n, height, width) or
    (n, height, width, channels) with 1, 3 or 4 channels, bytes or floats in [0, 1]; or features,
    (n, features), any finite floats. Labels are whole numbers from 0, (n,). The same folder must
    give the same arrays.
    """

    x_train: NDArray[np.generic]  # (n, ...)
    y_train: NDArray[np.generic]  # (n,)
    x_test: NDArray[np.generic]  # (m, ...)
    y_test: NDArray[np.generic]  # (m,)
    owner: NDArray[np.generic] | None = None  # (n,) who each training sample belongs to, if known


class CustomDataset(PlugIn):
    """A plug-in data set: a factory, whose arrays are checked as those of a file are."""

    setting = "communities.task"

    def load(self, data_dir: Path | None) -> Dataset:
        """Call the factory with a data folder, and return its data set.

        Raises:
            UsersCodeError: it fails, or what it gives is no data set.
        """
        with self.guarded("the factory"):
            samples = self.inner(data_dir)
        samples = self.of_kind(samples, Samples, "the factory")
        with self.guarded("its arrays"):
            # Copies: the factory's owner may write to theirs.
            given = vars(samples).items()
            copies: dict[str, Any] = {k: None if v is None else np.array(v) for k, v in given}
            samples, name = Samples(**copies), self.name
            provenance = Provenance(name, False, (SourceFile(name, _md5_of(samples), False),))
            try:
                return dataset_of(name, samples, provenance=provenance)
            except DataDamagedError as error:
                self.refuse(error.reason)


def _md5_of(samples: Samples) -> str:
    """MD5 sum of types, shapes and contents: a checkpoint belongs to the arrays that have it."""
    digest = hashlib.md5(usedforsecurity=False)
    for value in vars(samples).values():
        if value is not None:
            digest.update(f"{value.dtype} {value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def dataset_of(
    task: str, arrays: Samples, *, provenance: Provenance, names: tuple[str, ...] | None = None
) -> Dataset:
    """Build a checked data set from arrays; `names`, of x and y of both splits, are for errors.

    Raises:
        DataLayoutError: shapes, types or values are not what they must be.
    """
    source = provenance.source
    x_train, y_train, x_test, y_test = names or ("x_train", "y_train", "x_test", "y_test")
    splits = [
        Split(_samples(x, key, source), labels(y, label, source))
        for x, key, y, label in (
            (arrays.x_train, x_train, arrays.y_train, y_train),
            (arrays.x_test, x_test, arrays.y_test, y_test),
        )
    ]
    classes = 1 + max(int(split.labels.max(initial=0)) for split in splits)
    owners = None if arrays.owner is None else _owners(arrays.owner, splits[0], source)
    return checked(
        task, splits[0], splits[1], classes=classes, provenance=provenance, owners=owners
    )


def labels(array: NDArray[np.generic], key: str, source: str) -> NDArray[np.int64]:
    """Return labels, integers (n,) or (n, 1), as int64 (n,). Raises DataLayoutError for others."""
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise DataLayoutError(
            source, f"{key} is {array.dtype} {array.shape}; wanted integers (n,) or (n, 1)"
        )
    if len(array) and int(array.max()) >= MOST_CLASSES:
        raise DataLayoutError(
            source, f"{key} holds a label {array.max()}; at most {MOST_CLASSES - 1}"
        )
    return array.astype(np.int64)


def _owners(array: NDArray[np.generic], train: Split, source: str) -> NDArray[np.int64]:
    if array.ndim != 1 or array.dtype.kind not in "iu" or len(array) != len(train.labels):
        raise DataLayoutError(
            source,
            f"owner is {array.dtype} {array.shape}; wanted integers ({len(train.labels)},), one "
            "for each training sample",
        )
    return frozen(array.astype(np.int64))


def _samples(array: NDArray[Any], key: str, source: str) -> Pixels:
    if array.ndim == 2:
        return _features(array, key, source)
    if array.ndim == 3:
        array = array[..., np.newaxis]
    if array.ndim != 4 or array.shape[3] not in (1, 3, 4):
        raise DataLayoutError(
            source,
            f"{key} is {array.shape}; wanted images, (n, height, width) or"
            " (n, height, width, channels) with 1, 3 or 4 channels, or features, (n, features)",
        )
    if array.dtype == np.uint8:
        return np.ascontiguousarray(array)
    if array.dtype.kind == "f":
        if not np.all((array >= 0.0) & (array <= 1.0)):
            raise DataLayoutError(source, f"{key} holds floats outside [0, 1]")
        return np.ascontiguousarray(array, dtype=np.float32)
    raise DataLayoutError(source, f"{key} is of type {array.dtype}; wanted bytes or floats")


def _features(array: NDArray[np.generic], key: str, source: str) -> Pixels:
    """Return features (n, features) as float32 images of one pixel with a channel each."""
    if array.dtype.kind != "f" or array.shape[1] == 0:
        raise DataLayoutError(
            source, f"{key} is {array.dtype} {array.shape}; features are floats, one at least"
        )
    with np.errstate(over="ignore"):
        floats = np.ascontiguousarray(array, dtype=np.float32)
    if not np.isfinite(floats).all():
        raise DataLayoutError(source, f"{key} holds features that are no finite float32")
    return floats[:, np.newaxis, np.newaxis, :]
