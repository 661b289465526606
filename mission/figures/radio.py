"""The radio by place: the gains of a map, and where plans were wrong about it."""

import math
from collections.abc import Sequence

import altair as alt
import numpy as np

from fl.radio.city import Building
from fl.radio.radio_map import RadioMap
from mission.base.arrays import Floats
from mission.figures.charts import finished
from mission.figures.frame import MapFrame
from mission.figures.style import (
    BAD,
    GOOD,
    PAPER,
    SOFT,
    WARM,
    Chart,
    heading,
    keys,
    named,
    table,
)
from mission.log.records import LATE
from mission.log.values import FlightData

_WIDTH = 560.0
_MOST_CELLS = 200  # a side: more cannot be told apart


def gain_picture(
    made: RadioMap, device: int, buildings: Sequence[Building] = (), *, about: str = ""
) -> Chart:
    """The gains from a device to all places at the lowest height of a map, among `buildings`."""
    (x, x2), (y, y2) = (_edges(line) for line in (made.x_m, made.y_m))
    across, up = (max(1, math.ceil(len(line) / _MOST_CELLS)) for line in (x, y))
    frame = MapFrame.around([np.array([[x[0], y[0]], [x2[-1], y2[-1]]])], [], _WIDTH)
    columns, rows = np.arange(0, len(x), across), np.arange(0, len(y), up)
    j, i = (part.ravel() for part in np.meshgrid(rows, columns, indexing="ij"))
    gain_db = made.path_gain_db[device, 0, j, i]
    last_i, last_j = np.minimum(i + across, len(x)) - 1, np.minimum(j + up, len(y)) - 1
    seam_m = 0.5 * frame.pixel_m  # cells that only touch have paper between them
    cells = table(
        x=x[i], x2=x2[last_i] + seam_m, y=y[j], y2=y2[last_j] + seam_m, gain=np.round(gain_db, 1)
    )
    low, high = np.quantile(gain_db, (0.01, 1.0)) / 10.0
    ends = [10.0 * math.floor(low), 10.0 * math.ceil(high)]
    scale = alt.Scale(scheme="viridis", domain=ends, clamp=True)
    key = alt.Legend(gradientLength=260, tickCount=5)
    at_m = made.devices_m[device]
    place = table(round=[0], x=at_m[:1], y=at_m[1:])
    drawn = [
        frame.chart(cells)
        .mark_rect(clip=True)
        .encode(
            alt.X2(field="x2"),
            alt.Y2(field="y2"),
            alt.Color("gain:Q", title="path gain (dB)", scale=scale, legend=key),
        ),
        *frame.outlines(buildings),
        frame.chart(place).mark_point(filled=True, size=150, color=BAD, stroke=PAPER, opacity=1),
    ]
    title = f"Path gain from device {device} to places {made.height_m[0]:g} m above home"
    return frame.finished(drawn, heading(title, about))


def _edges(middles: Floats) -> tuple[Floats, Floats]:
    """Where cells begin and end; a map of one has no width, and is a metre wide."""
    between = (middles[1:] + middles[:-1]) / 2.0
    first, last = (
        (2.0 * middles[0] - between[0], 2.0 * middles[-1] - between[-1])
        if len(between)
        else (middles[0] - 0.5, middles[0] + 0.5)
    )
    return np.append(first, between), np.append(between, last)


def plan_errors(run: FlightData) -> list[Chart]:
    """Planned and true PER of every update, where the truth is another than the channel."""
    if run.config.get("radio", {}).get("truth", "channel") == "channel" or not run.uplinks:
        return []
    late = (LATE,) if any(uplink.outcome == LATE for uplink in run.uplinks) else ()
    outcomes = ("delivered", "lost", *late)
    data = table(
        planned=[uplink.plan_per for uplink in run.uplinks],
        true=[uplink.true_per for uplink in run.uplinks],
        round=[uplink.round for uplink in run.uplinks],
        device=[uplink.device for uplink in run.uplinks],
        outcome=[uplink.outcome for uplink in run.uplinks],
    )
    scale = alt.Scale(domain=[0.0, 1.0], padding=8)
    axes = (
        alt.X("planned:Q", title="packet error rate as planned", scale=scale),
        alt.Y("true:Q", title="true", scale=scale),
    )
    colours = named(outcomes, [GOOD, BAD, WARM][: len(outcomes)])
    drawn = [
        alt.Chart(table(planned=[0.0, 1.0], true=[0.0, 1.0]))
        .mark_line(color=SOFT, strokeWidth=1.2, strokeDash=[4, 3])
        .encode(*axes),
        alt.Chart(data)
        .mark_point(filled=True, size=45, opacity=0.6, tooltip=True)
        .encode(
            *axes,
            alt.Color("outcome:N", title=None, scale=colours, legend=keys(outcomes)),
            alt.Detail(["round:Q", "device:Q"]),
        ),
    ]
    note = "a dot an update; above the line the plan hoped for too much"
    return [finished(drawn, title="Where the plan was wrong", note=note)]
