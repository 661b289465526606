"""Maps of a run: planned against flown, who was served and from where."""

import math
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import altair as alt
import numpy as np

from mission.analysis.load import extent
from mission.base import polyline
from mission.base.arrays import Floats
from mission.base.palette import community_colour
from mission.figures.frame import MapFrame, line_table, run_lines, zones_of
from mission.figures.places import item_numbers, places
from mission.figures.style import (
    CROWD,
    INK,
    PAPER,
    RING,
    SOFT,
    Chart,
    arranged,
    dot_radii,
    heading,
    importance_size,
    keys,
    named,
    per_key,
    per_scale,
    table,
)
from mission.figures.words import CROWDED, NAME, Drawn, Look, Word, gathered, words
from mission.log.records import LATE, RoundRecord, UplinkRecord
from mission.log.values import FlightData, PlanRecord

_MAPS = 12  # small multiples on one picture
_WIDTH, _PANEL = 640.0, 300.0
_MARGIN = 0.04  # of the area, around it
_FEW = 8  # rounds that can be told apart on one map
_SAME_END_M = 15.0  # ends that are closer share their words
_THIN_PX, _WIDER_PX = 2.6, 1.1  # the path of a round, and of each before it of few
_HOME_PX = 5.0
# A cross in a ring.
_LOST = (
    f"{RING}M-0.55,-0.42L-0.42,-0.55L0.55,0.42L0.42,0.55Z"
    "M-0.55,0.42L-0.42,0.55L0.55,-0.42L0.42,-0.55Z"
)
_LATE_SHAPE = "M-0.8,-1L0.8,-1L-0.8,1L0.8,1Z"  # an hourglass
_NOT_SERVED = "not served"
_AREA = Look(6.0, 8.0, SOFT)  # of areas without room for their names

Served: TypeAlias = Mapping[int, UplinkRecord]  # by device


def overview(run: FlightData, about: str) -> Chart:
    """All rounds on one map: flown coloured by round, planned dashed over it."""
    frame = MapFrame(*extent(run, margin=_MARGIN), _WIDTH)
    lines = run_lines(run, run.plans)
    flights = [line for line in lines if line[0] == "flown"]
    planned = [line for line in lines if line[0] == "planned"]
    importance = np.mean([plan.importance for plan in run.plans], axis=0)
    sized_by = "mean importance" if len(run.plans) > 1 else "importance"
    few = len(flights) <= _FEW
    layers = [
        *frame.ground(run),
        *frame.lines([line for line in lines if line[0] not in ("planned", "flown")]),
        *(_by_round(frame, flights) if flights else []),
        frame.chart(line_table(planned))
        .mark_line(stroke=INK, strokeWidth=0.7, strokeDash=[2, 5])
        .encode(alt.Order("step:Q"), alt.Detail("part:N")),
        *_devices(run, frame, [(0, importance, {})], sized_by),
        *words(
            frame,
            [*_device_words(run, {}), (NAME, _ends(flights) if few else []), (NAME, [_home(run)])],
            _drawn(run, [importance], [(0, points) for _, _, points in lines]),
        ),
    ]
    title = heading("Planned (dashed) and flown paths, all rounds", about)
    return frame.finished(layers, title)


def round_maps(run: FlightData, about: str) -> Chart:
    """A map a round, at most twelve, evenly chosen: who was served, and where it flew."""
    chosen = _evenly([plan for plan in run.plans if record_of(run, plan)], _MAPS)
    chosen = chosen or [run.plans[0]]
    columns = min(len(chosen), 3 if len(chosen) > 4 else 2)
    width = _PANEL if columns > 1 else 1.6 * _PANEL
    panels = [round_map(run, [plan], width=width) for plan in chosen]
    some = f" · {len(chosen)} of {len(run.plans)} rounds" if len(chosen) < len(run.plans) else ""
    title = heading("Planned and flown, round by round", about + some)
    return arranged(panels, how="concat", columns=columns, spacing=24, title=title)


def round_map(
    run: FlightData, plans: Sequence[PlanRecord], *, width: float = _WIDTH, about: str = ""
) -> Chart:
    """A map of one round; of several, of which the parameter `shown` chooses one.

    The parameter `everything` shows the flown paths of the others too.
    """
    chosen = plans[0].round if len(plans) > 1 else None
    frame = MapFrame(*extent(run, margin=_MARGIN), width, chosen=chosen)
    served = {plan.round: _served(run, plan.round) for plan in plans}
    lines = [(plan.round, plan.route_m) for plan in plans]
    lines += [(number, link) for number, of in served.items() for link in _link_lines(run, of)]
    lines += [(0, points) for _, _, points in run_lines(run, [])]
    beside = frame.names_beside(*zones_of(run))
    is_round = run.plan_file is None
    starts = [Word("start", tuple(plan.waypoints_m[0]), plan.round) for plan in plans]
    layers = [
        *frame.ground(run),
        *_links(run, frame, served),
        *frame.lines(run_lines(run, plans)),
        *(frame.waypoints(plans) if is_round else places(frame, run)),
        *_devices(run, frame, [(p.round, p.importance, served[p.round]) for p in plans]),
        *words(
            frame,
            [
                *_device_words(run, served),
                (Look(), [] if run.plan_file is None else item_numbers(run.plan_file)),
                (_AREA, [Word(name, tuple(at_m)) for name, at_m in beside]),
                (NAME, [_home(run)]),
                (NAME, starts if is_round else []),
            ],
            _drawn(run, [plan.importance for plan in plans], lines),
        ),
    ]
    title = _round_title(run, plans[0]) if len(plans) == 1 else "Planned and flown"
    return frame.finished(layers, heading(title, about) if about else {"text": title})


