"""A researcher's own partition, held to what every partition must keep."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Ints, frozen
from fl.plugins import PluginError, find, guarded

KEY = "communities.partition"


@dataclass(frozen=True)
class PartitionTask:
    """What a partition is made of."""

    labels: Ints  # (n,) class of each training sample, 0 to classes - 1
    owners: Ints | None  # (n,) whose each sample is, where the data set tells
    devices: int  # K_c, of the community
    classes: int
    rng: np.random.Generator  # the community's own stream: draw from nothing else


class Partition(Protocol):
    """How samples are spread over the devices of a community: a function."""

    def __call__(self, task: PartitionTask) -> Sequence[ArrayLike]:
        """For each device the indices of its samples, from 0; none empty, none given twice."""


def custom_partition(name: str, task: PartitionTask) -> list[Ints]:
    """The shares that the function of that name deals out, sorted.

    Raises:
        PluginError: it cannot be imported, fails, or its answer is no partition.
    """
    function = find(name, key=KEY)
    with guarded(name, key=KEY, doing="the partition"):
        given = [np.asarray(share) for share in function(task)]

    def refuse(reason: str) -> None:
        raise PluginError(KEY, name, reason)

    if len(given) != task.devices:
        refuse(f"gives shares of {len(given)} devices, not {task.devices}")
    for device, share in enumerate(given):
        if share.ndim != 1 or share.dtype.kind not in "iu" or share.size == 0:
            refuse(
                f"device {device} gets {share.dtype} {share.shape}; wanted whole numbers (n,), one "
                "at least"
            )
        if share.min() < 0 or share.max() >= len(task.labels):
            wrong = share.min() if share.min() < 0 else share.max()
            refuse(f"device {device} gets sample {wrong}; there are 0 to {len(task.labels) - 1}")
    every, times = np.unique(np.concatenate(given), return_counts=True)
    if times.max() > 1:
        refuse(f"sample {every[times.argmax()]} is given {times.max()} times")
    return [frozen(np.sort(share).astype(np.int64)) for share in given]
