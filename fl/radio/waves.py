"""Normal fields over places of the aircraft, made of plane waves: the same again at a place."""

import numpy as np

from fl.arrays import Floats, Ints
from fl.native import library


def drawn(rng: np.random.Generator, count: int) -> Floats:
    """Draw waves (count, 2, 3, WAVES), two fields a device: turns a correlation distance d_cor east
    and north, phase in turns.

    A field is normal with variance 1, and its correlation over a distance d is exp(-d / d_cor). In
    the plane that is the transform of a density over wave numbers k that falls as
    (1 + (k d_cor)^2)^(-3/2), so that 1 / sqrt(1 + (k d_cor)^2) is uniform.
    """
    u = 1.0 - rng.random((count, 2, library.WAVES))  # in (0, 1]
    k = np.sqrt(1.0 / u**2 - 1.0) / (2.0 * np.pi)
    east, north = rng.standard_normal((2, *u.shape))  # of no preferred direction
    turns = k / np.sqrt(east**2 + north**2)
    return np.stack((turns * east, turns * north, rng.random(u.shape)), axis=2)


def values(waves: Floats, device: Ints, place_m: Floats, *, correlation_m: float) -> Floats:
    """Both fields (2, n) of devices (n,) at places (n, 2 or 3)."""
    found = np.empty((2, len(device)))
    for at, (of, (x, y)) in enumerate(zip(device, place_m[:, :2] / correlation_m, strict=True)):
        east, north, phase = waves[of].transpose(1, 0, 2)  # (2, WAVES) each
        found[:, at] = np.cos(2.0 * np.pi * (x * east + y * north + phase)).sum(axis=1)
    return np.asarray(found * np.sqrt(2.0 / waves.shape[-1]))
