"""The channel against values from outside this code: averages over draws, other papers' forms."""

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ndtr

from fl.radio.channel import (
    CHANNEL_PRESETS,
    DEFAULT_PRESET,
    Channel,
    average_per,
    fit_logistic,
    link_budget,
    log_mean_snr,
    los_probability,
    served_radius_m,
    smooth_per,
)
from native.errors import SettingError

DISTANCES_M = [0.0, 50.0, 100.0, 150.0, 200.0, 300.0, 400.0, 600.0]


def make(**changes: float) -> Channel:
    from dataclasses import replace

    return replace(CHANNEL_PRESETS[DEFAULT_PRESET], **changes)


@pytest.mark.parametrize(
    ("preset", "expected"),
    [
        ("suburban+10dB", [0.0005, 0.075, 0.912, 1, 1, 1, 1, 1]),
        ("suburban+15dB", [0, 0, 0.015, 0.538, 0.971, 1, 1, 1]),
        ("suburban+20dB", [0, 0, 0.0001, 0.004, 0.077, 0.880, 0.999, 1]),
        ("suburban+30dB", [0, 0, 0.0001, 0.003, 0.029, 0.235, 0.504, 0.794]),
    ],
)
def test_per_of_the_presets_is_as_tabulated(preset: str, expected: list[float]) -> None:
    per = average_per(CHANNEL_PRESETS[preset], DISTANCES_M)
    np.testing.assert_allclose(per, expected, atol=6e-4)


def test_printed_constants_lose_everything_overhead() -> None:
    budget = link_budget(CHANNEL_PRESETS["literal"])
    assert budget.snr_los_db == pytest.approx(4.6, abs=0.05)
    assert budget.threshold_db == pytest.approx(10.0)
    assert budget.per == pytest.approx(0.9999, abs=5e-5)


def log_normal(value: float, median: float, sigma: float) -> float:
    """The density of values whose logarithm has this deviation."""
    off = math.log(value / median) / sigma
    return math.exp(-(off**2) / 2.0) / (value * sigma * math.sqrt(2.0 * math.pi))


@pytest.mark.parametrize("horizontal_m", [0.0, 70.0, 130.0, 180.0, 260.0, 450.0])
@pytest.mark.parametrize("preset", ["suburban", "urban", "suburban-log-variance"])
def test_per_is_the_integral_of_the_log_normal_snr_under_the_threshold(
    preset: str, horizontal_m: float
) -> None:
    c = CHANNEL_PRESETS[preset]
    d = math.sqrt(horizontal_m**2 + c.altitude_m**2)
    theta = math.pi / 2 if horizontal_m == 0.0 else math.atan(c.altitude_m / horizontal_m)
    rho = 1.0 / (1.0 + math.exp(-c.a1_per_rad * theta + c.a2))
    expected = 0.0
    for weight, beta_db, alpha, sigma in (
        (rho, c.beta_los_db, c.alpha_los, c.sigma_los),
        (1.0 - rho, c.beta_nlos_db, c.alpha_nlos, c.sigma_nlos),
    ):
        median = 10.0 ** ((c.tx_power_db - c.noise_db + beta_db) / 10.0) * d**-alpha
        # The density over gamma itself, in the log of gamma so that quad sees it.
        mass, _ = quad(
            lambda x, *of: log_normal(math.exp(x), *of) * math.exp(x),
            math.log(median) - 12 * sigma,
            max(math.log(c.snr_threshold), math.log(median) - 12 * sigma),
            args=(median, sigma),
            points=[min(math.log(median), math.log(c.snr_threshold))],
            limit=400,
        )
        expected += weight * mass
    assert float(average_per(c, horizontal_m)) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("height_m", [0.0, 0.4, 120.0, 4e3])
@pytest.mark.parametrize("preset", CHANNEL_PRESETS)
def test_per_is_the_closed_form(preset: str, height_m: float) -> None:
    c = CHANNEL_PRESETS[preset]
    r = np.concatenate([[0.0, 1e-9], np.linspace(0.5, 3e3, 1000), [1e9]])
    mu_los, mu_nlos = log_mean_snr(c, r, height_m=height_m)
    rho = 1.0 / (1.0 + np.exp(-c.a1_per_rad * np.arctan2(height_m, r) + c.a2))
    lost = (
        ndtr((math.log(c.snr_threshold) - mu_los) / c.sigma_los),
        ndtr((math.log(c.snr_threshold) - mu_nlos) / c.sigma_nlos),
    )
    per = average_per(c, r, height_m=height_m)
    np.testing.assert_allclose(per, rho * lost[0] + (1.0 - rho) * lost[1], rtol=1e-12, atol=1e-14)
    assert average_per(c, np.inf) == 1.0
    assert np.isnan(average_per(c, np.nan))
    assert average_per(c, 3.0).shape == ()


