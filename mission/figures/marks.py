"""What every map shows, of plans as of flights: areas, devices, transmissions, and names."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import altair as alt
import numpy as np

from fl.radio.city import Building
from mission.base.airspace import Airspace
from mission.base.arrays import Floats
from mission.base.palette import community_colour
from mission.figures.frame import Lines, MapFrame, NoFly, named_areas
from mission.figures.style import (
    CROWD,
    RING,
    SOFT,
    dot_radii,
    importance_size,
    keys,
    named,
    per_key,
    per_scale,
    table,
)
from mission.figures.words import CROWDED, SIDES, Drawn, Look, Word, words
from mission.log.records import LATE
from mission.log.values import Devices

NOT_SERVED = "not served"
_AREA = Look(7.0, 9.0, SOFT)  # of names
_HOME_PX = 6.0  # radius of the mark of home, or of the start
_LOST = "lost"
# Shapes of what became of an update: a circle, a cross in a ring, an hourglass, a ring.
_SHAPES = {
    "served": "circle",
    "delivered": "circle",
    _LOST: (
        f"{RING}M-0.55,-0.42L-0.42,-0.55L0.55,0.42L0.42,0.55Z"
        "M-0.55,0.42L-0.42,0.55L0.55,-0.42L0.42,-0.55Z"
    ),
    LATE: "M-0.8,-1L0.8,-1L-0.8,1L0.8,1Z",
    NOT_SERVED: RING,
}


@dataclass(frozen=True)
class Sent:
    """A device's transmission in a round, as it is planned or as it went."""

    round: int
    device: int
    step: int
    from_m: Floats | None  # (2,) where the aircraft is; None: its slot was not reached in time
    per: float  # there
    outcome: str
    t_s: float = math.nan  # when


@dataclass(frozen=True)
class RoundMarks:
    """What a map shows of one round (0: of all)."""

    number: int
    importance: Floats  # (K,)
    sent: Mapping[int, Sent]  # by device


@dataclass(frozen=True)
class Scene:
    """The content of a map, of a plan or of a run: devices, rounds, areas, lines, labels."""

    devices: Devices
    rounds: Sequence[RoundMarks]
    rings: Sequence[Floats]  # outlines of what must not be flown
    zones: Sequence[NoFly]  # all areas, those that are flown over too
    buildings: Sequence[Building]
    lines: Lines  # that no word should cover
    home_m: Floats  # (2,) of the mark of home, or of the start
    names: Sequence[tuple[Look, Sequence[Word]]] = ()  # beside those of devices and areas
    outcomes: Sequence[str] = ()  # in its key; none: the map is of no round
    sized_by: str = "importance"

    @property
    def met(self) -> list[tuple[Sent, Floats]]:
        """Transmissions whose slot was reached, and from where (2,)."""
        every = (sent for one in self.rounds for sent in one.sent.values())
        return [(sent, sent.from_m) for sent in every if sent.from_m is not None]


def layers(frame: MapFrame, scene: Scene, between: Sequence[alt.Chart]) -> list[alt.Chart]:
    """The layers of a map, with those `between` the links and the devices."""
    return [
        *frame.buildings(scene.buildings),
        *frame.areas(scene.rings, scene.zones),
        *_links(frame, scene),
        *between,
        *_device_marks(frame, scene),
        *words(
            frame,
            [_device_words(scene), _area_names(frame, scene), *scene.names],
            _obstacles(scene),
        ),
    ]


def _links(frame: MapFrame, scene: Scene) -> list[alt.Chart]:
    """Layers of radio links, from aircraft to device, coloured by packet error rate."""
    if not scene.met:
        return []
    met, from_m = zip(*scene.met, strict=True)
    x, y = np.array(from_m).T
    x2, y2 = scene.devices.pos_m[[sent.device for sent in met]].T
    names = ("round", "device", "step", "per", "t_s")
    told = {name: [getattr(sent, name) for sent in met] for name in names}
    tip = [
        alt.Tooltip("device:Q"),
        alt.Tooltip("step:Q", title="slot"),
        alt.Tooltip("t_s:Q", title="time (s)", format=".1f"),
        alt.Tooltip("per:Q", title="true PER", format=".3~g"),
    ]
    colour = alt.Color("per:Q", title="link: PER", scale=per_scale(), legend=per_key())
    links = frame.chart(table(x=x, y=y, x2=x2, y2=y2, **told)).encode(color=colour, tooltip=tip)
    return [
        links.mark_rule(strokeWidth=1.2).encode(alt.X2(field="x2"), alt.Y2(field="y2")),
        links.mark_point(filled=True, size=14, opacity=1),
    ]


