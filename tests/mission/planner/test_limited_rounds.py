"""Plans within limits of time and energy: they fit, and their bound stays true."""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from again import again
from drawn_problems import drawn_problem, plan
from one_aircraft import changed

from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.base.errors import InfeasiblePlanError
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import plan_along, success
from mission.planner.factory import make_planner
from mission.planner.fleet.planner import FleetPlanner
from mission.planner.flyable import foresee_round
from mission.planner.improving import fitted, standing, varied
from mission.planner.limited import LimitedPlanner
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem

pytestmark = pytest.mark.usefixtures("hasty")

FLYING = Performance(20.0, 5.0, LimitsConfig())
WALL = np.array([[300.0, 100], [360, 100], [360, 700], [300, 700]])


def limits(duration_s: float = math.inf, energy_j: float = math.inf) -> RoundLimits:
    return RoundLimits(FLYING, duration_s, energy_j)


def problem(seed: int = 1, *, given: RoundLimits | None, **more):
    return drawn_problem(seed, limits=given, **{"path_budget_m": 1200.0, **more})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "given"),
    [
        ("certified", limits(30.0)),
        ("certified", limits(40.0, 9000.0)),
        ("sqp", limits(energy_j=7000.0)),
        ("paper", limits(45.0)),
    ],
)
def test_every_planner_keeps_to_limits(kind: str, given: RoundLimits) -> None:
    made = plan(problem(given=given), kind)
    assert made.foreseen is not None
    assert made.foreseen.duration_s <= given.duration_s * (1.0 + 1e-6)
    assert made.foreseen.energy_j <= given.energy_j * (1.0 + 1e-6)
    assert given.share(made.foreseen) > 0.97, "what is allowed is made use of"
    assert math.isnan(made.upper_bound) == (kind != "certified")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_nothing_that_fits_exceeds_the_bound(seed: int) -> None:
    given = limits(30.0) if seed % 2 else limits(energy_j=8000.0)
    here = problem(seed, given=given)
    made = plan(here)
    assert made.value <= made.upper_bound
    rng, tried = np.random.default_rng(seed), 0
    for turn in range(200):
        # Of other plans' shape and of none; smaller and smaller, so that some fit.
        path = rng.uniform(0, 800, (6, 2)) if turn % 2 else made.waypoints_m.copy()
        path[1:] += rng.normal(0, 60, (5, 2))
        path = here.start_m + (path - here.start_m) * (1.0 - turn / 250)
        path[0] = here.start_m
        other = plan_along(here, path)
        if given.fits(foresee_round(here, other)):
            tried += 1
            assert other.value <= made.upper_bound * (1.0 + 1e-9)
            assert other.path_m <= given.longest_m(here.legs) + 1e-6
    assert tried > 10


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["certified", "sqp"])
@pytest.mark.parametrize("duration_s", [9.0, 40.0])
def test_hovers_for_uploads_count_and_fewer_are_served(kind: str, duration_s: float) -> None:
    upload_s = np.array([0.5, 6.0, 3.0, 1.0, 4.0, 2.0, 5.0, 2.5])
    made = plan(problem(given=limits(duration_s), upload_s=upload_s), kind)
    assert made.foreseen is not None
    assert made.foreseen.duration_s <= duration_s * (1.0 + 1e-6)
    assert made.value > 0.0
    served = made.schedule.any(axis=(0, 1))
    assert upload_s[served].sum() <= duration_s
    assert served.any()
    assert not made.value > made.upper_bound  # NaN: nothing is proven


def test_who_sends_longest_for_least_is_left_out() -> None:
    # Both stand below the start, and only one of them can send.
    given = problem(
        given=limits(10.0), devices=2, devices_m=np.full((2, 2), 400.0),
        importance=np.array([1.0, 0.9]), upload_s=np.array([9.0, 2.0]),
    )  # fmt: skip
    assert plan(given).schedule.any(axis=(0, 1)).tolist() == [False, True]


