"""What an aircraft learns of the radio on its way, by Gaussian-process regression.

It begins with a belief, takes its error in dB for a normal field whose correlation falls as
exp(-d / d_cor), and conditions that on the SNR of pilot tones that it hears from all devices where
it is (Rasmussen and Williams 2006, algorithm 2.1).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from fl.arrays import Floats
from fl.radio.per_grid import PerGrid
from fl.radio.place import PlacedRadio

# Of a belief's error. Walls decide over tens of metres; with a larger deviation than this, plans go
# where nothing is known too often (`city.toml`, 3 seeds: 6, 10 and 15 dB; 20, 40 and 80 m).
DEVIATION_DB, CORRELATION_M = 6.0, 40.0
PILOT_GAIN_DB = 10.0  # tones are heard so far under what a packet needs; less counts as that
SURE = 1e-6  # rates nearer to 0 or 1 say nothing more of the SNR
DIGITS = 6  # of what is learned: the last ones may differ from machine to machine
CELL_M = 10.0  # of places that count as one


@dataclass
class LearnedRadio:
    """The belief of an aircraft that listens."""

    prior: PerGrid
    truth: PlacedRadio  # that pilots come by
    # By cell of `CELL_M`: how often pilots were heard there, and the sums (K,) of their SNR.
    _heard: dict[tuple[int, int], tuple[int, Floats]] = field(default_factory=dict, init=False)

    def hear(self, est_m: Floats, true_m: Floats, rng: np.random.Generator) -> None:
        """Pilots of all devices, as the aircraft believes to be at places (n, 3) and is at others.

        Each fades by itself, as packets do.
        """
        terms, count = self.truth.terms, len(self.prior.success)
        floor_db = terms.snr_threshold_db - PILOT_GAIN_DB
        for at_m, where_m in zip(est_m, true_m, strict=True):
            median_db = self.truth.snr_db(np.arange(count), np.tile(where_m, (count, 1)))
            snr_db = median_db + terms.fading_db * rng.standard_normal(count)
            x, y = (math.floor(axis / CELL_M) for axis in at_m[:2].tolist())
            times, total_db = self._heard.get((x, y), (0, np.zeros(count)))
            self._heard[x, y] = times + 1, total_db + np.maximum(snr_db, floor_db)

    def grid(self) -> PerGrid:
        """What it believes now."""
        # Imported here: few runs learn.
        from scipy.linalg import cholesky, solve_triangular
        from scipy.special import ndtr, ndtri

        if not self._heard:
            return self.prior
        terms, prior = self.truth.terms, self.prior
        spread_db = math.hypot(terms.fading_db, DEVIATION_DB)
        clear = np.clip(prior.success, SURE, 1.0 - SURE)
        mean_db = terms.snr_threshold_db + spread_db * ndtri(clear)
        places_m = (np.array(list(self._heard), dtype=np.float64) + 0.5) * CELL_M
        times, total_db = (np.array(part) for part in zip(*self._heard.values(), strict=True))
        heard_db = (total_db / times[:, None]).T  # (K, n)
        devices = np.repeat(np.arange(len(heard_db)), len(places_m))
        at_m = np.tile(places_m, (len(heard_db), 1))
        believed_db = prior.between(mean_db, devices, at_m).reshape(heard_db.shape)
        noise = np.diag(terms.fading_db**2 / times)
        lower = cholesky(_covariance(places_m, places_m) + noise, lower=True)
        whitened = solve_triangular(lower, (heard_db - believed_db).T, lower=True)
        success = np.empty_like(prior.success)
        rows, columns = success.shape[1:]
        x_m = prior.first_m[0] + prior.cell_m * np.arange(columns)
        for row in range(rows):
            y_m = np.full(columns, prior.first_m[1] + prior.cell_m * row)
            cross = _covariance(places_m, np.column_stack((x_m, y_m)))
            gain = solve_triangular(lower, cross, lower=True)
            known = mean_db[:, row] + whitened.T @ gain
            left = np.maximum(0.0, DEVIATION_DB**2 - (gain**2).sum(axis=0))
            over = known - terms.snr_threshold_db
            success[:, row] = ndtr(over / np.sqrt(terms.fading_db**2 + left))
        return replace(prior, success=np.round(success, DIGITS))


def _covariance(a_m: Floats, b_m: Floats) -> Floats:
    far_m = np.hypot(*(a_m[:, None, :] - b_m[None, :, :]).transpose(2, 0, 1))
    return np.asarray(DEVIATION_DB**2 * np.exp(-far_m / CORRELATION_M))
