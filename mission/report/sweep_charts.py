"""The charts of a sweep's report: curves with their intervals, and where the runs ended."""

from collections.abc import Sequence
from html import escape

import numpy as np

from mission.palette import community_colour
from mission.report import svg
from mission.report.charts import card
from mission.report.svg import Chart, Scale, Series
from mission.sweep.curves import Picture, by_round, groups_of
from mission.sweep.results import RunResult
from mission.sweep.stats import Interval, band, interval
from mission.sweep.view import percent

_DOTTED = 25  # points of a line that are few enough to be marked
_ROW = 46.0  # height of a strategy among the intervals
_EDGE = 12.0


def curve_cards(picture: Picture) -> list[str]:
    """A card for each panel: the mean of every group, with its 95 % interval."""
    return [_curves(picture, column, title) for column, title in picture.panels]


def _curves(picture: Picture, column: str, title: str) -> str:
    colours = {label: community_colour(index) for index, label in enumerate(picture.order)}
    most = np.inf if column.startswith("cov_") else 1.0
    series, bands, reach = [], [], []
    for label, (x, values) in picture.curves(column).items():
        mean, half = band(values)
        across = x.tolist()
        dots = len(across) <= _DOTTED
        series.append(Series(label, colours[label], across, mean.tolist(), dots=dots))
        # An interval may reach beyond what the quantity can be; the chart need not.
        low, high = np.clip(mean - half, 0.0, most), np.clip(mean + half, 0.0, most)
        known = np.isfinite(half)
        if known.any():
            bands.append((colours[label], x[known], low[known], high[known]))
        edges = np.concatenate((mean, low, high))
        reach += edges[np.isfinite(edges)].tolist()
    chart = svg.line_chart(
        title, series,
        x_label=picture.x_label, y=svg.padded(reach), whole_x=picture.sampling is by_round,
    )  # fmt: skip
    lines, chart.parts = chart.parts, []
    for colour, x, low, high in bands:
        chart.band(colour, x.tolist(), low.tolist(), high.tolist())
    chart.parts += lines
    return card(chart)


def interval_card(results: Sequence[RunResult], community: str) -> str:
    """A row a strategy: every seed as a ring, the mean as a dot in its interval."""
    column = f"final_accuracy_{community}"
    rows: list[tuple[str, str, Interval, list[float]]] = []
    for index, (label, runs) in enumerate(groups_of(results).items()):
        values = [float(run.summary[column]) for run in runs if column in run.summary]
        if values:
            rows.append((label, community_colour(index), interval(values), values))
    ends = [end for _, _, item, values in rows for end in (*_ends(item), *values)]
    air = 0.05 * (max(ends) - min(ends)) or 0.02
    chart = Chart(
        f"{community}: accuracy at the end", "accuracy (%)", "",
        (max(0.0, 100 * (min(ends) - air)), min(100.0, 100 * (max(ends) + air))), (0.0, 1.0),
        height=svg.TOP + _ROW * len(rows) + svg.BOTTOM,
    )  # fmt: skip
    across = Scale(*chart.x, _EDGE, svg.WIDTH - _EDGE)
    base = chart.height - svg.BOTTOM
    parts = [
        f'<line class="grid" x1="{across.at(v):.1f}" x2="{across.at(v):.1f}" y1="{svg.TOP}" '
        f'y2="{base:.1f}"/><text class="tick" x="{across.at(v):.1f}" y="{base + 16:.1f}" '
        f'text-anchor="middle">{v:g}</text>'
        for v in svg.ticks(*chart.x)
    ]
    for row, (label, colour, item, values) in enumerate(rows):
        parts += _row(across, svg.TOP + _ROW * (row + 0.75), label, colour, item, values)
    parts.append(
        f'<text class="label" x="{svg.WIDTH - _EDGE}" y="{chart.height - 5}" text-anchor="end">'
        f"{chart.x_label}</text>"
    )
    return (
        f'<section class="card"><h3>{escape(chart.title)}</h3><p class="sub">dot: mean, bar: its '
        f'95 % interval, rings: seeds</p><svg viewBox="0 0 {svg.WIDTH:.0f} {chart.height:.0f}" '
        f'role="img" aria-label="{escape(chart.title)}">{"".join(parts)}</svg></section>'
    )


def _row(
    across: Scale, y: float, label: str, colour: str, item: Interval, values: Sequence[float]
) -> list[str]:
    low, high = (across.at(100 * end) for end in _ends(item))
    name = f"{label}: {percent(item)}"
    return [
        f'<text class="tick" x="{_EDGE}" y="{y - 12:.1f}">{escape(name)}</text>',
        f'<line x1="{low:.1f}" x2="{high:.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="{colour}" '
        'stroke-width="4" opacity="0.45"/>',
        *(
            f'<circle cx="{across.at(100 * value):.1f}" cy="{y:.1f}" r="3.4" fill="none" '
            f'stroke="{colour}" stroke-width="1.4"/>'
            for value in values
        ),
        f'<circle cx="{across.at(100 * item.mean):.1f}" cy="{y:.1f}" r="5" fill="{colour}">'
        f"<title>{escape(name)} %</title></circle>",
    ]


def _ends(item: Interval) -> tuple[float, float]:
    """Of the interval, within what an accuracy can be; the mean itself where there is none."""
    half = item.half if np.isfinite(item.half) else 0.0
    return max(item.mean - half, 0.0), min(item.mean + half, 1.0)
