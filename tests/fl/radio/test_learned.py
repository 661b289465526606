"""What is learned of the radio: against the formulas written out, and against the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from fl.arrays import Floats, Ints
from fl.radio.learned import FIELDS, NUGGET_DB, Heard, Learned, Listener
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
ERROR_DB = math.hypot(NUGGET_DB, *(db for db, _ in FIELDS["channel"]))
PRIOR_DB = 10.0 + np.hypot(3.0, ERROR_DB) * ndtri(0.3)
FLOOR_DB = 0.0


def field(a: Floats, b: Floats, of: str = "channel") -> Floats:
    """What two places have in common of the prior's error: its covariance in dB^2."""
    away = np.linalg.norm(a[:, None, :2] - b[None, :, :2], axis=-1)
    return sum(db**2 * np.exp(-away / over_m) for db, over_m in FIELDS[of])


def told(place_m: Floats, snr_db: list[float], *, device: int = 0) -> Heard:
    return Heard(np.full(len(place_m), device), place_m, np.array(snr_db))


def over(*at: tuple[float, float]) -> Floats:
    return np.array([(x, y, 60.0) for x, y in at])


def test_what_listened_to_nothing_believes_as_before() -> None:
    assert (LISTENER.grid(Heard()).success == PRIOR.success).all()


@pytest.mark.parametrize("of", FIELDS)
def test_it_is_the_posterior_of_a_normal_field(of: str) -> None:
    heard = over((15.0, 45.0), (65.0, 45.0), (65.0, 45.0), (45.0, 105.0))
    all_heard = LISTENER.hear(Heard(), heard, heard, BOTH, np.random.default_rng(3))
    belief, error_db = (
        Learned(PRIOR, TERMS, of),
        math.hypot(NUGGET_DB, *(db for db, _ in FIELDS[of])),
    )
    prior_db = 10.0 + math.hypot(3.0, error_db) * ndtri(0.3)
    grid, again = replace(LISTENER, belief=belief).grid(all_heard), np.random.default_rng(3)
    snr_db = np.array(
        [
            TRUTH.snr_db(np.arange(2), np.tile(at, (2, 1))) + 3.0 * again.normal(size=2)
            for at in heard
        ]
    )
    assert snr_db.min() > 0.0  # above the floor
    same = (heard[:, None] == heard[None]).all(axis=-1)
    inverse = np.linalg.inv(field(heard, heard, of) + NUGGET_DB**2 * same + 9.0 * np.eye(4))
    asked = over((75.0, 65.0), (65.0, 45.0), (15.0, 195.0))
    cross = field(asked, heard, of)
    known_db = prior_db + cross @ inverse @ (snr_db - prior_db)
    left = error_db**2 - np.einsum("ij,jk,ik->i", cross, inverse, cross)
    expected = ndtr((known_db - 10.0) / np.sqrt(9.0 + left)[:, None])
    mean_db, deviation_db = belief.snr_db(all_heard, asked)
    np.testing.assert_allclose(mean_db, known_db.T)
    np.testing.assert_allclose(deviation_db, np.sqrt([left, left]))
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
        assert np.abs(off).mean() < 0.04  # for the hill has no nugget


def test_a_value_at_the_floor_says_that_it_is_no_more() -> None:
    """One tone at the floor among two that are above: the mean is that of the field, given them."""
    low, high = over((45.0, 45.0)), over((105.0, 45.0), (45.0, 155.0))
    asked = over((45.0, 45.0), (75.0, 45.0), (195.0, 195.0))
    # The tone at the floor and the asked places, given the other two.
    ahead = np.concatenate((low, asked))
    noise = NUGGET_DB**2 + 9.0
    gain = field(ahead, high) @ np.linalg.inv(field(high, high) + noise * np.eye(2))
    mean_db = PRIOR_DB + gain @ (np.array([14.0, 4.0]) - PRIOR_DB)
    left = field(ahead, ahead) - gain @ field(high, ahead)
    spread_db = np.sqrt(left[0, 0] + noise)
    top = (FLOOR_DB - mean_db[0]) / spread_db
    density = math.exp(-(top**2) / 2) / math.sqrt(2 * math.pi)
    under_db = mean_db[0] - spread_db * density / ndtr(top)  # of a normal one cut off at the top
    expected = mean_db[1:] + left[1:, 0] / spread_db**2 * (under_db - mean_db[0])
    heard = told(np.concatenate((low, high)), [FLOOR_DB, 14.0, 4.0])
    found, _ = Learned(PRIOR, TERMS).snr_db(heard, asked)
    np.testing.assert_allclose(found[0], expected, atol=0.01)
    np.testing.assert_allclose(found[1], PRIOR_DB)


