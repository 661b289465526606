"""A sweep's pictures: curves of every strategy, where they end, and what the method gains."""

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mission.base.palette import community_colour
from mission.figures.style import GRID, TEXT, new_figure, plain, save_figures
from mission.sweep.outcome.curves import (
    Curve,
    Panel,
    Picture,
    by_round,
    communities_of,
    pictures_of,
)
from mission.sweep.outcome.ends import EndRow, final_rows, gain_rows
from mission.sweep.outcome.view import final_rounds
from mission.sweep.results import RunResult

_WIDTH = 7.6  # inches
_ROW = 0.42  # of a strategy among the ends
_DOTTED = 12  # points of a line that are few enough to be marked


def draw_sweep(folder: Path, results: Sequence[RunResult]) -> None:
    """Draw the sweep's pictures into `folder/figures`.

    Raises:
        InputError: they cannot be written.
    """
    figures = {f"{item.name}.png": _curves(item) for item in pictures_of(results)}
    communities = communities_of(results)
    finals = {name: final_rows(results, name) for name in communities}
    figures["final.png"] = _ends(finals, f"final accuracy (%): {final_rounds(results)}")
    gains = {name: rows for name in communities if (rows := gain_rows(results, name))}
    if gains:
        label = "final accuracy of cov less the other's, same seed (points)"
        figures["gains.png"] = _ends(gains, label, zero=True)
    save_figures(figures, folder / "figures")


def _curves(picture: Picture) -> Figure:
    panels = picture.panels
    figure = new_figure(_WIDTH, 0.9 + 2.6 * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    colours = {label: community_colour(index) for index, label in enumerate(picture.order)}
    for axis, panel in zip(axes, panels, strict=True):
        for rank, (label, curve) in enumerate(picture.curves(panel).items()):
            _line(axis, curve, label=label, colour=colours[label], rank=rank)
        _fit(axis, panel)
        axis.set_title(panel.title, loc="left", fontsize=10, color=TEXT)
        plain(axis)
        axis.set_axisbelow(True)
        axis.yaxis.grid(visible=True, color=GRID, lw=0.8)
    axes[-1].set_xlabel(picture.x_label)
    axes[-1].margins(x=0.01)
    if picture.sampling is by_round:
        axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    if picture.about:
        figure.suptitle(picture.about, x=0.01, ha="left", fontsize=9, color=TEXT)
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 5 if max(map(len, labels)) < _DOTTED else 2
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(len(labels), columns),
        frameon=False, fontsize=9,
    )  # fmt: skip
    return figure


def _line(axis: Axes, curve: Curve, *, label: str, colour: str, rank: int) -> None:
    """The first group lies on top; one that nobody flew is dashed: it is a bound, not a rival."""
    axis.plot(
        curve.x, curve.mean,
        color=colour, lw=1.8, label=label, ls="-" if curve.flown else (0, (4, 2)),
        marker="o" if len(curve.x) <= _DOTTED else "", ms=4, zorder=3.0 - 0.01 * rank,
    )  # fmt: skip
    axis.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.10, lw=0)
    for edge in (curve.low, curve.high):
        axis.plot(curve.x, edge, color=colour, lw=0.6, alpha=0.45)


def _fit(axis: Axes, panel: Panel) -> None:
    """From zero or a little under the lowest, to what the quantity can be at most."""
    low, high = axis.get_ylim()
    axis.set_ylim(max(low, -0.02 * high), min(high, 1.02 * panel.most))


def _ends(groups: dict[str, list[EndRow]], label: str, *, zero: bool = False) -> Figure:
    """A panel a community, a row a strategy: mean, its interval, every seed."""
    longest = max(len(rows) for rows in groups.values())
    figure = new_figure(_WIDTH, 0.9 + _ROW * longest)
    axes = figure.subplots(1, len(groups), squeeze=False)[0]
    for axis, (name, rows) in zip(axes, groups.items(), strict=True):
        for y, row in enumerate(rows):
            axis.plot(row.ends, (y, y), color=row.colour, lw=5, alpha=0.3, solid_capstyle="butt")
            axis.plot(
                row.values, [y] * len(row.values), "o", mfc="none", mec=row.colour, ms=6, mew=1.2
            )
            axis.plot([row.mean], [y], "o", color=row.colour, ms=6)
        axis.set_yticks(range(len(rows)), [row.label for row in rows] if axis is axes[0] else [])
        axis.set_ylim(len(rows) - 0.5, -0.5)
        if zero:
            axis.axvline(0.0, color=TEXT, lw=1.0)
        low, high = axis.get_xlim()
        axis.set_xlim(_reach(rows, low=low, high=high))
        axis.set_title(name, loc="left", fontsize=10, color=TEXT)
        plain(axis)
        axis.spines["left"].set_visible(False)
        axis.tick_params(axis="y", length=0)
        axis.set_axisbelow(True)
        axis.xaxis.grid(visible=True, color=GRID, lw=0.8)
    figure.supxlabel(label, fontsize=9, color=TEXT)
    figure.suptitle(
        "dot: mean over seeds, bar: its 95 % interval, rings: seeds",
        x=0.01, ha="left", fontsize=9, color=TEXT,
    )  # fmt: skip
    return figure


def _reach(rows: Sequence[EndRow], *, low: float, high: float) -> tuple[float, float]:
    """No wider than three times what the seeds reach: two seeds' intervals may be endless."""
    values = [value for row in rows for value in row.values]
    span = max(values) - min(values)
    if not span > 0.0 or not math.isfinite(span):
        return low, high
    return max(low, min(values) - span), min(high, max(values) + span)
