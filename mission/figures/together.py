"""Pictures of flights judged together: one map, distances over time, and who does what when."""

from collections.abc import Mapping
from typing import Any

import altair as alt
import numpy as np

from mission.analysis.airborne import times_in_air
from mission.analysis.holes import position_gaps
from mission.analysis.together import SEPARATIONS, Together
from mission.base.airspace import thin
from mission.base.arrays import Bools, Floats
from mission.base.gaps import inside, outside
from mission.base.palette import COLOURS, community_colour
from mission.figures.charts import Series, envelope, finished, line_chart
from mission.figures.film import Actor, film
from mission.figures.frame import TOLERANCE_M, Lines, MapFrame, line_table
from mission.figures.style import (
    BAD,
    BAND,
    COOL,
    GOOD,
    INK,
    PAPER,
    SOFT,
    WARM,
    Chart,
    keys,
    line_keys,
    named,
    table,
)
from mission.figures.words import Drawn, Look, Word, words
from mission.log.values import NS_PER_S, FlightData, Track

_PAIRS = 2 * COLOURS  # in one chart, the nearest: more look alike
_CROSS_PX = 7.0
_LEAST_SIDE = 0.4  # of a map's longer side
# In the order of the key; those of rounds are strong, the others pale.
_KINDS = {"climb, descent": SOFT, "leg": COOL, "hover": GOOD, "wait": WARM, "to and fro": BAND}
_STEP_S = 0.5
_MOVES_MPS = 0.7  # slower is a hover: gusts move it


def together_map(world: Together, width: float = 640.0) -> Chart:
    """A map with a hue for each flight, planned paths wide and pale, and a cross where two came
    nearest, with how near."""
    seen, met = world.seen, world.met
    planned: Lines = [(of.name, 0, path[:, :2]) for of in seen for path in of.plans]
    flown: Lines = []
    for of, flight, added_s in zip(seen, world.flights, world.added_s, strict=True):
        own = flight.run.data.truth.t_ns
        lost = position_gaps(flight.run.data, int(own[0]), int(own[-1])) + added_s
        parts = outside(of.track.pos_m[:, :2], of.track.t_ns / NS_PER_S, lost)
        flown += [(of.name, 0, thin(part, TOLERANCE_M)) for part in parts]
    served = _served(world)
    devices_m = world.on_map(world.flights[0].run.data.devices.pos_m)
    every = np.vstack([points for _, _, points in (*planned, *flown)] + [devices_m])
    low, high = every.min(axis=0), every.max(axis=0)
    aside = _LEAST_SIDE / 2 * (high - low).max()  # those who fly in a line need some height
    around = (low + high) / 2 + np.array([[-aside, -aside], [aside, aside]])
    frame = MapFrame.around([every, around], [], width)
    names = [of.name for of in seen]
    hue = alt.Stroke(
        "kind:O", scale=named(names, [of.colour for of in seen]), legend=line_keys(names)
    )
    hue_of_ring = alt.Stroke("by:N", scale=named(names, [of.colour for of in seen]), legend=None)
    order = alt.Order("step:Q"), alt.Detail("part:N")
    at = np.array([near.at_m[:2] for near in met]).reshape(-1, 2)
    told = [f"{near.away_m:.2f} m" for near in met]
    tip = alt.Tooltip("words:N", title=" ")
    crosses = frame.chart(table(x=at[:, 0], y=at[:, 1], words=[near.words for near in met]))
    # The nearest first, so that its words have room.
    order_of = sorted(range(len(met)), key=lambda n: met[n].away_m)
    labels = [Word(told[n], tuple(at[n].tolist())) for n in order_of]
    dots = np.column_stack((at, np.full(len(at), _CROSS_PX)))
    lines = [(0, points) for _, _, points in flown]
    ground = frame.chart(table(x=devices_m[:, 0], y=devices_m[:, 1], by=served))
    layers = [
        frame.chart(line_table(planned)).mark_line(strokeWidth=5, opacity=0.3).encode(hue, *order),
        frame.chart(line_table(flown)).mark_line(strokeWidth=1.8).encode(hue, *order),
        ground.transform_filter("datum.by == ''").mark_point(
            shape="circle", fill=PAPER, stroke=SOFT, size=40, opacity=1
        ),
        ground.transform_filter("datum.by != ''")
        .mark_point(shape="circle", fill=PAPER, size=60, strokeWidth=2.4, opacity=1)
        .encode(hue_of_ring, alt.Tooltip("by:N", title="served by")),
        crosses.mark_point(
            shape="cross", fill=BAD, stroke=None, size=110, opacity=1, angle=45
        ).encode(tooltip=tip),
        *words(frame, [(Look(colour=BAD), labels)], Drawn(dots, lines)),
    ]
    return frame.finished(layers, {"text": "Flown together"})


def _served(world: Together) -> list[str]:
    """By whom each device on the map was served most often; empty for those that nobody has."""
    count = len(world.flights[0].run.data.devices.community)
    times = np.zeros((len(world.names), count))
    for n, flight in enumerate(world.flights):
        for item in flight.run.data.uplinks:
            times[n, item.device] += 1
    return [world.names[of.argmax()] if of.any() else "" for of in times.T]


