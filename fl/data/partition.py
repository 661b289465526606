"""How the samples of a task are spread over the devices of its community.

Every partitioner returns one sorted index array per device; together they hold each sample of
the classes that have an owner exactly once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Bools, Floats, Ints, frozen
from fl.plugins import PlugIn, read_only
from native.errors import SettingError

DIRICHLET_TRIES = 100


def draw_owners(
    devices: int, classes: int, *, per_device: int, coverage: bool, rng: np.random.Generator
) -> Bools:
    """Draw which device owns which class: (devices, classes), `per_device` true in each row.

    Without `coverage` each device draws its classes at random and some classes may stay without
    an owner. With it, shuffled classes are first dealt round the devices, then every device
    fills up at random.
    """
    check_owners(devices, classes, per_device=per_device, coverage=coverage)
    owns = np.zeros((devices, classes), dtype=np.bool_)
    if coverage:
        order = rng.permutation(devices)
        for turn, label in enumerate(rng.permutation(classes)):
            owns[order[turn % devices], label] = True
    for row in owns:
        free = np.flatnonzero(~row)
        row[rng.choice(free, size=per_device - int(row.sum()), replace=False)] = True
    return owns


def check_owners(devices: int, classes: int, *, per_device: int, coverage: bool) -> None:
    """Raise SettingError where `draw_owners` cannot deal the classes out."""
    if per_device > classes:
        raise SettingError("labels_per_device", per_device, f"the task has {classes} classes")
    if coverage and devices * per_device < classes:
        raise SettingError(
            "coverage",
            coverage,
            f"{devices} devices with {per_device} labels each cannot own {classes} classes; "
            "give more devices or labels_per_device",
        )


def by_labels(
    labels: Ints, owns: Bools, *, rng: np.random.Generator, weights: Floats | None = None
) -> list[Ints]:
    """Split the samples of each class at random over the devices that own it: equally, or in
    proportion to `weights`, (devices,).

    Equal shares differ by one sample at most; which owners get one more is drawn. The samples of
    a class without an owner are used by nobody.
    """
    shares: list[list[Ints]] = [[] for _ in owns]
    for label in range(owns.shape[1]):
        owners = np.flatnonzero(owns[:, label])
        if owners.size == 0:
            continue
        samples = rng.permutation(np.flatnonzero(labels == label))
        dealt = rng.permutation(owners)
        parts = _split(samples, len(dealt), None if weights is None else weights[dealt])
        for owner, part in zip(dealt, parts, strict=True):
            shares[owner].append(part)
    return _finish([np.concatenate(s) if s else np.empty(0, np.int64) for s in shares])


def by_dirichlet(
    labels: Ints,
    *,
    devices: int,
    classes: int,
    alpha: float,
    rng: np.random.Generator,
    weights: Floats | None = None,
) -> list[Ints]:
    """Split each class over all devices in proportions drawn from Dirichlet(alpha), whose mean
    are the `weights` where there are any.

    Drawn again until every device has a sample (Yurochkin et al. 2019, Hsu et al. 2019).
    """
    spread = np.full(devices, alpha)
    if weights is not None:
        spread *= weights / weights.mean()
    for _ in range(DIRICHLET_TRIES):
        shares: list[list[Ints]] = [[] for _ in range(devices)]
        for label in range(classes):
            samples = rng.permutation(np.flatnonzero(labels == label))
            cuts = np.cumsum(rng.dirichlet(spread))[:-1] * samples.size
            for share, part in zip(shares, np.split(samples, cuts.astype(np.int64)), strict=True):
                share.append(part)
        joined = [np.concatenate(share) for share in shares]
        if min(part.size for part in joined) > 0:
            return _finish(joined)
    raise SettingError(
        "dirichlet_alpha",
        alpha,
        f"{DIRICHLET_TRIES} draws left one of the {devices} devices without a sample;"
        " use a larger value or fewer devices",
    )


def iid(
    samples: int, *, devices: int, rng: np.random.Generator, weights: Floats | None = None
) -> list[Ints]:
    """Split all samples at random over the devices: equally, or in proportion to `weights`."""
    return _finish(_split(rng.permutation(samples), devices, weights))


def _split(samples: Ints, parts: int, weights: Floats | None) -> list[Ints]:
    if weights is None:
        return list(np.array_split(samples, parts))
    ends = np.round(np.cumsum(weights) / weights.sum() * len(samples)).astype(np.int64)
    return list(np.split(samples, ends[:-1]))


def by_owner(owners: Ints, *, devices: int, rng: np.random.Generator) -> list[Ints]:
    """Give each device the samples of one owner; which of the data set's owners, is drawn."""
    known = np.unique(owners)
    if devices > len(known):
        raise SettingError("devices", devices, f"the data have {len(known)} owners")
    chosen = rng.permutation(known)[:devices]
    return _finish([np.flatnonzero(owners == owner) for owner in chosen])


def class_counts(labels: Ints, shares: list[Ints], *, classes: int) -> Ints:
    """The assignment as a table: samples of each class on each device, (devices, classes)."""
    rows = [np.bincount(labels[share], minlength=classes) for share in shares]
    return np.stack(rows).astype(np.int64)


def _finish(shares: list[Ints]) -> list[Ints]:
    for device, share in enumerate(shares):
        if share.size == 0:
            raise SettingError(
                "devices", len(shares), f"device {device} of them would be without a sample"
            )
    return [frozen(np.sort(share).astype(np.int64)) for share in shares]


@dataclass(frozen=True)
class PartitionTask:
    """The samples and devices of a community, for a partition of one's own."""

    labels: Ints  # (n,) class of each training sample, 0 to classes - 1
    owners: Ints | None  # (n,) whose each sample is, where the data set tells
    devices: int  # K_c, of the community
    classes: int
    rng: np.random.Generator  # the community's own stream: draw from nothing else


class Partition(Protocol):
    """A function that splits the samples of a community over its devices."""

    def __call__(self, task: PartitionTask) -> Sequence[ArrayLike]:
        """For each device the indices of its samples, from 0; none empty, none given twice."""


class CustomPartition(PlugIn):
    """A plug-in `Partition` whose shares are checked."""

    setting = "communities.partition"

    def shares(self, task: PartitionTask) -> list[Ints]:
        """Call the plug-in, and return the sorted sample indices of each device.

        Raises:
            UsersCodeError: the answer is no partition.
        """
        with self.guarded("the partition"):
            given = [np.asarray(share) for share in self.inner(read_only(task))]
        if len(given) != task.devices:
            self.refuse(f"gives shares of {len(given)} devices, not {task.devices}")
        for device, share in enumerate(given):
            if share.ndim != 1 or share.dtype.kind not in "iu" or share.size == 0:
                self.refuse(
                    f"device {device} gets {share.dtype} {share.shape}; wanted whole numbers "
                    "(n,), one at least"
                )
            if share.min() < 0 or share.max() >= len(task.labels):
                wrong = share.min() if share.min() < 0 else share.max()
                self.refuse(
                    f"device {device} gets sample {wrong}; there are 0 to {len(task.labels) - 1}"
                )
        every, times = np.unique(np.concatenate(given), return_counts=True)
        if times.max() > 1:
            self.refuse(f"sample {every[times.argmax()]} is given {times.max()} times")
        return [frozen(np.sort(share).astype(np.int64)) for share in given]
