"""Plans that choose their altitude: near the best of all, under a bound that none exceeds."""

import dataclasses
import itertools

import numpy as np
import pytest
from again import again
from drawn_problems import drawn_problem, plan
from one_aircraft import changed

from fl.radio.channel import CHANNEL_PRESETS, Channel, average_per
from mission.base.airspace import Airspace
from mission.base.errors import InfeasiblePlanError, PlanInputError
from mission.planner.altitudes import CertifiedAltitudes
from mission.planner.certified import CertifiedPlanner, ExploringPlanner
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import check_problem, finish, success_bounds
from mission.planner.factory import make_planner
from mission.planner.plan import Planner
from mission.planner.problem import RoundProblem
from mission.planner.reward import FINE_M, excess, reward_table
from mission.planner.sqp import SqpPlanner

LIMITS = (40.0, 120.0)
GAP = 0.01


def problem(seed: int = 1, *, devices: int = 6, channel: str = "suburban", **more) -> RoundProblem:
    usual = {"steps": 4, "altitudes_m": LIMITS, "channel": CHANNEL_PRESETS[channel]}
    return drawn_problem(seed, devices=devices, **{**usual, **more})


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["suburban", "suburban+10dB", "urban", "suburban-log-variance"])
@pytest.mark.parametrize("case", [(3, 6), *again([(1, 3), (2, 4)])])
def test_no_altitude_beats_the_plan_by_more_than_the_gap(channel: str, case: tuple[int, int]):
    """Against the planner for one altitude, metre by metre: another way to the same answer."""
    seed, steps = case
    given = problem(seed, channel=channel, steps=steps, altitudes_m=(40.0, 70.0))
    made = plan(given)
    single = [CertifiedPlanner().plan(given.at(float(h))) for h in range(40, 71)]
    best = max(single, key=lambda other: other.value)
    assert made.gap <= GAP + 1e-9
    assert made.value >= best.value * (1.0 - GAP)
    assert made.upper_bound >= best.value * (1.0 - 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(3), *again(range(3, 8))])
