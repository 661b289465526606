"""Which point of a path a flown sample belongs to, where the answer is known by construction."""

import itertools
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.analysis.alignment import align, leg_numbers, leg_of, matched
from mission.log.values import Track


def line(start, end, *, step=2.0):
    start, end = np.array(start, float), np.array(end, float)
    count = max(2, int(np.linalg.norm(end - start) / step) + 1)
    return np.linspace(start, end, count)


def test_a_parallel_track_has_its_offset_and_its_own_progress() -> None:
    track = line((0, 3), (400, 3), step=1.37)
    fit = align(track, np.array([[0.0, 0.0], [400.0, 0.0]]))
    np.testing.assert_allclose(fit.cross_m, 3.0, atol=1e-12)
    np.testing.assert_allclose(fit.along_m, track[:, 0], atol=1e-9)
    np.testing.assert_array_equal(fit.above_m, 0.0)
    assert fit.length_m == 400.0
    assert fit.corners_m.size == 0


def test_a_path_that_retraces_itself_is_matched_leg_by_leg() -> None:
    """Out on y = 0 with 1 m of error, back along the same line with 4 m: the nearest point of the
    whole path cannot tell the legs apart, progress can."""
    path = np.array([[0.0, 0.0], [200.0, 0.0], [0.0, 0.0]])
    track = np.vstack((line((0, 1), (200, 1)), line((200, -4), (0, -4))))
    fit = align(track, path)
    half = len(track) // 2
    np.testing.assert_allclose(fit.along_m[: half - 5], track[: half - 5, 0], atol=1e-9)
    np.testing.assert_allclose(fit.along_m[half + 5 :], 400 - track[half + 5 :, 0], atol=1e-9)
    np.testing.assert_allclose(fit.corners_m, [200.0])


def test_a_path_that_crosses_itself_keeps_to_its_legs() -> None:
    path = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0], [50.0, 50.0], [50.0, -50.0]])
    track = np.vstack([line(a, b, step=1.0)[:-1] for a, b in itertools.pairwise(path)]) + np.array(
        [0.0, 0.25]
    )
    fit = align(track, path)
    flown = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))))
    assert np.abs(fit.along_m - flown).max() < 1.0
    assert fit.cross_m.max() <= 0.25 + 1e-9


def test_corners_ignore_coincident_and_collinear_waypoints() -> None:
    path = np.array([[0, 0], [0, 0], [50, 0], [50, 0], [100, 0], [100, 0.0], [100, 100]], float)
    fit = align(line((0, 0), (100, 0)), path)
    np.testing.assert_allclose(fit.corners_m, [100.0])
    np.testing.assert_allclose(fit.corner_points_m, [[100.0, 0.0]])
    assert fit.length_m == 200.0


def test_a_corner_is_a_turn_from_the_leg_before() -> None:
    path = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0], [100.0, 90.0], [60.0, 90.0]])
    fit = align(line((0, 0), (100, 0)), path)
    np.testing.assert_allclose(fit.corners_m, [100.0, 190.0])
    np.testing.assert_allclose(fit.corner_points_m, [[100.0, 0.0], [100.0, 90.0]])


