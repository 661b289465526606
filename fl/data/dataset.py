"""A task's images and labels: what they are, and where they come from."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fl.errors import DataLayoutError

Pixels = NDArray[np.uint8] | NDArray[np.float32]
Labels = NDArray[np.int64]


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
    """A file that images or labels were read from, with its MD5 sum."""

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
    """One task. Labels run from 0 to `classes` - 1 in both splits.

    Planning looks at the labels alone, so that generated images are drawn when first looked at.
    """

    task: str
    labels: Labels  # of the training images
    held_out: Labels  # (classes,) validation images of each class
    image_shape: tuple[int, int, int]  # height, width, channels
    classes: int
    provenance: Provenance
    load_splits: Callable[[], tuple[Split, Split]]
    owners: Labels | None = None  # (n,) whose each training sample is, where the data tell

    @cached_property
    def _splits(self) -> tuple[Split, Split]:
        return self.load_splits()

    @property
    def train(self) -> Split:
        """The training split, which is spread over the devices."""
        return self._splits[0]

    @property
    def validation(self) -> Split:
        """The split that accuracy is measured on; nobody trains on it."""
        return self._splits[1]


def checked(
    task: str,
    train: Split,
    validation: Split,
    *,
    classes: int,
    provenance: Provenance,
    owners: Labels | None = None,
) -> Dataset:
    """A data set whose splits fit together; `DataLayoutError` names what does not."""
    source = provenance.source
    for name, split in (("training", train), ("validation", validation)):
        count = len(split.labels)
        if count == 0:
            raise DataLayoutError(source, f"no {name} images")
        if len(split.images) != count:
            raise DataLayoutError(
                source, f"{len(split.images)} {name} images, but {count} {name} labels"
            )
        low, high = int(split.labels.min()), int(split.labels.max())
        if low < 0 or high >= classes:
            bad = low if low < 0 else high
            raise DataLayoutError(
                source, f"{name} label {bad} is outside the classes 0 to {classes - 1}"
            )
    if train.images.shape[1:] != validation.images.shape[1:]:
        raise DataLayoutError(
            source,
            f"training images of {train.images.shape[1:]},"
            f" validation images of {validation.images.shape[1:]}",
        )
    if train.images.dtype != validation.images.dtype:
        raise DataLayoutError(
            source,
            f"training images of {train.images.dtype}, validation images of "
            f"{validation.images.dtype}: they must be alike, as they are scaled alike",
        )
    _, height, width, channels = train.images.shape
    shape, counts = (height, width, channels), np.bincount(validation.labels, minlength=classes)
    return Dataset(
        task, train.labels, counts, shape, classes, provenance, lambda: (train, validation), owners
    )


def subset(data: Dataset, share: float) -> Dataset:
    """Return a share of a data set: the first images of each class, equally many where possible."""
    if share == 1.0:
        return data

    def first(labels: Labels) -> NDArray[np.int64]:
        each = max(1, round(share * len(labels) / data.classes))
        members = [np.flatnonzero(labels == label)[:each] for label in range(data.classes)]
        return np.sort(np.concatenate(members))

    def part(split: Split) -> Split:
        kept = first(split.labels)
        return Split(split.images[kept], split.labels[kept])

    kept = first(data.labels)
    each_held_out = max(1, round(share * int(data.held_out.sum()) / data.classes))
    return replace(
        data,
        labels=data.labels[kept],
        held_out=np.minimum(data.held_out, each_held_out),
        load_splits=lambda: (part(data.train), part(data.validation)),
        owners=None if data.owners is None else data.owners[kept],
    )


def hold_out(images: Pixels, labels: Labels, *, share: float, seed: int) -> tuple[Split, Split]:
    """Split off a share of every class: (the rest, that share); the same on every machine."""
    held = held_out(labels, share=share, seed=seed)
    return Split(images[~held], labels[~held]), Split(images[held], labels[held])


def held_out(labels: Labels, *, share: float, seed: int) -> NDArray[np.bool_]:
    """Return which samples (n,) `hold_out` takes for its second part."""
    rng = np.random.Generator(np.random.PCG64(seed))
    held = np.zeros(len(labels), dtype=np.bool_)
    for label in sorted(set(labels.tolist())):
        members = rng.permutation(np.flatnonzero(labels == label))
        held[members[: held_out_of_each(np.array([len(members)]), share)[0]]] = True
    return held


def held_out_of_each(samples: NDArray[np.int64], share: float) -> NDArray[np.int64]:
    """Return how many of each class are held out of `samples` (classes,): 1 or more if any."""
    wanted = np.maximum(1, np.rint(share * samples)).astype(np.int64)
    return np.asarray(np.minimum(samples, wanted), dtype=np.int64)
