"""How far, how long and for how many joules is flown, and what follows for plans: by hand."""

import math
from typing import Any

import numpy as np
import pytest
from drawn_problems import drawn_problem
from one_aircraft import changed

from fl.radio.channel import average_per
from fl.radio.per_grid import PerGrid
from flightdyn.config import LimitsConfig
from flightdyn.physics.power import power_w
from mission.base.airspace import Airspace
from mission.base.errors import InfeasiblePlanError
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import finish
from mission.planner.improving import changes_for
from mission.planner.limited import near_of, reach_bound, servable
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance, acceptance_radii
from mission.planner.plan import PlannedPath, RoundPlan

PAPER = Performance(20.0, 5.0, None)
GUIDED = Performance(
    20.0, 5.0, LimitsConfig(acceleration_mps2=4.0, smoothing_s=0.25), wind_mps=(3.0, -4.0),
    stopping_s=1.5,
)  # fmt: skip
SQUARE = Airspace((np.array([[500.0, 300], [700, 300], [700, 500], [500, 500]]),), None, 10.0)


def watts(speed_mps: float) -> float:
    return float(power_w(np.array([speed_mps]), density=1.0)[0])


def test_the_paper_s_aircraft_is_always_at_its_speed() -> None:
    assert (PAPER.longest_m(10.0), PAPER.least_s(100.0)) == (200.0, 5.0)
    assert PAPER.least_j(100.0) == pytest.approx(5.0 * watts(20.0))
    assert PAPER.cheapest_j() == pytest.approx(watts(20.0) / 20.0)
    assert PAPER.farthest_m(5.0 * watts(20.0)) == pytest.approx(100.0)
    assert PAPER.farthest_m(math.inf) == PAPER.longest_m(math.inf) == math.inf
    assert (PAPER.fastest_mps, PAPER.stop_m) == (20.0, (0.0, 0.0))


def test_a_guided_aircraft_brakes_and_starts() -> None:
    """At 20 m/s and 4 m/s2 it starts and brakes in 5 s and 50 m each, all of it 0.25 s later."""
    assert GUIDED.stop_m == pytest.approx((20.0 * 1.75, 100.0))
    slower = Performance(20.0, 5.0, LimitsConfig(speed_mps=16.0), pace=1.25)
    assert (GUIDED.fastest_mps, slower.fastest_mps) == (20.0, 16.0 / 1.25)
    assert slower.stop_m[1] == pytest.approx(16.0**2 / 5.0)
    same = Performance(20.0, 5.0, LimitsConfig(speed_mps=16.0))
    for metres in (10.0, 300.0, 5000.0):
        assert slower.least_s(metres) == pytest.approx(1.25 * same.least_s(metres))
        assert slower.longest_m(slower.least_s(metres)) == pytest.approx(metres, rel=0.01)
    flown = GUIDED.foresee(np.array([[0.0, 0.0], [300.0, 0.0]]), [0.0, 0.0], 5.0)
    assert GUIDED.least_s(300.0) <= flown.duration_s
    assert GUIDED.least_s(300.0) == pytest.approx(250.0 / 20.0 + 7.5, abs=0.8)
    assert GUIDED.farthest_m(math.inf) == GUIDED.longest_m(math.inf) == math.inf
    # Beyond the table's 20 km all metres cost the same, and nothing is said of how far.
    beyond_j = GUIDED.least_j(21_000.0) - GUIDED.least_j(20_000.0)
    assert beyond_j == pytest.approx(1000.0 * GUIDED.cheapest_j(), rel=1e-9)
    across_j = GUIDED.least_j(20_010.0) - GUIDED.least_j(19_990.0)
    assert across_j == pytest.approx(20.0 * GUIDED.cheapest_j(), rel=1e-4)
    assert GUIDED.least_j(300.5) > GUIDED.least_j(300.0) > 0.0
    assert GUIDED.farthest_m(GUIDED.least_j(19_000.0)) == pytest.approx(19_000.5)
    assert GUIDED.farthest_m(GUIDED.least_j(20_000.0) * 1.001) == math.inf


