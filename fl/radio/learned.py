"""Pilot tones that an aircraft hears on its way, and the radio belief learned from them.

`Learned`, the built-in belief, is Gaussian process regression: it takes the error of the prior in
dB for the sum of normal fields with correlations exp(-d / d_cor) and of a nugget, and conditions
that on the SNR of the tones (Rasmussen and Williams 2006, algorithm 2.1). Of tones at the floor of
the receiver it is known only that they are no stronger (a Tobit model).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Bools, Floats, Ints
from fl.radio.per_grid import PerGrid
from fl.radio.place import LinkTerms, PlacedRadio

# Of the error of a prior: deviation in dB, and the metres over which its correlation falls to 1/e,
# of walls on the way, and of what a device has everywhere (it is indoors, its street is open).
# Chosen for coverage and cross-entropy over seeds 1 to 3 of three cities, which 20 % more or less
# hardly changes.
WALLS_KNOWN = ((7.0, 15.0), (5.0, 300.0))
FIELDS = {"channel": ((7.0, 25.0), (12.0, 300.0)), "buildings": WALLS_KNOWN, "map": WALLS_KNOWN}
NUGGET_DB = 2.5  # of it that is a place's own
TURNS = 60  # of `_uncensored`; more would only move what is far below the floor
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
    of: str = "channel"  # what the prior is of: a key of `FIELDS`

    def success(self, heard: Heard, place_m: Floats) -> Floats:
        """Return 1 - PER (K, n) at places (n, 3), as `Belief.success`."""
        # Imported here and below: few runs learn, and SciPy takes 150 ms.
        from scipy.special import ndtr

        every, who = np.arange(len(self.prior.success))[:, None], np.unique(heard.device)
        success = self.prior.between(self.prior.success, every, place_m)
        if len(who):
            mean_db, deviation_db = self.snr_db(heard, place_m)
            spread_db = np.hypot(self.terms.fading_db, deviation_db[who])
            over_db = mean_db[who] - self.terms.snr_threshold_db
            success[who] = np.round(ndtr(over_db / spread_db), DIGITS)
        return success

    def snr_db(self, heard: Heard, place_m: Floats) -> tuple[Floats, Floats]:
        """Mean and standard deviation (K, n) of the median SNR at places (n, 3), as believed."""
        from scipy.linalg import cho_solve, cholesky, solve_triangular
        from scipy.special import ndtri

        terms, prior, every = self.terms, self.prior, np.arange(len(self.prior.success))[:, None]
        error_db = math.hypot(NUGGET_DB, *(field_db for field_db, _ in FIELDS[self.of]))
        clear = np.clip(prior.success, SURE, 1.0 - SURE)
        prior_db = terms.snr_threshold_db + math.hypot(terms.fading_db, error_db) * ndtri(clear)
        mean_db = prior.between(prior_db, every, place_m)
        deviation_db = np.full(mean_db.shape, error_db)
        cells_m, times, total_db = _by_cell(heard, len(every))
        ways, way_of = np.unique(times, axis=0, return_inverse=True)
        for way, often in enumerate(ways):  # one, where all devices were heard alike
            near, who = often > 0, np.flatnonzero(way_of == way)
            at_m, often = cells_m[near], often[near]
            if not len(at_m):
                continue
            before_db = prior.between(prior_db, who[:, None], at_m)
            noise = np.diag(NUGGET_DB**2 + terms.fading_db**2 / often)
            lower = cholesky(self._covariance(at_m, at_m) + noise, lower=True)
            off_db = total_db[np.ix_(who, near)] / often - before_db
            floor_db = terms.snr_threshold_db - PILOT_GAIN_DB - before_db
            off_db = _uncensored(off_db, floor_db, cho_solve((lower, True), np.eye(len(at_m))))
            whitened = solve_triangular(lower, off_db.T, lower=True)
            for first in range(0, len(place_m), _AT_ONCE):
                some = slice(first, first + _AT_ONCE)
                cross = self._covariance(at_m, place_m[some, :2])
                gain = solve_triangular(lower, cross, lower=True)
                known_db2 = np.minimum((gain**2).sum(axis=0), error_db**2 - NUGGET_DB**2)
                deviation_db[who, some] = np.sqrt(error_db**2 - known_db2)
                mean_db[who, some] += whitened.T @ gain
        return mean_db, deviation_db

    def _covariance(self, a_m: Floats, b_m: Floats) -> Floats:
        far_m = np.hypot(*(a_m[:, None, :] - b_m[None, :, :]).transpose(2, 0, 1))
        fields = FIELDS[self.of]
        return np.asarray(sum(db**2 * np.exp(-far_m / over_m) for db, over_m in fields))


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


def _uncensored(off_db: Floats, floor_db: Floats, inverse: Floats) -> Floats:
    """Replace the values (k, c) at the floor (k, c) by the mean that each has under it, given all
    others. Of a single one that is exact.

    `inverse` (c, c) of their covariance gives what is expected of one given the others (Rasmussen
    and Williams 2006, equation 5.12)."""
    from scipy.special import log_ndtr

    low = off_db < floor_db + 1e-6  # all tones of a cell
    spread_db2 = 1.0 / inverse.diagonal()
    off_db = np.where(low, np.minimum(off_db, 0.0), off_db)  # the prior may be below the floor
    for _ in range(TURNS if low.any() else 0):
        others_db = off_db - off_db @ inverse * spread_db2
        z = (floor_db - others_db) / np.sqrt(spread_db2)
        under = np.exp(-0.5 * z**2 - log_ndtr(z)) / math.sqrt(2.0 * math.pi)
        mean_db = others_db - np.sqrt(spread_db2) * under
        # Half of the way: all move at once, and would swing.
        off_db = np.where(low, (off_db + mean_db) / 2.0, off_db)
    return off_db
