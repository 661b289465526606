"""Pictures of flights of plan files: profiles along the planned path."""

from collections.abc import Sequence

import altair as alt
import numpy as np

from mission.analysis.compare import RunComparison
from mission.analysis.comparison_text import labels_of
from mission.analysis.spikes import events, spikes
from mission.base.airspace import thin
from mission.base.arrays import Floats
from mission.base.palette import community_colour
from mission.figures.charts import Series, finished, line_chart
from mission.figures.render import stacked
from mission.figures.style import BAD, COOL, FLOWN, GOOD, PLANNED, Chart, line_keys, named, table
from mission.log.values import NS_PER_S

_TOLERANCE = 0.02  # metres, or metres a second, that thinning may move a line
_ALONG = "along the plan (m)"


def profiles(flights: Sequence[RunComparison]) -> Chart:
    """The charts of `profile_charts` under each other, as one picture."""
    about = flights[0].run.about if len(flights) == 1 else f"{len(flights)} flights"
    return stacked(profile_charts(flights), title="Along the plan", about=about)


def profile_charts(flights: Sequence[RunComparison]) -> list[Chart]:
    """Time lines, then charts of height, path distance, ground speed and estimate error."""
    plan = flights[0].run.data.plans[0]
    along_m = flights[0].measured[0].fit.waypoints_at_m
    height, cross, speed, error = [], [], [], []
    alone, labels = len(flights) == 1, labels_of(flights)
    for index, flight in enumerate(flights):
        for measured in flight.measured:
            name, colour = ("flown", FLOWN) if alone else (labels[index], community_colour(index))
            if len(flight.measured) > 1:
                name = f"{name}, pass {measured.record.round}"
            track, fit = measured.truth, measured.fit
            t_s = (track.t_ns - track.t_ns[0]) / NS_PER_S
            height.append(_thinned(name, colour, fit.along_m, track.pos_m[:, 2]))
            if fit.length_m > 0:
                cross.append(_thinned(name, colour, fit.along_m, fit.cross_m))
            speed.append(_thinned(name, colour, fit.along_m, measured.speed_mps))
            if not len(measured.estimate_m):
                continue
            sides = ("horizontal", COOL), ("height", GOOD)
            both = (measured.estimate_m, np.abs(measured.estimate_height_m))
            for (side, shade), values in zip(sides, both, strict=True):
                label = side if alone and len(flight.measured) == 1 else f"{side}, {name}"
                error.append(_thinned(label, shade if alone else colour, t_s, values))
                if not alone:
                    break  # the horizontal one is enough to compare
    planned = Series("planned", PLANNED, along_m, plan.route_height_m, dashed=True)  # above all
    return [
        *(timeline_chart(flight, alone=alone) for flight in flights),
        line_chart("Height above home", [*height, planned], x=_ALONG, y="height (m)"),
        *([line_chart("Distance from the path", cross, x=_ALONG, y="distance (m)")] * bool(cross)),
        line_chart("Ground speed", speed, x=_ALONG, y="speed (m/s)"),
        *(
            line_chart(
                "Estimate against the truth", error, x="time in the mission (s)", y="error (m)"
            )
            for _ in error[:1]  # where there is one
        ),
    ]


def timeline_chart(flight: RunComparison, *, alone: bool) -> Chart:
    """Errors over the log's time with what happened: events as lines, spikes with reasons."""
    times = [measured.truth.t_ns / NS_PER_S for measured in flight.measured]
    errors: tuple[tuple[str, str, list[Floats]], ...] = (
        ("cross-track", FLOWN, [measured.cross_m for measured in flight.measured]),
        ("height", GOOD, [np.abs(measured.height_m) for measured in flight.measured]),
    )
    lines = table(
        series=[name for name, _, parts in errors for part in parts for _ in part],
        x=np.concatenate([*times, *times]),
        y=np.concatenate([part for _, _, parts in errors for part in parts]),
    )
    happened = events(flight.run.data, float(times[0][0]), float(times[-1][-1]))
    peaks = spikes(flight.run.data, flight.measured)
    x, y = (
        alt.X("x:Q", title="time of the log (s)", scale=alt.Scale(zero=False)),
        alt.Y("y:Q", title="error (m)"),
    )
    names = [name for name, _, _ in errors]
    shades = named(names, [colour for _, colour, _ in errors])
    colour = alt.Color("series:O", scale=shades, legend=line_keys(names))
    rules = table(
        x=[event.start_s for event in happened],
        x2=[event.end_s for event in happened],
        what=[event.text for event in happened],
    )
    tops = table(
        x=[spike.peak_s for spike in peaks],
        y=[spike.peak_m for spike in peaks],
        what=[spike.words for spike in peaks],
    )
    told = [alt.Tooltip("what:N", title=" ")]
    layers = [
        alt.Chart(rules).mark_rect(color=BAD, opacity=0.15).encode(x=x, x2="x2:Q", tooltip=told),
        alt.Chart(rules).mark_rule(color=BAD, strokeDash=[3, 3]).encode(x=x, tooltip=told),
        alt.Chart(lines).mark_line(strokeWidth=1.6).encode(x=x, y=y, color=colour),
        alt.Chart(tops).mark_point(color=BAD, filled=True, size=50).encode(x=x, y=y, tooltip=told),
    ]
    shown = (("dashed: something happened", happened), ("points: spikes, and why", peaks))
    note = "; ".join(words for words, there in shown if there)
    title = "Time line" if alone else f"Time line of {flight.run.about}"
    return finished(layers, title=title, note=note)


def _thinned(label: str, colour: str, x: Floats, y: Floats) -> Series:
    kept = thin(np.column_stack((x, y)), _TOLERANCE)
    return Series(label, colour, kept[:, 0], kept[:, 1])
