"""A task's images and labels: what they are, where they come from, how they are loaded."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fl.errors import DataDamagedError, DataMissingError

logger = logging.getLogger(__name__)

Pixels = NDArray[np.uint8] | NDArray[np.float32]
Labels = NDArray[np.int64]
Stamp = tuple[tuple[str, int, int], ...]

# Sub-folders of a data folder, or of these, in which files are looked for.
FOLDERS = frozenset(
    [
        "mnist",
        "MNIST",
        "fashion-mnist",
        "fashion",
        "FashionMNIST",
        "raw",
        "cifar10",
        "cifar-10-batches-py",
        "cifar-10-batches-bin",
    ]
)


@dataclass(frozen=True)
class Split:
    """Images (n, height, width, channels), uint8 or float32 in [0, 1], and labels (n,)."""

    images: Pixels
    labels: Labels

    def __post_init__(self) -> None:
        self.images.setflags(write=False)
        self.labels.setflags(write=False)


@dataclass(frozen=True)
class SourceFile:
    """One file that was read."""

    name: str
    md5: str  # of the content the official sum is about
    official: bool


@dataclass(frozen=True)
class Provenance:
    """Where a data set comes from, for the run's summary."""

    source: str  # a folder, an archive, or how the data are made
    official: bool  # every file carries its official sum
    files: tuple[SourceFile, ...] = ()


@dataclass(frozen=True)
class Dataset:
    """One task. Labels run from 0 to `classes` - 1 in both splits."""

    task: str
    train: Split
    validation: Split
    classes: int
    provenance: Provenance

    @property
    def image_shape(self) -> tuple[int, int, int]:
        """(height, width, channels)"""
        _, height, width, channels = self.train.images.shape
        return height, width, channels


def checked(
    task: str, train: Split, validation: Split, *, classes: int, provenance: Provenance
) -> Dataset:
    """A data set whose splits fit together; `DataDamagedError` names what does not."""
    source = provenance.source
    for name, split in (("training", train), ("validation", validation)):
        count = len(split.labels)
        if count == 0:
            raise DataDamagedError(source, f"no {name} images")
        if len(split.images) != count:
            raise DataDamagedError(
                source, f"{len(split.images)} {name} images, but {count} {name} labels"
            )
        low, high = int(split.labels.min()), int(split.labels.max())
        if low < 0 or high >= classes:
            bad = low if low < 0 else high
            raise DataDamagedError(
                source, f"{name} label {bad} is outside the classes 0 to {classes - 1}"
            )
    if train.images.shape[1:] != validation.images.shape[1:]:
        raise DataDamagedError(
            source,
            f"training images of {train.images.shape[1:]},"
            f" validation images of {validation.images.shape[1:]}",
        )
    return Dataset(task, train, validation, classes, provenance)


def hold_out(images: Pixels, labels: Labels, *, share: float, seed: int) -> tuple[Split, Split]:
    """All but a part of every class, and that part; the same on every machine."""
    rng = np.random.Generator(np.random.PCG64(seed))
    held = np.zeros(len(labels), dtype=np.bool_)
    for label in np.unique(labels):
        members = rng.permutation(np.flatnonzero(labels == label))
        held[members[: held_out_of_each(np.array([len(members)]), share)[0]]] = True
    return Split(images[~held], labels[~held]), Split(images[held], labels[held])


def held_out_of_each(samples: NDArray[np.int64], share: float) -> NDArray[np.int64]:
    """How many of each class are held out, of `samples` (classes,): one at least of what is."""
    wanted = np.maximum(1, np.rint(share * samples)).astype(np.int64)
    return np.asarray(np.minimum(samples, wanted), dtype=np.int64)


def load(task: str, *, data_dir: Path | None, data_file: str | None = None) -> Dataset:
    """The data set of `task`, from `data_dir` unless it is bundled or generated.

    Raises `DataMissingError` that says what is looked for, `DataDamagedError` naming the file.
    Intact files that are not the official ones (a subset, say) are used, and said so. A process
    that asks again while the files are as they were gets the same data set again: an archive
    takes seconds to unpack, and a sweep has many runs.
    """
    if task in ("digits", "colour-shapes"):
        from fl import bundled

        makers: dict[str, Callable[[], Dataset]] = {
            "digits": bundled.digits,
            "colour-shapes": bundled.colour_shapes,
        }
        return makers[task]()
    return _read(task, data_dir, data_file, _stamp(data_dir, data_file))


@lru_cache(maxsize=3)
def _read(
    task: str,
    data_dir: Path | None,
    data_file: str | None,
    stamp: Stamp,  # noqa: ARG001  # tells the cache that files have changed
) -> Dataset:
    from fl import cifar, idx, npz

    if task in ("mnist", "fashion-mnist"):
        dataset = idx.load(task, _folder(task, data_dir, idx.WANTED))
    elif task == "cifar10":
        dataset = cifar.load(_folder(task, data_dir, cifar.WANTED))
    elif task == "npz":
        name = data_file or ""
        dataset = npz.load(name, _folder(task, data_dir, f"the file {name}"))
    else:
        raise DataMissingError(task, data_dir, "nothing: there is no such task")
    if not dataset.provenance.official:
        logger.info(
            "%s: %s is intact but not the official data set: %d training, %d validation images",
            task,
            dataset.provenance.source,
            len(dataset.train.labels),
            len(dataset.validation.labels),
        )
    return dataset


def _folder(task: str, data_dir: Path | None, wanted: str) -> Path:
    if data_dir is None or not data_dir.is_dir():
        raise DataMissingError(task, data_dir, wanted)
    return data_dir


def _stamp(folder: Path | None, data_file: str | None = None) -> Stamp:
    """Names, sizes and times of the files where data are looked for."""
    if folder is None or not folder.is_dir():
        return ()
    found: list[tuple[str, int, int]] = []
    try:
        paths = set(folder.iterdir()) | ({folder / data_file} if data_file else set())
        for path in sorted(paths):
            if path.is_file():
                status = path.stat()
                found.append((str(path), status.st_size, status.st_mtime_ns))
            elif path.name in FOLDERS:
                found += _stamp(path)
    except OSError as error:
        raise DataDamagedError(folder, error.strerror or str(error)) from error
    return tuple(found)
