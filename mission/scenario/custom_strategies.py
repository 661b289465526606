"""A researcher's own strategy: what it is told, and how its answers are checked."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from fl.plugins import PlugIn
from mission.base.area import Area
from mission.base.arrays import Floats, Ints
from mission.base.errors import InfeasiblePlanError, PlanError, PlanInputError
from mission.base.explain import shown
from mission.config.models import MissionConfig
from mission.planner.check import check_plan
from mission.planner.fleet.mending import kept_apart
from mission.planner.plan import Planner
from mission.planner.problem import RoundProblem
from mission.scenario.strategies import Sortie


@dataclass(frozen=True)
class StrategyContext:
    """What a strategy's factory is given: `factory(context) -> Strategy`."""

    mission: MissionConfig  # the table `mission` of the configuration
    planner: Planner  # the one that the configuration names
    devices_m: Floats  # (K, 2) area coordinates in metres: x east, y north
    area: Area  # size_m and home_m in metres; from_ned and to_ned cross into the flight's frame
    seed: int  # of the run: draw from np.random.default_rng((seed, round)) and nothing else


@dataclass(frozen=True)
class RoundInfo:
    """What the UAV knows before a round, for a strategy that weighs devices in its own way."""

    round: int  # about to be planned, from 1
    delta: Floats  # (K,) the paper's importance, with or without fairness as the strategy says
    p: Floats  # (K,) share in (0, 1] of each device in its community's data
    cov: Floats  # (K,) psi of each device's community, 0 or more
    community_of: Ints  # (K,) index of each device's community, from 0
    last_heard: Ints  # (K,) round of the last update that arrived; 0: none yet
    accuracy: Floats  # (K,) eps_k as each device last sent it, 0 to 1; NaN: never heard
    # (K,) seconds until it has an update to send, 0: at once. Told as if the round began now: where
    # the altitude is chosen, a climb comes first, and who still trains is ready sooner by its time.
    ready_in_s: Floats
    staleness: Ints  # (K,) rounds since the model of that update came down; 0: this

    @property
    def age_rounds(self) -> Ints:
        """(K,) age of information: rounds since the last update; 1 for one of the last round."""
        return self.round - self.last_heard


@runtime_checkable
class ImportanceStrategy(Protocol):
    """A strategy with an importance of its own, which the planner then maximises."""

    def importance(self, info: RoundInfo) -> Floats:
        """Return importance (K,), finite, 0 or more, by `info` alone: so runs can be resumed."""


class CustomStrategy(PlugIn):
    """A researcher's own strategy, whose answers are checked where they are made."""

    setting = "mission.strategy"
    members = ("fairness", "approach_m", "sortie")

    @property
    def fairness(self) -> bool:
        """Whether importance carries the coefficient of variation; see `Strategy.fairness`."""
        fairness = self.value("fairness")
        if not isinstance(fairness, bool | np.bool_):
            self.refuse(f"fairness is {shown(fairness)}: must be True or False")
        return bool(fairness)

    @property
    def approach_m(self) -> Floats | None:
        """(2,) position before the first round, area coordinates in m; None: above home."""
        place_m = self.value("approach_m")
        return None if place_m is None else self.array(place_m, "approach_m", shape=(2,))

    def importance(self, info: RoundInfo) -> Floats:
        """The importance that the strategy gives devices, (K,); where it gives none, the paper's.

        Raises:
            UsersCodeError: of the wrong shape, negative or not finite.
        """
        if not isinstance(self.inner, ImportanceStrategy):
            return info.delta
        of = f" in round {info.round}"
        importance = self.ask("importance", info, of=of)
        what = f"what importance(){of} gives"
        return self.array(importance, what, shape=info.delta.shape, low=0.0)

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The strategy's sortie, if its plan keeps the round's constraints; where aircraft come too
        near to each other, mended.

        Raises:
            UsersCodeError: no `Sortie`.
            PlanError: the plan breaks a constraint.
        """
        of = f" in round {round_index + 1}"
        try:
            sortie = self.of_kind(
                self.ask("sortie", round_index, problem, of=of), Sortie, f"sortie(){of}"
            )
            with self.guarded("its plan"):
                near = replace(problem, separation_m=0.0)  # what is too near is mended
                check_plan(near, sortie.plan, hold_s=sortie.hold_s)
        except PlanInputError as error:  # which knows no strategy
            self.refuse(f"round {round_index + 1}: {error}")
        except InfeasiblePlanError as error:
            reason = f"round {round_index + 1}: {error}"
            raise PlanError(f"{self.key} = {self.name!r}: {reason}") from None
        return replace(sortie, plan=kept_apart(problem, sortie.plan, hold_s=sortie.hold_s))
