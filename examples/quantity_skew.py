"""A partition of one's own: every device has all classes, but some have far more data.

Samples are dealt out in shares that fall off as 1 / rank (Zipf), so the first device of a community
has several times as many as the last.

    aerofed run --set communities.0.partition=examples.quantity_skew:split
"""

import numpy as np

from aerofed import PartitionTask


def split(task: PartitionTask) -> list[np.ndarray]:
    """What `communities.N.partition` names: the indices of each device's samples."""
    weights = 1.0 / np.arange(1, task.devices + 1)
    order = task.rng.permutation(len(task.labels))
    ends = np.cumsum(weights / weights.sum()) * len(order)
    return np.split(order, ends[:-1].astype(int))