def test_per_is_the_share_of_lost_packets_over_drawn_gains() -> None:
    c = make()
    rng = np.random.Generator(np.random.PCG64(7))
    horizontal, n = 190.0, 400_000
    theta = math.degrees(math.atan(c.altitude_m / horizontal))
    los = rng.random(n) < 1.0 / (1.0 + 4.88 * math.exp(-0.43 * (theta - 4.88)))
    d = math.hypot(horizontal, c.altitude_m)
    shadow_db = rng.normal(0.0, 1.0, n) * np.where(los, math.sqrt(2.0), math.sqrt(5.0))
    snr_db = (-20 + 17 + 95) + np.where(los, -30 - 22.7 * math.log10(d), -40 - 36.4 * math.log10(d))
    lost = (snr_db + shadow_db < 10.0).mean()
    assert float(average_per(c, horizontal)) == pytest.approx(lost, abs=4 * 0.5 / math.sqrt(n))


@pytest.mark.parametrize(
    ("preset", "a", "b"),
    [("suburban", 4.88, 0.43), ("urban", 9.61, 0.16), ("high-rise", 27.23, 0.08)],
)
def test_los_probability_is_al_houranis_in_degrees(preset: str, a: float, b: float) -> None:
    for horizontal in DISTANCES_M[1:]:
        degrees = math.degrees(math.atan2(60.0, horizontal))
        expected = 1.0 / (1.0 + a * math.exp(-b * (degrees - a)))
        got = float(los_probability(CHANNEL_PRESETS[preset], horizontal))
        assert got == pytest.approx(expected, rel=1e-12)


def test_degrees_taken_for_radians_show_overhead() -> None:
    assert float(los_probability(make(), 0.0)) > 0.999
    assert float(los_probability(make(a1_per_rad=0.43), 0.0)) == pytest.approx(0.047, abs=1e-3)


@pytest.mark.parametrize(
    ("preset", "b1", "b2", "worst"),
    [
        ("suburban+10dB", 15.2, -10.4, 0.029),
        ("suburban+15dB", 30.0, -11.7, 0.023),
        ("suburban+20dB", 50.5, -11.9, 0.024),
        ("suburban+30dB", 31.8, -4.79, 0.056),
    ],
)
def test_logistic_fit_finds_the_known_optimum(
    preset: str, b1: float, b2: float, worst: float
) -> None:
    fit = fit_logistic(CHANNEL_PRESETS[preset])
    assert fit.b1_per_rad == pytest.approx(b1, rel=4e-3)
    assert fit.b2 == pytest.approx(b2, rel=5e-3)
    assert fit.worst_error == pytest.approx(worst, abs=6e-4)


@pytest.mark.parametrize("preset", sorted(CHANNEL_PRESETS))
def test_stand_in_stays_a_probability_and_near(preset: str) -> None:
    c = CHANNEL_PRESETS[preset]
    fit = fit_logistic(c)
    r = np.linspace(0.0, 1131.0, 500)
    q = smooth_per(fit, c, r)
    assert np.all((q >= 0.0) & (q <= 1.0))
    assert np.abs(q - average_per(c, r)).max() <= fit.worst_error + 1e-3
    assert fit.worst_error < 0.15


def test_per_grows_with_distance_and_falls_with_power() -> None:
    r = np.linspace(0.0, 1200.0, 700)
    per = average_per(make(), r)
    assert np.all(np.diff(per) >= -1e-15)  # rounding near 1
    assert np.all(average_per(make(tx_power_db=3.0), r) <= per)


def test_height_broadcasts_and_defaults_to_the_planned_one() -> None:
    c = make()
    r = np.array([0.0, 120.0, 240.0])
    np.testing.assert_array_equal(average_per(c, r), average_per(c, r, height_m=60.0))
    grid = average_per(c, r, height_m=np.array([[30.0], [60.0]]))
    assert grid.shape == (2, 3)
    np.testing.assert_array_equal(grid[0], average_per(make(altitude_m=30.0), r))
    assert np.isfinite(average_per(c, 0.0, height_m=0.0))


@pytest.mark.parametrize("name", ["altitude_m", "sigma_los", "sigma_nlos", "snr_threshold"])
def test_impossible_constants_are_named(name: str) -> None:
    with pytest.raises(SettingError, match=rf"{name} = 0.0: must be above 0"):
        make(**{name: 0.0})
    with pytest.raises(SettingError, match=f"{name} = nan: must be a finite number") as caught:
        make(**{name: math.nan})
    again = pickle.loads(pickle.dumps(caught.value))  # errors cross process borders in sweeps
    assert str(again) == str(caught.value)


def test_served_is_up_to_where_half_of_the_packets_are_lost() -> None:
    for preset in ("suburban", "suburban+30dB", "high-rise"):
        channel = CHANNEL_PRESETS[preset]
        radius_m = served_radius_m(channel)
        assert average_per(channel, radius_m) <= 0.5 < average_per(channel, radius_m + 1.0)
    assert served_radius_m(CHANNEL_PRESETS["literal"]) == 0.0
    assert served_radius_m(make(tx_power_db=90.0, beta_nlos_db=40.0)) == 49_999.0


def test_a_distance_below_zero_is_named() -> None:
    channel = make()
    assert channel.per([0.0, 200.0]).tolist() == average_per(channel, [0.0, 200.0]).tolist()
    assert channel.per(3.0, 20.0) == average_per(channel, 3.0, height_m=20.0)
    for wrong in (-1.0, math.nan):
        with pytest.raises(ValueError, match=f"distance_m holds {wrong}: must be 0 or more"):
            channel.per([0.0, wrong, -7.0])
