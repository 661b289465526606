"""A chart of cells over two settings: a colour and words in each."""

from collections.abc import Sequence
from dataclasses import dataclass

import altair as alt

from mission.figures.charts import LayerChart, finished
from mission.figures.style import BAD, COOL, GRID, INK, SOFT, table

_WIDTH, _HEIGHT = 78.0, 40.0


@dataclass(frozen=True)
class Cell:
    """What stands at one place of the two settings."""

    down: str
    across: str
    value: float  # by which it is coloured
    words: str
    bold: bool = False


def cell_map(
    title: str, cells: list[Cell], *, down: str, across: str, most: float, signed: bool, note: str
) -> LayerChart:
    """Rows by the setting `down`, columns by `across`, both in order of appearance.

    Colours reach to `most`; `signed`: from -`most`, through none at zero.
    """
    columns = list(dict.fromkeys(cell.across for cell in cells))
    rows = list(dict.fromkeys(cell.down for cell in cells))
    data = table(
        down=[cell.down for cell in cells],
        across=[cell.across for cell in cells],
        value=[cell.value for cell in cells],
        strength=[abs(cell.value) for cell in cells],
        words=[cell.words for cell in cells],
        weight=["bold" if cell.bold else "normal" for cell in cells],
    )
    base = alt.Chart(data).encode(
        x=alt.X("across:O", title=across, sort=columns, axis=alt.Axis(labelAngle=0)),
        y=alt.Y("down:O", title=down, sort=rows),
    )
    # By how much it covers the paper, which is of either theme, and not by a mixed colour.
    strength = alt.FillOpacity(
        "strength:Q", scale=alt.Scale(domain=[0.0, most], range=[0.0, 0.7]), legend=None
    )
    colour = alt.when("datum.value < 0").then(alt.value(BAD)).otherwise(alt.value(COOL))
    tip = [
        alt.Tooltip("down:O", title=down),
        alt.Tooltip("across:O", title=across),
        alt.Tooltip("words:N", title=" "),
    ]
    layers = [
        base.mark_rect(stroke=GRID).encode(
            fill=colour if signed else alt.value(SOFT), fillOpacity=strength, tooltip=tip
        ),
        *(
            base.transform_filter(alt.datum.weight == weight)
            .mark_text(fontSize=11, fontWeight=weight, color=INK)
            .encode(text="words:N")
            for weight in ("bold", "normal")
        ),
    ]
    width, height = _WIDTH * len(columns), _HEIGHT * len(rows)
    return finished(layers, title=title, note=note, width=width, height=height)


def beside(charts: Sequence[LayerChart]) -> alt.HConcatChart:
    """Charts beside each other, each with colours of its own."""
    row = alt.hconcat(*charts, spacing=24)
    apart: alt.HConcatChart = row.resolve_scale(color="independent", fillOpacity="independent")
    return apart
