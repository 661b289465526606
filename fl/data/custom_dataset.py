"""A researcher's own data set: arrays from a factory, held to what files are held to."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fl.data.arrays import Arrays, dataset_of
from fl.data.dataset import Dataset, Provenance, SourceFile
from fl.errors import DataDamagedError, first_line, kind_of
from fl.plugins import PluginError, find, guarded

KEY = "communities.task"


@dataclass(frozen=True)
class Samples:
    """What the factory of a data set gives: `factory(data_dir) -> Samples`.

    `data_dir` is the folder of --data-dir, or None. Samples are images, (n, height, width) or
    (n, height, width, channels) with 1, 3 or 4 channels, bytes or floats in [0, 1]; or features,
    (n, features), any finite floats. Labels are whole numbers from 0, (n,). The same folder must
    give the same arrays.
    """

    x_train: NDArray[np.generic]  # (n, ...)
    y_train: NDArray[np.integer]  # (n,)
    x_test: NDArray[np.generic]  # (m, ...)
    y_test: NDArray[np.integer]  # (m,)
    owner: NDArray[np.integer] | None = None  # (n,) who each training sample belongs to, if known


@lru_cache(maxsize=3)
def load(name: str, data_dir: Path | None) -> Dataset:
    """The data set that the factory of that name gives for a data folder.

    Raises:
        PluginError: the factory fails, or what it gives is no data set.
    """
    factory = find(name, key=KEY)
    with guarded(name, key=KEY, doing="the factory"):
        samples = factory(data_dir)
    if not isinstance(samples, Samples):
        raise PluginError(KEY, name, f"gives {kind_of(samples)}, not Samples")
    try:
        # Copies: the factory's owner may write to theirs.
        given = vars(samples).items()
        copies: dict[str, Any] = {k: None if v is None else np.array(v) for k, v in given}
        arrays = Arrays(**copies)
        provenance = Provenance(name, False, (SourceFile(name, _digest(arrays), False),))
        return dataset_of(name, arrays, provenance=provenance)
    except DataDamagedError as error:
        raise PluginError(KEY, name, error.reason) from None
    except Exception as error:
        raise PluginError(KEY, name, f"its arrays cannot be used: {first_line(error)}") from error


def _digest(arrays: Arrays) -> str:
    """By which a checkpoint knows them again."""
    digest = hashlib.md5(usedforsecurity=False)
    for value in vars(arrays).values():
        if value is not None:
            digest.update(f"{value.dtype} {value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()
