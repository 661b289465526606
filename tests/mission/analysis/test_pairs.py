"""How near two tracks come, of instants that are given, against a close look at what is between."""

import math

import numpy as np
import pytest

from mission.analysis.together import Apart, Pair

AXES = [(0, 1, 2), (0, 1), (2,)]
NONE = np.zeros((0, 2))


def between(apart: Apart, count: int = 4001) -> tuple[np.ndarray, np.ndarray]:
    """Times and distances by axis wherever it is known, close to each other."""
    parts = [
        np.linspace(
            np.append(apart.t_s[n], apart.away_m[n]),
            np.append(apart.t_s[n + 1], apart.away_m[n + 1]), count,
        )
        for n in np.flatnonzero(apart.known)
    ]  # fmt: skip
    every = np.vstack(parts)
    return every[:, 0], every[:, 1:]


@pytest.mark.parametrize("seed", range(12))
def test_the_least_distance_is_that_of_a_close_look(seed: int) -> None:
    """Of all axes and some; and while the others are below a bound, where that ever holds."""
    rng = np.random.default_rng(seed)
    t_s = 10.0 + np.cumsum(rng.uniform(0.1, 2.0, 7))
    away_m = rng.normal(0.0, 5.0, (7, 3))
    away_m[3] = away_m[2]  # it stands
    known = np.append(True, rng.random(5) < 0.7)
    apart = Apart(t_s, away_m, known)
    fine_s, fine_m = between(apart)
    for axes in AXES:
        size_m = np.linalg.norm(fine_m[:, axes], axis=1)
        near = apart.near(axes)
        assert near.away_m == pytest.approx(size_m.min(), abs=0.01)
        at_m = [np.interp(near.t_s, t_s, axis) for axis in away_m.T]
        assert np.linalg.norm(np.array(at_m)[list(axes)]) == pytest.approx(near.away_m, abs=1e-9)
    for axes, beside in (((0, 1), (2,)), ((2,), (0, 1))):
        for below_m in (0.5, 2.0, 6.0):
            here = np.linalg.norm(fine_m[:, beside], axis=1) < below_m
            if not here.any():
                continue
            near = apart.near(axes, beside, below_m)
            least = np.linalg.norm(fine_m[here][:, axes], axis=1).min()
            assert near.away_m == pytest.approx(least, abs=0.02)
            at_m = [np.interp(near.t_s, t_s, axis) for axis in away_m.T]
            assert np.linalg.norm(np.array(at_m)[list(beside)]) <= below_m + 1e-9
    assert fine_s.min() >= t_s[0]


def pair(t_s: list[float], away_m: object, known: list[bool], lost_s: object = NONE) -> Pair:
    nothing = Apart(np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool))
    flown = Apart(np.array(t_s), np.array(away_m, dtype=float), np.array(known, dtype=bool))
    return Pair(0, 1, "a and b", flown, nothing, np.array(lost_s, dtype=float).reshape(-1, 2))


def test_what_never_counts_is_infinitely_far_and_what_stands_beside_counts() -> None:
    still = [(4.0, 0.0, 2.0), (4.0, 0.0, 2.0)]
    of = pair([1.0, 3.0], still, [True]).flown
    assert math.isinf(of.near((0, 1), (2,), 2.0).away_m)  # it is not below
    assert math.isnan(of.near((0, 1), (2,), 2.0).t_s)
    assert of.near((0, 1), (2,), 2.01).away_m == 4.0
    assert of.near((0, 1), (2,), 2.01).t_s == 1.0
    assert math.isinf(pair([1.0, 3.0], still, [False]).flown.near((0, 1, 2)).away_m)
    assert math.isinf(pair([], np.zeros((0, 3)), []).flown.near((0,)).away_m)
    # It passes through the bound's height at the very end of what is known.
    falls = pair([0.0, 1.0, 2.0], [(9, 0, 4), (5, 0, 2), (0, 0, 0)], [True, False]).flown
    assert math.isinf(falls.near((0, 1), (2,), 2.0).away_m)
    assert falls.near((0, 1), (2,), 3.0).away_m == pytest.approx(5.0)
    assert falls.near((0, 1), (2,), 3.0).t_s == 1.0


def test_limits_of_both_axes_count_while_the_other_is_below_its_own() -> None:
    """It sinks from 8 m above to 8 m below in 16 s, while it comes from 16 m to 0 m."""
    of = pair([0.0, 16.0], [(16.0, 0.0, 8.0), (0.0, 0.0, -8.0)], [True])
    level, up = "separation_horizontal_min_m", "separation_vertical_min_m"
    assert of.nearest("separation_min_m", {}).away_m == pytest.approx(128**0.5 / 2)
    assert of.nearest(level, {level: 9.0}).away_m == 0.0
    both = {level: 6.0, up: 3.0}
    assert of.nearest(level, both).away_m == pytest.approx(5.0)  # until it is 3 m below
    assert of.nearest(level, both).t_s == pytest.approx(11.0)
    assert of.nearest(up, both).away_m == pytest.approx(2.0)  # from 6 m beside on
    assert of.nearest(up, both).t_s == pytest.approx(10.0)


def test_how_long_it_is_known_and_the_longest_time_that_is_not() -> None:
    away_m = [(0.0, 0.0, 5.0), (0.0, 0.0, 2.0), (0.0, 6.0, 0.0), (1.0, 2.0, 2.0)]
    of = pair([0.0, 1.5, 4.0, 5.0], away_m, [True, False, True], [(1, 3.5), (9, 12.0), (20, 21)])
    assert of.known_s == 2.5
    assert of.lost() == of.lost(2.9) == "no positions of one of them at 9.0-12.0 s"
    assert of.lost(3.0) == pair([0.0, 1.0], away_m[:2], [True]).lost() == ""
    near = of.flown.near((0, 1, 2))
    assert (near.t_s, near.away_m) == (1.5, 2.0)
    t_s, distances_m = of.over_time(near)
    assert t_s.tolist() == [0.0, 1.5, 1.5, 4.0, 5.0]
    np.testing.assert_array_equal(distances_m, [5.0, 2.0, math.nan, 6.0, 3.0])
