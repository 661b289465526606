"""Limits that no round can keep to are refused; tours are as long as theirs allow."""

from typing import Any

import pytest

from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.scenario.limits import (
    UNLIMITED,
    Amount,
    aircraft_of,
    budget_of,
    budget_of_all,
    foreseen_performance,
    is_limited,
    performance_of,
    round_limits,
    separation,
    unflyable,
)
from mission.scenario.scenario import build_scenario
from mission.scenario.strategies import Rectangular, stretch


def config(*, link: str = "in_process", **mission: Any) -> RunConfig:
    return RunConfig.model_validate(
        {
            "mission": {"steps": 8, **mission},
            "link": {"kind": link},
            "communities": [{"name": "a", "task": "digits", "devices": 2, "partition": "iid"}],
        }
    )


def refused(given: RunConfig) -> list[str]:
    """The keys whose limits no round can keep to."""
    return [key for key, _, _ in unflyable(given, foreseen_performance(given))]


@pytest.mark.parametrize("heights", [{"altitude_m": 200.0}, {"altitude_m": (200.0, 300.0)}])
def test_air_is_as_thin_as_where_the_lowest_flight_is(heights: dict[str, Any]) -> None:
    """The standard atmosphere's (ISO 2533) 1.1117 kg/m3 at 1000 m, and 1.225 at sea level."""
    flying = performance_of(config(**heights).mission, 800.0, None)
    assert flying.density == pytest.approx(1.1117 / 1.225, abs=1e-4)


@pytest.mark.parametrize(
    ("from_deg", "blows"),
    [(270.0, (4.0, 0.0)), (180.0, (0.0, 4.0)), (45.0, (-(8**0.5), -(8**0.5)))],
)
def test_the_wind_of_a_round_is_the_simulated_one(from_deg: float, blows: Any) -> None:
    """Its velocity east and north; of an external vehicle nobody knows one."""
    wind = {"speed_mps": 4.0, "from_deg": from_deg}
    for link, wanted in (("in_process", blows), ("external", (0.0, 0.0))):
        given = RunConfig.model_validate(
            {**config(link=link).model_dump(), "vehicle": {"aircraft": {"wind": wind}}}
        )
        flying = foreseen_performance(given)
        assert flying.wind_mps == pytest.approx(wanted, abs=1e-12)
        assert (flying.speed_mps, flying.widest_m, flying.pace) == (20.0, 5.0, 1.0)


def test_a_whole_round_takes_its_limits_or_what_its_metres_take() -> None:
    """Unflown, at 20 m/s: 800 m take 40 s."""

    def whole(**mission: Any) -> Amount:
        given = config(flight="none", **mission)
        return budget_of(given, foreseen_performance(given)).whole_round

    metres, seconds, joules = whole()
    assert (metres, seconds) == (800.0, 40.0)
    assert whole(round_deadline_s=30.0) == pytest.approx((800.0, 30.0, 0.75 * joules))
    assert whole(round_deadline_s=50.0) == pytest.approx((800.0, 50.0, joules))
    assert whole(round_energy_j=joules / 2.0) == pytest.approx((800.0, 20.0, joules / 2.0))
    hover = whole(strategy="barycenter", hover_s=20.0, hover_cost_m=90.0)
    longer = whole(strategy="barycenter", hover_s=30.0, round_deadline_s=99.0)
    assert hover[:2] == (90.0, 20.0)
    assert longer == pytest.approx((100.0, 30.0, 1.5 * hover.joules))
    given = config(total_budget_m=5e3, total_deadline_s=900.0, rounds=7)
    budget = budget_of(given, foreseen_performance(given))
    assert (budget.rounds, budget.total) == (7, Amount(5e3, 900.0))
    assert budget_of(config(total_energy_j=9e5), foreseen_performance(given)).total.joules == 9e5
    several = RunConfig.model_validate(
        {**config(flight="none").model_dump(), "vehicles": [{"path_budget_m": 300}, {}]}
    )
    both = aircraft_of(several)
    assert budget_of_all(both).whole_round == pytest.approx((800.0, 40.0, joules))
    assert budget_of_all(both[:1]).whole_round.metres == 300.0