def test_several_values_at_the_floor_are_about_what_draws_say() -> None:
    low, asked = over((45.0, 45.0), (65.0, 45.0), (45.0, 75.0)), over((55.0, 55.0), (145.0, 145.0))
    every, rng = np.concatenate((low, asked)), np.random.default_rng(9)
    drawn = PRIOR_DB + 3.0 + rng.multivariate_normal(np.zeros(5), field(every, every), 200_000)
    tones = drawn[:, :3] + np.hypot(NUGGET_DB, 3.0) * rng.normal(size=(len(drawn), 3))
    expected = drawn[(tones <= FLOOR_DB).all(axis=1), 3:].mean(axis=0)
    prior = PerGrid(np.full((1, 20, 20), ndtr(ndtri(0.3) + 3.0 / np.hypot(3.0, ERROR_DB))),
                    (5.0, 5.0), 10.0)  # fmt: skip
    found, _ = Learned(prior, TERMS).snr_db(told(low, [FLOOR_DB] * 3), asked)
    assert np.abs(expected - PRIOR_DB - 3.0).max() > 5.0
    np.testing.assert_allclose(found[0], expected, atol=1.5)


def test_who_was_silent_where_little_was_hoped_for_is_not_believed_to_be_at_the_floor() -> None:
    deaf = PerGrid(np.full((1, 20, 20), 1e-4), (5.0, 5.0), 10.0)
    before_db = 10.0 + np.hypot(3.0, ERROR_DB) * ndtri(1e-4)
    at_m = over((45.0, 45.0))
    found, _ = Learned(deaf, TERMS).snr_db(told(at_m, [FLOOR_DB]), at_m)
    assert before_db - 0.5 < found[0, 0] <= before_db < FLOOR_DB - 20.0


def test_silence_says_that_there_is_little() -> None:
    learned, deaf = Heard(), over((195.0, 195.0))
    for _ in range(5):
        learned = LISTENER.hear(learned, deaf, deaf, BOTH, np.random.default_rng(5))
    grid = LISTENER.grid(learned)
    assert grid.per(np.array([1]), deaf)[0] == pytest.approx(0.98, abs=0.02)
    assert grid.per(np.array([1]), over((15.0, 15.0)))[0] == pytest.approx(0.78, abs=0.05)


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


@pytest.mark.parametrize(
    ("of", "fields"),
    [
        ("channel", ((7.0, 25.0), (12.0, 300.0))), ("buildings", ((7.0, 15.0), (5.0, 300.0))),
        ("map", ((7.0, 15.0), (5.0, 300.0))),
    ],
)  # fmt: skip
def test_the_error_of_each_prior_is_of_two_fields_and_a_nugget(of: str, fields) -> None:
    """Of one tone: how far it moves the mean, and how sure it makes, where and away from there."""
    belief = Learned(PRIOR, TERMS, of)
    error_db2 = 2.5**2 + sum(db**2 for db, _ in fields)
    prior_db = 10.0 + math.sqrt(9.0 + error_db2) * float(ndtri(0.3))
    tone = told(over((45.0, 45.0)), [prior_db + 6.0])
    asked = over((45.0, 45.0), (75.0, 85.0), (45.0, 195.0))
    common = [sum(db**2 * math.exp(-d / far_m) for db, far_m in fields) for d in (0.0, 50.0, 150.0)]
    mean_db, deviation_db = belief.snr_db(tone, asked)
    for place, known in enumerate(common):
        gain = known / (common[0] + 2.5**2 + 3.0**2)
        assert mean_db[0, place] == pytest.approx(prior_db + 6.0 * gain)
        assert deviation_db[0, place] == pytest.approx(math.sqrt(error_db2 - known * gain))
    assert mean_db[1] == pytest.approx(prior_db)
    # What lies in one cell of ten metres is one place, and heard twice.
    twice = told(over((41.0, 49.0), (49.9, 40.1)), [prior_db + 4.0, prior_db + 8.0])
    gain = common[0] / (common[0] + 2.5**2 + 3.0**2 / 2)
    assert belief.snr_db(twice, asked)[0][0, 0] == pytest.approx(prior_db + 6.0 * gain)
    apart = told(over((41.0, 49.0), (50.1, 40.1)), [prior_db + 4.0, prior_db + 8.0])
    assert belief.snr_db(apart, asked)[0][0, 0] != pytest.approx(prior_db + 6.0 * gain, abs=0.01)


def test_rates_that_are_almost_sure_say_no_more_of_the_snr() -> None:
    for rate, counts in ((0.0, 1e-6), (1e-9, 1e-6), (1e-5, 1e-5), (1.0, 1 - 1e-6)):
        sure = PerGrid(np.full((1, 3, 3), rate), (5.0, 5.0), 10.0)
        mean_db, _ = Learned(sure, TERMS).snr_db(Heard(), over((15.0, 15.0)))
        spread_db = math.sqrt(9.0 + 2.5**2 + 7.0**2 + 12.0**2)
        assert mean_db[0, 0] == pytest.approx(10.0 + spread_db * float(ndtri(counts)))


def test_a_tone_is_heard_down_to_ten_decibels_under_what_a_packet_needs() -> None:
    """The hill's second device has 0.3 dB less each metre: 20 dB more than it needs at 0."""
    places = over((0.0, 0.0), (66.0, 0.0), (99.0, 0.0), (101.0, 0.0), (190.0, 0.0))
    quiet = replace(LISTENER, truth=replace(TRUTH, terms=replace(TERMS, fading_db=1e-9)))
    heard = quiet.hear(Heard(), places, places, np.array([False, True]), np.random.default_rng(1))
    assert heard.snr_db == pytest.approx([30.0, 10.2, 0.3, 0.0, 0.0], abs=1e-6)
