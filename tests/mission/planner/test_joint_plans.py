"""Joint plans of several aircraft: legal, never above their bound, and no worse than others."""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from fl.radio.channel import CHANNEL_PRESETS, average_per
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.planner.certified import CertifiedPlanner, case_of
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import finish
from mission.planner.factory import make_planner
from mission.planner.fleet.joint import first_plans, plan_jointly
from mission.planner.fleet.packing import Column, Market, packed
from mission.planner.fleet.parts import improved_in_turn, masked
from mission.planner.fleet.prices import (
    column_along,
    columns_of,
    priced,
    search_prices,
    searched_alone,
)
from mission.planner.fleet.team import partitions, team_of
from mission.planner.fleet.within import shared_out
from mission.planner.limits import RoundLimits
from mission.planner.native.crews import alike, search_orders
from mission.planner.native.library import Goal, assign
from mission.planner.performance import Performance
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem, Start

pytestmark = pytest.mark.usefixtures("hasty")

FLYING = Performance(20.0, 5.0, LimitsConfig())
OWN = ((150.0, 150.0), (650.0, 650.0), (650.0, 150.0))
SHARED = ((400.0, 400.0),) * 3


def drawn(seed: int = 1, *, aircraft: int = 2, devices: int = 9, **more: Any) -> RoundProblem:
    rng = np.random.default_rng(seed)
    places, metres = more.pop("places", OWN), more.pop("metres", 500.0)
    usual = {
        "devices_m": rng.uniform(0, 800, (devices, 2)),
        "importance": rng.uniform(0.2, 1.0, devices),
        "starts": tuple(Start(np.array(place), metres) for place in places[:aircraft]),
        "steps": 6, "per_step": 2, "channel": CHANNEL_PRESETS["suburban+10dB"],
    }  # fmt: skip
    return RoundProblem(**{**usual, **more})


def alone(problem: RoundProblem) -> list[RoundProblem]:
    return [problem.alone(a) for a in range(len(problem.starts))]


def plan(problem: RoundProblem, **options: Any) -> RoundPlan:
    made = make_planner(PlannerConfig(**options)).plan(problem)
    check_plan(problem, made)
    return made


def value_along(problem: RoundProblem, ways: list[np.ndarray]) -> float:
    """The best schedule over the waypoints of all aircraft, by the packet error rate itself."""
    places = np.vstack(ways)
    far = np.hypot(*np.moveaxis(places[:, None] - problem.devices_m[None], -1, 0))
    success = 1.0 - average_per(problem.channel, far)
    schedule = assign(success, problem.importance, problem.per_step)
    return float((schedule * success * problem.importance).sum())


def random_ways(problem: RoundProblem, rng: np.random.Generator) -> list[np.ndarray]:
    """Paths over devices at random, as long as their budgets."""
    ways = []
    for start in problem.starts:
        goals = problem.devices_m[rng.permutation(len(problem.devices_m))[: problem.steps - 1]]
        goals = goals + rng.normal(0.0, 30.0, goals.shape)
        way = np.vstack([start.start_m, goals])
        length = np.hypot(*np.diff(way, axis=0).T).sum()
        ways.append(start.start_m + (way - start.start_m) * min(1.0, start.path_budget_m / length))
    return ways


@pytest.mark.parametrize(("seed", "places"), [(1, OWN), (2, SHARED), (3, OWN), (4, SHARED)])
def test_no_random_plan_is_above_the_bounds(seed: int, places: Any) -> None:
    problem = drawn(seed, aircraft=2 + seed % 2, places=places)
    team, rng = team_of(alone(problem)), np.random.default_rng(seed)
    begun = first_plans(team)[-1]
    orders = search_orders(team.joint, plan=begun, goal=Goal(0.001, 2000, max_open=2000))
    columns = columns_of(team, begun)
    by_prices, _ = search_prices(team, begun, columns, Goal(0.002, 100_000))
    assert by_prices.bound <= begun.bound
    low = min(orders.bound, by_prices.bound)
    best = max(orders.value, by_prices.value)
    assert best <= low * (1.0 + 1e-4)
    assert low <= best * 1.02  # each is of use
    for _ in range(300):
        ways = random_ways(problem, rng)
        assert value_along(problem, ways) <= low * (1.0 + 1e-6)
        local = np.stack([w - s.start_m for w, s in zip(ways, problem.starts, strict=True)])
        assert team.plan_along(local).value <= low * (1.0 + 1e-4)


