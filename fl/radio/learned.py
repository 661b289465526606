"""Pilot tones that an aircraft hears on its way, and the radio belief learned from them.

`Learned`, the built-in belief, is Gaussian process regression: it takes the error of the prior in
dB for a normal field with correlation exp(-d / d_cor), and conditions that on the SNR of the tones
(Rasmussen and Williams 2006, algorithm 2.1).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Bools, Floats, Ints
from fl.radio.per_grid import PerGrid
from fl.radio.place import LinkTerms, PlacedRadio

# Of a belief's error. Walls decide over tens of metres; with a larger deviation than this, plans go
# where nothing is known too often (`city.toml`, 3 seeds: 6, 10 and 15 dB; 20, 40 and 80 m).
DEVIATION_DB, CORRELATION_M = 6.0, 40.0
SURE = 1e-6  # rates nearer to 0 or 1 say nothing more of the SNR
DIGITS = 6  # of what is learned: the last ones may differ from machine to machine
CELL_M = 10.0  # of places that count as one
_AT_ONCE = 256  # places, for the memory
PILOT_GAIN_DB = 10.0  # tones are heard so far under what a packet needs; less counts as that


@dataclass(frozen=True)
class Heard:
    """All pilot tones since the run began, in their order."""

    device: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (m,) whose
    place_m: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # (m, 3) as it believed to be
    snr_db: Floats = field(default_factory=lambda: np.zeros(0))  # (m,) as measured


class Belief(Protocol):
    """A belief about the radio, given the pilot tones heard so far."""

    def success(self, heard: Heard, place_m: Floats) -> ArrayLike:
        """(K, n) 1 - PER of all devices with the aircraft at places (n, 3), each in [0, 1].

        Asked before each plan, first with nothing heard. The answer may depend on the arguments
        alone, so that a run can be resumed.
        """


@dataclass(frozen=True)
class Listener:
    """Simulated pilot tones, and a belief evaluated on a grid of places."""

    belief: Belief
    truth: PlacedRadio  # that pilots come by
    prior: PerGrid  # believed before anything is heard
    height_m: float  # of the places

    def hear(
        self, heard: Heard, est_m: Floats, true_m: Floats, devices: Bools, rng: np.random.Generator
    ) -> Heard:
        """Return `heard` with new tones of `devices` (K,), measured at the true places (n, 3) and
        noted at the estimated ones (n, 3). Each tone fades by itself, as packets do."""
        terms, count = self.truth.terms, len(devices)
        device = np.tile(np.arange(count), len(true_m))
        median_db = self.truth.snr_db(device, np.repeat(true_m, count, axis=0))
        snr_db = median_db + terms.fading_db * rng.standard_normal(len(device))
        snr_db = np.maximum(snr_db, terms.snr_threshold_db - PILOT_GAIN_DB)
        new = device, np.repeat(est_m, count, axis=0), snr_db
        before = heard.device, heard.place_m, heard.snr_db
        return Heard(
            *(np.concatenate((a, b[devices[device]])) for a, b in zip(before, new, strict=True))
        )

    def grid(self, heard: Heard) -> PerGrid:
        """Evaluate the belief, given the tones heard, on the grid of the prior."""
        success = np.asarray(self.belief.success(heard, self.prior.places_m(self.height_m)))
        return replace(self.prior, success=success.reshape(self.prior.success.shape))


@dataclass(frozen=True)
class Learned:
    """The built-in `Belief`: Gaussian process regression on the SNR of pilot tones."""

    prior: PerGrid
    terms: LinkTerms

    def success(self, heard: Heard, place_m: Floats) -> Floats:
        """Return 1 - PER (K, n) at places (n, 3), as `Belief.success`."""
        # Imported here: few runs learn.
        from scipy.linalg import cholesky, solve_triangular
        from scipy.special import ndtr, ndtri

        terms, prior, every = self.terms, self.prior, np.arange(len(self.prior.success))[:, None]
        success = prior.between(prior.success, every, place_m)
        if not len(heard.device):
            return success
        spread_db = math.hypot(terms.fading_db, DEVIATION_DB)
        clear = np.clip(prior.success, SURE, 1.0 - SURE)
        mean_db = terms.snr_threshold_db + spread_db * ndtri(clear)
        known_db = prior.between(mean_db, every, place_m)
        cells_m, times, total_db = _by_cell(heard, len(every))
        ways, way_of = np.unique(times, axis=0, return_inverse=True)
        for way, often in enumerate(ways):  # one, where all devices were heard alike
            near, who = often > 0, np.flatnonzero(way_of == way)
            at_m, often = cells_m[near], often[near]
            if not len(at_m):
                continue
            off_db = total_db[np.ix_(who, near)] / often
            off_db -= prior.between(mean_db, who[:, None], at_m)
            noise = np.diag(terms.fading_db**2 / often)
            lower = cholesky(_covariance(at_m, at_m) + noise, lower=True)
            whitened = solve_triangular(lower, off_db.T, lower=True)
            for first in range(0, len(place_m), _AT_ONCE):
                some = slice(first, first + _AT_ONCE)
                cross = _covariance(at_m, place_m[some, :2])
                gain = solve_triangular(lower, cross, lower=True)
                left = np.maximum(0.0, DEVIATION_DB**2 - (gain**2).sum(axis=0))
                over_db = known_db[who, some] + whitened.T @ gain - terms.snr_threshold_db
                success[who, some] = ndtr(over_db / np.sqrt(terms.fading_db**2 + left))
        return np.round(success, DIGITS)


def _by_cell(heard: Heard, devices: int) -> tuple[Floats, Ints, Floats]:
    """Middles (c, 2) of the cells, how often each device (K, c) was heard there, and the sum of
    its SNR in dB (K, c)."""
    cell = np.floor(heard.place_m[:, :2] / CELL_M)
    cells, first, of = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # as they were come by
    at = heard.device, np.argsort(order)[of]
    shape = devices, len(cells)
    times, total_db = np.zeros(shape, dtype=np.int64), np.zeros(shape)
    np.add.at(times, at, 1)
    np.add.at(total_db, at, heard.snr_db)
    return (cells[order] + 0.5) * CELL_M, times, total_db


def _covariance(a_m: Floats, b_m: Floats) -> Floats:
    far_m = np.hypot(*(a_m[:, None, :] - b_m[None, :, :]).transpose(2, 0, 1))
    return np.asarray(DEVIATION_DB**2 * np.exp(-far_m / CORRELATION_M))