def test_metres_that_take_no_time_are_refused() -> None:
    """Waypoints that are flown as one: the bound counts their metres."""
    here = problem(given=limits(3.0), steps=4, path_budget_m=1200.0)
    longest_m = limits(3.0).longest_m()
    zigzag = here.start_m + np.array([[0, 0], [longest_m, 0], [longest_m + 0.4, 0], [longest_m, 0]])
    made = plan_along(here, zigzag)
    with pytest.raises(InfeasiblePlanError, match="longer than its limits allow"):
        check_plan(here, made)


def test_metres_that_pay_for_less_are_the_limit() -> None:
    short = problem(given=limits(300.0, 1e6), path_budget_m=400.0)
    free = changed(short, limits=None)
    limited, metres = plan(short), plan(free)
    assert limited.value >= metres.value
    assert limited.upper_bound == pytest.approx(metres.upper_bound)


@pytest.mark.slow
def test_more_time_is_worth_no_less_in_the_bound() -> None:
    bounds = [plan(problem(given=limits(seconds))).upper_bound for seconds in (20, 30, 40, 60)]
    # Each is proven to a gap of 1 % only.
    assert all(b > 0.99 * a for a, b in itertools.pairwise(bounds))


def test_without_limits_the_planner_itself_answers() -> None:
    free = problem(given=None)
    made = plan(free)
    assert made.foreseen is None
    outermost = make_planner(PlannerConfig())
    inner = outermost.inner.plan(free)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(made.waypoints_m, inner.waypoints_m)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [(0, None), (1, None), (1, (40.0, 120.0)), *again([(0, (40.0, 120.0))])]
)
def test_around_areas_nothing_that_fits_exceeds_the_bound(case: tuple[int, Any]) -> None:
    """Nor is much better than the plan, of paths like it and of ones at random."""
    seed, altitudes_m = case
    given = limits(35.0) if seed % 2 else limits(energy_j=9000.0)
    space = Airspace((WALL, WALL + np.array([250.0, -80.0])), None, 15.0)
    here = problem(
        seed, given=given, airspace=space, start_m=np.array([200.0, 400.0]), altitudes_m=altitudes_m
    )
    made = plan(here)
    rng, tried = np.random.default_rng(seed), 0
    for turn in range(200):
        path = rng.uniform(0, 800, (6, 2)) if turn % 2 else made.waypoints_m.copy()
        path[1:] += rng.normal(0, 40, (5, 2))
        path[0] = here.start_m
        other = fitted(here, path)
        if other is not None:
            tried += 1
            check_plan(here, other)
            assert other.value <= made.upper_bound * (1.0 + 1e-9)
            assert other.value <= made.value * 1.02
    assert tried > 100


@pytest.mark.slow
def test_an_altitude_to_choose_is_worth_no_less_than_one_of_them() -> None:
    given = limits(35.0)
    free = plan(problem(given=given, altitudes_m=(40.0, 120.0)))
    assert free.altitude_m is not None
    for altitude_m in (40.0, 80.0, 120.0):
        fixed = plan(problem(given=given).at(altitude_m))
        assert fixed.value <= free.upper_bound
        assert fixed.value <= free.value * 1.02


@pytest.mark.slow
def test_around_areas_within_a_deadline() -> None:
    space = Airspace((WALL,), None, 15.0)
    here = problem(3, given=limits(40.0), airspace=space, start_m=np.array([200.0, 400.0]))
    made = plan(here)
    assert made.value <= made.upper_bound
    assert made.via_m


def test_a_round_that_may_take_nothing_much_stands_still() -> None:
    made = plan(problem(given=limits(0.5)))
    assert made.path_m == 0.0
    assert made.foreseen is not None
    assert made.foreseen.duration_s == 0.0


@pytest.mark.slow
def test_the_same_problem_gives_the_same_plan() -> None:
    first, second = (plan(problem(given=limits(35.0))) for _ in range(2))
    np.testing.assert_array_equal(first.waypoints_m, second.waypoints_m)


@pytest.mark.parametrize(
    ("given", "words"), [(limits(20.0), "allowed are 20"), (limits(energy_j=5000.0), "are 5000")]
)
def test_a_plan_that_takes_longer_is_found_out(given: RoundLimits, words: str) -> None:
    free = plan(problem(given=None))
    with pytest.raises(InfeasiblePlanError, match=words):
        check_plan(problem(given=given), free)