def test_a_path_brings_what_each_of_its_places_does() -> None:
    """Its start serves, too; per place two, and a device once."""
    devices_m = np.array([OWN[0], (150.0, 180.0), (150.0, 190.0), (250.0, 150.0)])
    problem = drawn(devices_m=devices_m, importance=np.array([1.0, 0.9, 0.8, 0.7]), steps=2)
    way = np.array([(0.0, 0.0), (100.0, 0.0)])
    found = column_along(team_of(alone(problem)), 0, way)
    away = np.array([0.0, 30.0, math.hypot(100.0, 40.0), 0.0])  # from the place that serves each
    worth = problem.importance * (1.0 - average_per(problem.channel, away))
    np.testing.assert_allclose(found.brought, worth, rtol=1e-3)


def test_devices_are_shared_out_to_all_by_paths_and_by_clusters() -> None:
    """Two at each start; the drawn paths lead from each to one of them and one of the others'."""
    near, far = np.array(OWN[0]), np.array(OWN[1])
    beside = np.array([30.0, 0.0])
    devices_m = np.array([near + beside, near - beside, far + beside, far - beside])
    problem = drawn(devices_m=devices_m, importance=np.ones(4), steps=3, metres=5000.0)
    first, second = alone(problem)
    parts = [
        finish(first, np.array([near, devices_m[0], devices_m[2]])),
        finish(second, np.array([far, devices_m[3], devices_m[1]])),
    ]
    asked: list[tuple[int, ...]] = []

    class Asked:
        def plan(self, given: RoundProblem) -> RoundPlan:
            asked.append(tuple(np.flatnonzero(given.importance).tolist()))
            return CertifiedPlanner(max_nodes=1).plan(given)

    found = list(shared_out([first, second], [parts], Asked()))
    assert set(asked[::2]) == {(0, 1, 2, 3), (0, 2), (0, 1)}
    assert len(found) == 3
    for (one, other), of_one in zip(found, asked[::2], strict=True):
        assert set(np.flatnonzero(one.schedule.any(axis=(0, 1)))) >= set(of_one)
        assert not (one.schedule.any(axis=(0, 1)) & other.schedule.any(axis=(0, 1))).any()


@pytest.mark.parametrize("places", [OWN, SHARED])
def test_no_split_of_few_devices_is_better(places: Any) -> None:
    """All ways to share the devices out, each share planned for one aircraft almost exactly."""
    problem = drawn(7, devices=4, places=places, steps=3, per_step=1, metres=350.0)
    made = plan(problem, gap=0.003)
    single = CertifiedPlanner(gap=0.001)
    shares: dict[tuple[int, bytes], RoundPlan] = {}

    def of_share(a: int, mine: np.ndarray) -> RoundPlan:
        key = (a if places is OWN else 0, mine.tobytes())
        if key not in shares:
            shares[key] = single.plan(masked(problem.alone(a), mine))
        return shares[key]

    best = 0.0
    for split in itertools.product((0, 1), repeat=4):
        parts = [of_share(a, np.array(split) == a) for a in (0, 1)]
        best = max(best, sum(part.value for part in parts))
        # What one split is worth at most says nothing of the others.
    assert best <= made.upper_bound * (1.0 + 1e-6)
    assert made.value >= best * (1.0 - 0.003 - 1e-6)


def test_a_planted_best_plan_is_found() -> None:
    """Each aircraft has a row of devices that it just reaches: no plan earns more than all."""
    row = np.column_stack([np.arange(1, 6) * 60.0, np.zeros(5)])
    places = np.array([[0.0, 0.0], [0.0, 900.0], [900.0, 450.0]])
    heads = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0]])
    devices = np.vstack([place + row * head for place, head in zip(places, heads, strict=True)])
    problem = drawn(
        devices_m=devices, importance=np.ones(15), steps=6, per_step=1,
        starts=tuple(Start(place, 300.0) for place in places),
        channel=CHANNEL_PRESETS["suburban+10dB"],
    )  # fmt: skip
    best = 15.0 * (1.0 - problem.channel.per(0.0))
    made = plan(problem)
    assert made.value >= best * 0.99
    assert made.upper_bound >= best * (1.0 - 1e-6)


def test_the_bound_of_one_chain_is_that_of_the_search_for_one() -> None:
    problem = drawn(3, aircraft=1)
    team, case = team_of([problem]), case_of(problem)
    begun = team.plan_along(np.zeros((1, 6, 2)))
    joint = search_orders(team.joint, plan=begun, goal=Goal(0.001, 20_000, max_open=20_000))
    single = CertifiedPlanner(gap=0.001).plan(problem)
    assert joint.gap <= 0.001 * (1.0 + 1e-9)
    assert case.limits.length == problem.path_budget_m
    assert joint.value <= single.upper_bound
    assert single.value <= joint.bound * (1.0 + 1e-9)


