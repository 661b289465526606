"""What a run has added up to, round by round, and what its path budget still pays for."""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from mission.base.arrays import Ints
from mission.config.models import MissionConfig
from mission.log.records import RoundRecord

_WITHIN_ROUNDING = 1.0 - 1e-9  # 800.1 m pay for 3 rounds of 266.7 m, also in binary fractions


@dataclass
class RunTotals:
    """Sums over the finished rounds; those of a flight under way are not in them yet."""

    last_heard: Ints  # (K,) round of each device's last update; 0: none yet
    rounds_done: int = 0
    budget_used_m: float = 0.0
    flown_m: float = 0.0
    sim_s: float = 0.0  # since power-up
    scheduled: int = 0
    delivered: int = 0
    battery_changes: int = 0
    accuracy: dict[str, float] = field(default_factory=dict)  # per community, after the last round
    untrained: dict[str, float] = field(default_factory=dict)  # the same, before the first

    @classmethod
    def before(cls, devices: int) -> Self:
        """Before the first round of a run with so many devices."""
        return cls(np.zeros(devices, dtype=np.int64))

    @property
    def next_round(self) -> int:
        """Number of the current or next round, from 1."""
        return self.rounds_done + 1

    def add(self, record: RoundRecord) -> None:
        """One more round is over."""
        self.rounds_done += 1
        self.budget_used_m = record.budget_used_m
        self.flown_m += record.flown_path_m
        self.scheduled += record.scheduled
        self.delivered += record.delivered
        self.accuracy = dict(record.accuracy)

    def is_over(self, mission: MissionConfig) -> bool:
        """Whether the rounds or the path budget are spent.

        What is left of the budget must pay for a whole round: a stub of one would end the run on
        models that few devices had a part in. Only the first round may be shorter.
        """
        if self.rounds_done >= mission.rounds:
            return True
        cost = min(round_cost_m(mission), mission.total_budget_m)
        left = self.left_m(mission)
        return left < cost * _WITHIN_ROUNDING or left <= 0.0

    def left_m(self, mission: MissionConfig) -> float:
        """Metres of the path budget that are not spent."""
        return mission.total_budget_m - self.budget_used_m


def round_cost_m(mission: MissionConfig) -> float:
    """What a whole round costs of the path budget at most, in metres."""
    return mission.hover_cost_m if mission.strategy == "barycenter" else mission.path_budget_m


def rounds_paid_for(mission: MissionConfig) -> int:
    """How many whole rounds the path budget pays for in any case; at most the mission's rounds.

    There may be more of them: a flight that cuts corners costs less than its plan was allowed.
    """
    cost = round_cost_m(mission) * _WITHIN_ROUNDING
    if cost == 0.0:
        return mission.rounds
    return min(mission.rounds, max(1, math.floor(mission.total_budget_m / cost)))