def test_no_path_from_any_altitude_exceeds_the_bound(seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    channel = str(rng.choice(list(CHANNEL_PRESETS)))
    given = problem(
        seed, channel=channel, devices=int(rng.integers(1, 14)), steps=int(rng.integers(2, 11)),
        per_step=int(rng.integers(1, 4)), altitudes_m=tuple(np.sort(rng.uniform(10, 500, 2))),
    )  # fmt: skip
    made = plan(given)
    assert given.altitudes_m is not None
    for height_m in rng.uniform(given.altitudes_m[0], given.altitudes_m[1], 12):
        bare = dataclasses.replace(given.at(float(height_m)))
        other = CertifiedPlanner(max_nodes=200).plan(bare)
        assert other.value <= made.upper_bound * (1.0 + 1e-4)


def drawn(seed: int) -> Channel:
    """A channel with every constant at random, sharper and flatter than all presets."""
    rng = np.random.default_rng(seed)
    return Channel(
        altitude_m=60.0, alpha_los=rng.uniform(1.5, 3), alpha_nlos=rng.uniform(2.5, 5),
        beta_los_db=-30.0, beta_nlos_db=-40.0, sigma_los=10 ** rng.uniform(-2, 0.7),
        sigma_nlos=10 ** rng.uniform(-2, 0.7), a1_per_rad=10 ** rng.uniform(0, 2),
        a2=rng.uniform(-3, 20), tx_power_db=rng.uniform(-20, 20), noise_db=-95.0,
        snr_threshold=10.0,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("channel", [*CHANNEL_PRESETS, *range(3), *again(range(3, 12))])
@pytest.mark.parametrize("ends", [(40.0, 60.0), (10.0, 12.5), (95.0, 100.0), (10.0, 132.5)])
def test_what_is_earned_in_between_stays_below_the_raised_chord(channel: str | int, ends) -> None:
    reach = 512
    preset = drawn(channel) if isinstance(channel, int) else CHANNEL_PRESETS[channel]
    low = dataclasses.replace(preset, altitude_m=ends[0])
    r = np.arange(0.0, reach + 2.0)
    f = [1.0 - average_per(low, r, height_m=h) for h in ends]
    above = excess(low, reach, ends[1])[:: round(1.0 / FINE_M)]
    for share in np.linspace(0.0, 1.0, 1203)[1:-1:12]:
        between = 1.0 - average_per(low, r, height_m=ends[0] + share * (ends[1] - ends[0]))
        assert (between <= (1.0 - share) * f[0] + share * f[1] + above + 1e-12).all()


def test_the_raised_table_lies_above_what_it_expands() -> None:
    low = dataclasses.replace(CHANNEL_PRESETS["suburban+10dB"], altitude_m=60.0)
    table = reward_table(low, 512, (50.0, 80.0))
    raised = 1.0 - average_per(low, np.arange(0.0, 514.0, FINE_M))
    raised += np.maximum(excess(low, 512, 50.0), excess(low, 512, 80.0))
    for i, f in enumerate(raised[: 4 * 512]):
        row = (i + 2) // 4
        d = (i - 4 * row) * FINE_M
        value, slope, bend = table.rows[row]
        assert value + slope * d + bend * d * d / 2.0 >= f - 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqp", "paper"])
def test_planners_without_a_bound_try_nine_altitudes(kind: str) -> None:
    given = problem(5, devices=4, channel="urban")
    made = plan(given, kind)
    middle = make_planner(PlannerConfig(kind=kind)).plan(given.at(80.0))
    assert made.value >= middle.value
    assert np.isnan(made.upper_bound)


def test_the_same_problem_has_the_same_plan() -> None:
    given = problem(4, devices=10, steps=8)
    first, again = plan(given), plan(given)
    assert first.waypoints_m.tobytes() == again.waypoints_m.tobytes()
    assert (first.altitude_m, first.upper_bound) == (again.altitude_m, again.upper_bound)


def test_a_cap_on_nodes_leaves_an_honest_gap() -> None:
    given = problem(2, devices=12, channel="suburban-log-variance", steps=8)
    rough, fine = plan(given, max_nodes=20), plan(given)
    assert rough.gap > GAP
    assert rough.upper_bound >= fine.value


def test_around_areas_the_bound_holds_for_every_altitude() -> None:
    block = np.array([[450.0, 300], [600, 300], [600, 560], [450, 560]])
    given = problem(6, devices=4, channel="urban", airspace=Airspace((block,), None, 15.0))
    made = plan(given)
    for height_m in (60.0, made.altitude_m, 110.0):
        other = make_planner(PlannerConfig()).plan(given.at(height_m))
        assert other.value <= made.upper_bound * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "more", [{"steps": 1}, {"path_budget_m": 0.0}, {"importance": np.zeros(6)}]
)
def test_where_there_is_nothing_to_move_for(more) -> None:
    given = problem(1, **more)
    made = plan(given)
    heights = np.arange(40.0, 120.01, 0.1)
    worth = [finish(given.at(float(h)), made.waypoints_m).value for h in heights]
    assert made.value == pytest.approx(max(worth), rel=1e-9)
    in_vain = (
        0.01 * given.importance[~made.schedule.any(axis=(0, 1))].sum()
    )  # without hope, but not quite
    assert made.value <= made.upper_bound <= max(worth) * 1.001 + in_vain + 1e-9


def test_bounds_of_success_hold_between_their_samples() -> None:
    given = problem(1, channel="high-rise")
    far = np.linspace(0.0, 600.0, 40)
    bound = success_bounds(given, far).max(axis=0)
    for height_m in np.linspace(*LIMITS, 1001):
        assert (1.0 - average_per(given.channel, far, height_m=height_m) <= bound + 1e-12).all()


def test_nothing_in_reach() -> None:
    made = plan(problem(1, devices_m=np.full((6, 2), 4e3)))
    assert made.value == pytest.approx(0.0, abs=1e-9)
    assert made.upper_bound >= made.value


def test_plans_that_do_not_fit_their_limits_are_refused() -> None:
    given = problem()
    made = plan(given)
    for altitude_m, said in ((None, "names no altitude"), (130.0, "from 40 to 120 m")):
        with pytest.raises(InfeasiblePlanError, match=said):
            check_plan(given, made.with_own(altitude_m=altitude_m))
    with pytest.raises(InfeasiblePlanError, match="the problem has one of 60 m"):
        check_plan(changed(given, altitudes_m=None), made)


@pytest.mark.parametrize("kind", ["certified", "sqp", "exploring"])
@pytest.mark.parametrize("exponent", [-30, 30])
def test_importance_in_another_unit_gives_the_same_plan_at_the_same_altitude(
    kind: str, exponent: int
) -> None:
    planners: dict[str, Planner] = {
        "certified": CertifiedAltitudes(CertifiedPlanner()), "sqp": SqpPlanner(),
        "exploring": ExploringPlanner(),
    }  # fmt: skip
    made = planners[kind]
    given = problem() if kind == "certified" else changed(problem(), altitudes_m=None)
    scaled = dataclasses.replace(given, importance=np.ldexp(given.importance, exponent))
    here, there = made.plan(given), made.plan(scaled)
    assert there.value == np.ldexp(here.value, exponent)
    assert there.waypoints_m.tobytes() == here.waypoints_m.tobytes()
    assert there.altitude_m == here.altitude_m
    if kind == "certified":
        assert there.upper_bound == np.ldexp(here.upper_bound, exponent)


@pytest.mark.parametrize("limits", [(120.0, 40.0), (60.0, 60.0), (0.0, 40.0), (40.0, np.nan)])
def test_limits_that_make_no_sense(limits: tuple[float, float]) -> None:
    with pytest.raises(PlanInputError, match="altitudes_m"):
        check_problem(problem(altitudes_m=limits))


def test_a_fixed_altitude_is_planned_as_ever() -> None:
    given = changed(problem(), altitudes_m=None)
    one, other = CertifiedPlanner().plan(given), CertifiedAltitudes(CertifiedPlanner()).plan(given)
    assert one.altitude_m is None
    assert one.waypoints_m.tobytes() == other.waypoints_m.tobytes()
    assert list(itertools.chain(one.schedule.ravel())) == list(other.schedule.ravel())


@pytest.mark.parametrize("seed", [2, 4])
def test_a_search_that_cannot_lower_its_part_splits_it(seed: int) -> None:
    """Where altitudes differ so much that both ends of a part are bounded by what is between."""
    rng = np.random.default_rng(seed)
    given = problem()
    devices_m, importance = rng.uniform(-300, 300, (8, 2)), rng.uniform(0.2, 1, 8)
    wide = changed(
        given, devices_m=devices_m, importance=importance, start_m=np.zeros(2), steps=5, per_step=2,
        path_budget_m=800.0, altitudes_m=(10.0, 500.0),
    )  # fmt: skip
    made = CertifiedAltitudes(CertifiedPlanner()).plan(wide)
    check_plan(wide, made)
    assert made.gap <= 0.01