def test_equal_aircraft_are_searched_once_and_as_well() -> None:
    """Budgets that differ by a millionth of a metre are not equal, and mean the same plans."""
    equal = drawn(5, aircraft=3, places=SHARED)
    starts = tuple(
        dataclasses.replace(start, path_budget_m=start.path_budget_m + 1e-6 * a)
        for a, start in enumerate(equal.starts)
    )
    unequal = dataclasses.replace(equal, starts=starts)
    found = []
    for problem, same in ((equal, [0, 0, 0]), (unequal, [0, 1, 2])):
        team = team_of(alone(problem))
        assert alike(team.cases).tolist() == same
        begun = first_plans(team)[0]
        found.append(
            search_orders(team.joint, plan=begun, goal=Goal(0.002, 60_000, max_open=10_000))
        )
    assert found[0].gap <= 0.0021
    assert found[1].gap <= 0.0021
    assert found[0].bound >= found[1].value * (1.0 - 1e-6)
    assert found[1].bound >= found[0].value * (1.0 - 1e-6)
    assert found[0].nodes < found[1].nodes


@pytest.mark.parametrize("steps", [3, 6])
def test_a_price_is_paid_by_whoever_is_served(steps: int) -> None:
    """By search of places (3 steps) and of orders: no path less its prices is above the bound."""
    problem = drawn(11, aircraft=1, steps=steps, devices=7)
    case, rng = case_of(problem), np.random.default_rng(0)
    delta = case.devices.delta
    for share in (0.0, 0.3, 0.8):
        prices = np.ascontiguousarray(share * rng.uniform(0.0, 1.0, 7) * delta)
        one = priced(case, prices)
        begun = one.polished(np.zeros((steps, 2)))
        scale = float(delta.sum()) / 3.0
        found = searched_alone(one, begun, Goal(0.0, 5000, 0.01 * scale, scale))
        assert found.value <= found.bound <= found.value + 0.0101 * scale
        most = 0.0
        for _ in range(400):
            way = random_ways(problem, rng)[0]
            far = np.hypot(*np.moveaxis(way[:, None] - problem.devices_m[None], -1, 0))
            gain = np.maximum(0.0, (1.0 - average_per(problem.channel, far)) * delta - prices)
            schedule = assign(gain, np.ones(7), problem.per_step)
            most = max(most, float((gain * schedule).sum()))
        assert most <= found.bound * (1.0 + 1e-6)
        served = np.flatnonzero(found.assigned >= 0)
        brought = case.devices.brought(served, found.way[found.assigned[served]])
        assert found.value == pytest.approx(float((brought - prices[served]).sum()))
        assert (brought > prices[served]).all()  # a plan leaves out who is not worth it


@pytest.mark.parametrize("channel", ["dense-urban", "suburban+10dB"])
def test_no_order_of_visits_is_above_the_bound_at_prices(channel: str) -> None:
    """Whoever is heard from afar only is not worth its price: that leaves out no good path."""
    nodes = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        problem = drawn(
            seed, aircraft=1, devices_m=rng.uniform(0, 450, (6, 2)), per_step=1 + seed % 2,
            importance=rng.uniform(0.2, 1.0, 6), metres=350.0, channel=CHANNEL_PRESETS[channel],
        )  # fmt: skip
        case = case_of(problem)
        total = float(case.devices.delta.sum())
        one = priced(case, np.ascontiguousarray(rng.uniform(0.2, 0.8, 6) * case.devices.delta))
        begun = one.polished(np.zeros((6, 2)))
        found = searched_alone(one, begun, Goal(0.0, 20_000, 1e-4 * total, total / 3.0))
        best, nodes = found.value, nodes + found.nodes
        for order in itertools.chain(*(itertools.permutations(range(6), n) for n in range(1, 5))):
            way = np.vstack([np.zeros(2), case.devices.u[list(order)]])
            way *= min(1.0, 350.0 / np.hypot(*np.diff(way, axis=0).T).sum())
            best = max(best, one.polished(way[np.minimum(np.arange(6), len(order))]).value)
        assert best <= found.bound + 1e-6 * total
        assert found.bound <= best + 0.01 * total
    assert nodes > 50  # it was no easy matter


