"""Charts as SVG text: axes, lines, dots and bars, in the page's own colours.

Ink, grid and paper are CSS variables, so that a chart follows the reader's light or dark theme.
Text sizes are chosen for a chart that is 440 units wide and shown at 340 to 600 pixels.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from mission.report import html

WIDTH = 440.0
LEFT, RIGHT, TOP, BOTTOM = 46.0, 12.0, 24.0, 36.0
_TICKS = 5


@dataclass(frozen=True)
class Series:
    """One line of a chart. NaN leaves a gap."""

    label: str
    colour: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    dots: bool = True


@dataclass(frozen=True)
class Scale:
    """From values to SVG units along one axis."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """Where a value lies; a scale without extent puts everything in its middle."""
        span = self.high - self.low
        share = (value - self.low) / span if span else 0.5
        return self.start + share * (self.end - self.start)


@dataclass
class Chart:
    """A plot area with axes, to which marks are added; `text` gives the SVG."""

    title: str
    x_label: str
    y_label: str
    x: tuple[float, float]
    y: tuple[float, float]
    height: float = 250.0
    whole_x: bool = False  # ticks at whole numbers only
    percent: bool = False
    dot_legend: bool = False  # of dots, not of lines
    parts: list[str] = field(default_factory=list)
    legend: list[tuple[str, str, bool]] = field(default_factory=list)

    @property
    def across(self) -> Scale:
        """The horizontal scale."""
        return Scale(*self.x, LEFT, WIDTH - RIGHT)

    @property
    def up(self) -> Scale:
        """The vertical scale; SVG's y grows downwards."""
        return Scale(*self.y, self.height - BOTTOM, TOP)

    def add(self, series: Series) -> None:
        """A line with or without dots."""
        across, up = self.across, self.up
        points = [
            (across.at(x), up.at(y)) if math.isfinite(y) else None
            for x, y in zip(series.x, series.y, strict=True)
        ]
        dash = ' stroke-dasharray="5 4"' if series.dashed else ""
        self.parts.append(
            f'<path d="{path(points)}" fill="none" stroke="{series.colour}" '
            f'stroke-width="2" stroke-linejoin="round"{dash}/>'
        )
        if series.dots:
            for point, x, y in zip(points, series.x, series.y, strict=True):
                if point is not None:
                    self.dot(point, series.colour, f"{series.label}: {_say(y)} ({_say(x)})")
        self.legend.append((series.label, series.colour, series.dashed))

    def band(
        self,
        colour: str,
        x: Sequence[float],
        low: Sequence[float],
        high: Sequence[float],
    ) -> None:
        """An area between two lines, without marks of its own; cut at the edges of the chart."""
        across, up = self.across, self.up
        there = [
            (across.at(at), up.at(min(max(y, self.y[0]), self.y[1])))
            for at, y in zip(x, high, strict=True)
        ]
        back = [
            (across.at(at), up.at(min(max(y, self.y[0]), self.y[1])))
            for at, y in zip(x, low, strict=True)
        ]
        self.parts.append(
            f'<path d="{path([*there, *reversed(back)])}Z" fill="{colour}" opacity="0.15"/>'
        )

    def dot(self, at: tuple[float, float], colour: str, tip: str, *, radius: float = 3.2) -> None:
        """A dot at SVG coordinates with a tooltip."""
        self.parts.append(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{colour}">'
            f"<title>{escape(tip)}</title></circle>"
        )

    def bars(self, label: str, colour: str, x: Sequence[float], y: Sequence[float]) -> None:
        """Bars from zero, one unit of x wide with a gap."""
        across, up = self.across, self.up
        width = max(1.0, 0.72 * (across.at(1.0) - across.at(0.0)))
        for at, value in zip(x, y, strict=True):
            top, base = up.at(value), up.at(max(self.y[0], 0.0))
            self.parts.append(
                f'<rect x="{across.at(at) - width / 2:.1f}" y="{top:.1f}" width="{width:.1f}" '
                f'height="{max(base - top, 0):.1f}" fill="{colour}" rx="1.5">'
                f"<title>{escape(label)}: {_say(value)} ({_say(at)})</title></rect>"
            )
        self.legend.append((label, colour, False))

    def text(self) -> str:
        """The chart as one `<svg>` element; its title and legend stand outside of it."""
        return (
            f'<svg viewBox="0 0 {WIDTH:.0f} {self.height:.0f}" role="img" '
            f'aria-label="{escape(self.title)}">{self._axes()}{"".join(self.parts)}</svg>'
        )

    def legend_html(self) -> str:
        """The legend, for a place that wraps on narrow screens."""
        keys = dict.fromkeys(self.legend)
        items = (
            html.key(f"background:{colour}", label, dot=True)
            if self.dot_legend
            else html.key(f"border-top:3px {'dashed' if dashed else 'solid'} {colour}", label)
            for label, colour, dashed in keys
        )
        return f'<div class="legend">{"".join(items)}</div>'

    def _axes(self) -> str:
        across, up, right = self.across, self.up, WIDTH - RIGHT
        parts = []
        for value in ticks(*self.y):
            y = up.at(value)
            label = f"{100 * value:.0f} %" if self.percent else _say(value)
            parts.append(
                f'<line class="grid" x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>'
                f'<text class="tick" x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{label}'
                "</text>"
            )
        marks = [v for v in ticks(*self.x) if not self.whole_x or v == round(v)]
        parts += [
            f'<text class="tick" x="{across.at(value):.1f}" y="{self.height - BOTTOM + 16:.1f}" '
            f'text-anchor="middle">{_say(value)}</text>'
            for value in marks
        ]
        base = up.at(self.y[0])
        parts.append(
            f'<line class="axis" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{base}" y2="{base}"/>'
        )
        parts.append(
            f'<text class="label" x="{right}" y="{self.height - 5}" text-anchor="end">'
            f"{escape(self.x_label)}</text>"
        )
        if self.y_label:
            parts.append(f'<text class="label" x="2" y="12">{escape(self.y_label)}</text>')
        return "".join(parts)


