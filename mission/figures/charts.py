"""Charts that every picture is made of: lines with their intervals, bars, and rows of dots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, TypeAlias

import altair as alt
import numpy as np

from mission.base.arrays import Floats
from mission.base.gaps import HOLE
from mission.figures.style import (
    BAD,
    HEIGHT,
    INK,
    SOFT,
    WIDTH,
    Chart,
    keys,
    layered,
    line_keys,
    named,
    table,
)

Values: TypeAlias = Sequence[float] | Floats

_TITLE = 44  # characters of an axis title in a row: it fits a phone
_LABEL = 26  # characters of a row's label beside it
_MARKED = 25  # points of a line that are few enough to be marked
_DASHED = [5, 4]
_LOOKS = (([1, 0], [2, 3]), (_DASHED, [8, 3, 2, 3]))  # solid and dashed; where colours come again
_ROW, _CLOSE_ROW = 34.0, 20.0  # of a strategy among the intervals, and where there are many
_MANY_ROWS = 20
_BINS = 400  # of a line over time; its least and its greatest value in each are drawn


@dataclass(frozen=True)
class Series:
    """One line of a chart; NaN leaves a gap. Its interval, where it has one, is an area."""

    label: str
    colour: str
    x: Values
    y: Values
    dashed: bool = False
    again: bool = False  # another one has this colour
    low: Values | None = None
    high: Values | None = None


def line_chart(
    title: str,
    series: Sequence[Series],
    *,
    x: str,
    y: str,
    note: str = "",
    most: float = math.inf,
    whole_x: bool = False,
    steps: bool = False,
    gate: str = "",
    gate_at: float = 1.0,
    marks: Series | None = None,
    height: float = HEIGHT,
) -> Chart:
    """Lines over a common axis; `x` and `y` are its titles, with units.

    The vertical axis begins at zero where nothing is negative, and ends at `most` at the latest.
    `steps`: a value holds until the next. `gate` names a line, at 1 if not told; `marks` are
    single points to be seen.
    """
    data = table(series=_labels(series, "x"), x=_joined(series, "x"), y=_joined(series, "y"))
    names = [item.label for item in series]
    drawn = [*series, *([] if marks is None else [marks])]
    values = [edge for item in drawn for edge in (item.y, item.low, item.high) if edge is not None]
    shown = np.concatenate([[gate_at] if gate else [], *values])
    # Told, not found: where no value is known, an axis without ends could not be drawn.
    along = _joined(drawn, "x")
    known = along[np.isfinite(along)]
    reach = [float(known.min()), float(known.max())] if known.size else [0.0, 1.0]
    scale_x = alt.Scale(domain=reach, nice=False, padding=8)
    words = wrap(x, _TITLE) if len(x) > _TITLE else x
    across = alt.X(
        "x:Q", title=words, scale=scale_x, axis=_whole(series) if whole_x else alt.Axis()
    )
    up = alt.Y("y:Q", title=y, scale=alt.Scale(domain=_range(shown, most), nice=False, clamp=True))
    dashes = named(names, [_LOOKS[item.dashed][item.again] for item in series])
    key = line_keys(names)
    look = alt.Color("series:O", scale=named(names, [item.colour for item in series]), legend=key)
    base = alt.Chart(data).encode(x=across, y=up, color=look)
    few = max((len(item.x) for item in series), default=0) <= _MARKED
    tip = [
        alt.Tooltip("series:O", title=" "),
        alt.Tooltip("x:Q", title=x, format=".5~g"),
        alt.Tooltip("y:Q", title=y, format=".4~g"),
    ]
    layers: list[alt.Chart] = [
        *_bands(series, across),
        base.mark_line(strokeWidth=2, interpolate="step-after" if steps else "linear").encode(
            strokeDash=alt.StrokeDash("series:O", scale=dashes, legend=key)
        ),
        # A line of many points has none to see, but each tells its values.
        base.mark_point(filled=True, size=32 if few else 60, opacity=1 if few else 0).encode(
            tooltip=tip
        ),
    ]
    if gate:
        layers += _gate(gate, gate_at)
    if marks is not None and len(marks.x):
        chart = alt.Chart(table(series=_labels([marks], "x"), x=marks.x, y=marks.y))
        layers.append(
            chart.mark_point(filled=True, color=marks.colour, size=40, opacity=1).encode(
                x=across, y=up, tooltip=tip
            )
        )
    return finished(layers, title=title, note=note, height=height)


def _gate(name: str, at_y: float) -> list[alt.Chart]:
    """Rule at a limit, with its name."""
    at = alt.Chart(table(y=[at_y], name=[name]))
    where: dict[str, Any] = {"align": "right", "baseline": "bottom", "dy": -3, "clip": False}
    text = at.mark_text(color=BAD, fontSize=11, **where)
    return [
        at.mark_rule(color=BAD, strokeDash=_DASHED).encode(alt.Y("y:Q")),
        text.encode(x=alt.value("width"), y=alt.Y("y:Q"), text=alt.Text("name:N")),
    ]


def finished(
    layers: Sequence[alt.Chart],
    *,
    title: str,
    note: str = "",
    width: float = WIDTH,
    height: float = HEIGHT,
    **more: Any,
) -> Chart:
    """Combine layers into a chart with a title and, below it, a `note` on how to read it."""
    words = {"text": title, **({"subtitle": note} if note else {})}
    return layered(layers, title=words, width=width, height=height, **more)


def bar_chart(title: str, bars: Sequence[Series], *, x: str, y: str) -> Chart:
    """Bar chart at whole numbers; bars begin at zero, later series are in front of earlier."""
    names = [item.label for item in bars]
    data = table(series=_labels(bars, "x"), x=_joined(bars, "x"), y=_joined(bars, "y"))
    numbers = ticks(sorted({int(at) for item in bars for at in item.x}))
    marks = (
        alt.Chart(data)
        .mark_bar(width={"band": 0.75}, tooltip=True)
        .encode(
            x=alt.X("x:O", title=x, axis=alt.Axis(values=numbers, labelAngle=0)),
            y=alt.Y("y:Q", title=y, stack=None, axis=alt.Axis(tickMinStep=1)),
            color=alt.Color(
                "series:N", scale=named(names, [item.colour for item in bars]), legend=keys(names)
            ),
        )
    )
    return finished([marks], title=title)


@dataclass(frozen=True)
class DotRow:
    """A row of a dot chart: a mean, what it is the mean of, and its interval where it has one."""

    label: str
    colour: str
    values: tuple[float, ...]  # one a seed
    mean: float
    ends: tuple[float, float] | None  # of the interval


def dot_rows(title: str, rows: Sequence[DotRow], *, x: str, zero: bool = False) -> Chart:
    """A row a strategy: every seed as a ring, the mean as a dot, its interval as a bar."""
    order = [row.label for row in rows]
    values = [value for row in rows for value in row.values]
    span = max(values) - min(values) or 2.0
    ends = [(row.label, *row.ends) for row in rows if row.ends is not None]
    # Intervals of few seeds are long: no wider than three times what the seeds reach.
    low = max(min([low for _, low, _ in ends], default=-math.inf), min(values) - span)
    high = min(max([high for _, _, high in ends], default=math.inf), max(values) + span)
    low, high = min(low, *values), max(high, *values)
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    air = 0.05 * (high - low)
    scale = alt.Scale(domain=[low - air, high + air], nice=False, clamp=True)
    # A long label stands above its row: beside it, a phone would have no room for the row.
    long = max(map(len, order)) > _LABEL
    look: dict[str, Any] = {"labelLimit": 0, "domain": False, "ticks": False, "labelColor": INK}
    look |= {"labelAlign": "left", "labelPadding": -2, "labelOffset": -10} if long else {}
    y = alt.Y("row:N", title=None, sort=order, axis=alt.Axis(**look))
    x_axis = alt.X("x:Q", title=x, scale=scale, axis=alt.Axis(grid=True))
    colour = alt.Color("row:N", scale=named(order, [row.colour for row in rows]), legend=None)
    tip = [alt.Tooltip("row:N", title=" "), alt.Tooltip("x:Q", title=x, format=".4~g")]
    seeds = table(row=[row.label for row in rows for _ in row.values], x=values)
    means = table(row=order, x=[row.mean for row in rows])
    layers = [alt.Chart(table(x=[0.0])).mark_rule(color=SOFT).encode(x_axis)] if zero else []
    bar = ""
    if ends:
        labels, lows, highs = zip(*ends, strict=True)
        data = table(row=labels, x=lows, high=highs)
        bar = ", bar: its 95 % interval"
        layers.append(
            alt.Chart(data)
            .mark_rule(strokeWidth=5, opacity=0.35)
            .encode(x_axis, y, colour, alt.X2(field="high"))
        )
    layers += [
        alt.Chart(seeds).mark_point(filled=False, size=45).encode(x_axis, y, colour, tooltip=tip),
        alt.Chart(means)
        .mark_point(filled=True, size=60, opacity=1)
        .encode(x_axis, y, colour, tooltip=tip),
    ]
    note = f"dot: mean{bar}, rings: seeds"
    each = _ROW if len(rows) < _MANY_ROWS else _CLOSE_ROW
    return finished(layers, title=title, note=note, height=each * len(rows))


def _bands(series: Sequence[Series], across: alt.X) -> list[alt.Chart]:
    """Areas of the intervals, without a colour scale: its legend would be as pale as they are."""
    return [
        alt.Chart(table(x=item.x, low=item.low, high=item.high))
        .mark_area(fill=item.colour, opacity=0.15, clip=True)
        .encode(x=across, y=alt.Y("low:Q"), y2=alt.Y2(field="high"))
        for item in series
        if item.low is not None and item.high is not None
    ]


def _labels(series: Sequence[Series], name: str) -> list[str]:
    return [item.label for item in series for _ in getattr(item, name)]


def _joined(series: Sequence[Series], name: str) -> Floats:
    parts = [np.asarray(getattr(item, name), dtype=np.float64) for item in series]
    return np.concatenate((np.zeros(0), *parts))


def _range(values: Floats, most: float) -> list[float]:
    """Axis range of values with a little room; it begins at 0 where none is negative."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    low = min(low, 0.0)
    air = 0.06 * (high - low) or 0.5
    return [low and low - air, min(high + air, most)]


