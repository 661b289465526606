"""When a path budget ends a run."""

import pytest

from mission.config.models import MissionConfig
from mission.run.budget import RunTotals, rounds_paid_for


def flown(mission: MissionConfig, cost_m: float) -> int:
    """Rounds of a run whose every round costs the same."""
    totals = RunTotals.before(1)
    while not totals.is_over(mission):
        totals.rounds_done += 1
        totals.budget_used_m += cost_m
    return totals.rounds_done


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
    flying = MissionConfig(path_budget_m=round_m, total_budget_m=total_m, rounds=99)
    assert flown(flying, min(round_m, total_m)) == rounds == rounds_paid_for(flying)
    hovering = MissionConfig(
        strategy="barycenter", hover_cost_m=round_m, total_budget_m=total_m, rounds=99
    )
    assert flown(hovering, round_m) == rounds == rounds_paid_for(hovering)


def test_what_corners_save_pays_for_more_rounds() -> None:
    mission = MissionConfig(path_budget_m=800.0, total_budget_m=4790.0, rounds=99)
    assert rounds_paid_for(mission) == 5
    assert flown(mission, 795.0) == 6


def test_rounds_that_spend_nothing_end_by_their_number() -> None:
    mission = MissionConfig(path_budget_m=100.0, rounds=7)
    assert flown(mission, 0.0) == rounds_paid_for(mission) == 7
