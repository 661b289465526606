"""Pictures of flights of plan files: profiles along the planned path."""

from collections.abc import Callable, Sequence

import altair as alt
import numpy as np

from mission.analysis.compare import RunComparison
from mission.analysis.comparison_text import labels_of
from mission.analysis.measure import Measured
from mission.analysis.spikes import events, spikes
from mission.base.airspace import thin
from mission.base.arrays import Floats
from mission.base.gaps import outside
from mission.base.palette import community_colour
from mission.figures.charts import Series, envelope, finished, line_chart
from mission.figures.render import stacked
from mission.figures.style import BAD, COOL, FLOWN, GOOD, PLANNED, Chart, line_keys, named, table
from mission.log.values import NS_PER_S

_OF_ERRORS = 4  # layers of a time line
_OTHERS = (1, 3, 4, 5, 6, 0)  # colours than those of errors
_TOLERANCE = 0.02  # metres, or metres a second, that thinning may move a line
_TOLD = (  # lines of a flight without a plan
    ("off its setpoint", FLOWN, "tracking_m"),
    ("off its target's way", COOL, "target_m"),
    ("height", GOOD, "height_off_m"),
)
# How the vehicle was: shares of a whole, and others of the most in the flight.
_HEALTH = (
    ("innovations, of what is accepted", "innovation_ratio"),
    ("battery left", "remaining"),
    ("motors, of the most", "motors"),
    ("vibration, of {:.1f} m/s2", "vibration_mps2"),
    ("clips, of {:.0f}", "clips"),
    ("satellites, of {:.0f}", "satellites"),
)
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
            height.append(_thinned(name, colour, measured, fit.along_m, track.pos_m[:, 2]))
            if fit.length_m > 0:
                cross.append(_thinned(name, colour, measured, fit.along_m, fit.cross_m))
            speed.append(_thinned(name, colour, measured, fit.along_m, measured.speed_mps))
            if not len(measured.estimate_m):
                continue
            sides = ("horizontal", COOL), ("height", GOOD)
            both = (measured.estimate_m, np.abs(measured.estimate_height_m))
            for (side, shade), values in zip(sides, both, strict=True):
                label = side if alone and len(flight.measured) == 1 else f"{side}, {name}"
                error.append(_thinned(label, shade if alone else colour, measured, t_s, values))
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
    """Errors over the log's time with what happened (events as lines, spikes with reasons), and by
    the axis at the right how the vehicle was."""
    errors: dict[tuple[str, str], Callable[[Measured], Floats]] = {
        ("cross-track", FLOWN): lambda measured: measured.cross_m,
        ("height", GOOD): lambda measured: np.abs(measured.height_m),
    }
    drawn = {
        name: _broken([
            part for item in flight.measured
            for part in _parts(item, item.truth.t_ns / NS_PER_S, of(item))
        ])
        for (name, _), of in errors.items()
    }  # fmt: skip
    drawn |= {name: _told(flight, key) for name, _, key in _TOLD if not flight.measured}
    x_s, y_m = np.vstack(list(drawn.values())).T
    lines = table(series=[name for name, rows in drawn.items() for _ in rows], x=x_s, y=y_m)
    if flight.measured:
        ends_ns = flight.measured[0].truth.t_ns[0], flight.measured[-1].truth.t_ns[-1]
        begin_s, end_s = (at / NS_PER_S for at in ends_ns)
    elif flight.flown is not None:
        begin_s, end_s = flight.flown.start_s, flight.flown.end_s
    happened = events(flight.run.data, begin_s, end_s)
    peaks = spikes(flight.run.data, flight.measured)
    x = alt.X("x:Q", title="time of the log (s)", scale=alt.Scale(zero=False))
    y = alt.Y("y:Q", title="error (m)")
    names = [name for name, rows in drawn.items() if len(rows)]
    colours = dict(errors.keys()) | {name: colour for name, colour, _ in _TOLD}
    shades = named(names, [colours[name] for name in names])
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
        *_shares(flight, x),
    ]
    shown = (("dashed: something happened", happened), ("points: spikes, and why", peaks))
    note = "; ".join(words for words, there in shown if there)
    title = "Time line" if alone else f"Time line of {flight.run.about}"
    chart = finished(layers, title=title, note=note)
    if len(layers) > _OF_ERRORS:  # beside an axis of its own
        *of_errors, shares = chart["layer"]
        scales = {"y": "independent", "color": "independent"}
        chart |= {"layer": [{"layer": of_errors}, shares], "resolve": {"scale": scales}}
    return chart


def _shares(flight: RunComparison, x: alt.X) -> list[alt.Chart]:
    """A layer of the lines of `_HEALTH` that the log has; none without any."""
    drawn: dict[str, Floats] = {}
    for label, key in _HEALTH:
        rows = _told(flight, key)
        most = np.nanmax(rows[:, 1], initial=0.0)
        if most > 0.0:
            of = most if "{" in label else 1.0
            drawn[label.format(most)] = rows / (1.0, of)
    if not drawn:
        return []
    x_s, share = np.vstack(list(drawn.values())).T
    lines = table(series=[name for name, rows in drawn.items() for _ in rows], x=x_s, y=share)
    shades = named(list(drawn), [community_colour(n) for n in _OTHERS[: len(drawn)]])
    colour = alt.Color("series:O", scale=shades, legend=line_keys(list(drawn)))
    y = alt.Y("y:Q", title="share", axis=alt.Axis(grid=False))
    marks = alt.Chart(lines).mark_line(strokeWidth=1.0, opacity=0.6, strokeDash=[6, 2])
    return [marks.encode(x=x, y=y, color=colour)]


def _told(flight: RunComparison, key: str) -> Floats:
    """A number over the time of a flight against what it was told, as a line (n, 2)."""
    values = flight.flown.series.get(key) if flight.flown else None
    if values is None:
        return np.empty((0, 2))
    return np.column_stack(envelope(values.t_s, np.abs(values.values)))


def _thinned(label: str, colour: str, measured: Measured, x: Floats, y: Floats) -> Series:
    kept = _broken([thin(part, _TOLERANCE) for part in _parts(measured, x, y)])
    return Series(label, colour, kept[:, 0], kept[:, 1])


def _parts(measured: Measured, x: Floats, y: Floats) -> list[Floats]:
    """Points (n, 2) of what was measured at each sample, in the parts between holes."""
    t_s = measured.truth.t_ns / NS_PER_S
    return outside(np.column_stack((x, y)), t_s, measured.hidden_s)


def _broken(parts: Sequence[Floats]) -> Floats:
    """Lines (n, 2) as parts of one, which has no value behind each."""
    rows = [rows for part in parts if len(part) for rows in (part, [(part[-1, 0], np.nan)])]
    return np.vstack([np.empty((0, 2)), *rows])
