"""The places of a plan file on its map, with the numbers of their items."""

import altair as alt
import numpy as np

from mission.figures.frame import MapFrame
from mission.figures.style import FENCE, FLOWN, PAPER, SOFT, keys, named, table
from mission.figures.words import Word, gathered
from mission.log.values import PlannedPlaces

_NEAR_M = 1.0  # places closer than this share one label
_KINDS = {  # colour and shape of what is on the map
    "reached": (FLOWN, "circle"),
    "not reached": (FENCE, "cross"),
    "not reached outside holes": (FENCE, "cross"),
    "rally point": (SOFT, "triangle-up"),
}


def places(frame: MapFrame, plan: PlannedPlaces) -> list[alt.Chart]:
    """Layer of a plan's places, reached or not, and of its rally points."""
    missed = "not reached outside holes" if plan.in_holes else "not reached"
    kinds = ["reached" if seq in plan.reached else missed for seq in plan.places_m]
    at_m = np.array([*plan.places_m.values(), *plan.rally_m]).reshape(-1, 3)
    kinds += ["rally point"] * len(plan.rally_m)
    names = [str(seq) for seq in plan.places_m] + [""] * len(plan.rally_m)
    shown = [kind for kind in _KINDS if kind in kinds]
    strokes, shapes = zip(*(_KINDS[kind] for kind in shown), strict=True)
    key = keys(shown, symbolSize=70)
    x, y, height = at_m.T
    data = table(round=[0] * len(kinds), x=x, y=y, height=height, kind=kinds, item=names)
    tip = [
        alt.Tooltip("item:N"),
        alt.Tooltip("kind:N", title="was"),
        alt.Tooltip("height:Q", title="height (m)", format=".1f"),
    ]
    points = frame.chart(data).mark_point(size=50, opacity=1, strokeWidth=1.6)
    marks = points.encode(
        shape=alt.Shape("kind:N", scale=named(shown, shapes), legend=key),
        color=alt.Color("kind:N", scale=named(shown, strokes), legend=key),
        fill=alt.value(PAPER),
        tooltip=tip,
    )
    return [marks]


def item_numbers(plan: PlannedPlaces) -> list[Word]:
    """The mission items' sequence numbers, one word for items that share a place."""
    each = gathered([(place[:2], seq) for seq, place in plan.places_m.items()], _NEAR_M)
    return [Word(", ".join(map(str, items)), tuple(at)) for at, items in each]
