"""What the compiled loops are given: one planning problem as plain arrays."""

from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import Indices, Matrix, Vector


class Devices(NamedTuple):
    """The devices worth something, in coordinates with the start at the origin."""

    u: Matrix  # (K, 2) positions in metres
    delta: Vector  # (K,) importance, above 0
    rows: Matrix  # (R, 3) f, f', f'' of the channel, one row a metre


class Limits(NamedTuple):
    """What a plan may use."""

    steps: int  # N
    per_step: int  # K_bar
    length: float  # L_max


class Relaxation(NamedTuple):
    """Tables of the dual bound; see `mission.planner.reward.Conjugates`."""

    coefficients: Matrix  # (rows, S + 3) of H, one row a distance interval
    spacing: Vector  # (rows,)
    hi: Vector  # (rows,) outer radius of the interval
    ends: Indices  # (rows, 2) its radii, as indices
    row: Indices  # (B, B) the interval between two radii
    ladder: Indices  # (B,) the radius that is decided about after this one
    radii: Vector  # (B,)
    promise: Matrix  # (K, B) bound of delta f for a device out of reach of radius b


class Problem(NamedTuple):
    """All of it."""

    devices: Devices
    limits: Limits
    relaxation: Relaxation


def smallest_problem() -> Problem:
    """One device below the start that earns nothing, in arrays like those of any problem."""
    rows = np.zeros((2, 3))
    rows.flags.writeable = False
    relaxation = Relaxation(
        np.zeros((1, 4)),
        np.ones(1),
        np.zeros(1),
        np.zeros((1, 2), dtype=np.int64),
        np.zeros((1, 1), dtype=np.int64),
        np.zeros(1, dtype=np.int64),
        np.zeros(1),
        np.zeros((1, 1)),
    )
    return Problem(Devices(np.zeros((1, 2)), np.ones(1), rows), Limits(2, 1, 1.0), relaxation)
