"""Gains on a grid: at its places as they were given, between them linear."""

import numpy as np
import pytest

from fl.radio.place import RadioMap

DEVICES = np.array([[10.0, 20.0], [70.0, 30.0]])
X, Y, H = np.array([5.0, 15.0, 25.0]), np.array([2.0, 6.0]), np.array([40.0, 60.0])


def plane(device, place_m):
    """Linear in every direction, another for each device."""
    x, y, height = place_m.T
    return -50.0 - 0.25 * x + 0.5 * y - 0.125 * height - 8.0 * device * (1.0 + 0.01 * x)


def made(heights=H) -> RadioMap:
    places = np.stack(np.meshgrid(heights, Y, X, indexing="ij"))[::-1].reshape(3, -1).T
    gain = [plane(np.full(len(places), k), places).reshape(len(heights), 2, 3) for k in (0, 1)]
    return RadioMap(np.array(gain), heights, Y, X, DEVICES)


def test_linear_between_the_places_and_constant_beyond() -> None:
    rng = np.random.default_rng(3)
    device = rng.integers(0, 2, 500)
    place_m = np.column_stack(
        (rng.uniform(0, 30, 500), rng.uniform(0, 8, 500), rng.uniform(30, 70, 500))
    )
    held = np.clip(place_m, [5.0, 2.0, 40.0], [25.0, 6.0, 60.0])
    assert made().gain_db(device, place_m) == pytest.approx(plane(device, held), abs=1e-9)


def test_a_map_of_one_height_counts_at_all() -> None:
    one = made(np.array([60.0]))
    at = np.array([[15.0, 2.0, 10.0], [15.0, 2.0, 99.0]])
    expected = plane(np.array([0, 1]), np.array([[15.0, 2.0, 60.0]] * 2))
    assert one.gain_db(np.array([0, 1]), at) == pytest.approx(expected)


def test_a_map_is_made_at_the_middles_of_cells() -> None:
    class Plane:
        def gain_db(self, device, place_m):
            return plane(device, place_m)

    found = RadioMap.of(Plane(), DEVICES, size_m=(30.0, 20.0), height_m=H, cell_m=10.0)
    assert found.x_m.tolist() == [5.0, 15.0, 25.0]
    assert found.y_m.tolist() == [5.0, 15.0]
    place_m = np.array([[25.0, 5.0, 60.0]])
    assert found.path_gain_db[1, 1, 0, 2] == plane(np.ones(1), place_m)[0]
    assert found.gain_db(np.ones(1, dtype=np.int64), place_m) == plane(np.ones(1), place_m)
