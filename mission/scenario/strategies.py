"""Where a round goes and whom it serves: the paper's method and its baselines, and a researcher's
own strategy: what it is told, and how its answers are checked."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from fl.plugins import PlugIn
from mission.base import polyline
from mission.base.area import Area
from mission.base.arrays import Floats, Ints
from mission.base.errors import InfeasiblePlanError, InputError, PlanError, PlanInputError
from mission.base.explain import shown
from mission.config.models import MissionConfig
from mission.planner.check import check_plan
from mission.planner.evaluate import finish, fit_budget
from mission.planner.fleet.mending import kept_apart
from mission.planner.improving import serving_fewer
from mission.planner.limits import RoundLimits
from mission.planner.performance import acceptance_radii
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem

_BEGINS, _HALVINGS = 96, 12  # starts of a stretch that are tried; bisections of its length


@dataclass(frozen=True)
class Sortie:
    """What one round flies, and what it costs of the budget."""

    plan: RoundPlan
    hold_s: float = 0.0  # seconds of hover at each stop, 0 or more
    cost_m: float | None = None  # of L_total; None: the metres flown, L_max at most

    def __post_init__(self) -> None:
        """Refuse what cannot be flown.

        Raises:
            ValueError: negative or not finite.
        """
        for name, value in (("hold_s", self.hold_s), ("cost_m", self.cost_m or 0.0)):
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} = {value}: must be a finite number of 0 or more")


class Strategy(Protocol):
    """A policy that chooses paths and schedule of each round.

    A strategy of one's own, which serves only those who count more than others:

    >>> from dataclasses import replace
    >>> import aerofed, numpy as np
    >>> class Upper:
    ...     fairness, approach_m = True, None
    ...     def __init__(self, planner):
    ...         self.planner = planner
    ...     def sortie(self, round_index, problem):
    ...         delta = problem.importance
    ...         few = replace(problem, importance=np.where(delta > delta.mean(), delta, 0.0))
    ...         return aerofed.Sortie(self.planner.plan(few))
    >>> first = aerofed.first_problem("quickstart")
    >>> from mission.planner.sqp import SqpPlanner
    >>> plan = Upper(SqpPlanner()).sortie(0, first).plan
    >>> plan.schedule.shape == (1, first.steps, len(first.devices_m))
    True
    """

    @property
    def fairness(self) -> bool:
        """Whether importance carries the coefficient of variation."""

    @property
    def approach_m(self) -> Floats | None:
        """(2,) where to be before the first round, area coordinates in m, or (A, 2) for each
        aircraft; None: above home."""

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """Plan one round from the starts in `problem`; `round_index` counts from 0."""


@dataclass(frozen=True)
class Optimised:
    """Path and schedule by a planner: the paper's method, or No-CoV without fairness."""

    planner: Planner
    fairness: bool
    approach_m: Floats | None = None

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        """Plan the round with the planner."""
        return Sortie(self.planner.plan(problem))


@dataclass(frozen=True)
class Barycenter:
    """Baseline 1: hover at the mean device position; a fixed time and budget a round."""

    approach_m: Floats
    hover_s: float
    cost_m: float
    fairness: bool = True

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        """Hover at the round's start for all N steps, with the best schedule there."""
        path = np.tile(problem.start_m, (problem.steps, 1))
        plan = serving_fewer(
            problem, finish(problem, path, hold_s=self.hover_s), hold_s=self.hover_s
        )
        return Sortie(plan, hold_s=self.hover_s, cost_m=self.cost_m)


@dataclass(frozen=True)
class Rectangular:
    """Baseline 2: a fixed rectangular tour; each round covers its next `length_m` metres.

    The N steps of a round are points spread over that stretch. The tour's corners are among them
    where N allows it; else steps are spaced evenly, and may cut corners.
    """

    corners_m: Floats  # (4, 2) in order of flight
    length_m: float  # L_max
    fairness: bool = True

    @property
    def approach_m(self) -> Floats:
        """(2,) the first corner of the tour, area coordinates in m."""
        return np.asarray(self.corners_m[0])

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The next stretch of the tour, with the best schedule on it."""
        # Shorter than L_max where less of L_total is left, or less fits into the round's limits.
        most_m = min(self.length_m, problem.path_budget_m)
        length_m = longest(
            most_m, lambda m: _fits(problem.limits, self._tour(round_index, m, problem))
        )
        tour = self._tour(round_index, length_m, problem)
        plan = finish(problem, fit_budget(tour, problem.path_budget_m))
        return Sortie(serving_fewer(problem, plan))

    def _tour(self, round_index: int, length_m: float, problem: RoundProblem) -> Floats:
        """(N, 2) waypoints over `length_m` metres of the tour, from the round's start."""
        tour = stretch(self.corners_m, round_index * self.length_m, length_m, problem.steps)
        # Where the last round ended, which is on the tour but for the error of flight.
        tour[0] = problem.start_m
        return tour