def together_film(world: Together) -> Chart:
    """The film of the map: all aircraft at once."""
    actors = [
        Actor(flight.run.data, of.track, of.name, of.colour, added_s)
        for flight, of, added_s in zip(world.flights, world.seen, world.added_s, strict=True)
    ]
    begin_s, end_s = zip(*((t.t_ns[0] / NS_PER_S, t.t_ns[-1] / NS_PER_S) for t in world.tracks),
                         strict=True)  # fmt: skip
    return film(actors, {0: (float(min(begin_s)), float(max(end_s)))})


def separation_chart(world: Together, limits: Mapping[str, float]) -> Chart:
    """The distance of each pair over time, with the limit as a red line."""
    met = sorted(world.met, key=lambda near: near.away_m)
    some = f"the {_PAIRS} pairs that came nearest" if len(met) > _PAIRS else ""
    series = [
        Series(near.name, community_colour(n), *envelope(near.times_s, near.distances_m),
               again=n >= COLOURS)
        for n, near in enumerate(met[:_PAIRS])
    ]  # fmt: skip
    (name, *_) = SEPARATIONS
    limit = limits.get(name)
    return line_chart(
        "Distances between vehicles", series, x=f"time of {world.names[0]} (s)", y="distance (m)",
        note=some, gate="" if limit is None else f"limit {limit:g} m", gate_at=limit or 0.0,
    )  # fmt: skip


def timetable(world: Together) -> Chart:
    """A row for each aircraft: climbs, legs, hovers, waits for others behind its last slot of a
    round, and ways outside rounds; a stroke for each slot."""
    bars: dict[str, list[Any]] = {"vehicle": [], "kind": [], "begin": [], "end": []}
    slots: dict[str, list[Any]] = {"vehicle": [], "at": []}
    for name, flight, track, added_s in zip(
        world.names, world.flights, world.tracks, world.added_s, strict=True
    ):
        data = flight.run.data
        air_s = np.array(times_in_air(flight.run.path, data)) + added_s
        for span in _spans(data, track, added_s, air_s):
            for key, value in zip(bars, (name, *span), strict=True):
                bars[key].append(value)
        times = [item.slot_t_s + added_s for item in data.uplinks if np.isfinite(item.slot_t_s)]
        slots["vehicle"] += [name] * len(times)
        slots["at"] += times
    rows = alt.Y("vehicle:N", title=None, sort=list(world.names))
    colours = named(list(_KINDS), list(_KINDS.values()))
    time = alt.X("begin:Q", title=f"time of {world.names[0]} (s)")
    layers = [
        alt.Chart(table(**bars))
        .mark_bar(height=13)
        .encode(
            rows,
            time,
            alt.X2("end:Q"),
            alt.Color("kind:N", scale=colours, legend=keys(list(_KINDS))),
            tooltip=["vehicle:N", "kind:N", alt.Tooltip("begin:Q", format=".1f")],
        ),
        alt.Chart(table(**slots))
        .mark_tick(color=INK, thickness=1.2, height=17)
        .encode(rows, alt.X("at:Q"), tooltip=["vehicle:N", alt.Tooltip("at:Q", title="slot (s)")]),
    ]
    return finished(layers, title="What each does when", height=26.0 * len(world.names))


def _spans(
    data: FlightData, track: Track, added_s: float, air_s: Floats
) -> list[tuple[str, float, float]]:
    """Kind, begin and end of what an aircraft does in the air (k, 2), one after another."""
    begin_s, end_s = (float(at) for at in track.t_ns[[0, -1]] / NS_PER_S)
    t_s = np.append(np.arange(begin_s, end_s, _STEP_S), end_s)
    if len(t_s) < 2:
        return []
    way = np.diff(track.at(np.round(t_s * NS_PER_S).astype(np.int64)).pos_m, axis=0)
    speed = np.linalg.norm(way, axis=1) / np.diff(t_s)
    upright = np.abs(way[:, 2]) > np.linalg.norm(way[:, :2], axis=1)
    middle = (t_s[:-1] + t_s[1:]) / 2.0
    in_round, waits = _rounds(data, middle - added_s)
    moves = speed > _MOVES_MPS
    kind = np.select(
        [~inside(middle, air_s), moves & upright, moves & in_round, moves, waits | ~in_round],
        ["", "climb, descent", "leg", "to and fro", "wait"],
        "hover",
    )
    ends = np.flatnonzero(np.append(kind[1:] != kind[:-1], True))
    starts = np.insert(ends[:-1] + 1, 0, 0)
    return [
        (str(kind[first]), float(t_s[first]), float(t_s[last + 1]))
        for first, last in zip(starts, ends, strict=True)
        if kind[first]
    ]


def _rounds(data: FlightData, t_s: Floats) -> tuple[Bools, Bools]:
    """Which times (n,) are within a round, and which of those behind its last slot; of a flight
    without rounds all are within."""
    if not data.rounds:
        return np.ones(len(t_s), dtype=bool), np.zeros(len(t_s), dtype=bool)
    within, waits = np.zeros(len(t_s), dtype=bool), np.zeros(len(t_s), dtype=bool)
    for record in data.rounds:
        here = (t_s >= record.start_t_s) & (t_s <= record.start_t_s + record.duration_s)
        own = [item.slot_t_s for item in data.uplinks if item.round == record.round]
        last_s = max((at for at in own if np.isfinite(at)), default=record.start_t_s)
        within |= here
        waits |= here & (t_s > last_s)
    return within, waits
