"""Ways around areas: shortest, at the margin, within the fence."""

import math
from collections import Counter
from contextlib import suppress
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flightdyn.obstacles import flaw
from mission.base import polyline
from mission.base.airspace import OPEN, Airspace, circle, within
from mission.base.errors import InputError

SQUARE = np.array([[100.0, 100], [200, 100], [200, 200], [100, 200]])
ELL = np.array([[300.0, 300], [500, 300], [500, 380], [380, 380], [380, 500], [300, 500]])
FENCE = np.array([[0.0, 0], [600, 0], [600, 600], [250, 600], [250, 260], [0, 260]])


def at(x: float, y: float) -> np.ndarray:
    return np.array([float(x), float(y)])


def test_a_way_that_nothing_blocks_is_straight() -> None:
    for space in (OPEN, Airspace((SQUARE,), None, 10.0)):
        np.testing.assert_array_equal(space.way(at(0, 0), at(300, 50)), [[0, 0], [300, 50]])


def test_the_way_around_a_square_is_a_taut_string() -> None:
    """Around two corners: tangents and arcs of the margin, in closed form; their points lie a
    little outside of the arcs."""
    margin = 10.0
    way = Airspace((SQUARE,), None, margin).way(at(0, 150), at(300, 150))
    leg = math.hypot(100, 50)  # from an end to a corner
    tangent = math.sqrt(leg**2 - margin**2)
    turn = math.atan2(50, 100) + math.asin(margin / leg)
    exact = 2 * tangent + 2 * margin * turn + 100
    assert exact <= polyline.length(way) <= exact + 0.02 * margin * 4
    assert polyline.length(way[[0, -1]]) == 300


def test_the_shorter_side_is_taken() -> None:
    space = Airspace((SQUARE,), None, 10.0)
    assert space.way(at(0, 120), at(300, 120))[1, 1] < 100
    assert space.way(at(0, 180), at(300, 180))[1, 1] > 200


@pytest.mark.parametrize("turned", [SQUARE, SQUARE[::-1]])
def test_either_direction_of_an_outline_is_the_same_area(turned: np.ndarray) -> None:
    space = Airspace((turned,), None, 10.0)
    assert space.free(np.array([at(95, 150), at(150, 150), at(50, 50)])).tolist() == [0, 0, 1]


@pytest.mark.slow
@settings(max_examples=60)
@given(st.lists(st.floats(-50, 650), min_size=4, max_size=4))
def test_every_way_keeps_the_margin_and_no_corner_of_it_can_be_left_out(place) -> None:
    space = Airspace((SQUARE, ELL), FENCE, 12.0)
    a, b = space.moved(np.array(place).reshape(2, 2))
    way = space.way(a, b)
    dense = np.vstack([np.linspace(p, q, 200) for p, q in pairwise(way)])
    assert space.free(dense).all()
    for ring in (SQUARE, ELL):
        assert _distance(dense, ring) >= 12.0 - 1e-5
    np.testing.assert_array_equal(way[[0, -1]], [a, b])
    for skipped in range(1, len(way) - 1):
        assert not space.clear(way[[skipped - 1]], way[[skipped + 1]])[0]
    assert polyline.length(space.way(b, a)) == pytest.approx(polyline.length(way))


def _distance(points: np.ndarray, ring: np.ndarray) -> float:
    """Of the nearest of many points on the outline: another way than the product's."""
    closed = np.vstack((ring, ring[:1]))
    edge = np.vstack([np.linspace(p, q, 400) for p, q in pairwise(closed)])
    return float(min(np.hypot(*(edge - point).T).min() for point in points)) + 0.0


