"""Running totals of a run, and what is left of its budgets: metres, seconds, joules."""

import math
from dataclasses import dataclass, field

import numpy as np

from mission.base.arrays import Ints
from mission.log.records import RoundRecord
from mission.planner.plan import relative_gap
from mission.scenario.limits import ENOUGH, KEYS, NOTHING, Amount, Budget


@dataclass
class RunTotals:
    """Sums over the finished rounds; those of a flight under way are not in them yet."""

    # (K,) round of each device's last update; 0: none yet
    last_heard: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    rounds_done: int = 0
    used: Amount = NOTHING  # of the budgets
    flown_m: float = 0.0
    sim_s: float = 0.0  # since power-up
    scheduled: int = 0
    delivered: int = 0
    battery_changes: int = 0
    gaps: list[float] = field(default_factory=list)  # of each round's plan, NaN without a bound
    accuracy: dict[str, float] = field(default_factory=dict)  # per community, after the last round
    untrained: dict[str, float] = field(default_factory=dict)  # the same, before the first

    @property
    def next_round(self) -> int:
        """Number of the current or next round, from 1."""
        return self.rounds_done + 1

    def add(self, record: RoundRecord) -> None:
        """Add a finished round's record."""
        self.rounds_done += 1
        self.used = Amount(record.budget_used_m, record.time_used_s, record.energy_used_j)
        self.flown_m += record.flown_path_m
        self.scheduled += record.scheduled
        self.delivered += record.delivered
        self.gaps.append(relative_gap(record.plan_objective, record.upper_bound))
        self.accuracy = dict(record.accuracy)

    def is_over(self, budget: Budget) -> bool:
        """Whether the rounds or one of the budgets are spent.

        What is left of each must pay for a whole round: a stub of one would end the run on
        models that few devices had a part in. Only the first round may be shorter.
        """
        return self.rounds_done >= budget.rounds or self._spent(budget) is not None

    def why_over(self, budget: Budget) -> str:
        """Which budget ended the run before its last round, in words; empty where none did."""
        spent = self._spent(budget)
        if spent is None or self.rounds_done >= budget.rounds:
            return ""
        key, unit, what = KEYS[spent]
        total, left = budget.total[spent], self.left(budget)[spent]
        ending = f"so the run ends before round {self.next_round}"
        if round(left) == 0:
            return f"the {what} of {total:g} {unit} ({key}) is spent, {ending}"
        if left < 0.0:
            rest = f"{math.ceil(-left)} {unit} more than allowed were used"
        else:
            whole = budget.whole_round[spent]
            rest = f"{left:.0f} {unit} are left, and a whole round takes {whole:.0f}"
        return f"of the {what} of {total:g} {unit} ({key}) {rest}, {ending}"

    def left(self, budget: Budget) -> Amount:
        """Remaining budgets: metres, seconds, joules."""
        return Amount(*(total - used for total, used in zip(budget.total, self.used, strict=True)))

    def used_with(self, cost: Amount, budget: Budget) -> Amount:
        """Return what is used after a round of this cost; metres never exceed their budget."""
        metres = min(cost.metres, self.left(budget).metres)
        costs = (metres, cost.seconds, cost.joules)
        return Amount(*(used + more for used, more in zip(self.used, costs, strict=True)))

    def _spent(self, budget: Budget) -> int | None:
        """Return the index of the first budget that pays for no whole round; None where all do."""
        for index, (left, share) in enumerate(zip(self.left(budget), ENOUGH, strict=True)):
            cost = min(budget.whole_round[index], budget.total[index])
            if math.isfinite(left) and (left < cost * share or left <= 0.0):
                return index
        return None


def rounds_paid_for(budget: Budget) -> int:
    """How many whole rounds the budgets pay for in any case; at most the mission's rounds.

    There may be more of them: a flight that cuts corners costs less than its plan was allowed.
    """
    rounds = budget.rounds
    for total, cost in zip(budget.total, budget.whole_round, strict=True):
        if math.isfinite(total) and cost > 0.0:
            rounds = min(rounds, max(1, math.floor(total / (cost * ENOUGH.metres))))
    return rounds
