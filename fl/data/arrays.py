"""Plain arrays as a data set: images or features, labels, and who owns what."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fl.arrays import frozen
from fl.data.dataset import Dataset, Pixels, Provenance, Split, checked
from fl.errors import DataLayoutError

MOST_CLASSES = 2**16


@dataclass(frozen=True)
class Arrays:
    """As they are found; `dataset_of` says what they must be."""

    x_train: NDArray[np.generic]
    y_train: NDArray[np.generic]
    x_test: NDArray[np.generic]
    y_test: NDArray[np.generic]
    owner: NDArray[np.generic] | None = None


def dataset_of(
    task: str, arrays: Arrays, *, provenance: Provenance, names: tuple[str, ...] | None = None
) -> Dataset:
    """The data set of these arrays; `names` are those of x and y, of both splits, in errors.

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
    """Whole numbers from 0, (n,) or (n, 1), as (n,)."""
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
    """As images of one pixel, whose channels are the features: each is scaled by itself."""
    if array.dtype.kind != "f" or array.shape[1] == 0:
        raise DataLayoutError(
            source, f"{key} is {array.dtype} {array.shape}; features are floats, one at least"
        )
    with np.errstate(over="ignore"):
        found = np.ascontiguousarray(array, dtype=np.float32)
    if not np.isfinite(found).all():
        raise DataLayoutError(source, f"{key} holds features that are no finite float32")
    return found[:, np.newaxis, np.newaxis, :]