@pytest.mark.parametrize(("turn_deg", "corner"), [(4.9, False), (5.1, True), (6.0, True)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_corner_turns_by_more_than_five_degrees(turn_deg: float, corner: bool, side) -> None:
    turn = np.radians(turn_deg)
    path = np.array([[0.0, 0.0], [50.0, 0.0], [50 + 50 * np.cos(turn), side * 50 * np.sin(turn)]])
    assert align(path, path).corners_m.tolist() == [50.0] * corner


def test_climbs_turn_nowhere_and_what_is_above_is_above() -> None:
    path = np.array(
        [[0, 0, 0], [0, 0, 10], [100, 0, 10], [100, 0, 40], [100, 50, 40], [60, 50, 40.0]]
    )
    track = np.array([[0.0, 3.0, 4.0], [31.3, -2.0, 8.5], [101.0, 20.7, 43.0], [70.2, 50.0, 39.0]])
    fit = align(track, path)
    np.testing.assert_allclose(fit.along_m, [4.0, 41.3, 160.7, 219.8], atol=1e-9)
    np.testing.assert_allclose(fit.cross_m, [3.0, 2.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(fit.above_m, [0.0, -1.5, 3.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(fit.waypoints_at_m, [0.0, 10.0, 110.0, 140.0, 190.0, 230.0])
    np.testing.assert_allclose(fit.corners_m, [190.0])
    np.testing.assert_allclose(fit.corner_points_m, [[100.0, 50.0]])
    assert fit.length_m == 230.0
    assert leg_of(fit).tolist() == [0, 1, 3, 4]


def test_progress_is_between_bounds_that_are_known() -> None:
    """Samples that stand at the middle of a hairpin's first leg, and what is known of them."""
    path = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 6.0], [0.0, 6.0]])
    track = np.tile([50.2, 1.0], (4, 1))
    low_m, high_m = np.array([0.0, 20.0, 60.2, 110.0]), np.array([30.2, 80.0, 90.0, 206.0])
    fit = align(track, path, between=(low_m, high_m))
    # The last one is on the way back; pieces are half a metre long.
    np.testing.assert_allclose(fit.along_m, [30.2, 50.2, 60.2, 155.8], atol=0.5)
    np.testing.assert_allclose(fit.cross_m, [20.0, 1.0, 10.0, 5.0], atol=0.55)
    np.testing.assert_allclose(fit.along_m[[1, 3]], [50.2, 155.8], atol=1e-9)


def test_the_sum_of_squares_is_the_least_that_is_possible() -> None:
    """Against all ways to give five samples nondecreasing pieces of a path of six."""
    rng = np.random.default_rng(7)
    for _ in range(8):
        path = np.cumsum(rng.uniform(-0.28, 0.28, (7, 2)), axis=0)
        track = path[np.sort(rng.integers(0, 7, 5))] + rng.normal(0.0, 0.3, (5, 2))
        begin, way = path[:-1], np.diff(path, axis=0)
        share = ((track[:, None] - begin) * way).sum(axis=2) / (way**2).sum(axis=1)
        foot = begin + np.clip(share, 0.0, 1.0)[..., None] * way
        away2 = ((track[:, None] - foot) ** 2).sum(axis=2)
        least = min(
            sum(away2[row, piece] for row, piece in enumerate(pieces))
            for pieces in itertools.combinations_with_replacement(range(6), 5)
        )
        assert (align(track, path).cross_m ** 2).sum() == pytest.approx(least, abs=1e-6)


def test_a_hover_is_one_point() -> None:
    fit = align(np.array([[3.0, 4.0], [0.0, 1.0]]), np.zeros((5, 2)))
    np.testing.assert_allclose(fit.cross_m, [5.0, 1.0])
    np.testing.assert_allclose(fit.along_m, 0.0)
    assert fit.length_m == 0.0


points = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


@settings(max_examples=50, deadline=None)
@given(
    path=st.lists(points, min_size=2, max_size=6), track=st.lists(points, min_size=1, max_size=30)
)
def test_never_nearer_than_the_nearest_point_of_the_path(path, track) -> None:
    waypoints, flown = np.array(path), np.array(track)
    fit = align(flown, waypoints)
    legs = list(itertools.pairwise(waypoints))
    dense = np.vstack([np.linspace(a, b, 4001) for a, b in legs])  # at most 0.21 m apart
    nearest = np.linalg.norm(flown[:, None] - dense, axis=-1).min(axis=1)
    assert np.all(fit.cross_m >= nearest - 0.11)
    assert np.all(np.diff(fit.along_m) >= 0)
    assert fit.length_m == pytest.approx(sum(np.linalg.norm(b - a) for a, b in legs), abs=1e-3)
    first = align(flown[:1], waypoints)  # a single sample is free to take the nearest
    assert first.cross_m[0] <= nearest[0] + 0.26


def test_a_long_flight_needs_little_memory() -> None:
    corner_m = 2000.0 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    track = np.column_stack([np.interp(np.linspace(0, 2, 1000), range(3), x) for x in corner_m.T])
    tracemalloc.start()
    try:
        aligned = align(track, corner_m)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert aligned.cross_m.max() < 1e-6
    assert most < 2000 * len(track)


def test_items_at_one_place_share_a_leg_and_no_number_is_left_out() -> None:
    at_m = np.array([0.0, 10.0, 10.0, 20.0, 25.0, 30.0])
    ends = np.array([True, True, True, False, True])  # the last leg has a corner
    assert leg_numbers(at_m, ends).tolist() == [1, 2, 2, 3, 3]
    # Half a metre is a leg of its own, less is none.
    for long_m, second in ((0.4375, 1), (0.5, 2), (0.5625, 2)):
        at_m = 3.0 + np.array([0.0, long_m, 10.0])
        assert leg_numbers(at_m, np.array([True, True])).tolist() == [1, second]


@pytest.mark.parametrize("step_s", [0.07, 0.1, 0.37])
def test_where_a_corner_is_cut_counts_also_between_samples(step_s: float) -> None:
    """Across 10 m before and after it, farthest off in the middle, at 14.75 s."""
    at_s = np.arange(0.0, 30.0, step_s)
    known = ((0.0, 13.0, 16.5, 30.0), ((0, 90, 100, 100), (0, 0, 10, 100)))
    flown = np.column_stack([np.interp(at_s, known[0], axis) for axis in known[1]])
    path = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0]])
    track, fit = matched(Track(np.round(at_s * 1e9).astype(np.int64), flown), path)
    entered = int(leg_of(fit).argmax())
    assert track.t_ns[entered] == pytest.approx(14.75e9, abs=2e6)
    assert fit.cross_m.max() == fit.cross_m[entered] == pytest.approx(5.0, abs=0.01)
    assert fit.along_m[entered] == 100.0
    assert np.all(np.diff(track.t_ns) > 0)


