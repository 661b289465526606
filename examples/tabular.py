"""Tabular data: rows of features instead of images, and a network without convolutions.

Each feature is scaled to zero mean and unit variance over the training rows. In a configuration
the community has `task = "examples.tabular:load"`, `network = "convnet"` and an empty list of
blocks, which leaves the dense layers:

    [communities.convnet]
    channels = []
    hidden = [16]

A file does the same: an .npz with `features`, (n, features) floats, and `labels`.
"""

from pathlib import Path

import numpy as np

from aerofed import Samples

CLASSES, FEATURES = 10, 6


def load(data_dir: Path | None) -> Samples:
    """What `communities.N.task` names: sensor readings around a centre for each class."""
    rng = np.random.default_rng(5)
    units = np.array([1.0, 10.0, 1000.0, 0.1, 1.0, 5.0])  # of the features, which differ
    centres = rng.normal(size=(CLASSES, FEATURES))

    def draw(count: int) -> tuple[np.ndarray, np.ndarray]:
        labels = np.arange(count) % CLASSES
        return (centres[labels] + 0.3 * rng.normal(size=(count, FEATURES))) * units, labels

    return Samples(*draw(1200), *draw(300))
