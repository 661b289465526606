"""Curves of a sweep: the mean over seeds, with its 95 % interval, of every strategy."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mission.errors import InputError
from mission.palette import community_colour
from mission.sweep.curves import Floats, Picture, by_round, pictures_of
from mission.sweep.results import RunResult
from mission.sweep.stats import band

_DPI = 150
_GRID = "#D9DDE2"
_TEXT = "#1F2933"


def draw_sweep(folder: Path, results: Sequence[RunResult]) -> tuple[Path, ...]:
    """Draw the sweep's pictures into `folder/figures`; returns the files.

    Raises:
        InputError: they cannot be written.
    """
    pictures = {f"{item.name}.png": _draw(item) for item in pictures_of(results)}
    target = folder / "figures"
    try:
        target.mkdir(exist_ok=True)
        for name, figure in pictures.items():
            figure.savefig(target / name)
    except OSError as error:
        raise InputError(f"{target}: cannot write the figures: {error.strerror}") from None
    return tuple(target / name for name in pictures)


def _draw(picture: Picture) -> Figure:
    panels = picture.panels
    figure = Figure(figsize=(7.6, 1.0 + 2.9 * len(panels)), dpi=_DPI, layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    colours = {label: community_colour(index) for index, label in enumerate(picture.order)}
    for axis, (column, title) in zip(axes, panels, strict=True):
        for label, (x, values) in picture.curves(column).items():
            _line(axis, x, values, label=label, colour=colours[label])
        # An interval may reach beyond what the quantity can be; the picture need not.
        low, high = axis.get_ylim()
        axis.set_ylim(max(low, -0.02), high if column.startswith("cov_") else min(high, 1.02))
        axis.set_title(title, loc="left", fontsize=10, color=_TEXT)
        _plain(axis)
    axes[-1].set_xlabel(picture.x_label)
    if picture.sampling is by_round:
        axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    handles, labels = axes[0].get_legend_handles_labels()
    seeds = max(len(runs) for runs in picture.groups.values())
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
