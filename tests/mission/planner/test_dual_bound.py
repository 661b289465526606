"""The dual bound of one visiting order, against the primal program solved by cvxpy."""

from dataclasses import replace

import numpy as np
import pytest
from one_aircraft import round_problem
from search_parts import (
    away_from_way,
    barrier_at,
    conjugate,
    hopeless,
    limit_of_step,
    merged_run,
    newton_step,
    order_bound,
    queued,
)

from fl.radio.channel import CHANNEL_PRESETS, average_per
from mission.planner.certified import instance, relax


def answer(case):
    """The bound, the ends of every interval, and splines at, between and past their knots."""
    u = np.array(case["u"])
    m = len(u)
    problem = round_problem(
        u, np.array(case["delta"]), np.zeros(2), m, 1, case["length"],
        CHANNEL_PRESETS[case["preset"]],
    )  # fmt: skip
    devices, limits = instance(problem)
    limits = replace(limits, steps=max(m, 2))
    relaxation = relax(problem, devices)
    rows = np.array([relaxation.row[lo, hi] for lo, hi in case["intervals"]])
    bound = order_bound(
        devices, limits, relaxation, interval=rows, merged=np.array(case["merged"], dtype=np.int64),
        eps=case["eps"],
    )  # fmt: skip
    past = []
    for row in rows:
        last = relaxation.coefficients.shape[1] - 3
        knots = np.array([0.0, 0.4, 7.3, 30.0, last - 1e-9, last, last + 23.0])
        s = relaxation.spacing[row] * knots
        past.append((s, conjugate(relaxation, int(row), s)))
    ends = [[float(relaxation.radii_m[e]) for e in relaxation.ends[row]] for row in rows]
    lines = []  # of each device, slopes and offsets: what the splines make of the envelope
    for row in rows:
        s = np.append(relaxation.spacing[row] * np.arange(0.0, last, 0.2), 0.0)
        lines.append((-s, conjugate(relaxation, int(row), s)))
    return bound, ends, past, lines


