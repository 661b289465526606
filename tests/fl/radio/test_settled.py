"""A channel whose line of sight and shadowing are drawn once: right on average, the same again."""

import numpy as np
import pytest

from fl.radio.channel import CHANNEL_PRESETS
from fl.radio.place import AverageRadio, SettledRadio, drawn_waves

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