def test_a_hover_counts() -> None:
    here = problem(given=limits(30.0))
    made = plan(here)
    with pytest.raises(InfeasiblePlanError, match="allowed are 30"):
        check_plan(here, made, hold_s=2.0)


def test_unflown_rounds_are_always_at_their_speed() -> None:
    exact = RoundLimits(Performance(20.0, 5.0, None), 30.0)
    made = plan(problem(given=exact))
    assert exact.longest_m() == 600.0
    assert made.foreseen is not None
    assert made.foreseen.duration_s == pytest.approx(made.path_m / 20.0)


def test_a_slower_pace_takes_longer_and_allows_less() -> None:
    slow = dataclasses.replace(FLYING, pace=1.25)
    points = np.array([[0.0, 0], [300, 0], [300, 200]])
    ours, theirs = (p.foresee(points, [0.0, 0.0, 3.0], 5.0) for p in (FLYING, slow))
    assert theirs.duration_s - 3.0 == pytest.approx(1.25 * (ours.duration_s - 3.0))
    assert slow.longest_m(50.0) == pytest.approx(FLYING.longest_m(40.0))
    assert slow.least_s(700.0) == pytest.approx(1.25 * FLYING.least_s(700.0))


@pytest.mark.parametrize("metres", [19_000.0, 21_000.0, 60_000.0])
def test_bounds_of_energy_hold_for_the_longest_paths(metres: float) -> None:
    points = np.array([[0.0, 0.0], [metres, 0.0]])
    flown_j = FLYING.foresee(points, [0.0, 0.0], 5.0).energy_j
    assert FLYING.farthest_m(flown_j) >= metres
    # At 20 m/s a metre takes more than at the cheapest speed, for which the bound is.
    assert 0.5 * flown_j < FLYING.least_j(metres) < flown_j
    assert FLYING.farthest_m(FLYING.least_j(19_000.0)) == pytest.approx(19_000.0, abs=1.0)


def test_hovers_part_the_path() -> None:
    points = np.array([[0.0, 0], [300, 0], [600, 0]])
    through = FLYING.foresee(points, [0.0, 0.0, 0.0], 5.0)
    hovering = FLYING.foresee(points, [0.0, 4.0, 4.0], 5.0)
    leg_s = FLYING.least_s(300.0)
    assert through.duration_s == pytest.approx(FLYING.least_s(600.0))
    assert hovering.duration_s == pytest.approx(2 * (leg_s + 4.0))
    assert hovering.arrived_s[2] == pytest.approx(2 * leg_s + 4.0, abs=0.5)
    assert hovering.energy_j > through.energy_j + FLYING.hover_j(8.0)


class Asked:
    """A planner that counts how often it is asked."""

    def __init__(self, inner: Planner) -> None:
        self.inner, self.times = inner, 0

    def plan(self, given: RoundProblem) -> RoundPlan:
        self.times += 1
        return self.inner.plan(given)


def of_one(config: PlannerConfig) -> LimitedPlanner:
    """The planner that rounds of one aircraft are handed to."""
    planner = make_planner(config)
    assert isinstance(planner, FleetPlanner)
    assert isinstance(planner.inner, LimitedPlanner)
    return planner.inner


@pytest.mark.parametrize(("devices", "times"), [(24, 0), (12, 1)])
def test_a_proof_for_all_altitudes_of_many_devices_is_brief(devices: int, times: int) -> None:
    given = problem(given=limits(40.0), devices=devices, altitudes_m=(40.0, 120.0))
    planner = of_one(PlannerConfig())
    inner = Asked(planner.inner)
    made = dataclasses.replace(planner, inner=inner).plan(given)
    check_plan(given, made)
    assert inner.times == times
    assert made.nodes < (7000 if times == 0 else math.inf)
    few = of_one(PlannerConfig(max_nodes=1000))
    whole = dataclasses.replace(few, brief=None).plan(given)
    assert made.upper_bound >= whole.value


def test_who_sends_for_longer_than_a_round_may_take_is_in_no_bound() -> None:
    """By far the most important, if only it could be heard within the time, or the energy."""
    for given in (limits(40.0), limits(energy_j=7000.0)):
        uploads, weights = np.array([100.0, 3.0, 3.0, 3.0]), np.array([100.0, 1.0, 1.0, 1.0])
        made = plan(problem(given=given, devices=4, upload_s=uploads, importance=weights))
        assert made.value > 0.0
        assert made.upper_bound <= 3.0