def envelope(channel, lo, hi):
    """Lines whose least is the concave envelope on [0, hi] of f on [lo, hi]."""
    r = np.linspace(lo, hi, 1500)
    f = 1 - average_per(channel, r)
    hull = [int(f.argmax())]
    for i in range(hull[0] + 1, len(r)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (f[b] - f[a]) * (r[i] - r[a]) <= (f[i] - f[a]) * (r[b] - r[a]):
                hull.pop()
            else:
                break
        hull.append(i)
    slope = np.diff(f[hull]) / np.diff(r[hull])
    return np.r_[0.0, slope], np.r_[f.max(), f[hull][:-1] - slope * r[hull][:-1]]


def primal(case, ends, lines):
    """The most a path in this order can earn with every f replaced by the least of its lines."""
    import cvxpy as cp  # seconds, with scipy.stats: not of every process that collects

    u, delta = np.array(case["u"]), np.array(case["delta"])
    m = len(u)
    v, gain = cp.Variable((m, 2)), cp.Variable(m)
    leg = cp.vstack([v[:1], cp.diff(v, axis=0)]) if m > 1 else v
    constraints = [cp.sum(cp.norm(leg, axis=1)) <= case["length"]]
    for k, ((_, hi), (slope, offset)) in enumerate(zip(ends, lines, strict=True)):
        distance = cp.norm(v[k] - u[k])
        constraints.append(distance <= hi)
        away = cp.Variable(nonneg=True)
        constraints += [away >= distance, gain[k] <= slope * away + offset]
        if case["merged"][k]:
            constraints.append(leg[k] == 0)
    program = cp.Problem(cp.Maximize(delta @ gain), constraints)
    program.solve(solver=cp.CLARABEL)
    assert program.status == cp.OPTIMAL
    return program.value


def cases():
    rng = np.random.default_rng(11)
    for preset in ("suburban+10dB", "suburban", "suburban-log-variance", "high-rise"):
        for m in (1, 3, 6):
            # A walk with legs of about 200 m, a budget that forces it to cut corners.
            u = np.cumsum(rng.normal(scale=140.0, size=(m, 2)), axis=0)
            walk = np.hypot(*np.diff(np.vstack([[0, 0], u]), axis=0).T).sum()
            merged = [False] * m
            intervals = [[0, -1]] * m
            if m == 6:
                u[3] = u[2] + 8.0
                merged[3] = True
                intervals = [[0, -1], [2, -1], [0, 7], [0, -1], [3, -1], [0, -1]]
            yield {
                "preset": preset,
                "u": u.tolist(),
                "delta": rng.uniform(0.5, 1.5, m).tolist(),
                "length": 0.85 * walk,
                "intervals": intervals,
                "merged": merged,
                "eps": 1e-5,
            }


@pytest.fixture(scope="module")
def answers():
    return [(case, *answer(case)) for case in cases()]


def test_the_bound_is_the_optimum_of_the_primal_program(answers):
    for case, bound, ends, _, splines in answers:
        channel = CHANNEL_PRESETS[case["preset"]]
        best = primal(case, ends, [envelope(channel, lo, hi) for lo, hi in ends])
        assert bound >= best * (1 - 1e-6)  # -1 if the steps did not end well
        assert bound <= best * 1.01
        # Most of what is left is the splines': with them in place of f the two are nearly one.
        close = 2e-3 if any(case["merged"]) else 1e-4
        assert bound == pytest.approx(primal(case, ends, splines), rel=close)


def test_splines_stay_above_past_their_last_knot_too(answers):
    for case, _, all_ends, splines, _ in answers:
        channel = CHANNEL_PRESETS[case["preset"]]
        for (lo, hi), (slopes, values) in zip(all_ends, splines, strict=True):
            r = np.linspace(lo, hi, 4000)
            f = 1 - average_per(channel, r)
            for s, value in zip(slopes, values, strict=True):
                exact = (f + s * r).max()
                assert exact - 1e-12 <= value <= exact + 0.02 * f.max()


def test_steps_at_prices_come_away_from_the_boundary_of_the_cones() -> None:
    """A parent may have left its multipliers there: the bound is that of steps from the middle."""
    rng = np.random.default_rng(0)
    problem = round_problem(
        rng.uniform(0.0, 300.0, (9, 2)), rng.uniform(0.2, 1.0, 9), np.zeros(2), 9, 1, 400.0,
        CHANNEL_PRESETS["dense-urban"],
    )  # fmt: skip
    devices, limits = instance(problem)
    relaxation = relax(problem, devices)
    devices, none = replace(devices, price=np.zeros(9)), np.zeros(9, dtype=np.int64)
    rows = np.full(9, relaxation.row[0, 7])
    middle, edge = (
        order_bound(
            devices, limits, relaxation, interval=rows, merged=none, eps=1e-5, outwards=outwards
        )
        for outwards in (0.0, 1.0 - 1e-12)
    )
    assert edge == pytest.approx(middle, rel=2e-3)


def test_a_polyline_ends_at_its_last_point() -> None:
    """A leg of it is what is nearest, an end, or a corner; what lies behind it in memory never."""
    way = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 8.0], [50.0, 60.0], [70.0, 60.0]])
    assert away_from_way(3.0, -2.0, way, 3) == 2.0
    assert away_from_way(7.5, 4.0, way, 3) == 1.5
    assert away_from_way(9.0, -4.0, way, 3) == 5.0
    assert away_from_way(-3.0, 4.0, way, 3) == 5.0
    assert away_from_way(54.0, 72.0, way, 3) == 80.0  # 48 and 64
    assert away_from_way(54.0, 72.0, way, 1) == 90.0
    assert away_from_way(60.0, 61.0, way, 5) == 1.0