def line_chart(
    title: str,
    series: Sequence[Series],
    *,
    x_label: str,
    y_label: str = "",
    y: tuple[float, float] | None = None,
    percent: bool = False,
    whole_x: bool = False,
) -> Chart:
    """A chart that fits its series; `y` fixes the vertical range."""
    xs = [value for item in series for value in item.x]
    ys = [value for item in series for value in item.y if math.isfinite(value)]
    low, high = (min(xs), max(xs)) if xs else (0.0, 1.0)
    if low == high:
        low, high = low - 0.5, high + 0.5
    chart = Chart(title, x_label, y_label, (low, high), y or padded(ys), percent=percent,
                  whole_x=whole_x)  # fmt: skip
    for item in series:
        chart.add(item)
    return chart


def padded(values: Sequence[float]) -> tuple[float, float]:
    """A range with a little air above, from zero where no value is negative."""
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    if low >= 0:
        low = 0.0
    air = 0.06 * (high - low) or 0.5
    return (low if low == 0.0 else low - air, high + air)


def ticks(low: float, high: float) -> list[float]:
    """Round numbers within a range, about five of them."""
    if not high > low:
        return [low]
    raw = (high - low) / _TICKS
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * unit for factor in (1, 2, 2.5, 5, 10) if factor * unit >= raw)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(index * step, 12) + 0.0 for index in range(first, last + 1)]


def path(points: Sequence[tuple[float, float] | None]) -> str:
    """SVG path data; None lifts the pen."""
    commands, pen = [], "M"
    for point in points:
        if point is None:
            pen = "M"
            continue
        commands.append(f"{pen}{point[0]:.1f} {point[1]:.1f}")
        pen = "L"
    return "".join(commands)


def _say(value: float) -> str:
    return f"{value:.4g}"
