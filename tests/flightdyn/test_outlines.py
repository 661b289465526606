"""Outlines that cross themselves or enclose nothing, against a geometry library."""

import re

import numpy as np
import pytest
import shapely

from flightdyn.obstacles import flaw

SQUARE = np.array([[100.0, 100], [200, 100], [200, 200], [100, 200]])
ELL = np.array([[0.0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4]])


@pytest.mark.parametrize(
    ("ring", "words"),
    [
        (SQUARE, ""),
        (ELL, ""),
        (ELL[::-1], ""),
        (np.repeat(SQUARE, 2, axis=0), ""),  # each corner named twice
        (SQUARE[[0, 1, 2, 3, 0]], ""),  # closed by hand
        (SQUARE[[0, 2, 1, 3]], "crosses itself: its edges 0-1 and 2-3 meet"),
        (SQUARE[[0, 0, 2, 1, 3]], "crosses itself: its edges 0-2 and 3-4 meet"),
        # Through the corner at (2, 2) twice, and to its other side.
        (
            np.array([[0.0, 0], [2, 2], [4, 0], [4, 4], [2, 2], [0, 4]]),
            "crosses itself: its edges 0-1 and 3-4 meet",
        ),
        # Out to (9, 1) and back the same way.
        (
            np.array([[0.0, 0], [4, 0], [4, 1], [9, 1], [4, 1], [4, 4]]),
            "crosses itself: its edges 1-2 and 3-4 meet",
        ),
        (
            np.array([[0.0, 0], [4, 0], [9, 0], [4, 0], [4, 4]]),
            "crosses itself: its edges 0-1 and 2-3 meet",
        ),
        (
            np.array([[0.0, 0], [4, 0], [4, 4], [4, 2]]),
            "crosses itself: its edges 1-2 and 2-3 meet",
        ),
        (np.array([[0.0, 0], [1, 1], [2, 2]]), "has no area: its corners lie on one line"),
        (
            np.array([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]]),
            "has no area: its corners lie on one line",
        ),
        (SQUARE[[0, 1, 0, 1]], "has no area: its corners lie on one line"),
        (SQUARE[[1, 1, 1]], "has no area: its corners lie on one line"),
    ],
)
def test_what_is_wrong_with_an_outline(ring: np.ndarray, words: str) -> None:
    assert flaw(ring) == words


def test_corners_are_counted_from_where_a_list_has_them() -> None:
    assert flaw(SQUARE[[0, 2, 1, 3]], first=7) == "crosses itself: its edges 7-8 and 9-10 meet"
    # The last edge leads back to the first corner.
    last = flaw(SQUARE[[1, 3, 0, 2]][[3, 0, 1, 2]], first=7)
    assert last == "crosses itself: its edges 8-9 and 10-7 meet"


@pytest.mark.parametrize("whole", [True, False])
def test_flaws_are_found_where_a_geometry_library_finds_them(*, whole: bool) -> None:
    """Of corners on a coarse grid every kind of touching occurs; the edges named do meet."""
    rng, wrong = np.random.default_rng(4), 0
    for _ in range(4000):
        shape = int(rng.integers(3, 9)), 2
        ring = rng.integers(0, 6, shape).astype(float) if whole else rng.uniform(0, 9, shape)
        found = flaw(ring)
        area = shapely.Polygon(ring)
        assert (found == "") == (area.is_valid and area.area > 1e-9), ring.tolist()
        wrong += found != ""
        if pairs := re.findall(r"(\d+)-(\d+)", found):
            one, other = (shapely.LineString(ring[[int(a), int(b)]]) for a, b in pairs)
            assert one.intersects(other)
            if {*pairs[0]} & {*pairs[1]}:  # neighbours: more than their corner
                assert one.intersection(other).length > 0
    assert 1000 < wrong < 3800


def test_the_largest_outline_is_looked_at_without_a_table_of_all_pairs() -> None:
    turn = np.linspace(0.0, 2 * np.pi, 5000, endpoint=False)
    ring = np.rint(8e4 * np.column_stack((np.cos(turn), np.sin(turn))))
    assert flaw(ring) == ""
    ring[[4000, 4400]] = ring[[4400, 4000]]
    assert flaw(ring) == "crosses itself: its edges 3999-4000 and 4400-4401 meet"
    star = np.random.default_rng(1).uniform(0.0, 1.0, (5000, 2))  # nearly all edges cross
    assert flaw(star).startswith("crosses itself")