def test_a_round_has_the_least_of_its_limits_and_of_what_is_left() -> None:
    def limits(*left: float, timed: bool = False, **mission: Any) -> Any:
        given = config(**mission)
        made = round_limits(
            given.mission, foreseen_performance(given), left=Amount(*left), timed=timed
        )
        return made and (made.duration_s, made.energy_j)

    none = float("inf")
    assert limits(1.0, 2.0, 3.0) is None
    assert limits(1.0, timed=True) == (none, none)
    assert limits(1.0, 20.0, 5e3, timed=True) == (20.0, 5e3)
    assert limits(1.0, round_deadline_s=30.0) == (30.0, none)
    assert limits(1.0, 29.0, 5e3, round_deadline_s=30.0) == (29.0, 5e3)
    assert limits(1.0, 31.0, 4e3, round_deadline_s=30.0, round_energy_j=5e3) == (30.0, 4e3)
    for key in ("round_deadline_s", "total_deadline_s", "round_energy_j", "total_energy_j"):
        given: dict[str, Any] = {key: 1000.0}
        assert is_limited(config(**given).mission)
    assert not is_limited(config().mission)


def test_flying_adds_to_a_separation_that_is_planned() -> None:
    def kept(leaving: bool, **mission: Any) -> dict[str, Any]:
        return separation(config(separation_m=20.0, **mission).mission, leaving=leaving)

    flown = {"separation_m": 23.0, "late_s": 1.0, "least_m": None, "in_step": False}
    assert kept(leaving=True) == flown
    assert kept(leaving=False) == {**flown, "least_m": 20.0}
    assert kept(leaving=True, replan="stop") == {**flown, "in_step": True}
    exact = {**flown, "separation_m": 20.0, "late_s": 0.0}
    assert kept(leaving=True, flight="none") == exact
    assert separation(config().mission, leaving=True) == {}


def check(given: RunConfig) -> None:
    build_scenario(given, data_dir=None)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (config(round_deadline_s=2.0),
         "mission.round_deadline_s = 2.0: no round can be flown in it: flying 10 m and stopping "
         "takes 3.53 s; give at least that, or leave it out"),
        (config(total_deadline_s=1.0), "mission.total_deadline_s = 1.0: no round can be flown"),
        (config(round_energy_j=100.0), "mission.round_energy_j = 100.0: no round can be flown"),
        (config(total_energy_j=100.0), "mission.total_energy_j = 100.0: no round can be flown"),
        (config(strategy="barycenter", hover_s=20.0, round_deadline_s=15.0),
         "mission.round_deadline_s = 15.0: no round can be flown in it: a hover of mission.hover_s "
         "= 20 s takes 21.05 s; give at least that, or hover shorter"),
        (config(strategy="barycenter", hover_s=20.0, round_energy_j=3000.0),
         "mission.round_energy_j = 3000.0: no round can be flown in it: a hover"),
        (config(round_energy_j=10000.0, total_energy_j=9000.0),
         "mission.total_energy_j = 9000.0: pays for no round: a whole one takes 10000 J "
         "(mission.round_energy_j); give at least 9500 J, or a smaller mission.round_energy_j"),
        (config(round_deadline_s=40.0, total_deadline_s=37.9),
         "mission.total_deadline_s = 37.9: pays for no round: a whole one takes 40 s "
         "(mission.round_deadline_s); give at least 38 s, or a smaller mission.round_deadline_s"),
        (config(path_budget_m=800.0, total_deadline_s=40.0),
         "mission.total_deadline_s = 40.0: pays for no round: a whole one takes 44.7 s (what its "
         "metres take); give at least 42.47 s, or give mission.round_deadline_s, too"),
        (config(link="external", total_energy_j=1e6),
         "mission.total_energy_j = 1000000.0: of an external vehicle nobody knows the power, so "
         "energy cannot limit its plans; leave it out, and give a deadline or metres"),
    ],
)  # fmt: skip
def test_what_no_round_can_keep_is_refused(given: RunConfig, words: str) -> None:
    with pytest.raises(InputError) as refused:
        check(given)
    assert str(refused.value).startswith(f"configuration: {words}")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("limits", "enough", "too_little"),
    [
        ({}, {}, {"round_deadline_s": 3.52}),
        ({}, {"round_deadline_s": 3.53}, {"round_deadline_s": 3.52}),
        ({"strategy": "barycenter", "hover_s": 20.0},
         {"round_deadline_s": 21.05}, {"round_deadline_s": 21.04}),
        ({"round_deadline_s": 40.0}, {"total_deadline_s": 38.0}, {"total_deadline_s": 37.99}),
        ({"round_deadline_s": 30.0}, {"total_energy_j": 1e6}, {"total_energy_j": 1e3}),
    ],
)  # fmt: skip
def test_enough_is_not_refused_and_less_is(
    limits: dict[str, Any], enough: dict[str, Any], too_little: dict[str, Any]
) -> None:
    assert refused(config(**limits, **enough)) == []
    assert refused(config(**limits, **too_little)) == [f"mission.{key}" for key in too_little]