def record_of(run: FlightData, plan: PlanRecord) -> RoundRecord | None:
    """What became of a plan; None where its round was not finished."""
    return next((record for record in run.rounds if record.round == plan.round), None)


def _round_title(run: FlightData, plan: PlanRecord) -> str:
    if run.plan_file is not None:
        return "Planned and flown; numbers: items of the plan"
    record = record_of(run, plan)
    if record is None:
        return f"round {plan.round}: planned"
    arrived = f"{record.delivered} of {record.scheduled} delivered"
    chosen = len({other.altitude_m for other in run.plans}) > 1
    height = f" · {plan.altitude_m:.0f} m high" if chosen else ""
    return f"round {plan.round} · {arrived} · {record.flown_path_m:.0f} m{height}"


def _served(run: FlightData, number: int) -> Served:
    return {item.device: item for item in run.uplinks if item.round == number}


def _by_round(frame: MapFrame, lines: list[tuple[str, int, Floats]]) -> list[alt.Chart]:
    """Where rounds are few, later ones are thinner and lie on earlier ones, and arrows tell the
    direction."""
    numbers = sorted({number for _, number, _ in lines})
    few = len(numbers) <= _FEW
    # From light to dark, without the ends: plans are dark and lie above, the paper is white.
    scheme = alt.SchemeParams("plasma", extent=[0.92, 0.3])
    colour = alt.Color(
        "round:O" if few else "round:Q",
        title="flown in round",
        scale=alt.Scale(scheme=scheme),
        legend=alt.Legend(symbolType="stroke", columns=8, symbolStrokeWidth=2.2)
        if few
        else alt.Legend(gradientLength=260, tickMinStep=1, format="d"),
    )
    chart = frame.chart(line_table(lines)).encode(
        alt.Order("step:Q"), alt.Detail("part:N"), alt.Tooltip("round:Q"), color=colour
    )
    if not few:
        return [chart.mark_line(strokeWidth=_THIN_PX)]
    # Without a scale, which would be one with that of the fence, and have both in its legend.
    width = f"{_THIN_PX} + {_WIDER_PX} * ({numbers[-1]} - datum.round)"
    wide = chart.transform_calculate(width=width).mark_line()
    return [
        wide.encode(strokeWidth=alt.StrokeWidth("width:Q", scale=None)),
        *_arrows(frame, lines, colour),
    ]


def _arrows(
    frame: MapFrame, lines: list[tuple[str, int, Floats]], colour: alt.Color
) -> list[alt.Chart]:
    """One on each path that leads anywhere, not all at the same place of paths that are alike."""
    moved = [(number, points) for _, number, points in lines if polyline.length(points) > 0.0]
    rows = []
    for (number, points), share in zip(moved, np.linspace(0.25, 0.75, len(moved)), strict=True):
        along = polyline.along(points)
        at_m = share * along[-1]
        leg = min(int(np.searchsorted(along, at_m, side="right")), len(points) - 1)
        x, y = (np.interp(at_m, along, points[:, axis]) for axis in (0, 1))
        east, north = points[leg] - points[leg - 1]
        rows.append((number, x, y, math.degrees(math.atan2(east, north))))
    if not rows:
        return []
    numbers, east_m, north_m, headings = zip(*rows, strict=True)
    arrows: alt.Chart = frame.chart(
        table(round=numbers, x=east_m, y=north_m, heading=headings)
    ).mark_point(shape="triangle", filled=True, size=230, opacity=1, stroke=PAPER, strokeWidth=1)
    return [arrows.encode(color=colour, angle=alt.Angle("heading:Q", scale=None))]


def _ends(lines: list[tuple[str, int, Floats]]) -> list[Word]:
    """Rounds that ended at each place."""
    ends = gathered([(points[-1], number) for _, number, points in lines], _SAME_END_M)
    return [
        Word(
            f"round{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"
            f" end{'s' * (len(numbers) == 1)}",
            tuple(at),
        )
        for at, numbers in ends
    ]


def _home(run: FlightData) -> Word:
    return Word("home", run.area.home_m)


def _device_words(run: FlightData, served: Mapping[int, Served]) -> list[tuple[Look, list[Word]]]:
    """Their numbers; in a crowd of which it is known, of those only that one asks about."""
    at_m, count = [tuple(at) for at in run.devices.pos_m], len(run.devices.community)
    if count > CROWD and served:
        asked = [
            Word(str(k), at_m[k], number)
            for number, of in served.items()
            for k, uplink in of.items()
            if uplink.outcome in ("lost", LATE)
        ]
        return [(CROWDED, asked)]
    every = [Word(str(k), at_m[k]) for k in range(count)]
    return [(CROWDED if count > CROWD else Look(), every)]


