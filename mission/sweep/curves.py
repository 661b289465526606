"""What a sweep shows: groups of runs, and curves over rounds, distance and time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mission.sweep.results import RunResult

Floats = NDArray[np.float64]
Groups: TypeAlias = Mapping[str, Sequence[RunResult]]

_POINTS = 200  # of a curve over distance or time


def groups_of(results: Sequence[RunResult]) -> dict[str, list[RunResult]]:
    """Results by what they have in common beside the seed, in order of appearance."""
    groups: dict[str, list[RunResult]] = {}
    for result in results:
        groups.setdefault(result.label, []).append(result)
    return groups


def communities_of(results: Sequence[RunResult]) -> list[str]:
    """Names of all communities, in order of appearance."""
    prefix = "final_accuracy_"
    names = (key.removeprefix(prefix) for r in results for key in r.summary if prefix in key)
    return list(dict.fromkeys(names))


Sampling: TypeAlias = Callable[[Sequence[RunResult], str], tuple[Floats, Floats]]


def by_round(runs: Sequence[RunResult], column: str) -> tuple[Floats, Floats]:
    """Round numbers that every run has, and (runs, rounds) values."""
    shortest = min(len(run.rounds) for run in runs)
    values = np.array([run.curve(column)[:shortest] for run in runs])
    return np.arange(1.0, shortest + 1.0), values


def by_distance(runs: Sequence[RunResult], column: str) -> tuple[Floats, Floats]:
    """Kilometres of path budget, and what held there: the value after the last round before."""
    return _held(runs, column, "budget_used_m", 1000.0)


def by_time(runs: Sequence[RunResult], column: str) -> tuple[Floats, Floats]:
    """Simulated minutes, and what held then."""
    return _held(runs, column, "end_t_s", 60.0)


def _held(runs: Sequence[RunResult], column: str, clock: str, unit: float) -> tuple[Floats, Floats]:
    """Where every run has finished a round and none has ended."""
    ends = [run.curve(clock) / unit for run in runs]
    grid = np.linspace(max(e[0] for e in ends), min(e[-1] for e in ends), _POINTS)
    values = [
        run.curve(column)[np.maximum(np.searchsorted(end, grid, side="right") - 1, 0)]
        for run, end in zip(runs, ends, strict=True)
    ]
    return grid, np.array(values)


_LABELS: dict[Sampling, str] = {
    by_round: "round",
    by_distance: "distance flown (km); in a hover, its cost",
    by_time: "simulated time (min)",
}


@dataclass(frozen=True)
class Picture:
    """Columns of `rounds.csv` against one axis."""

    name: str
    panels: tuple[tuple[str, str], ...]  # column and title of each
    sampling: Sampling
    groups: Groups
    order: tuple[str, ...]  # of all groups of the sweep, which gives each its colour

    @property
    def x_label(self) -> str:
        """What is along the axis."""
        return _LABELS[self.sampling]

    def curves(self, column: str) -> dict[str, tuple[Floats, Floats]]:
        """Axis and (runs, points) values of every group that has the column."""
        found = {}
        for label, runs in self.groups.items():
            having = [run for run in runs if run.rounds and column in run.rounds[0]]
            if having:
                found[label] = self.sampling(having, column)
        return found


def pictures_of(results: Sequence[RunResult]) -> tuple[Picture, ...]:
    """Everything that is worth a look.

    Strategies that fly nothing are left out where distance, time or packet error rates matter.
    """
    groups, communities = groups_of(results), communities_of(results)
    order = tuple(groups)
    flying = {
        label: runs for label, runs in groups.items() if float(runs[0].summary["simulated_s"]) > 0
    }
    accuracy = tuple((f"accuracy_{name}", f"{name}: validation accuracy") for name in communities)
    pictures = [Picture("accuracy-rounds", accuracy, by_round, groups, order)]
    if flying:
        per = (("plan_per", "mean PER, planned"), ("true_per", "mean PER, true position"))
        pictures += [
            Picture("accuracy-distance", accuracy, by_distance, flying, order),
            Picture("accuracy-time", accuracy, by_time, flying, order),
            Picture("per", per, by_round, flying, order),
        ]
    arrived = (("participation", "devices whose update arrived"),)
    cov = ((f"cov_{name}", f"{name}: CoV ψ over devices") for name in communities)
    fairness = (("jain_communities", "Jain index over communities"), *cov)
    return (
        *pictures,
        Picture("participation", arrived, by_round, groups, order),
        Picture("fairness", fairness, by_round, groups, order),
    )