def _far_from_edges(a: np.ndarray, b: np.ndarray, rings: list[np.ndarray]) -> float:
    """The least distance of a leg from any edge: 0 where they cross, else at one of four ends."""

    def from_leg(p: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
        square = float((d - c) @ (d - c))
        share = 0.0 if square == 0.0 else min(1.0, max(0.0, float((p - c) @ (d - c)) / square))
        return float(np.hypot(*(c + share * (d - c) - p)))

    def cross(u: np.ndarray, v: np.ndarray) -> float:
        return float(u[0] * v[1] - u[1] * v[0])

    least = math.inf
    for ring in rings:
        for c, d in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            turn = cross(b - a, d - c)
            if turn != 0.0:
                along, across = cross(c - a, d - c) / turn, cross(c - a, b - a) / turn
                if 0.0 <= along <= 1.0 and 0.0 <= across <= 1.0:
                    return 0.0
            ends = (from_leg(a, c, d), from_leg(b, c, d), from_leg(c, a, b), from_leg(d, a, b))
            least = min(least, *ends)
    return least


@pytest.mark.slow
@settings(max_examples=300)
@example(start=[12.0, 12.0], step=[0.0, -40.0])  # at the margin
@given(
    st.lists(st.floats(-50, 650), min_size=2, max_size=2),
    st.lists(st.sampled_from([0.0, 1e-9, 1e-3, 3.0, -40.0, 300.0]), min_size=2, max_size=2),
)
def test_legs_and_points_keep_the_margin_as_worked_out_edge_by_edge(start, step) -> None:
    rings, space = [SQUARE, ELL, FENCE], Airspace((SQUARE, ELL), FENCE, 12.0)
    a, b = np.array(start), np.array(start) + step
    far = _far_from_edges(a, b, rings)
    # Nearer than this to the margin, rounding decides.
    if abs(far - 12.0 + 1e-6) > 1e-8:
        assert bool(space.clear(a[None], b[None])[0]) == (far > 12.0 - 1e-6)
    if abs(far - 1e-6) > 1e-8:
        assert bool(space.crosses(a[None], b[None])[0]) == (far < 1e-6)
    far = _far_from_edges(a, a, rings)
    inside = [_winding(ring, a) != 0 for ring in rings]
    allowed = inside == [False, False, True]
    if abs(far - 12.0 + 1e-6) > 1e-8:
        assert bool(space.free(a[None])[0]) == (allowed and far > 12.0 - 1e-6)
    if far > 1e-6:
        assert bool(space.allows(a[None])[0]) == allowed
        assert space.away(a[None])[0] == pytest.approx(0.0 if allowed else far)


def _winding(ring: np.ndarray, point: np.ndarray) -> int:
    """How often an outline goes around a point, by the angles under which its edges are seen."""
    seen = ring - point
    angles = np.arctan2(seen[:, 1], seen[:, 0])
    turns = (np.roll(angles, -1) - angles + np.pi) % (2 * np.pi) - np.pi
    return round(float(turns.sum()) / (2 * np.pi))


def test_on_an_outline_nobody_is_allowed() -> None:
    space = Airspace((SQUARE,), FENCE, 0.0)
    assert not space.allows(np.vstack((SQUARE, FENCE, at(150, 100), at(600, 300)))).any()


def test_no_legs_and_no_points_are_answered() -> None:
    none = np.empty((0, 2))
    for space in (OPEN, Airspace((SQUARE,), FENCE, 12.0)):
        for asked in (space.free, space.allows, space.outside, space.away, space.moved):
            assert len(asked(none)) == 0
        assert len(space.clear(none, none)) == 0


def test_ways_are_as_short_as_on_a_fine_grid() -> None:
    """Dijkstra's algorithm over a grid of 4 m, whose ways are up to 8 % longer, never shorter."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    space = Airspace((SQUARE, ELL), FENCE, 12.0)
    x, y = np.meshgrid(np.arange(2.0, 600, 4.0), np.arange(2.0, 600, 4.0), indexing="ij")
    grid = np.column_stack((x.ravel(), y.ravel()))
    free, side = space.free(grid), len(x)
    rows, columns, lengths = [], [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2)):
        i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
        inside = (i + dx < side) & (j + dy >= 0) & (j + dy < side)
        one = (i * side + j)[inside]
        other = ((i + dx) * side + j + dy)[inside]
        open_ = free[one] & free[other]
        rows += one[open_].tolist()
        columns += other[open_].tolist()
        lengths += [4.0 * math.hypot(dx, dy)] * int(open_.sum())
    graph = coo_array((lengths, (rows, columns)), shape=(side**2, side**2))
    ends = [int(np.hypot(*(grid - p).T).argmin()) for p in (at(30, 230), at(540, 540))]
    on_grid = dijkstra(graph.tocsr(), directed=False, indices=ends[0])[ends[1]]
    ours = polyline.length(space.way(grid[ends[0]], grid[ends[1]]))
    assert ours <= on_grid <= 1.08 * ours


def test_what_is_not_free_is_moved_to_the_nearest_place_that_is() -> None:
    space = Airspace((SQUARE,), None, 10.0)
    moved = space.moved(np.array([at(150, 110), at(95, 95), at(0, 0)]))
    np.testing.assert_allclose(moved[0], [150, 90], atol=1e-4)
    np.testing.assert_allclose(moved[1], 100 - 10 / math.sqrt(2), atol=1e-4)
    np.testing.assert_array_equal(moved[2], [0, 0])
    assert space.free(moved).all()
    fenced = Airspace((), FENCE, 10.0)
    np.testing.assert_allclose(fenced.moved(at(-50, -50)[None]), [[10, 10]], atol=1e-4)


def test_a_start_that_is_not_free_gets_out_first() -> None:
    way = Airspace((SQUARE,), None, 10.0).way(at(150, 195), at(150, 0))
    np.testing.assert_allclose(way[1], [150, 210], atol=1e-4)


def test_where_no_way_leads_is_said() -> None:
    wall = np.array([[200.0, -10], [220, -10], [220, 610], [200, 610]])
    space = Airspace((wall,), np.array([[0.0, 0], [600, 0], [600, 600], [0, 600]]), 10.0)
    with pytest.raises(ValueError, match="no way"):
        space.way(at(100, 300), at(400, 300))
    with pytest.raises(ValueError, match="nowhere is free"):
        Airspace((), np.array([[0.0, 0], [5, 0], [5, 5]]), 10.0).moved(at(1, 1)[None])


def test_how_far_away_anybody_must_stay() -> None:
    space = Airspace((SQUARE,), None, 10.0)
    far = space.away(np.array([at(150, 130), at(0, 0)]))
    np.testing.assert_allclose(far, [30, 0])


@pytest.mark.parametrize(
    ("keep_out", "keep_in", "words"),
    [
        ((SQUARE, SQUARE[[0, 2, 1, 3]]), None, "outline 1 crosses itself: its edges 0-1 and 2-3"),
        ((SQUARE,), SQUARE[:2], "outline 1 has no area: its corners lie on one line"),
        ((), SQUARE * [1.0, math.nan], "outline 0 has no area"),
    ],
)
def test_outlines_that_enclose_nothing_are_refused(
    keep_out: tuple[np.ndarray, ...], keep_in: np.ndarray | None, words: str
) -> None:
    with pytest.raises(InputError, match=f"^airspace: {words}"):
        Airspace(keep_out, keep_in)


def test_joined_areas_enclose_something_however_they_touch() -> None:
    """Of corners on coarse grids, where edges lie on each other and meet in corners."""
    rng, joined = np.random.default_rng(6), 0
    for _ in range(600):
        drawn = [10.1 * rng.integers(0, 8, (4, 2)).astype(np.float64) for _ in range(4)]
        areas = [(int(rng.integers(3)), ring) for ring in drawn if not flaw(ring)]
        with suppress(ValueError):
            for ring in within(areas, (40.0, 40.0)):
                assert flaw(ring) == ""
                joined += 1
    assert joined > 400


Shape = np.ndarray | tuple[float, float, float]  # corners, or a circle: x, y, radius


def fence_shapes(rng: np.random.Generator) -> list[tuple[int, Shape]]:
    """One to five areas in up to three groups."""
    shapes: list[tuple[int, Shape]] = []
    while len(shapes) < rng.integers(1, 6):
        (x, y), group = rng.uniform(20, 80, 2), int(rng.integers(0, 3))
        turn = np.sort(rng.uniform(0, 2 * math.pi, 7))
        rays = rng.uniform(5, 60, 7)[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
        if rng.random() < 0.3:
            shapes.append((group, (x, y, rng.uniform(10, 50))))
        elif shapely.Polygon(rays).is_valid:
            shapes.append((group, np.array([x, y]) + rays))
    return shapes


def is_inside(shape: Shape, points: np.ndarray) -> np.ndarray:
    """(P,) whether points lie in one area."""
    if isinstance(shape, tuple):
        return np.hypot(*(points - shape[:2]).T) <= shape[2]
    return shapely.contains_xy(shapely.Polygon(shape), points)


def is_edge(shape: Shape, points: np.ndarray) -> np.ndarray:
    """(P,) whether points lie on an outline, or between a circle's and its corners'."""
    if isinstance(shape, tuple):
        return np.abs(np.hypot(*(points - shape[:2]).T) - shape[2]) < 0.002 * shape[2]
    return shapely.distance(shapely.points(points), shapely.LinearRing(shape)) < 2e-3


@pytest.mark.slow
def test_a_fence_is_all_areas_of_a_group_whichever() -> None:
    """Against each area alone, on a grid of metres; parts apart from the start's are none of it."""
    cells = np.stack(np.meshgrid(*[np.arange(-40.5, 141, 3)] * 2), axis=-1)
    start, seen = np.array([50.0, 50.0]), Counter[str]()
    points = np.vstack((start, cells.reshape(-1, 2)))
    for seed in range(300):
        shapes = fence_shapes(np.random.default_rng(seed))
        groups = {group for group, _ in shapes}
        expected = np.any(
            [
                np.all([is_inside(shape, points) for g, shape in shapes if g == group], axis=0)
                for group in groups
            ],
            axis=0,
        )
        sure = ~np.any([is_edge(shape, points) for _, shape in shapes], axis=0)
        drawn = [
            (group, circle(np.array(shape[:2]), shape[2]) if isinstance(shape, tuple) else shape)
            for group, shape in shapes
        ]
        try:
            outline, *holes = within(drawn, start)
        except ValueError:
            assert not (expected & sure).any(), seed
            seen["nowhere"] += 1
            continue
        allowed = Airspace(tuple(holes), outline).allows(points)
        assert not (allowed & ~expected & sure).any(), seed
        assert allowed[0] == expected[0] or not sure[0], seed
        left = (expected & ~allowed & sure)[1:].reshape(cells.shape[:2])
        whole = (allowed & sure)[1:].reshape(cells.shape[:2])
        for axis in (0, 1):  # nothing of what is left out is beside what is not
            for step in (-1, 1):
                assert not (np.roll(left, step, axis=axis) & whole).any(), seed
        seen["several groups"] += len(groups) > 1
        seen["holes"] += bool(holes)
        seen["parts"] += bool(left.any())
    assert min(seen[kind] for kind in ("nowhere", "several groups", "holes", "parts")) > 3, seen


@pytest.mark.filterwarnings("error")
def test_a_corner_that_is_named_twice_is_one() -> None:
    twice = np.vstack((SQUARE[:2], SQUARE[1:], SQUARE[:1]))
    one, other = (Airspace((ring,), None, 10.0) for ring in (SQUARE, twice))
    places = np.array([[110.0, 150.0], [200.0, 100.0], [205.0, 150.0]])
    np.testing.assert_array_equal(one.moved(places), other.moved(places))
    np.testing.assert_array_equal(
        one.way(at(0, 140), at(300, 140)), other.way(at(0, 140), at(300, 140))
    )
