"""One round's planning problem and its answer: values only, no solver."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fl.radio.channel import Channel
from mission.base import polyline

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class RoundProblem:
    """Maximise sum_n sum_k omega_k[n] (1 - q_bar_k[n]) delta_k over path and schedule.

    Coordinates are area coordinates in metres (x east, y north).
    """

    devices_m: Floats  # (K, 2)
    importance: Floats  # (K,) delta
    start_m: Floats  # (2,) v_I, which is v[1]
    steps: int  # N
    per_step: int  # K_bar
    path_budget_m: float  # L_max
    channel: Channel


@dataclass(frozen=True)
class RoundPlan:
    """A feasible path and schedule with its true objective (exact average PER)."""

    waypoints_m: Floats  # (N, 2); the first is the start
    schedule: Bools  # (N, K)
    value: float
    upper_bound: float = field(default=float("nan"))  # NaN where the method proves none
    nodes: int = 0

    @property
    def gap(self) -> float:
        """(upper bound - value) / upper bound; 0 for a bound of 0, NaN without a bound."""
        if self.upper_bound == 0.0:
            return 0.0
        return (self.upper_bound - self.value) / self.upper_bound

    @property
    def path_m(self) -> float:
        """Length of the planned polyline in metres."""
        return polyline.length(self.waypoints_m)


class Planner(Protocol):
    """Anything that turns a round's problem into a plan."""

    def plan(self, problem: RoundProblem) -> RoundPlan:
        """Plan one round. The same problem gives the same plan on every machine."""
        ...
