"""The tables that planning works on, against the exact channel."""

import numpy as np
import pytest

from fl.radio.channel import CHANNEL_PRESETS, average_per
from mission.planner.reward import NEGLIGIBLE, conjugates, reward_table


@pytest.mark.parametrize("preset", CHANNEL_PRESETS)
def test_the_table_is_the_channel(preset):
    channel = CHANNEL_PRESETS[preset]
    table = reward_table(channel, 1024)
    r = np.random.default_rng(0).uniform(0.0, 1000.0, 2000)
    f, slope, bend = table.expanded(r)
    assert np.abs(f - (1 - average_per(channel, r))).max() < 1e-4
    h = 0.05
    inner = np.maximum(r, 2.0)
    f, slope, bend = table.expanded(inner)
    up, down = (1 - average_per(channel, inner + s) for s in (h, -h))
    here = 1 - average_per(channel, inner)
    assert np.abs(slope - (up - down) / (2 * h)).max() < 1e-4
    assert np.abs(bend - (up - 2 * here + down) / h**2).max() < 2e-3


@pytest.mark.parametrize("preset", CHANNEL_PRESETS)
def test_conjugates_lie_above_and_hardly_so(preset):
    channel = CHANNEL_PRESETS[preset]
    table = conjugates(channel, 1024)
    best = 1 - float(average_per(channel, 0.0))
    count = table.coefficients.shape[1] - 3
    for row in range(0, len(table.ends), 3):
        low, high = table.radii_m[table.ends[row]]
        r = np.linspace(low, high, 3001)
        f = 1 - average_per(channel, r)
        s = np.random.default_rng(row).uniform(0, count * table.spacing[row] * 0.999, 60)
        exact = (f[None, :] + s[:, None] * r[None, :]).max(axis=1)
        # The uniform cubic B-spline, by its basis.
        x = s / table.spacing[row]
        i = x.astype(int)
        t = x - i
        basis = np.stack(
            [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
        )
        c = table.coefficients[row][i + np.arange(4)[:, None]]
        spline = (basis * c).sum(axis=0) / 6
        assert (spline >= exact - 1e-12 * best).all()
        assert (spline - exact).max() < 0.02 * best


def test_the_ladder_climbs_to_where_the_channel_ends():
    for channel in CHANNEL_PRESETS.values():
        table = conjugates(channel, 4096)
        end = 1 - float(average_per(channel, table.radii_m[-1]))
        assert end <= NEGLIGIBLE * (1 - float(average_per(channel, 0.0))) * 1.001
        assert (table.ladder > np.arange(len(table.ladder)))[:-1].all()
        assert table.ladder[-2] == len(table.radii_m) - 1


def test_bounds_beyond_a_distance():
    channel = CHANNEL_PRESETS["suburban"]
    table = reward_table(channel, 1024)
    at = np.array([0.0, 10.3, 150.0, 400.0])
    bound = table.upper(at)
    for low, most in zip(at, bound, strict=True):
        f = 1 - average_per(channel, np.linspace(low, 1000.0, 5000))
        assert f.max() <= most <= f.max() + 2e-3
