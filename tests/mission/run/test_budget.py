"""When a budget ends a run."""

import math
from dataclasses import replace

import pytest

from mission.config.models import RunConfig
from mission.log.records import UNKNOWN_ROUND
from mission.run.budget import RunTotals, rounds_paid_for
from mission.scenario.limits import Amount, Budget, budget_of, foreseen_performance


def budget(**mission: object) -> Budget:
    communities = [{"name": "a", "task": "digits", "devices": 2}]
    config = RunConfig.model_validate({"mission": mission, "communities": communities})
    return budget_of(config, foreseen_performance(config))


def flown(given: Budget, cost: Amount) -> int:
    """Rounds of a run whose every round costs the same."""
    totals = RunTotals()
    while not totals.is_over(given):
        totals.rounds_done += 1
        totals.used = totals.used_with(cost, given)
    return totals.rounds_done


def metres(cost_m: float) -> Amount:
    return Amount(cost_m, 0.0, 0.0)


@pytest.mark.parametrize(
    ("round_m", "total_m", "rounds"),
    [
        (800.0, 4800.0, 6),
        (800.0, 4799.0, 5),
        (800.0, 500.0, 1),  # only the first may be shorter
        # In binary, twice 266.7 from 800.1 is less than 266.7; so are the others at some round.
        (266.7, 800.1, 3),
        (0.1, 0.3, 3),
        (33.3, 1665.0, 50),
    ],
)
def test_as_many_rounds_as_the_budget_pays_for(round_m: float, total_m: float, rounds: int) -> None:
    flying = budget(path_budget_m=round_m, total_budget_m=total_m, rounds=99)
    assert flown(flying, metres(min(round_m, total_m))) == rounds == rounds_paid_for(flying)
    hovering = budget(
        strategy="barycenter", hover_cost_m=round_m, total_budget_m=total_m, rounds=99
    )
    assert flown(hovering, metres(round_m)) == rounds == rounds_paid_for(hovering)


def test_what_corners_save_pays_for_more_rounds() -> None:
    given = budget(path_budget_m=800.0, total_budget_m=4790.0, rounds=99)
    assert rounds_paid_for(given) == 5
    assert flown(given, metres(795.0)) == 6


def test_rounds_that_spend_nothing_end_by_their_number() -> None:
    given = budget(path_budget_m=100.0, rounds=7)
    assert flown(given, metres(0.0)) == rounds_paid_for(given) == 7


@pytest.mark.parametrize(
    ("mission", "cost", "rounds", "words"),
    [
        ({"round_deadline_s": 40, "total_deadline_s": 130}, Amount(500, 40.0), 3,
         "of the time of 130 s (mission.total_deadline_s) 10 s are left, and a whole round takes "
         "40, so the run ends before round 4"),
        ({"round_energy_j": 9e3, "total_energy_j": 3e4}, Amount(500, 30, 9e3), 3,
         "of the energy of 30000 J (mission.total_energy_j) 3000 J are left"),
        ({"round_energy_j": 1e4, "total_energy_j": 3e4}, Amount(500, 30, 10031), 3,
         "of the energy of 30000 J (mission.total_energy_j) 93 J more than allowed were used, so "
         "the run ends before round 4"),
        ({"round_energy_j": 1e4, "total_energy_j": 3e4}, Amount(500, 30, 10200), 3,
         "of the energy of 30000 J (mission.total_energy_j) 600 J more than allowed were used"),
        ({"total_budget_m": 1700, "total_deadline_s": 900}, Amount(800, 50), 2,
         "of the path budget of 1700 m (mission.total_budget_m) 100 m are left, and a whole round "
         "takes 800, so the run ends before round 3"),
        ({"total_budget_m": 1600.7}, Amount(800), 2,
         "of the path budget of 1600.7 m (mission.total_budget_m) 1 m are left, and a whole round"),
        ({"total_budget_m": 1600}, Amount(800), 2,
         "the path budget of 1600 m (mission.total_budget_m) is spent, so the run ends before"),
        ({"total_budget_m": 100}, Amount(100), 1,
         "the path budget of 100 m (mission.total_budget_m) is spent, so the run ends before"),
        ({"total_deadline_s": 900, "rounds": 4}, Amount(800, 50), 4, ""),
    ],
)  # fmt: skip
def test_the_first_budget_that_pays_for_no_round_ends_a_run(
    mission: dict[str, float], cost: Amount, rounds: int, words: str
) -> None:
    given = budget(**{"rounds": 50, **mission})
    cost = Amount(*(0.0 if math.isinf(part) else part for part in cost))
    assert flown(given, cost) == rounds == rounds_paid_for(given)
    totals = RunTotals()
    totals.rounds_done = rounds
    totals.used = Amount(*(rounds * part for part in cost))
    assert totals.why_over(given).startswith(words)
    assert bool(totals.why_over(given)) == bool(words)


def test_a_round_without_a_limit_of_its_own_costs_what_its_metres_take() -> None:
    given = budget(total_deadline_s=900, total_energy_j=1e6, path_budget_m=800)
    # 800 m at 20 m/s, 4 s to start and stop, 0.7 s of smoothing and settling.
    assert given.whole_round.seconds == pytest.approx(800 / 20 + 4 + 0.7)
    assert 800 * 10.8 < given.whole_round.joules < 44.7 * 285.4  # at the best range, at 20 m/s
    shorter = budget(total_deadline_s=900, round_energy_j=5000, total_energy_j=1e6)
    assert shorter.whole_round.seconds < 0.62 * given.whole_round.seconds
    hovering = budget(strategy="barycenter", hover_s=5, total_deadline_s=13)
    # 5 s, and what it takes to settle where it is.
    assert hovering.whole_round.seconds == pytest.approx(6.05, abs=0.01)
    assert rounds_paid_for(hovering) == 2


def test_what_a_round_has_used_is_what_the_run_has() -> None:
    totals = RunTotals()
    round_1 = replace(UNKNOWN_ROUND, budget_used_m=800.0, time_used_s=40.0, energy_used_j=9000.0)
    totals.add(round_1)
    assert totals.used == Amount(800.0, 40.0, 9000.0)


def test_totals_are_those_of_all_rounds_and_what_is_used_the_last_ones() -> None:
    totals = RunTotals()
    given = {"budget_used_m": 500.0, "time_used_s": 30.0, "energy_used_j": 9e3}
    counted = {"flown_path_m": 510.0, "scheduled": 5, "delivered": 4}
    for more in (1.0, 2.0):
        used = {key: more * value for key, value in given.items()}
        value = {"plan_objective": 1.2 - 0.4 * more, "upper_bound": 1.0, "accuracy": {"a": more}}
        totals.add(replace(UNKNOWN_ROUND, **used, **counted, **value))  # type: ignore[arg-type]  # as they are
    assert (totals.rounds_done, totals.next_round) == (2, 3)
    assert totals.used == Amount(1000.0, 60.0, 18e3)
    assert (totals.flown_m, totals.scheduled, totals.delivered) == (1020.0, 10, 8)
    assert totals.gaps == pytest.approx([0.2, 0.6])
    assert totals.accuracy == {"a": 2.0}
    assert (totals.sim_s, totals.battery_changes, len(totals.last_heard)) == (0.0, 0, 0)
