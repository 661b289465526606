"""How every picture looks: paper, ink, margins and legends."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

GRID = "#D9DDE2"
TEXT = "#1F2933"
_AXIS = "#9AA5B1"
_DPI = 150


def new_figure(width: float, height: float) -> Figure:
    """An empty picture of that many inches."""
    engine = ConstrainedLayoutEngine(h_pad=0.09, w_pad=0.09)  # inches: room for the titles
    return Figure(figsize=(width, height), dpi=_DPI, layout=engine)


def add_legend(figure: Figure, handles: Sequence[Line2D], *, columns: int = 8) -> None:
    """A legend under the picture."""
    labels = [str(handle.get_label()) for handle in handles]
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )


def plain(axes: Axes) -> None:
    """Only the axes that carry numbers, in quiet colours."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(_AXIS)
    axes.tick_params(colors=TEXT, labelsize=9)
    axes.xaxis.label.set_color(TEXT)
    axes.yaxis.label.set_color(TEXT)