@pytest.mark.parametrize(
    ("cone", "y", "step", "mu", "mu_step", "limit"),
    [
        ([1.0], [(3.0, 0.0)], [(1.0, 0.0)], 5.0, 0.0, 1.0),  # the cone ends two steps away
        ([1.0], [(3.0, 0.0)], [(8.0, 0.0)], 5.0, 0.0, 0.8 * 0.25),
        ([1.0], [(0.0, -3.0)], [(0.0, -8.0)], 5.0, 0.0, 0.8 * 0.25),
        ([1.0], [(2.4, 1.8)], [(6.4, 4.8)], 5.0, 0.0, 0.8 * 0.25),
        ([1.0], [(3.0, 0.0)], [(0.0, 16.0)], 5.0, 0.0, 0.8 * 0.25),  # 3, 4, 5
        ([1.0], [(3.0, 0.0)], [(-32.0, 0.0)], 5.0, 0.0, 0.8 * 0.25),  # across
        ([4.0], [(6.0, 0.0)], [(16.0, 0.0)], 5.0, 0.0, 0.8 * 0.25),  # c is 2
        ([1.0], [(1.0, 0.0)], [(6.0, 0.0)], 5.0, -2.0, 0.8 * 0.5),  # 4 both
        ([1.0], [(0.0, 1.0)], [(0.0, 9.0)], 5.0, 1.0, 0.8 * 0.5),  # 5.5 both
        ([1.0], [(0.0, 0.0)], [(0.0, 0.0)], 5.0, -20.0, 0.8 * 0.25),  # mu stays above 0
        ([1.0, 1.0], [(0.0, 3.0), (3.0, 0.0)], [(0.0, 4.0), (8.0, 0.0)], 5.0, 0.0, 0.8 * 0.25),
        ([1.0, 1.0], [(3.0, 0.0), (0.0, 3.0)], [(8.0, 0.0), (0.0, 4.0)], 5.0, 0.0, 0.8 * 0.25),
    ],
)
def test_a_step_goes_four_fifths_of_the_way_to_the_nearest_cone(cone, y, step, mu, mu_step, limit):
    found = limit_of_step(np.array(cone), np.array(y), np.array(step), mu=mu, mu_step=mu_step)
    assert found == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize("stops", [1, 2, 3, 7])
def test_the_newton_step_solves_the_whole_system(stops):
    rng = np.random.default_rng(stops)
    gradient, cross = rng.normal(size=(2, stops, 2))
    block = rng.normal(size=(stops, 3)) * (0.5, 0.5, 0.5) + (6.0, 0.0, 6.0)
    device = rng.normal(size=(stops, 3)) * 0.5 + (1.0, 0.0, 1.0)
    slope, bend = 0.7, 9.0
    matrix = np.zeros((2 * stops + 1, 2 * stops + 1))
    for k in range(stops):
        at, (xx, xy, yy) = slice(2 * k, 2 * k + 2), block[k]
        matrix[at, at] = [[xx, xy], [xy, yy]]
        matrix[at, -1] = matrix[-1, at] = cross[k]
        if k + 1 < stops:
            after, (xx, xy, yy) = slice(2 * k + 2, 2 * k + 4), device[k]
            matrix[at, after] = matrix[after, at] = [[-xx, -xy], [-xy, -yy]]
    matrix[-1, -1] = bend
    right = -np.append(gradient.ravel(), slope)
    expected = np.linalg.solve(matrix, right)
    step, mu_step, decrement = newton_step(gradient, cross, block, device, slope=slope, bend=bend)
    np.testing.assert_allclose(np.append(step.ravel(), mu_step), expected, rtol=1e-9, atol=1e-12)
    assert decrement == pytest.approx(right @ expected, rel=1e-9)


