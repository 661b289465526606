"""The charts of what the aircraft met and knew: battery, wind, innovations of the estimator."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mission.base.palette import community_colour
from mission.log.values import FlightData, Floats, InnovationTrack, Ints, WindTrack
from mission.report import svg
from mission.report.charts import BAD, COOL, GOOD, WARM, card
from mission.report.svg import Series

_POINTS = 400  # of a line over time: more cannot be told apart
_SECONDS = "simulated s"


def condition_cards(run: FlightData) -> list[str]:
    """Battery, and wind where there was any."""
    return [
        *([_battery(run)] if len(run.battery.t_ns) else []),
        *([_wind(run.wind)] if np.any(run.wind.vel_mps) else []),
    ]


def estimator_cards(run: FlightData) -> list[str]:
    """A card for each sensor of the estimator."""
    return [
        _innovations(sensor, index, track)
        for index, (sensor, track) in enumerate(run.innovations.items())
    ]


def _battery(run: FlightData) -> str:
    every = max(1, len(run.battery.t_ns) // _POINTS)
    remaining = Series(
        "remaining", GOOD, _seconds(run.battery.t_ns[::every]),
        run.battery.remaining[::every].tolist(), dots=False,
    )  # fmt: skip
    return card(
        svg.line_chart("Battery", [remaining], x_label=_SECONDS, y=(0.0, 1.0), percent=True)
    )


def _wind(wind: WindTrack) -> str:
    across = np.hypot(wind.vel_mps[:, 0], wind.vel_mps[:, 1])
    upward = wind.vel_mps[:, 2]
    series = [
        Series("horizontal", COOL, *_thinned(wind.t_ns, across, np.mean), dots=False),
        Series("upward", WARM, *_thinned(wind.t_ns, upward, np.mean), dots=False),
    ]
    if len(wind.t_ns) > _POINTS:  # else mean and most are the same
        most = _thinned(wind.t_ns, across, np.max)
        series.append(Series("horizontal, most", COOL, *most, dots=False, dashed=True))
    chart = svg.line_chart("Wind at the aircraft", series, x_label=_SECONDS, y_label="m/s")
    return card(chart, note="as it was, with gusts and turbulence")


def _innovations(sensor: str, index: int, track: InnovationTrack) -> str:
    """How far a sensor was from what the estimator expected; the line at 1 is its gate."""
    x, y = _thinned(track.t_ns, track.ratio, np.max)
    name = sensor.replace("gnss", "GNSS")
    top = max(1.0, *y)
    chart = svg.line_chart(
        f"{name[0].upper()}{name[1:]} against the estimate",
        [Series(name, community_colour(index), x, y, dots=False)],
        x_label=_SECONDS, y_label="share", y=(0.0, 1.06 * top),
    )  # fmt: skip
    gate = chart.up.at(1.0)
    chart.parts.append(
        f'<line x1="{svg.LEFT}" x2="{svg.WIDTH - svg.RIGHT}" y1="{gate:.1f}" y2="{gate:.1f}" '
        f'stroke="{BAD}" stroke-dasharray="5 4"/>'
    )
    refused = ~track.accepted
    for t_s, ratio in zip(
        _seconds(track.t_ns[refused])[:_POINTS], track.ratio[refused].tolist(), strict=False
    ):
        at = (chart.across.at(t_s), chart.up.at(ratio))
        chart.dot(at, BAD, f"refused at {t_s:.1f} s: {ratio:.3g}")
    chart.legend.append(("refused beyond", BAD, True))
    note = (
        f"of {track.values.shape[1]} axes together, as a share of what is still believed"
        if track.values.shape[1] > 1
        else "as a share of what is still believed"
    )
    return card(chart, note=f"{note}; {refused.sum()} refused")


def _thinned(
    t_ns: Ints, values: Floats, what: Callable[[Floats], Any]
) -> tuple[list[float], list[float]]:
    """At most `_POINTS` points: one of each stretch of time, at its middle sample."""
    parts = np.array_split(np.arange(len(t_ns)), min(_POINTS, len(t_ns)))
    x = [float(t_ns[part[len(part) // 2]]) / 1e9 for part in parts]
    return x, [float(what(values[part])) for part in parts]


def _seconds(t_ns: Ints) -> list[float]:
    seconds: list[float] = (t_ns / 1e9).tolist()
    return seconds