def test_samples_at_corners_only_lie_on_the_path_also_where_rounding_leaves_them_short() -> None:
    """As of a plan that nobody flies: straight from point to point, so nowhere off the path."""
    path = np.array(
        [[0.0, 0.0], [100.0, 0.0], [100.0, 80.0], [100.0, 80.0], [30.0, 80.0], [60.0, 80.0]]
    )
    short = np.array(
        [[0.0, 0.0], [-1e-3, 0.0], [0.0, 1e-3], [0.0, -1e-3], [-1e-3, 0.0], [0.0, 0.0]]
    )
    track, fit = matched(Track(np.arange(6) * 10**9, path + short), path)
    assert fit.cross_m.max() < 2e-3
    assert set(leg_of(fit)) == {0, 1, 3, 4}
    assert np.all(np.diff(track.t_ns) > 0)


def test_a_leg_that_no_sample_is_close_to_is_flown_between_two_of_them() -> None:
    """Straight across from leg to leg of a hairpin, 6 m before its end, half way 3 m from both; and
    a rectangle's far side, of which the flight cuts off a half: 15 m from it in the middle."""
    hairpin = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 6.0], [0.0, 6.0]])
    flown = np.array([[0.0, 0.0], [94.0, 0.0], [94.0, 6.0], [0.0, 6.0]])
    _, fit = matched(Track(np.arange(4) * 10**9, flown), hairpin)
    assert fit.cross_m.max() == pytest.approx(3.0, abs=0.2)
    wide = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]])
    flown = np.array([[0.0, 0.0], [85.0, 0.0], [85.0, 60.0], [0.0, 60.0]])
    low_m, high_m = np.array([0.0, 50.0, 100.0, 200.0]), np.array([50.0, 100.0, 200.0, 260.0])
    for between in (None, (low_m, high_m)):
        track, fit = matched(Track(np.arange(4) * 10**9, flown), wide, between=between)
        middle = int(np.abs(track.pos_m[:, 1] - 30.0).argmin())
        assert fit.cross_m[middle] == pytest.approx(15.0, abs=0.01)
        assert fit.cross_m.max() == pytest.approx(15.0, abs=0.01)
        assert set(leg_of(fit)) == {0, 1, 2}


@pytest.mark.parametrize(("long_m", "more"), [(0.5, 1), (0.5625, 31)])
def test_samples_are_added_at_a_change_of_leg_and_where_one_lies_between(long_m, more) -> None:
    """Of more than half a metre: 32 pieces to the next sample, of which two are beside it."""
    path = np.array([[0.0, 0.0], [100.0, 0.0], [100.0 + long_m, 0.0], [200.0, 0.0]])
    flown = np.array([[0.0, 0.0], [50.0, 0.0], [150.0, 0.0], [200.0, 0.0]])
    track, fit = matched(Track(np.arange(4) * 10**9, flown), path)
    added = sorted({*track.t_ns.tolist()} - {0, 10**9, 2 * 10**9, 3 * 10**9})
    assert len(added) == more or (more > 1 and more <= len(added) <= more + 2)
    assert len(fit.along_m) == len(fit.above_m) == len(track.t_ns)