def test_the_barrier_is_the_logarithms_and_their_derivatives():
    """Of mu length - eps sum log(c^2 mu^2 - |y|^2), by differences; infinite outside of a cone."""
    cone = np.array([1.0, 4.0, 2.25])
    y = np.array([[1.0, -2.0], [3.0, 2.0], [-0.5, 4.0]])
    mu, eps, length = 3.0, 0.2, 7.0

    def value(y, mu):
        return mu * length - eps * np.log(cone * mu**2 - (y**2).sum(axis=1)).sum()

    def slopes(y, mu, h=1e-4):
        moved = [np.zeros_like(y) for _ in range(y.size)]
        for i, one in enumerate(moved):
            one.flat[i] = h
        by_y = [(value(y + one, mu) - value(y - one, mu)) / (2 * h) for one in moved]
        return np.array([*by_y, (value(y, mu + h) - value(y, mu - h)) / (2 * h)])

    (bound, barrier, slope, bend), parts = barrier_at(cone, y, mu=mu, eps=eps, length=length)
    assert bound == mu * length
    assert bound + barrier == pytest.approx(value(y, mu), rel=1e-12)
    np.testing.assert_allclose([*parts[:, :2].ravel(), slope], slopes(y, mu), rtol=1e-6)
    h = 1e-3
    by_mu = (slopes(y, mu + h) - slopes(y, mu - h)) / (2 * h)
    np.testing.assert_allclose([*parts[:, 2:4].ravel(), bend], by_mu, rtol=1e-4)
    for k, (xx, xy, yy) in enumerate(parts[:, 4:]):
        for axis, row in enumerate(([xx, xy], [xy, yy])):
            aside = np.zeros_like(y)
            aside[k, axis] = h
            by_y = (slopes(y + aside, mu) - slopes(y - aside, mu)) / (2 * h)
            np.testing.assert_allclose(by_y[2 * k : 2 * k + 2], row, rtol=1e-4)
    (bound, *_), _ = barrier_at(
        cone, np.array([[1.0, -2.9], *y[1:]]), mu=mu, eps=eps, length=length
    )
    assert bound == np.inf


@pytest.mark.parametrize(
    ("nodes", "gap", "goal", "most_nodes", "ends"),
    [
        (99, 0.5, 0.0, 10, None),  # no time to look
        (101, 0.5, 0.0, 10, None),
        # From a gap of 0.5 at 50 nodes to 0.375 at 100. What is foretold may be half as far again.
        (100, 0.375, 0.375, 67, False),  # 100 nodes to 100.5
        (100, 0.375, 0.375, 66, True),
        (100, 0.375, 0.3125, 100, False),  # half of another doubling: 150
        (100, 0.375, 0.3125, 99, True),
        (100, 0.375, 0.25, 134, False),  # one: 200
        (100, 0.375, 0.25, 133, True),
        (100, 0.375, 0.0625, 400, False),  # two and a half: 600
        (100, 0.375, 0.0625, 399, True),
        (100, 0.5, 0.375, 10**9, True),  # nothing was gained
        (100, 0.625, 0.375, 10**9, True),
        (100, 0.499, 0.0, 10**6, True),  # 499 doublings
    ],
)
def test_a_search_ends_where_its_pace_foretells_too_many_nodes(nodes, gap, goal, most_nodes, ends):
    found, look, last = hopeless((100, 0.5), nodes, gap, goal=goal, most_nodes=most_nodes)
    assert found == bool(ends)
    assert (look, last) == ((100, 0.5) if ends is None else (200, gap))


def test_open_nodes_are_taken_by_their_bounds_as_far_as_there_is_room():
    rng = np.random.default_rng(4)
    for count in (1, 2, 3, 7, 20, 64):
        bounds = (rng.permutation(count) // 2).astype(np.float64)
        taken, closed = queued(bounds, 64)
        assert taken.tolist() == sorted(bounds.tolist(), reverse=True)
        assert closed == 0.0
    taken, closed = queued(np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6]), 4)
    assert taken.tolist() == [4.0, 3.0, 1.5, 1.0, -1.0, -1.0]
    assert closed == 9.0


@pytest.mark.parametrize(
    ("edges", "size", "edge", "devices"),
    [
        # 0 undecided, 1 merged, 2 barred: of the edge before each device.
        ([0, 1, 0, 1, 1, 2, 0], 7, 2, 5), ([0, 1, 0, 1, 1, 2, 0], 7, 5, 4),
        ([0, 1, 0, 1, 1, 2, 0], 7, 6, 2), ([0, 1, 0, 1, 1, 2, 0], 7, 0, 2),  # at the start itself
        ([1, 1, 0, 1], 4, 2, 4), ([0, 0, 0, 0], 4, 2, 2),
        ([0, 0, 0, 1], 3, 2, 2), ([1, 1, 0, 1], 3, 2, 3),  # what lies beyond is of another node
    ],
)  # fmt: skip
def test_a_merged_edge_joins_the_runs_about_it(edges, size, edge, devices):
    assert merged_run(edges, size, edge) == devices
