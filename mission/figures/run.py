"""Pictures of a run: planned against flown, and what was learnt.

Like every module that draws, it uses figure objects only, none of pyplot's global state, so that
drawing works without a display and leaves nothing behind.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from mission.analysis.compare import Comparison, RunComparison
from mission.analysis.load import load_run
from mission.base.palette import community_colour
from mission.figures.maps import overview, round_maps
from mission.figures.style import (
    GRID,
    TEXT,
    add_legend,
    new_figure,
    plain,
    save_figure,
    save_figures,
)
from mission.log.records import RoundRecord


def draw_run(folder: Path) -> tuple[Path, ...]:
    """Draw a run's pictures into `folder/figures`: `map.png`, `rounds.png`, `learning.png`.

    A picture for which the run has no data (nothing flown, no round finished) is left out.
    Returns the files that were written.

    Raises:
        InputError: the folder is not a run, or the pictures cannot be written.
    """
    run = load_run(folder).data
    pictures: dict[str, Figure] = {}
    if run.plans and len(run.truth.t_ns):
        pictures["map.png"] = overview(run)
        pictures["rounds.png"] = round_maps(run)
    if run.rounds:
        pictures["learning.png"] = learning_curves(run.rounds)
    return save_figures(pictures, folder / "figures")


def draw_comparison(runs: Sequence[RunComparison], target: Path) -> Path:
    """Draw several runs into one picture, `comparison_figure`; returns the file.

    Raises:
        InputError: the picture cannot be written.
    """
    save_figure(comparison_figure(runs), target)
    return target


def comparison_figure(runs: Sequence[RunComparison]) -> Figure:
    """Runs against each other, round by round: tracking, timing, objective and arrivals."""
    figure = new_figure(9.6, 7.2)
    panels = figure.subplots(2, 2, sharex=True)
    kinds: tuple[tuple[str, Callable[[Comparison], float]], ...] = (
        ("cross-track rms on straights (m)", lambda c: c.straight_rms_m),
        ("slots late, mean (s)", lambda c: c.slot_late_mean_s),
        ("true objective", lambda c: c.true_objective),
        ("updates arrived", lambda c: float(c.delivered)),
    )
    for axes, (label, value) in zip(panels.flat, kinds, strict=True):
        for index, run in enumerate(runs):
            numbers = [item.round or 0 for item in run.rounds]
            axes.plot(
                numbers, [value(item) for item in run.rounds], color=community_colour(index),
                lw=1.7, marker="o" if len(numbers) <= 25 else "", ms=4,
            )  # fmt: skip
        axes.set_title(label, loc="left", fontsize=10, color=TEXT)
        axes.set_ylim(bottom=0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.grid(visible=True, color=GRID, lw=0.8)
        axes.set_axisbelow(True)
        plain(axes)
    for axes in panels[1]:
        axes.set_xlabel("round")
    add_legend(
        figure,
        [
            Line2D([], [], color=community_colour(index), lw=2, marker="o", ms=4, label=name)
            for index, name in enumerate(run.name for run in runs)
        ],
        columns=min(len(runs), 4),
    )
    return figure


def learning_curves(rounds: Sequence[RoundRecord]) -> Figure:
    """Accuracy and fairness CoV per community, and the updates that arrived, by round."""
    figure = new_figure(7.6, 7.2)
    accuracy, cov, updates = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1.3))
    numbers = [record.round for record in rounds]
    marker = "o" if len(numbers) <= 25 else ""
    for index, name in enumerate(rounds[0].accuracy):
        style: dict[str, Any] = {
            "color": community_colour(index), "lw": 1.8, "marker": marker, "ms": 4.5, "label": name,
        }  # fmt: skip
        accuracy.plot(numbers, [100 * record.accuracy[name] for record in rounds], **style)
        cov.plot(numbers, [record.cov[name] for record in rounds], **style)
    accuracy.set_ylabel("validation accuracy (%)")
    accuracy.set_ylim(0, 100)
    accuracy.legend(loc="lower right", frameon=False)
    cov.set_ylabel("fairness CoV ψ")
    cov.set_ylim(
        0, 1.08 * max(1e-3, *(value for record in rounds for value in record.cov.values()))
    )
    scheduled = [record.scheduled for record in rounds]
    updates.bar(numbers, scheduled, width=0.8, color=GRID, label="scheduled")
    updates.bar(
        numbers, [record.delivered for record in rounds], width=0.8, color="#009E73",
        label="delivered",
    )  # fmt: skip
    updates.set_ylabel("updates")
    updates.set_ylim(0, max(scheduled) * 1.45 + 1)
    updates.legend(loc="upper right", ncols=2, frameon=False, fontsize=9)
    updates.set_xlabel("round")
    updates.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in (accuracy, cov, updates):
        plain(axes)
        axes.set_axisbelow(True)
        axes.yaxis.grid(visible=True, color=GRID, lw=0.8)
    accuracy.set_title("What the communities learnt", loc="left", fontsize=12, color=TEXT)
    figure.align_ylabels()
    return figure