@pytest.mark.parametrize("counts", [(1, 1), (3,)])
def test_prices_of_the_paths_found_are_those_of_their_linear_programme(counts: Any) -> None:
    """Some of a path's devices may be left out: sum_k s_ck is what path c leaves after prices."""
    rng, devices, paths = np.random.default_rng(len(counts)), 12, 20
    delta = rng.uniform(0.2, 1.0, devices)
    brought = delta * rng.uniform(0.5, 1.0, (paths, devices)) * (rng.random((paths, devices)) < 0.4)
    brought[:, 3] = 0.0  # nobody brings it
    rows = np.arange(paths) % len(counts)
    market = Market(np.array(counts), delta)
    for row, one in zip(rows.tolist(), brought, strict=True):
        market.add(row, one)

    def worth(prices: np.ndarray) -> float:
        assert (prices >= 0.0).all()
        assert (prices <= delta).all()
        left = np.maximum(0.0, brought - prices).sum(axis=1)
        most = [left[rows == row].max() for row in range(len(counts))]
        assert market.most_after(prices) == pytest.approx(most)
        return float(prices.sum() + np.dot(counts, most))

    # min sum prices + sum counts most, most_row >= sum_k s_ck, s_ck >= brought_ck - prices_k
    each, size = np.eye(devices), devices + len(counts)
    over = np.zeros((paths * (devices + 1), size + paths * devices))
    for c in range(paths):
        mine = slice(size + c * devices, size + (c + 1) * devices)
        over[c, devices + rows[c]], over[c, mine] = -1.0, 1.0
        lines = slice(paths + c * devices, paths + (c + 1) * devices)
        over[lines, :devices], over[lines, mine] = -each, -each
    costs = np.concatenate((np.ones(devices), counts, np.zeros(paths * devices)))
    least = linprog(costs, over, np.concatenate((np.zeros(paths), -brought.ravel()))).fun
    assert market.prices(0.1)[3] < 1e-6
    market.prices(0.01)
    assert worth(market.prices(1e-3)) == pytest.approx(least, rel=2e-3)


def test_prices_of_a_dual_are_weak_without_the_price_on_serving() -> None:
    """Prices of nothing bound each aircraft by itself: with them, each device counts once."""
    problem = drawn(2, aircraft=2, places=SHARED, metres=800.0)
    joint = plan_jointly(alone(problem), Goal(0.01, 20_000), prices_wanted=True)
    assert joint.prices is not None
    apart = CertifiedPlanner().plan(problem.alone(0))
    assert joint.found.bound < 0.9 * 2.0 * apart.value
    assert (joint.prices <= joint.team.delta + 1e-12).all()
    assert joint.prices.max() > 0.0


def test_packing_takes_the_paths_that_bring_most_together() -> None:
    brought = [[3.0, 2.0, 0, 0], [0, 2.5, 2.0, 0], [3.0, 0, 2.0, 0], [0, 0, 0, 1.0]]
    columns = [Column(0, np.zeros((2, 2)), np.array(row)) for row in brought]
    for count in (1, 2, 3):
        best = max(
            itertools.combinations(range(4), count),
            key=lambda some: np.max([brought[i] for i in some], axis=0).sum(),
        )
        worth = np.max([brought[i] for i in best], axis=0).sum()
        chosen = packed(columns, [0] * 4, np.array([count]))
        assert len(chosen) <= count
        assert np.max([brought[i] for i in chosen], axis=0).sum() == pytest.approx(worth)


def test_partitions_are_of_all_devices_and_go_to_near_aircraft() -> None:
    rng = np.random.default_rng(0)
    devices, worth = rng.uniform(0, 800, (20, 2)), rng.uniform(0.2, 1.0, 20)
    starts = np.array([[100.0, 400.0], [700.0, 400.0]])
    for part in partitions(devices, worth, starts):
        assert set(part) <= {0, 1}
        centres = [devices[part == a].mean(axis=0) for a in (0, 1) if (part == a).any()]
        if len(centres) == 2:
            straight = sum(math.dist(c, s) for c, s in zip(centres, starts, strict=True))
            crossed = sum(math.dist(c, s) for c, s in zip(centres, starts[::-1], strict=True))
            assert straight <= crossed + 1e-9


def test_clusters_of_worthless_devices_have_a_centre() -> None:
    devices = np.array([[0.0, 0.0], [10.0, 0.0], [700.0, 700.0], [710.0, 700.0]])
    starts = np.array([[0.0, 0.0], [700.0, 700.0]])
    with np.errstate(all="raise"):
        parts = list(partitions(devices, np.array([1.0, 1.0, 0.0, 0.0]), starts))
    assert parts[-1].tolist() == [0, 0, 1, 1]