def _device_marks(frame: MapFrame, scene: Scene) -> list[alt.Chart]:
    """Layer of devices: colour for community, area for importance, shape for outcome."""
    devices, rounds, outcomes = scene.devices, scene.rounds, scene.outcomes
    names, count = devices.communities, len(devices.community)
    if not count:
        return []
    each = [one.sent.get(k) for one in rounds for k in range(count)]
    data = table(
        round=[one.number for one in rounds for _ in range(count)],
        device=list(range(count)) * len(rounds),
        community=list(devices.community) * len(rounds),
        x=np.tile(devices.pos_m[:, 0], len(rounds)),
        y=np.tile(devices.pos_m[:, 1], len(rounds)),
        importance=np.concatenate([one.importance for one in rounds]),
        outcome=[NOT_SERVED if sent is None else sent.outcome for sent in each],
        per=[math.nan if sent is None else sent.per for sent in each],
    )
    most = max(float(one.importance.max(initial=0.0)) for one in rounds)
    colours = named(names, [community_colour(k) for k in range(len(names))])
    key = keys(names, symbolStrokeColor="transparent", symbolOpacity=1.0)
    tip = [
        alt.Tooltip("device:Q"),
        alt.Tooltip("community:N"),
        alt.Tooltip("importance:Q", title=scene.sized_by, format=".3~g"),
    ]
    marks = frame.chart(data).mark_point(stroke=None, opacity=1)
    marks = marks.encode(
        # One community without a name has none to tell.
        fill=alt.Fill("community:N", scale=colours, legend=key if any(names) else None),
        size=importance_size(most, count, scene.sized_by),
    )
    if not outcomes:
        return [marks.encode(tooltip=tip)]
    key = keys(outcomes, symbolFillColor=SOFT, symbolStrokeColor="transparent", symbolSize=90)
    shapes = named(outcomes, [_SHAPES[outcome] for outcome in outcomes])
    tip += [alt.Tooltip("outcome:N"), alt.Tooltip("per:Q", title="true PER", format=".3~g")]
    return [marks.encode(shape=alt.Shape("outcome:N", scale=shapes, legend=key), tooltip=tip)]


def _device_words(scene: Scene) -> tuple[Look, list[Word]]:
    """The devices' numbers; in a crowd, where outcomes are shown, of those alone whose update did
    not arrive."""
    at_m = [tuple(at) for at in scene.devices.pos_m]
    look = CROWDED if len(at_m) > CROWD else Look()
    if len(at_m) > CROWD and _LOST in scene.outcomes:
        every = (sent for one in scene.rounds for sent in one.sent.values())
        lost = [sent for sent in every if sent.outcome in (_LOST, LATE)]
        return look, [Word(str(s.device), at_m[s.device], s.round) for s in lost]
    return look, [Word(str(k), at) for k, at in enumerate(at_m)]


def _area_names(frame: MapFrame, scene: Scene) -> tuple[Look, list[Word]]:
    """Names of areas, each in its middle, or beside its southern end where that has no room."""
    found = []
    for ring, name, _ in named_areas(scene.rings, scene.zones):
        half = np.array([0.28 * len(name), 0.5]) * _AREA.font_px * frame.pixel_m
        middle = ring.mean(axis=0)
        box = np.array([(x, y) for x in np.linspace(-1.0, 1.0, 9) for y in (-1.0, 1.0)]) * half
        fits = bool(Airspace(keep_in=ring).allows(middle + box).all())
        lowest = ring[:, 1] <= ring[:, 1].min() + frame.pixel_m
        at_m = middle if fits else ring[lowest].mean(axis=0)
        if frame.shows(at_m):
            found.append(Word(name, tuple(at_m), sides=((0, 0),) if fits else ((0, 1), *SIDES)))
    return _AREA, found


def _obstacles(scene: Scene) -> Drawn:
    """Obstacles of label placement: devices, home, lines, links."""
    lines = [(number, points) for _, number, points in scene.lines]
    at_m = scene.devices.pos_m
    lines += [(s.round, np.stack((from_m, at_m[s.device]))) for s, from_m in scene.met]
    most = np.max([one.importance for one in scene.rounds], axis=0)
    dots = np.column_stack((at_m, dot_radii(most, float(most.max(initial=0.0)))))
    return Drawn(np.vstack((dots, (*scene.home_m, _HOME_PX))), lines)
