"""How a flight went: distance from its plan, battery, wind, and the estimator's sensors."""

from collections.abc import Callable
from typing import Any

import altair as alt
import numpy as np

from mission.analysis.compare import RunComparison
from mission.base.airspace import thin
from mission.base.arrays import Floats, Ints
from mission.base.palette import community_colour
from mission.figures.charts import Series, finished, line_chart
from mission.figures.style import BAD, COOL, GOOD, GRID, WARM, Chart, table
from mission.log.values import FlightData, InnovationTrack, WindTrack

_POINTS = 400  # of a line over time: more cannot be told apart
_TOLERANCE = 0.02  # metres that thinning may move a line
_TIME = "simulated time (s)"


def flight_charts(comparison: RunComparison) -> list[Chart]:
    """Charts of tracking error along the path; by round also estimate error and slot delays."""
    items = comparison.rounds
    rounds = [item.round for item in items if item.round is not None]

    def by_round(label: str, colour: str, name: str, *, dashed: bool = False) -> Series:
        values = [float(getattr(item, name)) for item in items]
        return Series(label, colour, rounds, values, dashed=dashed)

    cross = line_chart(
        "Distance from the planned path",
        [
            by_round("straights, rms", COOL, "straight_rms_m"),
            by_round("straights, max", COOL, "straight_max_m", dashed=True),
            by_round("corners cut, max", WARM, "corner_cut_max_m"),
            by_round("estimate error, rms", GOOD, "estimate_rms_m"),
        ],
        x="round",
        y="distance (m)",
        whole_x=True,
    )
    late = line_chart(
        "Slots later than planned",
        [
            by_round("mean", COOL, "slot_late_mean_s"),
            by_round("max", COOL, "slot_late_max_s", dashed=True),
        ],
        x="round",
        y="delay (s)",
        whole_x=True,
    )
    moved = any(item.fit.length_m > 0 for item in comparison.measured)
    return [*([along_chart(comparison)] if moved else []), cross, late]


def along_chart(comparison: RunComparison) -> Chart:
    """Cross-track error along the path; of several rounds the parameter `shown` chooses one."""
    fits = {item.record.round: item.fit for item in comparison.measured}
    lines = {
        number: thin(np.column_stack((fit.along_m, fit.cross_m)), _TOLERANCE)
        for number, fit in fits.items()
    }
    track = table(
        round=[number for number, line in lines.items() for _ in line],
        step=[step for line in lines.values() for step in range(len(line))],
        x=np.concatenate([line[:, 0] for line in lines.values()]),
        y=np.concatenate([line[:, 1] for line in lines.values()]),
    )
    corners = table(
        round=[number for number, fit in fits.items() for _ in fit.corners_m],
        x=[at for fit in fits.values() for at in fit.corners_m],
    )
    longest = max([fit.length_m for fit in fits.values()], default=1.0)
    scale = alt.Scale(domain=[0.0, longest or 1.0], nice=False)
    x = alt.X("x:Q", title="along the planned path (m)", scale=scale)
    line = alt.Chart(track).mark_line(color=COOL, strokeWidth=1.6)
    tip = [
        alt.Tooltip("x:Q", title="along (m)", format=".0f"),
        alt.Tooltip("y:Q", title="away (m)", format=".2f"),
    ]
    marks = [
        alt.Chart(corners).mark_rule(color=GRID, strokeDash=[3, 3]).encode(x),
        line.encode(x, alt.Y("y:Q", title="distance (m)"), alt.Order("step:Q")),
        alt.Chart(track).mark_point(size=50, opacity=0).encode(x, alt.Y("y:Q"), tooltip=tip),
    ]
    several = len(fits) > 1
    note = "true track; dashed: corners of the plan"
    if several:
        marks = [mark.transform_filter("datum.round == shown") for mark in marks]
        note = f"of the round chosen above; {note}"
    more: dict[str, Any] = {"params": [{"name": "shown", "value": min(fits)}]} if several else {}
    return finished(marks, title="Distance from the path, along it", note=note, **more)


def condition_charts(run: FlightData) -> list[Chart]:
    """Battery charge over time, and the true wind where there was any."""
    return [
        *([_battery(run)] if np.isfinite(run.battery.remaining).any() else []),
        *([_wind(run.wind)] if np.any(run.wind.vel_mps) else []),
    ]


def estimator_charts(run: FlightData) -> list[Chart]:
    """Charts of each sensor's innovation test ratio over time, with the gate at 1."""
    return [
        _innovations(sensor, index, track)
        for index, (sensor, track) in enumerate(run.innovations.items())
    ]


def _battery(run: FlightData) -> Chart:
    every = max(1, len(run.battery.t_ns) // _POINTS)
    t_s = (run.battery.t_ns[::every] / 1e9).tolist()
    left = Series("remaining", GOOD, t_s, 100.0 * run.battery.remaining[::every])
    return line_chart("Battery", [left], x=_TIME, y="remaining (%)", most=100.0)


def _wind(wind: WindTrack) -> Chart:
    across = np.hypot(wind.vel_mps[:, 0], wind.vel_mps[:, 1])
    series = [
        Series("horizontal", COOL, *_thinned(wind.t_ns, across, np.mean)),
        Series("upward", WARM, *_thinned(wind.t_ns, wind.vel_mps[:, 2], np.mean)),
    ]
    if len(wind.t_ns) > _POINTS:  # else mean and most are the same
        most = _thinned(wind.t_ns, across, np.max)
        series.append(Series("horizontal, most", COOL, *most, dashed=True))
    return line_chart(
        "Wind at the aircraft",
        series,
        x=_TIME,
        y="wind (m/s)",
        note="as it was, with gusts and turbulence",
    )


def _innovations(sensor: str, index: int, track: InnovationTrack) -> Chart:
    """Chart of a sensor's innovation test ratio over time, with the gate at 1."""
    name = sensor.replace("gnss", "GNSS")
    x, y = _thinned(track.t_ns, track.ratio, np.max)
    refused = ~track.accepted
    series = [Series(name, community_colour(index), x, y)]
    axes = f"of {track.values.shape[1]} axes together; " if track.values.shape[1] > 1 else ""
    some = np.flatnonzero(refused)[:_POINTS]
    return line_chart(
        f"{name[0].upper()}{name[1:]} against the estimate",
        series,
        x=_TIME,
        y="deviation (1: the most accepted)",
        gate="refused beyond",
        note=f"{axes}{refused.sum()} refused",
        marks=Series("refused", BAD, track.t_ns[some] / 1e9, track.ratio[some]),
    )


def _thinned(
    t_ns: Ints, values: Floats, what: Callable[[Floats], float]
) -> tuple[list[float], list[float]]:
    """Thin to at most `_POINTS` (seconds, values): `what` reduces each stretch of time to one."""
    parts = np.array_split(np.arange(len(t_ns)), min(_POINTS, len(t_ns)))
    x = [float(t_ns[part[len(part) // 2]]) / 1e9 for part in parts]
    return x, [float(what(values[part])) for part in parts]
