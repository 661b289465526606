"""The film of a page's map: where everybody is when, and what was heard, lost and said then."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.analysis.holes import position_gaps
from mission.base.gaps import inside
from mission.figures.style import BAD, FLOWN, GOOD, PAPER, Chart
from mission.log.records import LATE
from mission.log.values import NS_PER_S, FlightData, Track

_STEP_S, _FRAMES = 0.5, 3600  # between places of an aircraft, and how many at most
_HEARD = {"delivered": ("heard", GOOD), "lost": ("lost", BAD), LATE: ("late", BAD)}


@dataclass(frozen=True)
class Actor:
    """One aircraft: its flight, and its track on the map, whose times are its own and more."""

    run: FlightData
    track: Track
    name: str = ""
    colour: str = FLOWN
    added_s: float = 0.0


def film(actors: Sequence[Actor], spans_s: dict[int, tuple[float, float]]) -> Chart:
    """Places of each at even times, and what happened, with a place where it has one; `spans_s`:
    from when to when each round lasts, 0: all. Times are seconds, places those of the map."""
    begin_s, end_s = min(s for s, _ in spans_s.values()), max(s for _, s in spans_s.values())
    step_s = max(_STEP_S, (end_s - begin_s) / _FRAMES)
    t_ns = np.round(np.arange(begin_s, end_s + step_s, step_s) * NS_PER_S).astype(np.int64)
    seen, news = [], list[tuple[float, str, float | None, float | None, str]]()
    for actor in actors:
        run, track, added_s = actor.run, actor.track, actor.added_s
        first_ns, last_ns = track.t_ns[[0, -1]].tolist()
        own_ns = run.truth.t_ns[[0, -1]].tolist()
        lost = inside(t_ns / NS_PER_S, position_gaps(run, own_ns[0], own_ns[1]) + added_s)
        known = (t_ns >= first_ns) & (t_ns <= last_ns) & ~lost
        places = [
            [round(v, 1) for v in row] if there else None
            for row, there in zip(track.at(t_ns).pos_m.tolist(), known.tolist(), strict=True)
        ]
        seen.append({"name": actor.name, "colour": actor.colour, "places": places})
        who = f"{actor.name}: " if actor.name else ""
        for event in run.events:
            if event.kind != "reached" or not run.uplinks:
                news.append((event.t_ns / NS_PER_S + added_s, who + event.text, None, None, ""))
        for sent in run.uplinks:
            if math.isfinite(sent.slot_t_s):
                word, colour = _HEARD[sent.outcome]
                x, y = run.devices.pos_m[sent.device].tolist()
                text = f"{who}device {sent.device} {word}"
                news.append((sent.slot_t_s + added_s, text, x, y, colour))
    news = sorted((of for of in news if begin_s <= of[0] <= end_s), key=lambda of: of[0])
    return {"from": begin_s, "step": step_s, "seen": seen, "news": news, "spans": spans_s}


def with_film(chart: Chart) -> Chart:
    """A map with a layer for the data `now`: aircraft, and who was heard or lost."""
    axes = next(of["encoding"] for of in chart["layer"] if "x" in of.get("encoding", {}))
    as_is = {"type": "nominal", "scale": None}
    layer = {
        "name": "now",
        "data": {"name": "now"},
        "mark": {"type": "point", "opacity": 1, "stroke": PAPER, "strokeWidth": 1.5, "size": 130},
        "encoding": {
            "x": axes["x"],
            "y": axes["y"],
            "fill": {"field": "colour", **as_is},
            "shape": {"field": "shape", **as_is},
        },
    }
    datasets = {**chart["datasets"], "now": []}
    return {**chart, "layer": [*chart["layer"], layer], "datasets": datasets}
