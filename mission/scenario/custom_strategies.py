"""A researcher's own strategy, held to what every strategy must keep."""

from dataclasses import dataclass
from typing import NoReturn, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fl.errors import kind_of
from mission.base.area import Area
from mission.base.errors import InputError, PlanError
from mission.base.user_code import make_from, users_code
from mission.config.models import MissionConfig
from mission.planner.check import check_plan
from mission.planner.errors import InfeasiblePlanError, PlanInputError
from mission.planner.problem import Planner, RoundProblem
from mission.scenario.strategies import Sortie, Strategy

Floats = NDArray[np.float64]

KEY = "mission.strategy"


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
    community_of: NDArray[np.int64]  # (K,) index of each device's community, from 0
    last_heard: NDArray[np.int64]  # (K,) round of the last update that arrived; 0: none yet
    accuracy: Floats  # (K,) eps_k as each device last sent it, 0 to 1; NaN: never heard
    # (K,) seconds until it has an update to send, 0: at once. Told as if the round began now: where
    # the altitude is chosen, a climb comes first, and who still trains is ready sooner by its time.
    ready_in_s: Floats
    staleness: NDArray[np.int64]  # (K,) rounds since the model of that update came down; 0: this

    @property
    def age_rounds(self) -> NDArray[np.int64]:
        """(K,) age of information: rounds since the last update; 1 for one of the last round."""
        return self.round - self.last_heard


@runtime_checkable
class ImportanceStrategy(Protocol):
    """A strategy with an importance of its own, which the planner then maximises."""

    def importance(self, info: RoundInfo) -> Floats:
        """(K,) finite, not negative; a function of `info` alone, so that runs can be resumed."""


@dataclass(frozen=True)
class CustomStrategy:
    """Checks what the researcher's strategy answers, so that an error is found where it is made."""

    path: str
    inner: Strategy

    @property
    def fairness(self) -> bool:
        """What the researcher's strategy says."""
        with users_code(self.path, key=KEY, doing="fairness"):
            return bool(self.inner.fairness)

    @property
    def approach_m(self) -> Floats | None:
        """What the researcher's strategy says."""
        with users_code(self.path, key=KEY, doing="approach_m"):
            return self.inner.approach_m

    def importance(self, info: RoundInfo) -> Floats:
        """The importance that the strategy gives devices, (K,); where it gives none, the paper's.

        Raises:
            InputError: of the wrong shape, negative or not finite.
        """
        if not isinstance(self.inner, ImportanceStrategy):
            return info.delta
        with users_code(self.path, key=KEY, doing=f"importance() in round {info.round}"):
            importance = np.asarray(self.inner.importance(info), dtype=np.float64)
        if importance.shape != info.delta.shape:
            shapes = f"of shape {importance.shape}, not {info.delta.shape}"
            self._refuse(f"importance in round {info.round} is {shapes}")
        wrong = np.flatnonzero(~(np.isfinite(importance) & (importance >= 0.0)))
        if len(wrong):
            which = f"{importance[wrong[0]]} for device {wrong[0]}"
            self._refuse(f"importance in round {info.round} is negative or not finite: {which}")
        return importance

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The strategy's sortie, if its plan keeps the round's constraints.

        Raises:
            InputError: no `Sortie`.
            PlanError: the plan breaks a constraint.
        """
        with users_code(self.path, key=KEY, doing=f"sortie() in round {round_index + 1}"):
            sortie = self._sortie(round_index, problem)
        if not isinstance(sortie, Sortie):
            self._refuse(f"sortie() gives {kind_of(sortie)}, not a Sortie")
        try:
            with users_code(self.path, key=KEY, doing="its plan"):
                check_plan(problem, sortie.plan, hold_s=sortie.hold_s)
        except InfeasiblePlanError as error:
            raise PlanError(f"{KEY} = {self.path!r}: round {round_index + 1}: {error}") from None
        return sortie

    def _sortie(self, round_index: int, problem: RoundProblem) -> object:
        try:
            return self.inner.sortie(round_index, problem)
        except PlanInputError as error:  # of what it gave to our functions, which know no strategy
            raise InputError(f"{KEY} = {self.path!r}: round {round_index + 1}: {error}") from None

    def _refuse(self, reason: str) -> NoReturn:
        raise InputError(f"{KEY} = {self.path!r}: {reason}")


def custom_strategy(path: str, context: StrategyContext) -> CustomStrategy:
    """The strategy that the factory at `path` makes.

    Raises:
        InputError: it cannot be imported, or what it makes is no strategy.
    """
    made = make_from(path, context, key=KEY, members=("fairness", "approach_m", "sortie"))
    return CustomStrategy(path, made)
