"""Our exp, log and arctan against the platform's, which promise no digits but are near."""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from native import building

NAN = np.nan


@pytest.fixture(scope="module")
def functions(tmp_path_factory: pytest.TempPathFactory) -> Any:
    library = building.Library("elementary", Path(__file__).parent, None, "elementary.c")
    target = tmp_path_factory.mktemp("library") / "elementary.so"
    building.compile_to(target, library, next(building.compilers()))
    return ctypes.CDLL(str(target))


def values(function: Any, *arrays: Any) -> np.ndarray:
    out = np.empty(len(arrays[0]))
    addresses = [ctypes.c_void_p(each.ctypes.data) for each in (*arrays, out)]
    function(*addresses, ctypes.c_int64(len(out)))
    return out


def ulps(found: np.ndarray, right: np.ndarray) -> float:
    return float((np.abs(found - right) / np.spacing(np.abs(right))).max())


def test_exp_is_within_two_units_in_the_last_place(functions: Any) -> None:
    x = -np.concatenate((np.linspace(0.0, 3.0, 30_001), np.geomspace(1e-12, 707.9, 30_001)))
    assert ulps(values(functions.exp_of, x), np.exp(x)) <= 2.0
    edges = np.array([0.0, 1e-300, 5.0, np.inf, -708.5, -np.inf, NAN])
    right = [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, NAN]
    np.testing.assert_equal(values(functions.exp_of, edges), right)


def test_log_is_within_two_units_in_the_last_place(functions: Any) -> None:
    m = np.concatenate((np.linspace(0.5, 2.0, 30_000), np.geomspace(1e-300, 1e300, 30_001)))
    m = m[np.abs(m - 1.0) > 1e-12]
    none = np.zeros(len(m), dtype=np.int64)
    assert ulps(values(functions.log_of_power, m, none), np.log(m)) <= 2.0
    one, power = np.array([1.0, 3.0, 3.0]), np.array([0, 2000, -2000])
    np.testing.assert_allclose(
        values(functions.log_of_power, one, power),
        [0.0, np.log(3.0) + 2000 * np.log(2.0), np.log(3.0) - 2000 * np.log(2.0)],
        rtol=1e-15,
    )


def test_angles_are_those_of_arctan2(functions: Any) -> None:
    angle = np.concatenate((np.linspace(-np.pi, np.pi, 40_001), [1e-9, -1e-9, np.pi / 8]))
    for size in (1e-12, 1.0, 1e12):
        y, x = size * np.sin(angle), size * np.cos(angle)
        found = values(functions.angle_of, y, x)
        np.testing.assert_allclose(found, np.arctan2(y, x), rtol=1e-15, atol=1e-16)

    def of(places: Sequence[tuple[float, float]]) -> list[float]:
        y, x = np.array(places, dtype=np.float64).T.copy()
        return values(functions.angle_of, y, x).tolist()

    quarter = np.pi / 2
    assert of([(0, 0), (0, 1), (1, 0), (0, -1), (-1, 0)]) == [0, 0, quarter, np.pi, -quarter]