def _drawn(run: FlightData, importance: Sequence[Floats], lines: list[tuple[int, Floats]]) -> Drawn:
    most = np.max(importance, axis=0)
    radii = dot_radii(most, float(most.max(initial=0.0)))
    dots = np.column_stack((run.devices.pos_m, radii)) if len(radii) else np.empty((0, 3))
    return Drawn(np.vstack((dots, (*run.area.home_m, _HOME_PX))), lines)


def _link_lines(run: FlightData, served: Served) -> list[Floats]:
    return [
        np.array([[uplink.true_x_m, uplink.true_y_m], run.devices.pos_m[uplink.device]])
        for uplink in _met(served)
    ]


def _met(served: Served) -> list[UplinkRecord]:
    """Transmissions whose slots the aircraft reached in time."""
    return [u for u in served.values() if math.isfinite(u.slot_t_s) and u.outcome != LATE]


def _links(run: FlightData, frame: MapFrame, served: Mapping[int, Served]) -> list[alt.Chart]:
    """From the slot, where each transmission was met, to its device; coloured by the true PER."""
    met = [uplink for of in served.values() for uplink in _met(of)]
    if not met:
        return []
    at_m = run.devices.pos_m[[uplink.device for uplink in met]]
    numbers = {key: [getattr(u, key) for u in met] for key in ("round", "device", "step")}
    from_m = {"x": [u.true_x_m for u in met], "y": [u.true_y_m for u in met]}
    rates = {"per": [u.true_per for u in met], "t_s": [u.slot_t_s for u in met]}
    data = table(**numbers, **from_m, x2=at_m[:, 0], y2=at_m[:, 1], **rates)
    tip = [
        alt.Tooltip("device:Q"),
        alt.Tooltip("step:Q", title="slot"),
        alt.Tooltip("t_s:Q", title="time (s)", format=".1f"),
        alt.Tooltip("per:Q", title="true PER", format=".3~g"),
    ]
    colour = alt.Color("per:Q", title="link: PER", scale=per_scale(), legend=per_key())
    links = frame.chart(data).encode(color=colour, tooltip=tip)
    return [
        links.mark_rule(strokeWidth=1.2).encode(alt.X2(field="x2"), alt.Y2(field="y2")),
        links.mark_point(filled=True, size=14, opacity=1),
    ]


def _devices(
    run: FlightData,
    frame: MapFrame,
    rounds: Sequence[tuple[int, Floats, Served]],
    sized_by: str = "importance",
) -> list[alt.Chart]:
    """Colour: community. Area: importance. Shape: what became of the update; ring: not served."""
    names, count = run.devices.communities, len(run.devices.community)
    if not count:
        return []
    outcome = any(served for *_, served in rounds)
    each = [served.get(k) for *_, served in rounds for k in range(count)]
    data = table(
        round=[number for number, *_ in rounds for _ in range(count)],
        device=list(range(count)) * len(rounds),
        community=list(run.devices.community) * len(rounds),
        x=np.tile(run.devices.pos_m[:, 0], len(rounds)),
        y=np.tile(run.devices.pos_m[:, 1], len(rounds)),
        importance=np.concatenate([importance for _, importance, _ in rounds]),
        outcome=[_NOT_SERVED if uplink is None else uplink.outcome for uplink in each],
        per=[math.nan if uplink is None else uplink.true_per for uplink in each],
    )
    most = max(float(importance.max(initial=0.0)) for _, importance, _ in rounds)
    tip = [
        alt.Tooltip("device:Q"),
        alt.Tooltip("community:N"),
        alt.Tooltip("importance:Q", title=sized_by, format=".3~g"),
    ]
    marks = frame.chart(data).encode(
        fill=alt.Fill(
            "community:N",
            scale=named(names, [community_colour(k) for k in range(len(names))]),
            legend=keys(names, symbolStrokeColor="transparent", symbolOpacity=1.0),
        ),
        size=importance_size(most, count, sized_by),
    )
    if not outcome:
        return [marks.mark_point(stroke=None, opacity=1).encode(tooltip=tip)]
    some_late = any(uplink.outcome == LATE for uplink in run.uplinks)
    late = {LATE: _LATE_SHAPE} if some_late else {}
    looks = {"delivered": "circle", "lost": _LOST, **late, _NOT_SERVED: RING}
    key = keys(list(looks), symbolFillColor=SOFT, symbolStrokeColor="transparent", symbolSize=90)
    became = marks.mark_point(stroke=None, opacity=1).encode(
        shape=alt.Shape("outcome:N", scale=named(list(looks), list(looks.values())), legend=key),
        tooltip=[*tip, "outcome:N", alt.Tooltip("per:Q", title="true PER", format=".3~g")],
    )
    return [became]


def _evenly(items: Sequence[PlanRecord], most: int) -> list[PlanRecord]:
    """At most `most` of the items, evenly spread, the first and the last among them."""
    if len(items) <= most:
        return list(items)
    return [items[round(index)] for index in np.linspace(0, len(items) - 1, most)]
