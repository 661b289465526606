"""The picture of a screen of planned rounds: how far weights move who is heard, by factor."""

from collections.abc import Sequence

import altair as alt
import pandas as pd
from apart_shift import (
    FACTORS,
    L_TOTAL_M,
    LAYOUTS,
    LEAST_SHIFT,
    TITLES,
    base_but,
    level_name,
    rounds_paid,
    shifts,
)  # fmt: skip

from mission.figures.charts import finished
from mission.figures.style import (
    BAD,
    COOL,
    GOOD,
    SOFT,
    WARM,
    Chart,
    arranged,
    heading,
    named,
    table,
)  # fmt: skip

COLOURS = dict(zip(LAYOUTS, (SOFT, COOL, BAD, GOOD, WARM), strict=True))

_CHANNELS = {
    "suburban": "default", "suburban-7dB": "-7 dB", "suburban-4dB": "-4 dB",
    "suburban+3dB": "+3 dB", "suburban-log-variance": "log var.", "dense-urban": "dense",
}  # fmt: skip


def _short(value: object) -> str:
    """A level, in as few letters as there is room for below a panel."""
    return _CHANNELS.get(str(value), level_name(value))


_APART = 0.15  # of a level's width, between its layouts
_WIDTH, _HEIGHT = 350.0, 170.0
_SHIFT = "shift, points"


def picture(rows: pd.DataFrame) -> Chart:
    """A panel a factor, alone around the base, and one of the rounds that L_total pays for."""
    found = shifts(rows)
    panels = []
    for factor in FACTORS:
        some = base_but(found, factor)
        levels = some[factor].drop_duplicates()
        order = levels if factor in ("channel", "planner") else levels.sort_values()
        of = pd.DataFrame({"layout": some.layout, "level": some[factor].map(_short)})
        panels.append(
            _panel(TITLES[factor], _SHIFT, of.assign(value=some["shift"]), [*map(_short, order)])
        )
    base = base_but(found)
    more = [
        pd.DataFrame({"layout": base.layout, "level": f"{total_m / 1e3:.0f}"}).assign(
            value=rounds_paid(base.path_m, total_m) - rounds_paid(base.path_m_1, total_m)
        )
        for total_m in L_TOTAL_M
    ]
    levels = [str(of.level.iloc[0]) for of in more]
    panels.append(_panel("L_total, km", "rounds more that it pays for", pd.concat(more), levels))
    about = [
        "Shift: how much more often CIFAR-10's devices are heard where they are three times as "
        "important as MNIST's (one panel: other ratios)",
        "than with all alike. Planned only; one factor at a time around N = 2, K_bar = 3. Dots: "
        "means over draws; faint: draws. Dashed: 10 points.",
    ]
    return arranged(
        panels,
        how="concat",
        columns=2,
        spacing=18,
        title=heading("Where weights can move anything", about),
    )


def _panel(title: str, y: str, rows: pd.DataFrame, levels: Sequence[str]) -> Chart:
    """Columns of levels; within each a column of draws a layout, from `rows` of layout, level and
    value."""
    order = list(COLOURS)
    means = rows.groupby(["layout", "level"], as_index=False, sort=False).value.mean()
    axis = alt.Axis(labels=False, ticks=False, titlePadding=22)
    reach = alt.Scale(domain=[-0.5, len(levels) - 0.5], nice=False)
    across = alt.X("x:Q", title=title, axis=axis, scale=reach)
    up = alt.Y("value:Q", title=y)
    key = alt.Legend(title="layout", columns=len(order), symbolOpacity=1.0)
    colour = alt.Color("layout:N", scale=named(order, [*COLOURS.values()]), legend=key)
    tip = [alt.Tooltip(f"{name}:N", title=" ") for name in ("layout", "level")]
    tip.append(alt.Tooltip("value:Q", title=y, format=".3~g"))
    # As marks: of an axis' labels every other one is left out as soon as two come close.
    names = alt.Chart(table(x=list(range(len(levels))), name=list(levels)))
    words = names.mark_text(baseline="top", color=SOFT, fontSize=11)
    layers = [words.encode(x=across, y=alt.value(_HEIGHT + 6.0), text="name:N")]
    if y == _SHIFT:
        least = alt.Chart(table(y=[LEAST_SHIFT]))
        layers.append(least.mark_rule(color=SOFT, strokeDash=[5, 4]).encode(alt.Y("y:Q")))
    for of, size, opacity in ((rows, 14, 0.4), (means, 60, 1.0)):
        x = of.level.map(list(levels).index) + _APART * (of.layout.map(order.index) - 2)
        data = table(x=x, layout=of.layout, level=of.level, value=of.value)
        layers.append(
            alt.Chart(data)
            .mark_point(filled=True, size=size, opacity=opacity)
            .encode(x=across, y=up, color=colour, tooltip=tip)
        )
    return finished(layers, title="", width=_WIDTH, height=_HEIGHT)