@pytest.mark.parametrize("limit", [{"round_deadline_s": 35.0}, {"round_energy_j": 9000.0}])
def test_a_tour_is_as_long_as_its_limits_allow(limit: dict[str, Any]) -> None:
    given = config(strategy="rectangular", **limit)
    scenario = build_scenario(given, data_dir=None)
    tour, limits = (
        scenario.strategy,
        round_limits(given.mission, scenario.fleet[0].performance, left=UNLIMITED),
    )
    assert isinstance(tour, Rectangular)
    assert limits is not None
    assert 300.0 < tour.length_m < 0.9 * given.mission.path_budget_m
    shares = []
    for number in range(8):
        points = stretch(tour.corners_m, number * tour.length_m, tour.length_m, 8)
        for radius_m in (5.0, 1.5):
            foreseen = limits.performance.foresee(points, [0.0] * 8, radius_m)
            shares.append(limits.share(foreseen))
    assert 0.9 < max(shares) <= 1.0


def test_an_unlimited_tour_keeps_its_length() -> None:
    tour = build_scenario(config(strategy="rectangular"), data_dir=None).strategy
    assert isinstance(tour, Rectangular)
    assert tour.length_m == 800.0


def test_speed_is_what_the_vehicle_allows() -> None:
    slow = config()
    slow = slow.model_copy(
        update={"vehicle": slow.vehicle.model_copy(update={"parameters": {"MPC_XY_VEL_MAX": 10.0}})}
    )
    assert foreseen_performance(slow).least_s(800.0) > 80.0
    assert foreseen_performance(config()).least_s(800.0) < 50.0


def test_the_first_problem_knows_the_limits() -> None:
    given = config(round_deadline_s=30.0, total_deadline_s=29.0, round_energy_j=5000.0)
    limits = build_scenario(given, data_dir=None).first_problem().limits
    assert limits is not None
    assert (limits.duration_s, limits.energy_j) == (29.0, 5000.0)
    assert build_scenario(config(), data_dir=None).first_problem().limits is None


@pytest.mark.parametrize("metres", [400.0, 777.0, 1234.5, 4000.0])
def test_what_a_refusal_asks_for_is_enough(metres: float) -> None:
    with pytest.raises(InputError) as refused:
        check(config(path_budget_m=metres, total_energy_j=3000.0))
    enough = float(str(refused.value).split("give at least ")[1].split(" J")[0])
    check(config(path_budget_m=metres, total_energy_j=enough))


def test_who_flies_nothing_needs_no_time_for_it() -> None:
    assert refused(config(strategy="ideal", total_deadline_s=20.0)) == []
    assert refused(config(total_deadline_s=20.0)) == ["mission.total_deadline_s"]
