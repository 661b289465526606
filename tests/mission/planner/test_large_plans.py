"""The bound of a hundred devices and more, against HiGHS and paths that share nothing with it."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, csr_matrix, eye, hstack, kron, vstack
from test_certificate import random_problem
from test_places import best_assignment, rewards
from test_potentials import shrunk

from mission.planner.certified import CertifiedPlanner
from mission.planner.check import check_plan

HEARD = 0.02  # of the best reward: less is left out


def places_of(problem, waypoints, *, apart_m, most):
    """Stops of a plan and devices that lie apart from each other, the start first."""
    places = [problem.start_m]
    for place in (*waypoints, *problem.devices_m[np.argsort(-problem.importance)]):
        if min(np.linalg.norm(place - other) for other in places) > apart_m:
            places.append(place)
    return np.array(places[:most])


def flown_in_parts(problem, places, *, neighbours):
    """What paths along legs between places earn at most, if a path may divide, by HiGHS.

    The primal of what the potentials bound, on a few places: a path, in parts, leaves the start;
    what is served somewhere comes from the start with no more than the path has on each leg, and by
    parts of stops, of which one is at the start. Every plan on the places is one way of doing so.
    """
    away = np.linalg.norm(places[:, None] - places, axis=-1)
    near = np.argsort(away, axis=1)[:, 1 : neighbours + 1]
    legs = {(i, j) for i, row in enumerate(near) for j in row}
    legs |= {(j, i) for i, j in legs} | {(i, i + 1) for i in range(len(places) - 1)}
    tail, head = np.array(sorted(leg for leg in legs if leg[1] != 0)).T
    worth = rewards(problem, places).T
    worth = worth[worth.max(axis=1) > HEARD * problem.importance]
    device, place = np.nonzero(worth > HEARD * worth.max(axis=1, keepdims=True))
    n_legs, n_served, devices, inner = len(tail), len(place), len(worth), len(places) - 1
    # Columns: the path on each leg, what is on its way to each device on each leg, who is served,
    # stops at each place.
    ways = n_legs + devices * n_legs
    into = coo_matrix(
        (np.repeat([1.0, -1.0], n_legs), (np.r_[head, tail], np.tile(np.arange(n_legs), 2)))
    ).tocsr()
    moved = np.flatnonzero(place > 0)
    arrives = coo_matrix(
        (np.ones(len(moved)), (device[moved] * inner + place[moved] - 1, moved)),
        shape=(devices * inner, n_served),
    )
    each = coo_matrix((np.ones(n_served), (device, np.arange(n_served))))
    at_place = coo_matrix((np.ones(n_served), (place, np.arange(n_served))))
    stop_of = coo_matrix((np.ones(n_served), (np.arange(n_served), place)))
    rest = devices * n_legs + n_served + len(places)
    no_way = csr_matrix((1, rest))
    no_leg = csr_matrix((1, ways + n_served))
    limits = [
        (hstack([kron(np.ones((devices, 1)), -eye(n_legs)), eye(devices * n_legs),
                 csr_matrix((devices * n_legs, n_served + len(places)))]),
         np.zeros(devices * n_legs)),
        (hstack([csr_matrix((devices, ways)), each, csr_matrix((devices, len(places)))]),
         np.ones(devices)),
        (csr_matrix(np.r_[away[tail, head], np.zeros(rest)]), [problem.path_budget_m]),
        (hstack([csr_matrix((len(places), ways)), at_place, -problem.per_step * eye(len(places))]),
         np.zeros(len(places))),
        (hstack([csr_matrix((n_served, ways)), eye(n_served), -stop_of]), np.zeros(n_served)),
        (hstack([no_leg, csr_matrix(np.ones((1, len(places))))]), [problem.steps]),
        (hstack([-into[1:], kron(np.ones((inner, 1)), no_way)]), np.zeros(inner)),
        (hstack([-into[0], no_way]), [1.0]),
    ]  # fmt: skip
    at_least = np.zeros(ways + n_served + len(places))
    at_least[ways + n_served] = 1.0
    found = linprog(
        np.r_[np.zeros(ways), -worth[device, place], np.zeros(len(places))],
        A_ub=vstack([row for row, _ in limits]),
        b_ub=np.concatenate([most for _, most in limits]),
        A_eq=hstack([
            csr_matrix((devices * inner, n_legs)), kron(eye(devices), into[1:]), -arrives,
            csr_matrix((devices * inner, len(places))),
        ]),
        b_eq=np.zeros(devices * inner),
        bounds=np.c_[at_least, np.full(len(at_least), np.inf)],
        method="highs-ipm",
    )  # fmt: skip
    assert found.status == 0
    return -found.fun


@pytest.mark.slow
@pytest.mark.parametrize(("devices", "steps"), [(100, 50), (30, 8)])
def test_no_path_in_parts_lies_above_the_bound(devices, steps):
    problem = random_problem(1, devices=devices, steps=steps, preset="suburban+10dB")
    plan = CertifiedPlanner().plan(problem)
    check_plan(problem, plan)
    places = places_of(problem, plan.waypoints_m, apart_m=50.0, most=22)
    found = flown_in_parts(problem, places, neighbours=4)
    assert 0.85 * plan.value <= found <= plan.upper_bound


def exchanged(problem, *, turns, seed):
    """The best value of paths over devices, changed at random: one put in, out or elsewhere."""
    rng = np.random.default_rng(seed)
    count = len(problem.devices_m)
    order: list[int] = []
    best = 0.0
    for _ in range(turns):
        trial = list(order)
        if trial and rng.random() < 0.4:
            trial.pop(rng.integers(len(trial)))
        if len(trial) + 1 < problem.steps:
            new = int(rng.integers(count))
            if new not in trial:
                stops = np.vstack([problem.start_m, problem.devices_m[[*trial]]])
                legs = np.linalg.norm(stops - problem.devices_m[new], axis=1)
                detour = legs + np.append(legs[1:], 0.0)
                detour[:-1] -= np.linalg.norm(np.diff(stops, axis=0), axis=1)
                trial.insert(int(detour.argmin()), new)
        way = shrunk(problem, np.vstack([problem.start_m, problem.devices_m[trial]]))
        value = best_assignment(problem, way)
        if value >= best:
            best, order = value, trial
    return best


@pytest.mark.slow
@pytest.mark.parametrize(
    ("devices", "channel", "turns"),
    [(100, "suburban+10dB", 150), (100, "suburban+30dB", 150), (1000, "suburban", 10)],
)
def test_paths_changed_at_random_lie_below_the_bound(devices, channel, turns):
    problem = random_problem(devices, devices=devices, steps=50, preset=channel)
    plan = CertifiedPlanner().plan(problem)
    found = exchanged(problem, turns=turns, seed=1)
    assert 0.1 * plan.value <= found <= plan.upper_bound
