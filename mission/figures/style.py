"""How every picture looks. Colours are the CSS variables of a page; a file gets their light values.

Layers are described in Altair, and put together as Vega-Lite: Altair copies every layer whenever
charts are put into one. `mission.figures.render` makes files and parts of pages of them.
"""

import math
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import altair as alt
import numpy as np
from altair.utils.schemapi import debug_mode
from numpy.typing import ArrayLike, NDArray

from mission.base.arrays import Floats
from mission.base.palette import PER_RAMP

Chart: TypeAlias = dict[str, Any]  # Vega-Lite, as JSON has it
Rows: TypeAlias = dict[str, Any]  # the data of a layer

PAPER, INK, SOFT, GRID = "var(--paper)", "var(--ink)", "var(--soft)", "var(--grid)"
PLANNED, FLOWN, BAND, FENCE = "var(--planned)", "var(--flown)", "var(--band)", "var(--fence)"
GOOD, WARM, BAD, COOL = "#009E73", "#E69F00", "#C8361D", "#0072B2"

WIDTH, HEIGHT = 440, 210  # of a chart in a file; on a page it is as wide as its card
CROWD = 60  # devices; if there are more, all marks are smaller
# A ring, one unit across.
RING = "M-1,0A1,1,0,1,1,1,0A1,1,0,1,1,-1,0M-0.75,0A0.75,0.75,0,1,0,0.75,0A0.75,0.75,0,1,0,-0.75,0"
_KEY_WIDTH = 300.0  # what a row of keys may take: it fits a phone
_CHARACTER, _SYMBOL = 6.1, 32.0

alt.data_transformers.disable_max_rows()
# Of what describes valid pictures: the tests see to that. Altair checks each part as it is made.
unchecked = debug_mode(False)

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


def layered(
    layers: Sequence[alt.Chart], *, title: Chart, width: float, height: float, **more: Any
) -> Chart:
    """Layers as one chart; `more` are further keys of it, such as `params`.

    Those without data are left out, unless there are no others: scales have no ends without data.
    """
    datasets: Chart = {}
    # What is described here is valid: the tests see to that, and it takes as long as drawing.
    inner = {"datasets": datasets, "top_level": False}
    some = [layer for layer in layers if layer.data["values"]] or layers
    each = [layer.to_dict(validate=False, context=inner) for layer in some]
    return {
        "title": title, "width": width, "height": height, "layer": each, "datasets": datasets,
        **more,
    }  # fmt: skip


def arranged(
    charts: Sequence[Chart],
    *,
    how: Literal["vconcat", "hconcat", "concat"],
    own: Sequence[str] = (),
    **more: Any,
) -> Chart:
    """Charts beside or under each other; in each, the channels `own` have scales of their own."""
    datasets = {name: rows for chart in charts for name, rows in chart["datasets"].items()}
    scales = {"resolve": {"scale": dict.fromkeys(own, "independent")}} if own else {}
    parts = [{key: of for key, of in chart.items() if key != "datasets"} for chart in charts]
    return {how: parts, "datasets": datasets, **scales, **more}


def heading(title: str, about: str | Sequence[str] = "") -> Chart:
    """Title of a picture, with a subtitle `about` what it shows: run, strategy, seed."""
    return {"text": title, "subtitle": about or [], "fontSize": 15, "offset": 12}


def table(**columns: ArrayLike) -> Rows:
    """Columns of equal length as the data of a layer; null where a number is not finite.

    Six digits are more than any place shows.
    """
    each = [_column(np.asarray(values)) for values in columns.values()]
    return {"values": [dict(zip(columns, row, strict=True)) for row in zip(*each, strict=True)]}


def _column(values: NDArray[np.generic]) -> list[object]:
    if values.dtype.kind == "f":
        return [float(f"{v:.6g}") if math.isfinite(v) else None for v in values.tolist()]
    found: list[object] = values.tolist()
    return found


def keys(names: Sequence[str], **look: Any) -> alt.Legend:
    """A legend in rows that fit the narrowest place."""
    widest = _SYMBOL + _CHARACTER * max(map(len, names), default=1)
    columns = max(1, min(len(names), int(_KEY_WIDTH // widest)))
    return alt.Legend(title=None, columns=columns, **look)


def line_keys(names: Sequence[str]) -> alt.Legend:
    """A legend of lines, as they are drawn."""
    return keys(
        names, symbolType="stroke", symbolSize=220, symbolStrokeWidth=2.2, symbolOpacity=1.0
    )


def named(names: Sequence[str], values: Sequence[str | float | Sequence[float]]) -> alt.Scale:
    """An ordinal scale: a colour, shape or width for each name."""
    return alt.Scale(type="ordinal", domain=list(names), range=list(values))


def per_scale() -> alt.Scale:
    """Colour scale of packet error rates, 0 to 1."""
    marks, colours = [per for per, _ in PER_RAMP], [colour for _, colour in PER_RAMP]
    return alt.Scale(domain=marks, range=colours, interpolate="rgb", clamp=True)


def per_key() -> alt.Legend:
    """Legend of the links' packet error rates."""
    return alt.Legend(values=[0.0, 0.5, 1.0], columns=3, symbolType="stroke", symbolSize=220,
                      symbolStrokeWidth=2.2, format="~g")  # fmt: skip


def _areas(count: int) -> tuple[float, float]:
    """Areas (px^2) of the dots of devices with no importance and with the greatest."""
    return (10.0, 110.0) if count > CROWD else (30.0, 260.0)


def dot_radii(importance: Floats, most: float) -> Floats:
    """(K,) radii in pixels of the devices' dots; their areas grow with importance (K,)."""
    low, high = _areas(len(importance))
    return np.asarray(np.sqrt((low + (high - low) * importance / (most or 1.0)) / np.pi))


def importance_size(most: float, count: int, title: str = "importance") -> alt.Size:
    """Size encoding (area) of a device's dot by importance, with its legend."""
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