def _whole(series: Sequence[Series]) -> alt.Axis:
    """Horizontal axis with labels at whole numbers only."""
    return alt.Axis(values=ticks(sorted({int(at) for one in series for at in one.x})), format="d")


def ticks(numbers: Sequence[int], most: int = 12) -> list[int]:
    """Whole numbers to label on an axis: `most` round ones at most, and the first."""
    steps = (factor * 10**power for power in range(9) for factor in (1, 2, 5))
    step = next(step for step in steps if len(numbers) <= step * most)
    return [n for index, n in enumerate(numbers) if n % step == 0 or index == 0]


def envelope(t_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """A line through the least and the greatest value in each of `_BINS` times, with gaps."""
    if not len(t_s):
        return t_s, values
    usual_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    gaps = np.flatnonzero(np.diff(t_s) > max(1.0, HOLE * usual_s)) + 1
    x, y = list[float](), list[float]()
    for run in np.split(np.arange(len(t_s)), gaps):
        for part in np.array_split(run, min(len(run), 1 + len(run) * _BINS // len(t_s))):
            known = part[np.isfinite(values[part])]
            ends = {int(known[at(values[known])]) for at in (np.argmin, np.argmax) if len(known)}
            chosen = sorted(ends) or [int(part[0])]
            x += t_s[chosen].tolist()
            y += values[chosen].tolist()
        x.append(float(t_s[run[-1]]))
        y.append(math.nan)
    return np.array(x), np.array(y)
