"""How every picture looks. Colours are the CSS variables of a page; a file gets their light values.

Descriptions are Altair charts; `mission.figures.render` makes files and parts of pages of them.
"""

from collections.abc import Sequence
from typing import Any

import altair as alt
import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from mission.base.arrays import Floats
from mission.base.palette import css_colour, per_colour

PAPER, INK, SOFT, GRID = "var(--paper)", "var(--ink)", "var(--soft)", "var(--grid)"
PLANNED, FLOWN, BAND, FENCE = "var(--planned)", "var(--flown)", "var(--band)", "var(--fence)"
GOOD, WARM, BAD, COOL = "#009E73", "#E69F00", "#C8361D", "#0072B2"

WIDTH, HEIGHT = 440, 210  # of a chart in a file; on a page it is as wide as its card
CROWD = 60  # devices from which on all marks are smaller
# A ring, one unit across.
RING = "M-1,0A1,1,0,1,1,1,0A1,1,0,1,1,-1,0M-0.75,0A0.75,0.75,0,1,0,0.75,0A0.75,0.75,0,1,0,-0.75,0"
_KEY_WIDTH = 300.0  # what a row of keys may take: it fits a phone
_CHARACTER, _SYMBOL = 6.1, 32.0

alt.data_transformers.disable_max_rows()

CONFIG: dict[str, object] = {
    "background": PAPER,
    "font": "Liberation Sans, Arial, Helvetica, sans-serif",
    "view": {"stroke": None},
    "axis": {
        "domainColor": SOFT, "gridColor": GRID, "tickColor": SOFT, "labelColor": SOFT,
        "titleColor": SOFT, "titleFontWeight": "normal", "labelFontSize": 11, "titleFontSize": 12,
        "tickCount": 6,
    },
    "axisX": {"grid": False},
    "legend": {
        "orient": "bottom", "direction": "horizontal", "labelColor": SOFT, "titleColor": SOFT,
        "titleFontWeight": "normal", "labelFontSize": 11, "titleFontSize": 11, "labelLimit": 0,
        "titleLimit": 0, "symbolStrokeWidth": 1.5, "offset": 6, "rowPadding": 1,
        "titleOrient": "left", "titleAnchor": "middle",
        # Under each other: beside each other, those that find no room would be cut.
        "layout": {"bottom": {"direction": "vertical", "anchor": "start", "margin": 3}},
    },
    "title": {
        "anchor": "start", "color": INK, "subtitleColor": SOFT, "fontSize": 13,
        "subtitleFontSize": 11, "fontWeight": 600, "limit": 0, "frame": "group", "offset": 8,
    },
    "line": {"strokeJoin": "round", "strokeCap": "round"},
}  # fmt: skip


def table(**columns: ArrayLike) -> pa.Table:
    """Columns of equal length as the data of a layer; null where a number is NaN.

    Six digits are more than any place shows.
    """
    return pa.table({name: _column(np.asarray(values)) for name, values in columns.items()})


def _column(values: NDArray[np.generic]) -> pa.Array:
    if values.dtype.kind == "f":
        values = np.array([float(f"{value:.6g}") for value in values.tolist()])
    return pa.array(values, from_pandas=True)


def keys(names: Sequence[str], *, title: str | None = None, **look: Any) -> alt.Legend:
    """A legend in rows that fit the narrowest place."""
    widest = _SYMBOL + _CHARACTER * max(map(len, names), default=1)
    columns = max(1, min(len(names), int(_KEY_WIDTH // widest)))
    return alt.Legend(title=title, columns=columns, **look)


def line_keys(names: Sequence[str]) -> alt.Legend:
    """A legend of lines, as they are drawn."""
    return keys(
        names, symbolType="stroke", symbolSize=220, symbolStrokeWidth=2.2, symbolOpacity=1.0
    )


def named(names: Sequence[str], values: Sequence[str | float | Sequence[float]]) -> alt.Scale:
    """A look for each name."""
    return alt.Scale(type="ordinal", domain=list(names), range=list(values))


def per_scale() -> alt.Scale:
    """From an error rate to its colour."""
    marks = [0.0, 0.5, 1.0]
    colours = [css_colour(per_colour(per)) for per in marks]
    return alt.Scale(domain=marks, range=colours, interpolate="rgb", clamp=True)


def per_key() -> alt.Legend:
    """Links by their error rate."""
    return alt.Legend(values=[0.0, 0.5, 1.0], columns=3, symbolType="stroke", symbolSize=220,
                      symbolStrokeWidth=2.2, format="~g")  # fmt: skip


def _areas(count: int) -> tuple[float, float]:
    """Of the dots of devices of no and of the most importance."""
    return (10.0, 110.0) if count > CROWD else (30.0, 260.0)


def dot_radii(importance: Floats, most: float) -> Floats:
    """(K,) in pixels, of the dots of all devices."""
    low, high = _areas(len(importance))
    return np.asarray(np.sqrt((low + (high - low) * importance / (most or 1.0)) / np.pi))


def importance_size(most: float, count: int, title: str = "importance") -> alt.Size:
    """Area of a device's dot, with its key."""
    scale = alt.Scale(domain=[0.0, most or 1.0], range=list(_areas(count)))
    legend = alt.Legend(
        title=title,
        tickCount=3,
        columns=4,
        format=".2~g",
        symbolFillColor=SOFT,
        symbolStrokeColor="transparent",
        symbolOpacity=1.0,
    )
    return alt.Size("importance:Q", scale=scale, legend=legend)