def test_hovers_are_in_the_wind_and_take_a_while_to_begin() -> None:
    assert GUIDED.hover_j(7.0) == pytest.approx(7.0 * watts(5.0))
    assert PAPER.hover_j(7.0) == pytest.approx(7.0 * watts(0.0))
    way = GUIDED.foresee(np.array([[0.0, 0.0], [300.0, 0.0]]), [0.0, 0.0], 5.0)
    hover, more = GUIDED.foresee_hover(4.0), GUIDED.with_hovers_begun(way, 3)
    begun_s, begun_j = hover.duration_s - 4.0, hover.energy_j - 4.0 * watts(5.0)
    assert begun_s > 0.5
    assert more.duration_s == pytest.approx(way.duration_s + 3 * begun_s)
    assert more.energy_j == pytest.approx(way.energy_j + 3 * begun_j)
    assert more.flown_m == way.flown_m


def test_the_best_speeds_are_where_power_and_joules_a_metre_are_least() -> None:
    speeds = np.linspace(0.5, 40.0, 2000)
    power = power_w(speeds, density=1.0)
    assert GUIDED.best_endurance_mps == pytest.approx(speeds[power.argmin()], abs=0.1)
    assert GUIDED.best_range_mps == pytest.approx(speeds[(power / speeds).argmin()], abs=0.1)
    assert 0.985 * power.min() < GUIDED.least_w < power.min()
    said = f"20 m/s: power is least at {GUIDED.best_endurance_mps:.1f} m/s through the air, energy"
    assert said in GUIDED.best_speeds


@pytest.mark.parametrize(
    ("widest_m", "radii_m"),
    [
        (10.0, [10, 8, 6, 5, 4, 3, 2]),
        (5.0, [5, 4, 3, 2.5, 2, 1.5]),  # a metre is as narrow as none is
        (1.5, [1.5, 1.2]),
        (0.5, [0.5]),
    ],
)
def test_radii_go_down_to_a_metre(widest_m: float, radii_m: list[float]) -> None:
    np.testing.assert_allclose(acceptance_radii(widest_m), radii_m, rtol=1e-12)


def test_a_plan_is_checked_to_a_millimetre_and_a_billionth() -> None:
    given = drawn_problem(3, devices=4)
    way = given.start_m + np.array(
        [[0, 0], [100, 0], [100, 300], [400, 300], [400, 300], [300, 300]]
    )
    plan = finish(given, way)

    def check(value: float = plan.value, bound: float = math.nan, **path: Any) -> None:
        schedule = plan.schedule
        check_plan(
            given, RoundPlan((PlannedPath(**{"waypoints_m": way, **path}),), schedule, value, bound)
        )

    assert (PlannedPath(way).wait_s, PlannedPath(way).altitude_m) == (0.0, None)
    check()
    check(wait_s=1e9)
    check(plan.value * (1.0 + 0.9e-9))
    check(bound=plan.value * (1.0 - 0.9e-9))
    check(via_m=(np.zeros((0, 2)),) * 5)
    grown = given.start_m + (way - given.start_m) * (1.0 + 1.1e-3 / 800.0)
    refused: list[tuple[str, dict[str, Any]]] = [
        ("claims a value", {"value": plan.value * (1.0 + 1.1e-9)}),
        ("claims that none is worth more", {"bound": plan.value * (1.0 - 1.1e-9)}),
        ("a wait of -0.1 s: must be 0 or more", {"wait_s": -0.1}),
        ("a wait of inf s", {"wait_s": math.inf}),
        ("first waypoint lies 0.0011 m from", {"waypoints_m": way + np.array([0.0, 0.0011])}),
        ("the path is 0.0011 m longer than its budget", {"waypoints_m": grown}),
        ("corners between 4 pairs of waypoints: must be 5", {"via_m": (np.zeros((0, 2)),) * 4}),
    ]
    for words, wrong in refused:
        with pytest.raises(InfeasiblePlanError, match=words):
            check(**wrong)


LIMITED = {"limits": RoundLimits(PAPER, 40.0)}
JOULES = {"limits": RoundLimits(PAPER, energy_j=1e4)}
TIMES = np.ones(8)


