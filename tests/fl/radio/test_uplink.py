"""The gate: shares of arrivals against the average PER, and independence between devices."""

import numpy as np
import pytest

from fl.arrays import Floats
from fl.radio.channel import CHANNEL_PRESETS, average_per
from fl.radio.place import AverageRadio
from fl.radio.uplink import Gate, deliver

CHANNEL = CHANNEL_PRESETS["suburban"]


def above(r: Floats, h: Floats) -> tuple[AverageRadio, Floats]:
    """A radio of devices at the origin, and places so far east of them and so high."""
    return AverageRadio(CHANNEL, np.zeros((len(r), 2))), np.column_stack((r, 0.0 * r, h))


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


@pytest.mark.parametrize("gate", ["average", "instantaneous"])
def test_share_of_arrivals_is_one_minus_per(gate: Gate) -> None:
    n = 200_000
    r = np.tile([120.0, 170.0, 200.0, 260.0], n // 4)
    h = np.tile([60.0, 60.0, 80.0, 40.0], n // 4)
    sent = np.ones(n, dtype=bool)
    arrivals = deliver(*above(r, h), transmitted=sent, rng=rng(1), gate=gate)
    for i in range(4):
        expected = 1.0 - average_per(CHANNEL, r[i], height_m=h[i])
        assert arrivals.delivered[i::4].mean() == pytest.approx(float(expected), abs=0.01)
        assert arrivals.per[i] == pytest.approx(float(average_per(CHANNEL, r[i], height_m=h[i])))


@pytest.mark.parametrize("gate", ["average", "instantaneous"])
def test_silent_devices_lose_and_change_nobodys_luck(gate: Gate) -> None:
    r = np.linspace(100.0, 250.0, 12)
    h = np.full(12, 60.0)
    everybody = np.ones(12, dtype=bool)
    some = np.arange(12) % 3 == 0
    for seed in range(20):
        all_sent = deliver(*above(r, h), transmitted=everybody, rng=rng(seed), gate=gate)
        few_sent = deliver(
            *above(np.where(some, r, np.nan), np.where(some, h, np.nan)),
            transmitted=some,
            rng=rng(seed),
            gate=gate,
        )
        assert not few_sent.delivered[~some].any()
        assert (few_sent.per[~some] == 1.0).all()
        np.testing.assert_array_equal(few_sent.delivered[some], all_sent.delivered[some])


def test_certain_and_hopeless_packets() -> None:
    r, h = np.array([0.0, 5000.0]), np.full(2, 60.0)
    for seed in range(50):
        got = deliver(*above(r, h), transmitted=np.ones(2, dtype=bool), rng=rng(seed))
        assert got.delivered.tolist() == [True, False]
