"""Pictures of flights of plan files: the map, and profiles along the planned path."""

from collections.abc import Sequence
from pathlib import Path

import altair as alt
import numpy as np

from mission.analysis.alignment import align
from mission.analysis.compare_plan import PlanFlight
from mission.analysis.load import flown, ground_speed
from mission.base import polyline
from mission.base.palette import community_colour
from mission.figures.charts import Series, line_chart
from mission.figures.frame import TOLERANCE_M, Frame, run_lines, thin
from mission.figures.render import heading, save_all, stacked
from mission.figures.style import (
    COOL,
    FENCE,
    FLOWN,
    GOOD,
    INK,
    PAPER,
    PLANNED,
    SOFT,
    keys,
    named,
    table,
)
from mission.log.values import NS_PER_S, Floats

_TOLERANCE = 0.02  # metres, or metres a second, that thinning may move a line
_NEAR_M = 1.0  # places closer than this share one label
_WIDTH = 640.0
_ALONG = "along the plan (m)"
_PLACES = {  # colour, fill, shape of what is on the map
    "reached": (FLOWN, PAPER, "circle"),
    "not reached": (FENCE, PAPER, "cross"),
    "rally point": (SOFT, PAPER, "triangle-up"),
}


def draw_flight(flight: PlanFlight, folder: Path) -> None:
    """Draw `map.png` and `profile.png` into `folder`.

    Raises:
        InputError: they cannot be written.
    """
    save_all({"map.png": flight_map(flight), "profile.png": profiles([flight])}, folder)


def flight_map(flight: PlanFlight) -> alt.LayerChart:
    """Planned and flown path, the places with the numbers of their items, and the way home."""
    run = flight.data
    frame = Frame(run, _WIDTH)
    end_ns = int(flown(run, flight.record).t_ns[-1])
    rest = run.truth.between(end_ns, int(run.truth.t_ns[-1])).pos_m[:, :2]
    after = ("after the last place", 0, thin(rest, TOLERANCE_M))
    lines = [*run_lines(run, [flight.plan]), *([after] if len(rest) > 1 else [])]
    layers = [*frame.ground(run), *frame.lines(lines), *_places(frame, flight)]
    title = heading("Planned and flown; numbers: items of the plan", flight.about)
    return frame.finished(layers).properties(title=title)


def profiles(flights: Sequence[PlanFlight]) -> alt.VConcatChart:
    """Along the planned path, a line a flight."""
    about = flights[0].about if len(flights) == 1 else f"{len(flights)} flights"
    return stacked(profile_charts(flights), title="Along the plan", about=about)


def profile_charts(flights: Sequence[PlanFlight]) -> list[alt.LayerChart]:
    """Height, distance from the path, ground speed and error of the estimate, a line a flight."""
    plan = flights[0].plan
    planned_m = np.column_stack((polyline.along(plan.route_m), plan.route_height_m))
    height = [Series("planned", PLANNED, planned_m[:, 0], planned_m[:, 1], dashed=True)]
    cross, speed, error = [], [], []
    for index, flight in enumerate(flights):
        alone = len(flights) == 1
        name, colour = ("flown", FLOWN) if alone else (flight.about, community_colour(index))
        track = flown(flight.data, flight.record)
        belief = flown(flight.data, flight.record, track=flight.data.belief)
        fit = align(track.pos_m[:, :2], flight.plan.route_m)
        away_m = belief.pos_m - track.pos_m
        t_s = (track.t_ns - track.t_ns[0]) / NS_PER_S
        height.append(_thinned(name, colour, fit.along_m, track.pos_m[:, 2]))
        if flight.plan.path_m > 0:
            cross.append(_thinned(name, colour, fit.along_m, fit.cross_m))
        speed.append(_thinned(name, colour, fit.along_m, ground_speed(track)))
        sides = ("horizontal", COOL), ("height", GOOD)
        both = (np.hypot(*away_m[:, :2].T), np.abs(away_m[:, 2]))
        for (side, shade), values in zip(sides, both, strict=True):
            label = side if alone else f"{side}, {name}"
            error.append(_thinned(label, shade if alone else colour, t_s, values))
            if not alone:
                break  # the horizontal one is enough to compare
    return [
        line_chart("Height above home", height, x=_ALONG, y="height (m)"),
        *([line_chart("Distance from the path", cross, x=_ALONG, y="distance (m)")] * bool(cross)),
        line_chart("Ground speed", speed, x=_ALONG, y="speed (m/s)"),
        line_chart("Estimate against the truth", error, x="time in the mission (s)", y="error (m)"),
    ]


def _thinned(label: str, colour: str, x: Floats, y: Floats) -> Series:
    kept = thin(np.column_stack((x, y)), _TOLERANCE)
    return Series(label, colour, kept[:, 0], kept[:, 1])


def _places(frame: Frame, flight: PlanFlight) -> list[alt.Chart]:
    kinds = ["reached" if seq in flight.reached else "not reached" for seq in flight.places_m]
    at_m = np.array([*flight.places_m.values(), *flight.rally_m]).reshape(-1, 3)
    kinds += ["rally point"] * len(flight.rally_m)
    names = [str(seq) for seq in flight.places_m] + [""] * len(flight.rally_m)
    shown = [kind for kind in _PLACES if kind in kinds]
    strokes, fills, shapes = zip(*(_PLACES[kind] for kind in shown), strict=True)
    key = keys(shown, symbolSize=70)
    marks = frame.chart(
        table(round=[0] * len(kinds), x=at_m[:, 0], y=at_m[:, 1], height=at_m[:, 2], kind=kinds,
              item=names)
    ).mark_point(size=50, opacity=1, strokeWidth=1.6).encode(
        shape=alt.Shape("kind:N", scale=named(shown, shapes), legend=key),
        color=alt.Color("kind:N", scale=named(shown, strokes), legend=key),
        fill=alt.value(fills[0]),
        tooltip=[alt.Tooltip("item:N"), alt.Tooltip("kind:N", title="was"),
                 alt.Tooltip("height:Q", title="height (m)", format=".1f")],
    )  # fmt: skip
    labels = _labels(flight)
    text = table(round=[0] * len(labels), x=[at[0] for at, _ in labels],
                 y=[at[1] for at, _ in labels], item=[", ".join(n) for _, n in labels])  # fmt: skip
    return [
        marks,
        frame.chart(text).mark_text(align="left", dx=7, dy=-7, fontSize=10, color=INK).encode(
            text="item:N"
        ),
    ]  # fmt: skip


def _labels(flight: PlanFlight) -> list[tuple[Floats, list[str]]]:
    """Where numbers stand, and which."""
    labels: list[tuple[Floats, list[str]]] = []
    for seq, place in flight.places_m.items():
        for at, numbers in labels:
            if np.linalg.norm(at - place[:2]) < _NEAR_M:
                numbers.append(str(seq))
                break
        else:
            labels.append((place[:2], [str(seq)]))
    return labels
