"""A channel whose line of sight and shadowing are drawn once: right on average, the same again."""

import numpy as np
import pytest
from scipy.special import ndtr

from fl.radio.channel import CHANNEL_PRESETS
from fl.radio.place import (
    AverageRadio,
    CustomRadio,
    LinkTerms,
    PlacedRadio,
    SettledRadio,
    drawn_waves,
)
from native.errors import UsersCodeError

COUNT = 4000
EVERY = np.arange(COUNT)


def radio() -> SettledRadio:
    average = AverageRadio(CHANNEL_PRESETS["urban"], np.zeros((COUNT, 2)))
    return SettledRadio(average, drawn_waves(np.random.default_rng(3), COUNT), 30.0)


def at(x: float, y: float = 0.0) -> np.ndarray:
    return np.tile([x, y, 60.0], (COUNT, 1))


@pytest.mark.parametrize("x", [10.0, 90.0, 130.0, 180.0, 300.0])
def test_over_the_draws_it_is_the_average(x: float) -> None:
    made = radio()
    lost, rate = made.per(EVERY, at(x)), float(made.average.per(EVERY[:1], at(x)[:1])[0])
    assert set(lost) <= {0.0, 1.0}
    assert lost.mean() == pytest.approx(rate, abs=4.0 * (rate * (1.0 - rate) / COUNT) ** 0.5 + 1e-3)


def test_a_second_try_meets_what_the_first_one_met_and_far_away_another() -> None:
    made, lost = radio(), radio().per(EVERY, at(130.0))
    assert (made.per(EVERY, at(130.0)) == lost).all()
    # All on a circle, so that distance alone does not decide.
    together = []
    for turn in (0.02, 0.1, 0.5, np.pi):
        there = made.per(EVERY, at(130.0 * np.cos(turn), 130.0 * np.sin(turn)))
        together.append(np.corrcoef(lost, there)[0, 1])
    assert together == sorted(together, reverse=True)
    assert together[0] > 0.7
    assert abs(together[-1]) < 0.05


def test_sight_and_shadow_are_those_of_the_waves() -> None:
    """The channel's law written out, with the sum of cosines for each device and place."""
    made, channel = radio(), CHANNEL_PRESETS["urban"]
    place_m = np.column_stack((np.linspace(40.0, 220.0, COUNT), np.full(COUNT, 7.0),
                               np.full(COUNT, 60.0)))  # fmt: skip
    east, north, phase = made.waves.transpose(2, 0, 1, 3)
    x, y = (place_m[:, axis, None, None] / 30.0 for axis in (0, 1))
    turns = x * east + y * north + phase
    sight, shadow = (np.cos(2 * np.pi * turns).mean(axis=2) * np.sqrt(2.0 * turns.shape[2])).T
    far_m = np.hypot(place_m[:, 0], 7.0)
    rho = 1.0 / (1.0 + np.exp(channel.a2 - channel.a1_per_rad * np.arctan2(60.0, far_m)))
    budget_db = channel.tx_power_db - channel.noise_db
    los, nlos = (
        (budget_db + beta_db) * np.log(10.0) / 10.0 - alpha * np.log(np.hypot(far_m, 60.0)) + more
        for beta_db, alpha, more in (
            (channel.beta_los_db, channel.alpha_los, channel.sigma_los * shadow),
            (channel.beta_nlos_db, channel.alpha_nlos, channel.sigma_nlos * shadow),
        )
    )
    seen = ndtr(sight) < rho
    lost = np.where(seen, los, nlos) < np.log(channel.snr_threshold)
    assert (made.per(EVERY, place_m) == lost).all()
    for some in (lost, seen):
        assert 0.2 < some.mean() < 0.8


def test_fading_and_what_is_unknown_are_one_spread() -> None:
    class Flat:
        def gain_db(self, device: np.ndarray, place_m: np.ndarray) -> np.ndarray:
            return np.asarray(place_m[:, 0] - 90.0 - 5.0 * device)

    terms = LinkTerms(10.0, 1e6, 7.0, 22.0, 3.0)  # an SNR of 27 dB, and 5 dB less for each
    devices, places = np.arange(3), np.zeros((3, 3))
    per = PlacedRadio(Flat(), terms).per(devices, places)
    assert per == pytest.approx(ndtr([-5 / 3, 0.0, 5 / 3]))
    spread = PlacedRadio(Flat(), terms, lambda device, _: np.full(len(device), 4.0))
    assert spread.per(devices, places) == pytest.approx(ndtr([-1.0, 0.0, 1.0]))


@pytest.mark.parametrize(("rate", "fits"), [(0.0, True), (1.0, True), (-1e-9, False), (1.1, False)])
def test_rates_of_a_radio_of_ones_own_are_from_0_to_1(rate: float, fits: bool) -> None:
    class Own:
        def per(self, device: np.ndarray, place_m: np.ndarray) -> list[float]:
            return [rate] * len(place_m[device])

    made = CustomRadio("own:radio", Own())
    if fits:
        assert made.per(np.arange(2), np.zeros((2, 3))).tolist() == [rate] * 2
        return
    with pytest.raises(
        UsersCodeError, match=r"per\(\) gives holds .* at \[0\]: must be from 0 to 1"
    ):
        made.per(np.arange(2), np.zeros((2, 3)))