FIXED_PATHS = (Barycenter, Rectangular)  # that ask no planner


def stretch(corners_m: Floats, start_m: float, length_m: float, steps: int) -> Floats:
    """(steps, 2) points over `length_m` metres of a closed polygon from arc length `start_m`.

    Corners on the way are among the points where there are enough steps for all of them.
    """
    ends = _ends(corners_m, start_m, length_m)
    if steps - 1 < len(ends) - 1:
        arc = np.linspace(ends[0], ends[-1], steps)
    else:
        lengths = np.diff(ends)
        legs = np.ones(len(lengths), dtype=int)
        for _ in range(steps - 1 - len(lengths)):
            legs[np.argmax(lengths / legs)] += 1
        pieces = [
            np.linspace(a, b, n, endpoint=False)
            for a, b, n in zip(ends[:-1], ends[1:], legs, strict=True)
        ]
        arc = np.concatenate([*pieces, ends[-1:]])
    return _along(corners_m, arc)


def _closed(corners_m: Floats) -> Floats:
    return np.vstack((corners_m, corners_m[:1]))


def _ends(corners_m: Floats, start_m: float, length_m: float) -> Floats:
    """Arc lengths of the start of a stretch, of the corners on it, and of its end."""
    knots = polyline.along(_closed(corners_m))
    perimeter = float(knots[-1])
    start = math.fmod(start_m, perimeter)
    laps = np.arange(math.ceil((start + length_m) / perimeter) + 1)[:, None] * perimeter
    inner = (knots[None, :-1] + laps).ravel()
    inner = inner[(inner > start + 1e-6) & (inner < start + length_m - 1e-6)]
    return np.concatenate(([start], inner, [start + length_m]))


def _along(corners_m: Floats, arc: Floats) -> Floats:
    """(n, 2) points of a closed polygon at arc lengths."""
    closed = _closed(corners_m)
    knots = polyline.along(closed)
    return polyline.at(np.mod(arc, knots[-1]), knots, closed)


def _stretch_m(corners_m: Floats, config: MissionConfig, limits: RoundLimits | None) -> float:
    """Metres of the tour that a round covers: L_max, less where its limits allow less anywhere."""
    begins = np.linspace(0.0, polyline.length(_closed(corners_m)), _BEGINS, endpoint=False).tolist()
    return longest(
        config.path_budget_m,
        lambda length_m: all(
            _fits(limits, stretch(corners_m, begin, length_m, config.steps)) for begin in begins
        ),
    )


def longest(most_m: float, fits: Callable[[float], bool], *, halvings: int = _HALVINGS) -> float:
    """Return the greatest length in metres up to `most_m` that `fits`, by bisection; else 0."""
    if fits(most_m):
        return most_m
    fitting_m = 0.0
    for _ in range(halvings):
        middle_m = (fitting_m + most_m) / 2.0
        if fits(middle_m):
            fitting_m = middle_m
        else:
            most_m = middle_m
    return fitting_m


def _fits(limits: RoundLimits | None, path: Floats) -> bool:
    """Whether the flight of a path (N, 2) with the sharpest corners keeps to a round's limits."""
    if limits is None:
        return True
    performance = limits.performance
    sharpest_m = float(acceptance_radii(performance.widest_m)[-1])
    return limits.fits(performance.foresee(path, [0.0] * len(path), sharpest_m))


def make_strategy(
    config: MissionConfig,
    planner: Planner,
    *,
    devices_m: Floats,
    area: Area,
    limits: RoundLimits | None = None,
) -> Strategy | None:
    """The strategy that the configuration names; None for `ideal`, which flies nothing.

    Raises:
        InputError: no strategy of ours has that name.
    """
    match config.strategy:
        case "cov" | "no_cov":
            return Optimised(planner, fairness=config.strategy == "cov")
        case "barycenter":
            return Barycenter(devices_m.mean(axis=0), config.hover_s, config.hover_cost_m)
        case "rectangular":
            width, height = area.size_m
            low, high = config.tour_inset, 1.0 - config.tour_inset
            corners = np.array([[low, low], [high, low], [high, high], [low, high]])
            corners *= (width, height)
            return Rectangular(corners, _stretch_m(corners, config, limits))
        case "ideal":
            return None
        case other:
            raise InputError(f"mission.strategy = {other!r}: no strategy of ours")


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
