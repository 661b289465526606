"""What a sweep shows: groups of runs, their means with intervals, and curves over rounds, distance
and time.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.special import stdtrit

from mission.base.arrays import Floats
from mission.base.palette import COLOURS
from mission.sweep.results import RunResult, communities_of

Groups: TypeAlias = Mapping[str, Sequence[RunResult]]

_TOLD_APART = 2 * COLOURS  # curves in one chart
CONFIDENCE = 0.95
ENOUGH = 3  # values: the interval of two is 13 times as wide as their standard error


@dataclass(frozen=True)
class Interval:
    """A mean and the half-width of its 95 % confidence interval."""

    mean: float
    half: float  # NaN with fewer than three values


def interval(values: Sequence[float] | Floats) -> Interval:
    """Mean over independent runs with Student's t interval; NaN for no values."""
    mean, half = band(np.asarray(values, dtype=np.float64).reshape(-1, 1))
    return Interval(float(mean[0]), float(half[0]))


def band(curves: Floats) -> tuple[Floats, Floats]:
    """Return mean and 95 % half-width at every point of (runs, points) curves: (points,) each.

    Of fewer than three runs the half-width is NaN: nothing can be said.
    """
    count = len(curves)
    if count == 0:
        nothing = np.full(curves.shape[1:], math.nan)
        return nothing, nothing
    mean = np.asarray(curves.mean(axis=0), dtype=np.float64)
    if count < ENOUGH:
        return mean, np.full_like(mean, math.nan)
    student = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2.0))
    spread = curves.std(axis=0, ddof=1)
    return mean, np.asarray(student * spread / math.sqrt(count), dtype=np.float64)


def groups_of(results: Sequence[RunResult]) -> dict[str, list[RunResult]]:
    """Group results by strategy and settings (`Point.label`), in order of appearance."""
    groups: dict[str, list[RunResult]] = {}
    for result in results:
        groups.setdefault(result.point.label, []).append(result)
    return groups


def flies(runs: Sequence[RunResult]) -> bool:
    """Whether the group's runs take simulated flight time; those of `ideal` do not."""
    return float(runs[0].summary["simulated_s"]) > 0.0


@dataclass(frozen=True)
class Curve:
    """A group's mean along an axis, with its interval clipped to possible values; (points,)."""

    x: Floats
    mean: Floats
    low: Floats  # NaN where there are fewer than three seeds
    high: Floats
    flown: bool


@dataclass(frozen=True)
class Along:
    """The horizontal axis of curves: rounds, or the metres or seconds spent by their ends."""

    label: str
    clock: str = ""  # column of `rounds.csv` that counts it; none: the rounds themselves
    unit: float = 1.0

    def sampled(self, runs: Sequence[RunResult], column: str) -> tuple[Floats, Floats]:
        """Return the axis (rounds,) and a column (runs, rounds) over the rounds that all runs have.

        A round stands at the mean of its ends: a grid of its own would show rounds where it
        happens to meet them, and the last one not at all. Accuracy begins at zero, with the
        untrained model, where all the runs know it.
        """
        shortest = min(len(run.rounds) for run in runs)
        values = np.array([run.curve(column)[:shortest] for run in runs])
        ends = np.arange(1.0, shortest + 1.0)
        if self.clock:
            clocks = np.array([run.curve(self.clock)[:shortest] for run in runs])
            ends = clocks.mean(axis=0) / self.unit
        before = [run.summary.get(f"untrained_{column}") for run in runs]
        if None in before:
            return ends, values
        start = np.array(before, dtype=np.float64)[:, None]
        return np.concatenate(([0.0], ends)), np.hstack((start, values))


ROUNDS = Along("round")
DISTANCE = Along("path budget used (km), mean over seeds", "budget_used_m", 1000.0)
TIME = Along("simulated time (min), mean over seeds", "end_t_s", 60.0)


@dataclass(frozen=True)
class Panel:
    """One column of `rounds.csv` and how it is shown."""

    column: str
    title: str
    axis: str  # title of the vertical one, with its unit
    unit: float = 1.0  # what it is multiplied by: 100 for percent
    most: float = math.inf  # what it can be, as shown; nothing here can be negative