@pytest.mark.parametrize("kind", ["certified", "sqp"])
def test_importance_in_another_unit_gives_the_same_plan_within_limits(kind: str) -> None:
    here = problem(given=limits(25.0), devices=4, upload_s=np.full(4, 2.0))
    there = dataclasses.replace(here, importance=here.importance * 2.0**-60)
    one, other = plan(here, kind), plan(there, kind)
    np.testing.assert_array_equal(one.waypoints_m, other.waypoints_m)
    assert other.value == one.value * 2.0**-60
    assert other.upper_bound == one.upper_bound * 2.0**-60 or math.isnan(one.upper_bound)


def test_who_cannot_be_served_sets_no_unit() -> None:
    ready, uploads = np.array([1e4, 0.0, 0.0, 0.0]), np.full(4, 3.0)
    weights = np.array([1e15, 1.0, 0.9, 0.8])
    given = problem(given=limits(12.0), devices=4, upload_s=uploads, ready_in_s=ready)
    made = [
        plan(dataclasses.replace(given, importance=some))
        for some in (weights, np.where(weights > 1.0, 0.0, weights))
    ]
    assert made[0].upper_bound == made[1].upper_bound


@pytest.mark.parametrize("ready_s", [10.0, 20.0, 30.0])
def test_nobody_else_sends_and_yet_a_device_is_waited_for(ready_s: float) -> None:
    """A detour that takes as long is found by a few changes, whatever they are drawn from."""
    alone = problem(
        given=limits(ready_s + 6.0), devices_m=np.array([[430.0, 400.0]]), importance=np.ones(1),
        upload_s=np.ones(1), ready_in_s=np.array([ready_s]), path_budget_m=800.0,
    )  # fmt: skip
    for seed in range(6):
        served = varied(alone, standing(alone), 100, tolerance=0.02, seed=seed)
        check_plan(alone, served)
        assert served.value > 0.9


def hopes(given: RoundProblem, made: RoundPlan) -> np.ndarray:
    """The successes of those that are scheduled."""
    return success(given.at(made.altitude_m), made.waypoints_m)[made.schedule[0]]


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        *[(kind, {"given": None}) for kind in ("certified", "sqp", "paper")],
        *[(kind, {"given": limits(40.0)}) for kind in ("certified", "paper")],
        ("certified", {"given": limits(energy_j=7000.0)}),
        ("sqp", {"given": limits(45.0), "ready_in_s": np.linspace(0.0, 40.0, 12)}),
        ("certified", {"given": None, "path_budget_m": 0.0}),
        ("certified", {"given": None, "altitudes_m": (40.0, 120.0)}),
    ],
)
def test_nobody_without_hope_is_scheduled(kind: str, more: dict[str, Any]) -> None:
    preset = CHANNEL_PRESETS["dense-urban"]
    for seed in range(1 if kind == "paper" else 2):
        given = problem(
            seed, devices=12, steps=6, channel=preset, **{"path_budget_m": 600.0, **more}
        )
        made = plan(given, kind)
        assert hopes(given, made).min() >= 0.01
        assert made.schedule.sum() < 12
        if (
            kind == "certified" and "ready_in_s" not in more
        ):  # the bound is of all plans, theirs as well that ask in vain
            in_vain = scheduled_all(given, made)
            assert made.value < in_vain <= made.upper_bound * (1.0 + 1e-9)
            assert more.get("given") or "path_budget_m" in more or made.gap <= 0.01 + 1e-9


def scheduled_all(given: RoundProblem, made: RoundPlan) -> float:
    """What the plan would be worth if who is left out sent as well, where there is room."""
    chances = success(given.at(made.altitude_m), made.waypoints_m)
    (schedule,), value = made.schedule.copy(), made.value
    for k in np.flatnonzero(~made.schedule.any(axis=(0, 1))):
        n = int(np.where(schedule.sum(axis=1) < given.per_step, chances[:, k], -1.0).argmax())
        schedule[n, k] = True
        value += chances[n, k] * given.importance[k]
    return float(value)
