"""Data with natural owners: the bundled digits as if each were written by one of twelve people.

Whoever writes thick writes all of it thick: samples are sorted by their ink and cut into owners, so
that devices differ by style, not by class, as the writers of FEMNIST do (Caldas et al. 2018,
arXiv 1812.01097). A file does the same: an .npz with `images`, `labels` and `owner`.

    aerofed run --set communities.0.task=examples.writers:load communities.0.partition=owners
"""

from pathlib import Path

import numpy as np

from aerofed import Samples
from fl.data.bundled import digits  # stands for data of yours; no part of the interface

WRITERS = 12


def load(data_dir: Path | None) -> Samples:
    """What `communities.N.task` names; these digits need no files."""
    known = digits()
    train, test = known.train, known.validation
    by_ink = np.argsort(train.images.reshape(len(train.labels), -1).sum(axis=1), kind="stable")
    owner = np.empty(len(train.labels), dtype=np.int64)
    for writer, samples in enumerate(np.array_split(by_ink, WRITERS)):
        owner[samples] = writer
    return Samples(train.images, train.labels, test.images, test.labels, owner)