@dataclass(frozen=True)
class Picture:
    """A figure of a sweep: panels of columns of `rounds.csv` against one axis, a curve a group."""

    name: str
    title: str
    panels: tuple[Panel, ...]
    along: Along
    groups: Groups
    order: tuple[str, ...]  # of all names of the sweep, which gives each its colour
    apart: tuple[str, ...] = ()  # settings that have charts of their own; there are many groups

    @property
    def about(self) -> str:
        """What the lines and areas are, in words."""
        counts = sorted({len(runs) for runs in self.groups.values()})
        parts = []
        if counts[-1] > 1:
            parts.append(f"mean over {'/'.join(map(str, counts))} seeds")
        if counts[-1] >= ENOUGH:
            parts.append("95 % interval")
        return ", ".join(parts)

    @property
    def end(self) -> float | None:
        """Last round shown, so that shorter runs can be seen; None: the axis is not cut."""
        if self.along is not ROUNDS:
            return None
        ends = sorted(self._ends().values())
        usual = ends[(len(ends) - 1) // 2]
        return float(usual) if ends[-1] > 2 * usual else None

    @property
    def x_label(self) -> str:
        """Label of the horizontal axis, with the groups that go on beyond its end."""
        label, end = self.along.label, self.end
        if end is None:
            return label
        beyond = [f"{name} to {last}" for name, last in self._ends().items() if last > 2 * end]
        return f"{label} ({', '.join(beyond)})"

    def _ends(self) -> dict[str, int]:
        """Return the last round of each group's longest run."""
        return {name: max(len(run.rounds) for run in runs) for name, runs in self.groups.items()}

    def curves(self, panel: Panel, where: str = "") -> dict[str, Curve]:
        """Return curves of a panel by group; with `where`, of that setting only, by strategy."""
        found = {}
        for label, runs in self.groups.items():
            if where:
                label = runs[0].point.strategy
                if runs[0].point.where != where:
                    continue
            having = [run for run in runs if run.rounds and panel.column in run.rounds[0]]
            if not having:
                continue
            x, values = self.along.sampled(having, panel.column)
            if self.end is not None:
                values = values[:, x <= self.end]
                x = x[x <= self.end]
            mean, half = band(panel.unit * values)
            low, high = (np.clip(edge, 0.0, panel.most) for edge in (mean - half, mean + half))
            found[label] = Curve(x, mean, low, high, flown=flies(runs))
        return found


def pictures_of(results: Sequence[RunResult]) -> tuple[Picture, ...]:
    """Pictures of a sweep: accuracy, packet error rate, participation, fairness.

    Strategies that fly nothing are left out where distance, time or packet error rates matter.
    Of more groups than can be told apart there are no curves.
    """
    groups, communities = groups_of(results), communities_of(results)
    if len(groups) > _TOLD_APART:
        return ()
    points = [runs[0].point for runs in groups.values()]
    strategies = tuple(dict.fromkeys(point.strategy for point in points))
    settings = tuple(dict.fromkeys(point.where for point in points))
    # So many curves in one chart would cover each other.
    many = len(groups) > COLOURS and 1 < len(strategies) < len(groups)
    order, apart = (strategies, settings) if many else (tuple(groups), ())
    flying = {label: runs for label, runs in groups.items() if flies(runs)}
    flown = {runs[0].point.where for runs in flying.values()}
    apart_flown = tuple(where for where in apart if where in flown)
    accuracy = tuple(
        Panel(f"accuracy_{name}", f"{name}: accuracy", "accuracy (%)", 100.0, 100.0)
        for name in communities
    )
    pictures = [
        Picture("accuracy-rounds", "Accuracy by round", accuracy, ROUNDS, groups, order, apart)
    ]
    if flying:
        per = (
            Panel("plan_per", "Planned", "mean PER", most=1.0),
            Panel("true_per", "At the true position", "mean PER", most=1.0),
        )
        pictures += [
            Picture(name, title, panels, along, flying, order, apart_flown)
            for name, title, panels, along in (
                ("accuracy-distance", "Accuracy by distance", accuracy, DISTANCE),
                ("accuracy-time", "Accuracy by time", accuracy, TIME),
                ("per", "Packet error rate", per, ROUNDS),
            )
        ]
    arrived = (Panel("participation", "Devices whose update arrived", "devices (%)", 100.0, 100.0),)
    fairness = (
        Panel("jain_communities", "Fairness over communities", "Jain index", most=1.0),
        *(Panel(f"cov_{name}", f"{name}: over its devices", "CoV ψ") for name in communities),
    )
    return (
        *pictures,
        Picture("participation", "Participation", arrived, ROUNDS, groups, order, apart),
        Picture("fairness", "Fairness", fairness, ROUNDS, groups, order, apart),
    )
