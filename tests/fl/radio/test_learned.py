"""What is learned of the radio: against the formulas written out, and against the truth."""

import numpy as np
import pytest
from scipy.stats import norm

from fl.arrays import Floats, Ints
from fl.radio.learned import CORRELATION_M, DEVIATION_DB, Heard, Learned, Listener
from fl.radio.per_grid import PerGrid
from fl.radio.place import LinkTerms, PlacedRadio

TERMS = LinkTerms(0.0, 1e6, 7.0, 10.0, 3.0)
# Its middles are those of the cells of what was heard.
PRIOR = PerGrid(np.full((2, 20, 20), 0.3), (5.0, 5.0), 10.0)


class Hill:
    """A gain that falls to the east, by another amount for each device."""

    def gain_db(self, device: Ints, place_m: Floats) -> Floats:
        need = TERMS.snr_threshold_db - (TERMS.tx_power_dbm - TERMS.noise_dbm)
        return np.asarray(need + 20.0 - (0.1 + 0.2 * device) * place_m[:, 0])


TRUTH = PlacedRadio(Hill(), TERMS)
LISTENER = Listener(Learned(PRIOR, TERMS), TRUTH, PRIOR, 60.0)
BOTH = np.ones(2, dtype=bool)


def over(*at: tuple[float, float]) -> Floats:
    return np.array([(x, y, 60.0) for x, y in at])


def test_what_listened_to_nothing_believes_as_before() -> None:
    assert (LISTENER.grid(Heard()).success == PRIOR.success).all()


def test_it_is_the_posterior_of_a_normal_field() -> None:
    heard = over((15.0, 45.0), (65.0, 45.0), (65.0, 45.0), (45.0, 105.0))
    grid = LISTENER.grid(LISTENER.hear(Heard(), heard, heard, BOTH, np.random.default_rng(3)))
    again = np.random.default_rng(3)
    snr_db = np.array(
        [
            TRUTH.snr_db(np.arange(2), np.tile(at, (2, 1))) + 3.0 * again.normal(size=2)
            for at in heard
        ]
    )
    assert snr_db.min() > 0.0  # above the floor
    spread_db = np.hypot(3.0, DEVIATION_DB)
    mean_db = 10.0 + spread_db * norm.ppf(0.3)

    def covariance(a, b):
        away = np.linalg.norm(a[:, None, :2] - b[None, :, :2], axis=-1)
        return DEVIATION_DB**2 * np.exp(-away / CORRELATION_M)

    inverse = np.linalg.inv(covariance(heard, heard) + 9.0 * np.eye(4))
    asked = over((75.0, 65.0), (65.0, 45.0), (15.0, 195.0))
    cross = covariance(asked, heard)
    known_db = mean_db + cross @ inverse @ (snr_db - mean_db)
    left = DEVIATION_DB**2 - np.einsum("ij,jk,ik->i", cross, inverse, cross)
    expected = norm.cdf((known_db - 10.0) / np.sqrt(9.0 + left)[:, None])
    for k in range(2):
        found = 1.0 - grid.per(np.full(3, k), asked)
        np.testing.assert_allclose(found, expected[:, k], atol=2e-6)


def test_who_has_flown_everywhere_knows_the_truth() -> None:
    learned, rng = Heard(), np.random.default_rng(4)
    line = 5.0 + 10.0 * np.arange(20)
    every = over(*((x, y) for x in line for y in line))
    for _ in range(20):
        learned = LISTENER.hear(learned, every, every, BOTH, rng)
    grid = LISTENER.grid(learned)
    for k in range(2):
        asked = np.full(len(every), k)
        off = grid.per(asked, every) - TRUTH.per(asked, every)
        assert np.abs(off).max() < 0.25  # where 1 dB is 0.13 of the rate
        assert np.abs(off).mean() < 0.02


def test_silence_says_that_there_is_little() -> None:
    learned, deaf = Heard(), over((195.0, 195.0))
    for _ in range(5):
        learned = LISTENER.hear(learned, deaf, deaf, BOTH, np.random.default_rng(5))
    grid = LISTENER.grid(learned)
    assert grid.per(np.array([1]), deaf)[0] == pytest.approx(0.98, abs=0.02)
    assert grid.per(np.array([1]), over((15.0, 15.0)))[0] == pytest.approx(0.7, abs=0.05)


def test_it_learns_where_it_believes_to_be() -> None:
    at_m, true_m = over((45.0, 45.0)), over((195.0, 45.0))
    grid = LISTENER.grid(LISTENER.hear(Heard(), at_m, true_m, BOTH, np.random.default_rng(6)))
    here, there = grid.per(np.array([1, 1]), over((45.0, 45.0), (195.0, 45.0)))
    assert here > 0.9 > there


def test_of_those_whose_pilots_are_not_heard_it_learns_nothing_and_of_others_the_same() -> None:
    heard = over((15.0, 45.0), (65.0, 45.0), (45.0, 105.0))
    every, second = (
        LISTENER.hear(Heard(), heard, heard, np.array(who), np.random.default_rng(3))
        for who in ((True, True), (False, True))
    )
    assert second.device.tolist() == [1, 1, 1]
    assert (second.place_m == heard).all()
    assert (second.snr_db == every.snr_db[every.device == 1]).all()
    (prior, alone), both = LISTENER.grid(second).success, LISTENER.grid(every).success
    assert (prior == 0.3).all()
    assert alone == pytest.approx(both[1], abs=2e-6)
    # Heard alike or not, each has its own cells and counts.
    again, first = heard[:1], np.array([True, False])
    more = LISTENER.hear(every, again, again, first, np.random.default_rng(8))
    moved, as_before = LISTENER.grid(more).success
    assert as_before == pytest.approx(both[1], abs=2e-6)
    assert np.abs(moved - both[0]).max() > 0.01
