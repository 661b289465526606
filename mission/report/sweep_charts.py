"""The charts of a sweep's report: curves with their intervals, and where the runs ended."""

from collections.abc import Sequence
from html import escape

import numpy as np

from mission.base.palette import community_colour
from mission.report import svg
from mission.report.charts import card
from mission.report.svg import Chart, Scale, Series
from mission.sweep.outcome.curves import Panel, Picture, by_round
from mission.sweep.outcome.ends import EndRow

_DOTTED = 25  # points of a line that are few enough to be marked
_ROW = 46.0  # height of a strategy among the intervals
_EDGE = 12.0


def curve_cards(picture: Picture) -> list[str]:
    """A card for each panel: the mean of every group, with its 95 % interval."""
    return [_curves(picture, panel) for panel in picture.panels]


def _curves(picture: Picture, panel: Panel) -> str:
    colours = {label: community_colour(index) for index, label in enumerate(picture.order)}
    curves = picture.curves(panel)
    reach = np.concatenate(
        [[0.0], *(np.concatenate((c.mean, c.low, c.high)) for c in curves.values())]
    )
    low, high = svg.padded(reach[np.isfinite(reach)].tolist())
    chart = svg.line_chart(
        panel.title,
        [
            Series(
                label,
                colours[label],
                c.x.tolist(),
                c.mean.tolist(),
                dots=len(c.x) <= _DOTTED,
                dashed=not c.flown,
            )
            for label, c in curves.items()
        ],
        x_label=picture.x_label,
        y=(low, min(high, panel.most)),
        whole_x=picture.sampling is by_round,
    )
    lines, chart.parts = chart.parts, []
    for label, curve in curves.items():
        known = np.isfinite(curve.low)
        if known.any():
            ends = (part[known].tolist() for part in (curve.x, curve.low, curve.high))
            chart.band(colours[label], *ends)
    chart.parts += lines
    return card(chart)


def ends_card(title: str, rows: Sequence[EndRow], *, x_label: str, zero: bool = False) -> str:
    """A row a strategy: every seed as a ring, the mean as a dot in its interval."""
    values = [value for row in rows for value in row.values]
    span = max(values) - min(values) or 2.0
    # Two seeds' intervals may be endless: no wider than three times what the seeds reach.
    low = max(min(row.ends[0] for row in rows), min(values) - span)
    high = min(max(row.ends[1] for row in rows), max(values) + span)
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    air = 0.05 * (high - low) or 1.0
    chart = Chart(
        title, x_label, "", (low - air, high + air), (0.0, 1.0),
        height=svg.TOP + _ROW * len(rows) + svg.BOTTOM,
    )  # fmt: skip
    across = Scale(*chart.x, _EDGE, svg.WIDTH - _EDGE)
    base = chart.height - svg.BOTTOM
    parts = [
        f'<line class="{"axis" if zero and v == 0.0 else "grid"}" x1="{across.at(v):.1f}" '
        f'x2="{across.at(v):.1f}" y1="{svg.TOP}" y2="{base:.1f}"/><text class="tick" '
        f'x="{across.at(v):.1f}" y="{base + 16:.1f}" text-anchor="middle">{v:g}</text>'
        for v in svg.ticks(*chart.x)
    ]
    for index, row in enumerate(rows):
        parts += _row(across, svg.TOP + _ROW * (index + 0.75), row, signed=zero)
    parts.append(
        f'<text class="label" x="{svg.WIDTH - _EDGE}" y="{chart.height - 5}" text-anchor="end">'
        f"{escape(x_label)}</text>"
    )
    return (
        f'<section class="card"><h3>{escape(title)}</h3><p class="sub">dot: mean, bar: its '
        f'95 % interval, rings: seeds</p><svg viewBox="0 0 {svg.WIDTH:.0f} {chart.height:.0f}" '
        f'role="img" aria-label="{escape(title)}">{"".join(parts)}</svg></section>'
    )


def _row(across: Scale, y: float, row: EndRow, *, signed: bool) -> list[str]:
    low, high = (across.at(min(max(end, across.low), across.high)) for end in row.ends)
    sign = "+" if signed else ""
    several = f" ± {row.half:.1f}" if len(row.values) > 1 else ""
    name = f"{row.label}: {row.mean:{sign}z.1f}{several}"
    return [
        f'<text class="tick" x="{_EDGE}" y="{y - 12:.1f}">{escape(name)}</text>',
        f'<line x1="{low:.1f}" x2="{high:.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="{row.colour}" '
        'stroke-width="4" opacity="0.45"/>',
        *(
            f'<circle cx="{across.at(value):.1f}" cy="{y:.1f}" r="3.4" fill="none" '
            f'stroke="{row.colour}" stroke-width="1.4"/>'
            for value in row.values
        ),
        f'<circle cx="{across.at(row.mean):.1f}" cy="{y:.1f}" r="5" fill="{row.colour}">'
        f"<title>{escape(name)}</title></circle>",
    ]
