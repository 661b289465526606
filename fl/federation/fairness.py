"""Fairness over devices (CoV) and their importance: the paper's formulas, in numpy.

Symbols: p_k data share of device k in its community, eps_k its mean validation accuracy over
the last l models, psi_c the coefficient of variation of its community, delta_k its importance.
"""

import numpy as np

from fl.arrays import Bools, Floats, Ints
from fl.config import Unheard

INITIAL_COV = 1.0  # psi_c of every community before the first update


def device_accuracy(correct: Ints, total: Ints, counts: Ints) -> Floats:
    """eps_k(theta): accuracy of one model on the validation samples of each device, (K_c,).

    A device's validation samples are the task's in the proportions of its own training data,
    `counts` (K_c, classes); `correct` and `total` (classes,) count over the task's whole set, and
    `correct` is (K_c, classes) where every device has a model of its own. So
    eps_k is the mean of the classes' accuracies, weighted by the device's share of each. A class
    without a validation sample is left out; a device that owns no other scores 0.
    """
    weights = counts * (total > 0)
    share = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1)
    accuracy = correct / np.maximum(total, 1)
    eps = share @ accuracy if accuracy.ndim == 1 else (share * accuracy).sum(axis=1)
    return np.asarray(eps, dtype=np.float64)


def windowed_accuracy(history: Floats, *, period: int) -> Floats:
    """Return eps_k (K,), the mean accuracy over the models of the `period` (l) rounds before.

    `history` (<= l + 1, K) ends with the model that has just come down, which does not count yet
    (the paper's j = m-l .. m-1 in round m). In the first round there is no other: it stands in.
    """
    before = history[:-1][-period:] if len(history) > 1 else history
    return np.asarray(before.mean(axis=0), dtype=np.float64)


def coefficient_of_variation(
    p: Floats, accuracy: Floats, *, unheard: Unheard = "left-out"
) -> float:
    """psi_c = sqrt(sum_k (eps_k - eps_bar)^2) / eps_bar with eps_bar = sum_k p_k eps_k.

    `accuracy` (K_c,) holds the last values received, NaN for a device never heard of, of which
    the paper says nothing. "left-out": psi is that of the others, with their p_k scaled to sum to
    1. "zero": it counts as 0; but then one device out of reach holds its community's psi above 1
    for good, however well the others are served. Where eps_bar is 0 (nothing received, or nothing
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

    `cov` (K,) is psi of each device's community, `boost` lambda > 1; before the first round all
    devices missed one. psi_c = 0 (perfectly equal devices) would make a community worthless, so
    that it waits for ever behind any other however badly it does: psi_c counts as `floor` at
    least. The floor is ours, the paper has none.
    """
    return np.asarray(p * np.maximum(cov, floor) * np.where(missed, boost, 1.0), dtype=np.float64)
