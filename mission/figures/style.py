"""How every picture looks: paper, ink, margins and legends."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from mission.base.errors import InputError
from mission.base.palette import BAND, PLANNED
from mission.base.run_folder import write_atomically
from mission.log.values import Floats

GRID = "#D9DDE2"
TEXT = "#1F2933"
_AXIS = "#9AA5B1"
_DPI = 150
_UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def new_figure(width: float, height: float) -> Figure:
    """An empty picture of that many inches."""
    engine = ConstrainedLayoutEngine(h_pad=0.09, w_pad=0.09)  # inches: room for the titles
    return Figure(figsize=(width, height), dpi=_DPI, layout=engine)


def save_figure(figure: Figure, target: Path) -> None:
    """Write a picture of the kind that the file's name says; the same one gives the same bytes.

    Raises:
        InputError: it cannot be written, or it is no kind of picture.
    """
    drawn, kind = io.BytesIO(), target.suffix[1:].lower()
    try:
        with rc_context({"svg.hashsalt": "aerofed"}):
            if kind == "png":
                # The bytes of savefig, which would draw everything a first time for nobody.
                FigureCanvasAgg(figure).print_png(drawn)  # type: ignore[no-untyped-call]
            else:
                figure.savefig(drawn, format=kind or "none", metadata=_UNDATED.get(kind))
    except ValueError:
        raise InputError(f"{target}: not a kind of picture; use .png, .svg or .pdf") from None
    write_atomically(target, drawn.getvalue())


def save_figures(pictures: Mapping[str, Figure], folder: Path) -> tuple[Path, ...]:
    """Write pictures by name into `folder`, which is made; returns the files.

    Raises:
        InputError: they cannot be written.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot write the figures: {error.strerror}") from None
    for name, figure in pictures.items():
        save_figure(figure, folder / name)
    return tuple(folder / name for name in pictures)


def add_legend(figure: Figure, handles: Sequence[Line2D], *, columns: int = 8) -> None:
    """A legend under the picture."""
    labels = [str(handle.get_label()) for handle in handles]
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )


def band(axes: Axes, points: Floats) -> None:
    """A planned line (n, 2) with its corners, wide and pale, so that a flown one shows on it."""
    axes.plot(*points.T, color=BAND, lw=5, solid_capstyle="round", zorder=1.8)
    axes.plot(*points.T, ls="", marker="o", ms=3.5, mfc="white", mec=PLANNED, zorder=3.5)


def plain(axes: Axes) -> None:
    """Only the axes that carry numbers, in quiet colours."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(_AXIS)
    axes.tick_params(colors=TEXT, labelsize=9)
    axes.xaxis.label.set_color(TEXT)
    axes.yaxis.label.set_color(TEXT)
