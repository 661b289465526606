"""Curves of a sweep: the mean over seeds, with its 95 % interval, of every strategy."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from mission.errors import InputError
from mission.palette import community_colour
from mission.sweep.results import RunResult
from mission.sweep.stats import band

Floats = NDArray[np.float64]
Groups: TypeAlias = Mapping[str, Sequence[RunResult]]

_POINTS = 200  # of a curve over distance or time
_DPI = 150
_GRID = "#D9DDE2"
_TEXT = "#1F2933"


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


def draw_sweep(folder: Path, results: Sequence[RunResult]) -> tuple[Path, ...]:
    """Draw the sweep's pictures into `folder/figures`; returns the files.

    Strategies that fly nothing are left out where distance, time or packet error rates matter.

    Raises:
        InputError: they cannot be written.
    """
    groups, communities = groups_of(results), communities_of(results)
    flying = {
        label: runs for label, runs in groups.items() if float(runs[0].summary["simulated_s"]) > 0
    }
    accuracy = [(f"accuracy_{name}", f"{name}: validation accuracy") for name in communities]
    pictures = {"accuracy-rounds.png": _curves(groups, accuracy, by_round)}
    if flying:
        pictures |= {
            "accuracy-distance.png": _curves(flying, accuracy, by_distance),
            "accuracy-time.png": _curves(flying, accuracy, by_time),
            "per.png": _curves(
                flying,
                [("plan_per", "mean PER, planned"), ("true_per", "mean PER, true position")],
                by_round,
            ),
        }
    pictures["participation.png"] = _curves(
        groups, [("participation", "devices whose update arrived")], by_round
    )
    fairness = [("jain_communities", "Jain index over communities")]
    fairness += [(f"cov_{name}", f"{name}: CoV ψ over devices") for name in communities]
    pictures["fairness.png"] = _curves(groups, fairness, by_round)
    target = folder / "figures"
    try:
        target.mkdir(exist_ok=True)
        for name, figure in pictures.items():
            figure.savefig(target / name)
    except OSError as error:
        raise InputError(f"{target}: cannot write the figures: {error.strerror}") from None
    return tuple(target / name for name in pictures)


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


def _curves(groups: Groups, panels: Sequence[tuple[str, str]], sampling: Sampling) -> Figure:
    figure = Figure(figsize=(7.6, 1.0 + 2.9 * len(panels)), dpi=_DPI, layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (column, title) in zip(axes, panels, strict=True):
        for index, (label, runs) in enumerate(groups.items()):
            having = [run for run in runs if run.rounds and column in run.rounds[0]]
            if having:
                _line(axis, *sampling(having, column), label=label, colour=community_colour(index))
        # An interval may reach beyond what the quantity can be; the picture need not.
        low, high = axis.get_ylim()
        axis.set_ylim(max(low, -0.02), high if column.startswith("cov_") else min(high, 1.02))
        axis.set_title(title, loc="left", fontsize=10, color=_TEXT)
        _plain(axis)
    axes[-1].set_xlabel(_LABELS[sampling])
    if sampling is by_round:
        axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    handles, labels = axes[0].get_legend_handles_labels()
    seeds = max(len(runs) for runs in groups.values())
    if seeds > 1:
        figure.suptitle(
            f"Mean over {seeds} seeds, 95 % interval", x=0.01, ha="left", fontsize=9, color=_TEXT
        )
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(len(labels), 5), frameon=False,
        fontsize=9,
    )  # fmt: skip
    return figure


def _line(axis: Axes, x: Floats, values: Floats, *, label: str, colour: str) -> None:
    mean, half = band(values)
    axis.plot(x, mean, color=colour, lw=1.6, label=label, marker="o" if len(x) <= 12 else "", ms=4)
    if len(values) > 1:
        axis.fill_between(x, mean - half, mean + half, color=colour, alpha=0.15, lw=0)


def _plain(axis: Axes) -> None:
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axis.spines[side].set_color("#9AA5B1")
    axis.tick_params(colors=_TEXT, labelsize=9)
    axis.xaxis.label.set_color(_TEXT)
    axis.set_axisbelow(True)
    axis.yaxis.grid(visible=True, color=_GRID, lw=0.8)
