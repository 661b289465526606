"""What each of several aircraft does when: a row for each, with its slots."""

from typing import Any

import altair as alt
import numpy as np

from mission.analysis.together import Together
from mission.base.arrays import Bools, Floats
from mission.figures.charts import finished
from mission.figures.style import BAND, COOL, GOOD, INK, SOFT, WARM, Chart, keys, named, table
from mission.log.values import NS_PER_S, FlightData, Track

# In the order of the key; those of rounds are strong, the others pale.
_KINDS = {"climb, descent": SOFT, "leg": COOL, "hover": GOOD, "wait": WARM, "to and fro": BAND}
_STEP_S = 0.5
_MOVES_MPS = 0.7  # slower is a hover: gusts move it


def timetable(world: Together) -> Chart:
    """A row for each aircraft: climbs, legs, hovers, waits for others behind its last slot of a
    round, and ways outside rounds; a stroke for each slot."""
    bars: dict[str, list[Any]] = {"vehicle": [], "kind": [], "begin": [], "end": []}
    slots: dict[str, list[Any]] = {"vehicle": [], "at": []}
    for name, flight, track, added_s in zip(
        world.names, world.flights, world.tracks, world.added_s, strict=True
    ):
        data = flight.run.data
        for span in _spans(data, track, added_s):
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


def _spans(data: FlightData, track: Track, added_s: float) -> list[tuple[str, float, float]]:
    """Kind, begin and end of what an aircraft does, one after another."""
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
        [moves & upright, moves & in_round, moves, waits | ~in_round],
        ["climb, descent", "leg", "to and fro", "wait"],
        "hover",
    )
    ends = np.flatnonzero(np.append(kind[1:] != kind[:-1], True))
    starts = np.insert(ends[:-1] + 1, 0, 0)
    return [
        (str(kind[first]), float(t_s[first]), float(t_s[last + 1]))
        for first, last in zip(starts, ends, strict=True)
    ]


def _rounds(data: FlightData, t_s: Floats) -> tuple[Bools, Bools]:
    """Which times (n,) are within a round, and which of those behind its last slot; of a flight
    without rounds all are within."""
    if not data.rounds:
        return np.ones(len(t_s), dtype=bool), np.zeros(len(t_s), dtype=bool)
    inside, waits = np.zeros(len(t_s), dtype=bool), np.zeros(len(t_s), dtype=bool)
    for record in data.rounds:
        here = (t_s >= record.start_t_s) & (t_s <= record.start_t_s + record.duration_s)
        own = [item.slot_t_s for item in data.uplinks if item.round == record.round]
        last_s = max((at for at in own if np.isfinite(at)), default=record.start_t_s)
        inside |= here
        waits |= here & (t_s > last_s)
    return inside, waits
