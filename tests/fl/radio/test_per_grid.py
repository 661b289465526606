"""Rates on a grid: as SciPy interpolates them, held beyond the edge, and bounded within a reach."""

import math

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from fl.arrays import Floats, Ints
from fl.radio.per_grid import PerGrid


def grid(seed: int = 1, shape: tuple[int, int, int] = (3, 5, 7)) -> PerGrid:
    return PerGrid(np.random.default_rng(seed).uniform(0.0, 1.0, shape), (20.0, -30.0), 10.0)


def test_between_its_places_it_is_bilinear_and_beyond_them_as_at_the_edge() -> None:
    made, rng = grid(), np.random.default_rng(2)
    device = rng.integers(0, 3, 400)
    place_m = rng.uniform((0.0, -60.0, 0.0), (110.0, 40.0, 90.0), (400, 3))
    cells = [device, (place_m[:, 1] + 30.0) / 10.0, (place_m[:, 0] - 20.0) / 10.0]
    expected = map_coordinates(made.success, cells, order=1, mode="nearest")
    assert made.per(device, place_m) == pytest.approx(1.0 - expected)
    corners = np.array([[20.0, -30.0, 0.0], [80.0, 10.0, 5.0], [80.0, -30.0, 9.0]])
    at = made.success[[0, 1, 2], [0, 4, 0], [0, 6, 6]]
    assert made.per(np.arange(3), corners) == pytest.approx(1.0 - at)
    values = made.between(-made.success, np.arange(3)[:, None], corners)  # of all at all
    assert values.shape == (3, 3)
    assert np.diagonal(values) == pytest.approx(-at)


def test_a_radio_is_asked_at_each_place_at_the_height() -> None:
    class Plane:
        def per(self, device: Ints, place_m: Floats) -> Floats:
            x, y, height = place_m.T
            return np.asarray(0.1 + device / 10 + x / 1000 + y / 10_000 + height / 1e6)

    for size_m, places in (
        ((40.0, 20.0), (5, 3)), ((41.0, 19.0), (6, 3)), ((5.0, 0.5), (2, 2)), ((10, 10.1), (2, 3))
    ):  # fmt: skip
        made = PerGrid.of(Plane(), 2, size_m=size_m, height_m=60.0, cell_m=10.0)
        assert made.success.shape == (2, places[1], places[0])
        assert (made.first_m, made.cell_m) == ((0.0, 0.0), 10.0)
        north, east = np.indices(made.success.shape[1:]) * 10.0
        for device in (0, 1):
            per = 0.1 + device / 10 + east / 1000 + north / 10_000 + 6e-5
            assert made.success[device] == pytest.approx(1.0 - per)
        at_m = made.places_m(7.0)
        assert at_m.tolist() == [[x, y, 7.0] for y, x in zip(north.flat, east.flat, strict=True)]
        with pytest.raises(ValueError, match="read-only"):
            made.success[0, 0, 0] = 1.0


@pytest.mark.parametrize("reach_m", [0.0, 4.0, 12.0, 35.0])
def test_nothing_within_reach_is_above_the_bound_which_a_place_nearby_has(reach_m: float) -> None:
    """Near by is the reach and the diagonal of a cell more; places outside count at the edge."""
    made, rng = grid(3), np.random.default_rng(4)
    points = made.places_m(0.0)
    for place_m in rng.uniform((0.0, -50.0), (100.0, 30.0), (60, 2)):
        bound, best_m = made.best_within(place_m, reach_m), made.best_places(place_m, reach_m)
        angle, far = rng.uniform(0, 2 * math.pi, 50), reach_m * np.sqrt(rng.random(50))
        around = place_m + np.column_stack((far * np.cos(angle), far * np.sin(angle)))
        around = np.column_stack((around, 0 * angle))
        held = np.clip(place_m, (20.0, -30.0), (80.0, 10.0))
        near = np.hypot(*(points[:, :2] - held).T) <= reach_m + math.hypot(10.0, 10.0)
        for device in range(3):
            success = 1.0 - made.per(np.full(50, device), around)
            assert success.max() <= bound[device] + 1e-12
            assert bound[device] == made.success[device].ravel()[near].max()
            at = np.append(best_m[device], 0.0)[None]
            assert 1.0 - made.per(np.array([device]), at)[0] == pytest.approx(bound[device])


def test_of_some_devices_from_another_origin_it_is_the_same() -> None:
    made, rng = grid(), np.random.default_rng(5)
    seen = made.seen_from(np.array([2, 0]), np.array([5.0, 7.0]))
    place_m = rng.uniform((0.0, -60.0, 0.0), (110.0, 40.0, 90.0), (50, 3))
    for number, device in enumerate((2, 0)):
        there = seen.per(np.full(50, number), place_m - (5.0, 7.0, 0.0))
        assert there == pytest.approx(made.per(np.full(50, device), place_m))
    assert seen.cell_m == 10.0