@pytest.mark.parametrize(
    ("more", "changes"),
    [
        ({}, 40_000),  # 8 devices at 6 steps are fewer than 120
        ({"steps": 75}, int(40_000 / 5.0**0.25)),
        ({**LIMITED, "ready_in_s": TIMES}, 13_333),
        (LIMITED, 40_000),
        (JOULES, 20_000),
        ({"airspace": SQUARE}, 20_000),
        ({"airspace": SQUARE, **LIMITED}, 8_000),
        ({"upload_s": TIMES}, 10_000),
        ({"upload_s": TIMES, **LIMITED}, 7_500),  # each of 8 may be left out: 4 / 3 more
        ({"upload_s": TIMES, **LIMITED, "ready_in_s": TIMES}, 5_454),
        ({"per_grid": PerGrid(np.ones((8, 2, 2)), (0.0, 0.0), 800.0)}, 80_000),
        ({"steps": 10**6, "upload_s": TIMES, **JOULES}, 393),
        ({"steps": 10**6, "airspace": SQUARE, **JOULES, "ready_in_s": TIMES}, 311),
        ({"steps": 10**6, "airspace": SQUARE, **JOULES, "upload_s": TIMES}, 240),
        (
            {"steps": 10**6, "devices": 80, "airspace": SQUARE, **JOULES, "upload_s": np.ones(80)},
            200,
        ),
    ],
)
def test_so_many_changes_are_tried_as_looks_are_quick(more: dict[str, Any], changes: int) -> None:
    assert changes_for(drawn_problem(1, **more)) == changes


def test_who_cannot_be_served_counts_for_nothing() -> None:
    """In 30 s, or with the joules of 20 s of hover; ready at the end of the longest round."""
    upload_s = np.array([0.0, 20.0, 20.001, 30.0, 30.001, 1.0, 1.0, 1.0])
    given = drawn_problem(1, upload_s=upload_s)

    def served(**limits: float) -> list[int]:
        made = changed(given, limits=RoundLimits(PAPER, **limits))
        assert set(servable(made)) <= {0.0, *made.importance}
        return np.flatnonzero(servable(made)).tolist()

    assert served(duration_s=30.0) == [0, 1, 2, 3, 5, 6, 7]
    assert served(energy_j=PAPER.hover_j(20.0) * (1.0 + 1e-9)) == [0, 1, 5, 6, 7]
    assert served() == list(range(8))
    ready_in_s = np.array([0, 44.0, 44.1, 99, 43.9, 0, 0, 0])  # 800 m at 20 m/s, a tenth more
    late = drawn_problem(1, ready_in_s=ready_in_s, limits=RoundLimits(PAPER))
    assert np.flatnonzero(servable(late)).tolist() == [0, 1, 4, 5, 6, 7]
    assert servable(changed(given, limits=None)).tolist() == given.importance.tolist()


def test_devices_are_as_near_as_the_budget_and_the_areas_let() -> None:
    devices_m = np.array(
        [[400.0, 420], [400, 1000], [600, 400], [510, 400], [400, 640], [900, 400]]
    )
    given = drawn_problem(
        1, devices=6, devices_m=devices_m, path_budget_m=240.0, airspace=SQUARE, per_step=1, steps=2
    )
    # In the square, 200 m wide, as far as its outline is; beyond the budget what is left.
    assert near_of(given).tolist() == pytest.approx([0.0, 360.0, 100.0, 10.0, 0.0, 260.0])
    inside = changed(given, start_m=np.array([600.0, 400.0]))
    assert near_of(inside)[2:4].tolist() == [0.0, 0.0]
    assert near_of(changed(given, path_budget_m=60.0))[3] == pytest.approx(50.0)
    # Of two places the best two, of two aircraft with each the better of both.
    chances = 1.0 - average_per(given.channel, near_of(given))
    worth = np.sort(chances * given.importance)[::-1]
    assert reach_bound([given]) == pytest.approx(worth[:2].sum())
    assert reach_bound([given, given]) == pytest.approx(worth[:4].sum())
    other = changed(given, start_m=np.array([400.0, 900.0]))
    both = np.maximum(chances, 1.0 - average_per(given.channel, near_of(other)))
    summed = np.sort(both * given.importance)[::-1][:4].sum()
    assert reach_bound([given, other]) == pytest.approx(summed)


def test_plans_proven_less_closely_than_asked_for_are_counted() -> None:
    config = PlannerConfig(gap=0.02)
    assert config.loosely_proven([0.02, 0.0, math.nan, 0.02 + 0.9e-9]) == ""
    assert config.loosely_proven([]) == ""
    assert config.loosely_proven([0.02, 0.034]).startswith(
        "1 of 2 plans is proven less closely than planner.gap = 0.02 asks: the largest gap is 3.4 %"
    )
    assert config.loosely_proven([0.5, 0.021]).startswith("2 of 2 plans are proven less")
    assert PlannerConfig(kind="sqp").loosely_proven([0.5]) == ""
