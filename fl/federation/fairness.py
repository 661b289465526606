"""Fairness over devices and what it makes of their importance: the paper's formulas, in numpy.

Symbols: p_k data share of device k in its community, eps_k its mean validation accuracy over
the last l models, psi_c the coefficient of variation of its community, delta_k its importance.
"""

import numpy as np
from numpy.typing import NDArray

from fl.config import Unheard

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

INITIAL_COV = 1.0  # psi_c of every community before the first update


def device_accuracy(correct: Indices, total: Indices, owned: Bools) -> Floats:
    """eps_k(theta): accuracy of one model on the validation samples of each device, (K_c,).

    A device's validation set is its own labels' part of the task's; `correct` and `total`
    (classes,) count over the whole set. A device none of whose labels occurs there scores 0.
    """
    hits = owned @ correct.astype(np.float64)
    samples = owned @ total.astype(np.float64)
    return np.asarray(hits / np.maximum(samples, 1.0), dtype=np.float64)


def windowed_accuracy(history: Floats) -> Floats:
    """eps_k = mean over the models that came down in the last l rounds; `history` is (<= l, K)."""
    return np.asarray(history.mean(axis=0), dtype=np.float64)


def coefficient_of_variation(p: Floats, accuracy: Floats, *, unheard: Unheard = "zero") -> float:
    """psi_c = sqrt(sum_k (eps_k - eps_bar)^2) / eps_bar with eps_bar = sum_k p_k eps_k.

    `accuracy` (K_c,) holds the last values received, NaN for a device never heard of, of which
    the paper says nothing. "zero": it counts as 0; its labels were never trained on by itself,
    and the community that hides it should look unfair, not fair. "left-out": psi is that of the
    others, with their p_k scaled to sum to 1. Where eps_bar is 0 (nothing received, or nothing
    learnt) the ratio is undefined and the answer is that of the start, 1: the community keeps an
    ordinary claim.
    """
    if unheard == "left-out":
        known = ~np.isnan(accuracy)
        accuracy = accuracy[known]
        p = p[known] / p[known].sum() if known.any() else p[known]
    heard = np.where(np.isnan(accuracy), 0.0, accuracy)
    mean = float(p @ heard)
    if mean <= 0.0:
        return INITIAL_COV
    return float(np.sqrt(np.sum((heard - mean) ** 2)) / mean)


def importance(p: Floats, cov: Floats, missed: Bools, *, boost: float, floor: float) -> Floats:
    """delta_k = p_k psi_c lambda if device k missed the previous round, p_k psi_c otherwise.

    `cov` (K,) is psi of each device's community, `boost` lambda > 1. A device missed the round
    if it was not scheduled or its update was lost; before the first round all did. psi_c = 0
    (perfectly equal devices) would make a community worthless and a plan for only such
    communities meaningless, so psi_c counts as `floor` at least: it then comes last, not never.
    """
    return np.asarray(p * np.maximum(cov, floor) * np.where(missed, boost, 1.0), dtype=np.float64)
