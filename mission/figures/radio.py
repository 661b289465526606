"""The radio by place: the gains of a map, and where plans were wrong about it."""

import math
from collections.abc import Sequence

import altair as alt
import numpy as np

from fl.radio.city import Building
from fl.radio.per_grid import PerGrid
from fl.radio.place import RadioMap
from mission.base.arrays import Floats
from mission.figures.charts import finished
from mission.figures.frame import MapFrame, run_frame, run_lines
from mission.figures.style import (
    BAD,
    FLOWN,
    GOOD,
    PAPER,
    SOFT,
    WARM,
    Chart,
    heading,
    keys,
    named,
    per_scale,
    table,
)
from mission.log.records import LATE
from mission.log.values import NS_PER_S, FlightData

_WIDTH = 560.0
_MOST_CELLS = 200  # a side: more cannot be told apart
_PANEL, _PANEL_CELLS = 230.0, 41  # of a belief, and cells a side
_SHOWN = (1, 2, 4)  # rounds, beside the last


def gain_picture(
    made: RadioMap, device: int, buildings: Sequence[Building] = (), *, about: str = ""
) -> Chart:
    """Heat map of path gain (dB) from a device, at the lowest height of a radio map."""
    (x, x2), (y, y2) = (_edges(line) for line in (made.x_m, made.y_m))
    across, up = (max(1, math.ceil(len(line) / _MOST_CELLS)) for line in (x, y))
    frame = MapFrame.around([np.array([[x[0], y[0]], [x2[-1], y2[-1]]])], [], _WIDTH)
    columns, rows = np.arange(0, len(x), across), np.arange(0, len(y), up)
    j, i = (part.ravel() for part in np.meshgrid(rows, columns, indexing="ij"))
    gain_db = made.path_gain_db[device, 0, j, i]
    last_i, last_j = np.minimum(i + across, len(x)) - 1, np.minimum(j + up, len(y)) - 1
    low, high = np.quantile(gain_db, (0.01, 1.0)) / 10.0
    ends = [10.0 * math.floor(low), 10.0 * math.ceil(high)]
    scale = alt.Scale(scheme="viridis", domain=ends, clamp=True)
    key = alt.Legend(gradientLength=260, tickCount=5)
    at_m = made.devices_m[device]
    place = table(round=[0], x=at_m[:1], y=at_m[1:])
    colour = alt.Color("gain:Q", title="path gain (dB)", scale=scale, legend=key)
    drawn = [
        _cells(frame, (x[i], x2[last_i]), (y[j], y2[last_j]), colour, gain=np.round(gain_db, 1)),
        *frame.outlines(buildings),
        frame.chart(place).mark_point(filled=True, size=150, color=BAD, stroke=PAPER, opacity=1),
    ]
    title = f"Path gain from device {device} to places {made.height_m[0]:g} m above home"
    return frame.finished(drawn, heading(title, about))


def _cells(
    frame: MapFrame,
    x: tuple[Floats, Floats],
    y: tuple[Floats, Floats],
    colour: alt.Color,
    **value: Floats,
) -> alt.Chart:
    """Layer of cells between bounds (n,) in `x` and in `y`, coloured by their value."""
    seam_m = 0.5 * frame.pixel_m  # cells that only touch have paper between them
    cells = table(x=x[0], x2=x[1] + seam_m, y=y[0], y2=y[1] + seam_m, **value)
    corners = alt.X2(field="x2"), alt.Y2(field="y2")
    drawn: alt.Chart = frame.chart(cells).mark_rect(clip=True).encode(*corners, colour)
    return drawn


def _edges(middles: Floats) -> tuple[Floats, Floats]:
    """Lower and upper bounds (n,) of cells with middles (n,); a single cell is 1 m wide."""
    between = (middles[1:] + middles[:-1]) / 2.0
    first, last = (
        (2.0 * middles[0] - between[0], 2.0 * middles[-1] - between[-1])
        if len(between)
        else (middles[0] - 0.5, middles[0] + 0.5)
    )
    return np.append(first, between), np.append(between, last)


def beliefs(run: FlightData) -> list[Chart]:
    """Maps of a device's PER as believed when some rounds began, and of the true one.

    The device is the one whose belief changed most. Empty where the log has no such maps.
    """
    if run.radio_true is None or not run.radio_believed:
        return []
    # A belief is written before its round starts, and after the round before did.
    grids = {
        1 + sum(record.start_t_s * NS_PER_S < t_ns for record in run.rounds): grid
        for t_ns, grid in run.radio_believed
    }
    first, last = grids[min(grids)], grids[max(grids)]
    device = int(np.abs(last.success - first.success).mean(axis=(1, 2)).argmax())
    frame = run_frame(run, _PANEL)
    panels = []
    for number in sorted({min(grids), max(grids), *_SHOWN} & grids.keys()):
        before = [plan for plan in run.plans if plan.round < number]
        paths = [line for line in run_lines(run, before) if line[0] == "flown"]
        lines = frame.lines(paths)
        panels.append(
            _belief(run, frame, grids[number], device, f"believed as round {number} began", lines)
        )
    return [*panels, _belief(run, frame, run.radio_true, device, "true", [])]


def _belief(
    run: FlightData, frame: MapFrame, grid: PerGrid, device: int, name: str, lines: list[alt.Chart]
) -> Chart:
    every = math.ceil(max(grid.success.shape[1:]) / _PANEL_CELLS)
    success, cell_m = grid.success[device, ::every, ::every], grid.cell_m * every
    row, column = np.indices(success.shape)
    x, y = (
        first + cell_m * (line.ravel() - 0.5)
        for first, line in zip(grid.first_m, (column, row), strict=True)
    )
    per = np.round(1.0 - success.ravel(), 2)
    colour = alt.Color("per:Q", title="packet error rate", scale=per_scale())
    at_m = run.devices.pos_m[device]
    drawn = [
        _cells(frame, (x, x + cell_m), (y, y + cell_m), colour, per=per),
        *lines,
        frame.chart(table(round=[0], x=at_m[:1], y=at_m[1:])).mark_point(
            filled=True, size=110, color=FLOWN, stroke=PAPER, opacity=1
        ),
    ]
    return frame.finished(drawn, {"text": f"Device {device}, {name}"})


def plan_errors(run: FlightData) -> list[Chart]:
    """Chart of true over planned PER of each update; none where the channel is the truth."""
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