def test_changes_in_turn_only_improve_and_serve_nobody_twice() -> None:
    problem = drawn(4, aircraft=3, devices=12)
    each = alone(problem)
    nobody = np.zeros(12, dtype=np.bool_)
    parts = [CertifiedPlanner(max_nodes=0).plan(masked(one, nobody)) for one in each]
    made = improved_in_turn(each, parts, 3000)
    together = RoundPlan.together(made)
    check_plan(problem, together)
    assert together.value > 0.5 * plan(problem).value


KINDS: dict[str, dict[str, Any]] = {
    "areas": {"airspace": Airspace((np.array([[300.0, 250], [420, 250], [420, 400]]),))},
    "deadline": {"duration_s": 25.0},
    "energy": {"energy_j": 7000.0},
    "altitudes": {"altitudes_m": (40.0, 120.0)},
    "uploads": {"duration_s": 30.0, "upload_s": True},
    "ready": {"duration_s": 30.0, "ready_in_s": True},
    "all": {
        "duration_s": 30.0, "energy_j": 8000.0, "altitudes_m": (40.0, 120.0), "upload_s": True,
        "ready_in_s": True,
    },
}  # fmt: skip


def of_kind(kind: str, *, devices: int = 7, seed: int = 6) -> RoundProblem:
    given, rng = dict(KINDS[kind]), np.random.default_rng(seed)
    ends = given.pop("duration_s", math.inf), given.pop("energy_j", math.inf)
    own = {"altitudes_m": given.pop("altitudes_m", None)}
    own["limits"] = None if ends == (math.inf, math.inf) else RoundLimits(FLYING, *ends)
    if given.get("upload_s"):
        given["upload_s"] = rng.uniform(0.5, 3.0, devices)
    if given.get("ready_in_s"):
        given["ready_in_s"] = np.where(rng.random(devices) < 0.5, rng.uniform(0, 15, devices), 0.0)
    problem = drawn(seed, devices=devices, **given)
    starts = tuple(dataclasses.replace(start, **own) for start in problem.starts)
    return dataclasses.replace(problem, starts=starts)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_plans_are_legal_whatever_a_round_has(kind: str) -> None:
    """Legal, at or under the bound, and no worse than one aircraft after the other."""
    problem = of_kind(kind, devices=5)
    made = plan(problem)
    planner, left, total = make_planner(PlannerConfig()), np.ones(5, dtype=np.bool_), 0.0
    for one in alone(problem):
        part = planner.plan(masked(one, left))
        left, total = left & ~part.schedule.any(axis=(0, 1)), total + part.value
    assert made.value >= total * (1.0 - 1e-9)
    assert total <= made.upper_bound * (1.0 + 1e-6)
    assert made.gap <= 0.01 or made.ended


@pytest.mark.parametrize(
    "more",
    [
        {"importance": np.zeros(9)},
        {"metres": 0.0},
        {"steps": 1},
        {"steps": 2, "per_step": 1},
        {"devices": 1, "aircraft": 3},
        {"devices_m": np.tile([[300.0, 300.0]], (9, 1)), "per_step": 1},
        {"devices_m": np.full((9, 2), 50_000.0)},
        {"importance": np.linspace(1e-9, 1e-8, 9)},
    ],
    ids=["worthless", "still", "one step", "scarce", "one device", "one place", "far", "small"],
)
def test_what_is_odd_is_planned(more: dict[str, Any]) -> None:
    made = plan(drawn(**more))
    assert made.upper_bound >= made.value
    if "importance" in more and not more["importance"].any():
        assert made.value == made.upper_bound == 0.0


def test_an_aircraft_that_may_not_move_serves_from_its_start() -> None:
    problem = drawn(1)
    starts = (problem.starts[0], Start(problem.devices_m[0], 0.0))
    made = plan(dataclasses.replace(problem, starts=starts))
    assert np.ptp(made.paths[1].waypoints_m, axis=0).max() < 1e-9
    assert made.schedule[1, :, 0].sum() == 1


def test_planners_without_a_proof_share_the_devices_out() -> None:
    made = plan(drawn(1, devices=6, steps=4), kind="sqp")
    assert np.isnan(made.upper_bound)
    assert made.schedule.any(axis=(1, 2)).all()


def test_the_same_problem_gives_the_same_plan() -> None:
    problem = drawn(9, devices=14, steps=8, places=SHARED)
    first, second = plan(problem, max_nodes=2000), plan(problem, max_nodes=2000)
    assert first.upper_bound == second.upper_bound
    assert first.nodes == second.nodes
    for one, other in zip(first.paths, second.paths, strict=True):
        assert one.waypoints_m.tobytes() == other.waypoints_m.tobytes()
