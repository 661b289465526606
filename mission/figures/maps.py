"""Maps of a run: planned against flown, who was served and from where, places of a plan file."""

import math
from collections.abc import Sequence

import altair as alt
import numpy as np

from mission.base import polyline
from mission.base.arrays import Floats
from mission.figures.frame import MapFrame, buildings_of, line_table, run_frame, run_lines, zones_of
from mission.figures.marks import NOT_SERVED, RoundMarks, Scene, Sent, layers
from mission.figures.style import (
    FENCE,
    FLOWN,
    INK,
    PAPER,
    SOFT,
    Chart,
    arranged,
    heading,
    keys,
    named,
    table,
)
from mission.figures.words import NAME, Look, Word, gathered
from mission.log.records import LATE, RoundRecord
from mission.log.values import FlightData, PlannedPlaces, PlanRecord

_MAPS = 12  # small multiples on one picture
_WIDTH, _PANEL = 640.0, 300.0
_FEW = 8  # rounds that can be told apart on one map
_SAME_END_M = 15.0  # ends that are closer share their words
_THIN_PX, _WIDER_PX = 2.6, 1.1  # the path of a round, and of each before it of few
_NEAR_M = 1.0  # places closer than this share one label
_KINDS = {  # colour and shape of what is on the map
    "reached": (FLOWN, "circle"),
    "not reached": (FENCE, "cross"),
    "not reached outside holes": (FENCE, "cross"),
    "rally point": (SOFT, "triangle-up"),
}


def overview(run: FlightData, about: str) -> Chart:
    """All rounds on one map: flown coloured by round, planned dashed over it."""
    frame = run_frame(run, _WIDTH)
    lines = run_lines(run, run.plans)
    flights = [line for line in lines if line[0] == "flown"]
    planned = [line for line in lines if line[0] == "planned"]
    few = len(flights) <= _FEW
    rings, zones = zones_of(run)
    scene = Scene(
        run.devices,
        [RoundMarks(0, np.mean([plan.importance for plan in run.plans], axis=0), {})],
        rings,
        zones,
        buildings_of(run),
        [(kind, 0, points) for kind, _, points in lines],
        np.array(run.area.home_m),
        names=[(NAME, _ends(flights) if few else []), (NAME, [_home(run)])],
        sized_by="mean importance" if len(run.plans) > 1 else "importance",
    )
    between = [
        frame.home(run.area.home_m),
        *frame.lines([line for line in lines if line[0] not in ("planned", "flown")]),
        *(_by_round(frame, flights) if flights else []),
        frame.chart(line_table(planned))
        .mark_line(stroke=INK, strokeWidth=0.7, strokeDash=[2, 5])
        .encode(alt.Order("step:Q"), alt.Detail("part:N")),
    ]
    title = heading("Planned (dashed) and flown paths, all rounds", about)
    return frame.finished(layers(frame, scene, between), title)


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
    frame = run_frame(run, width, chosen=chosen)
    rounds = [RoundMarks(p.round, p.importance, _sent(run, p.round)) for p in plans]
    late = (LATE,) if any(uplink.outcome == LATE for uplink in run.uplinks) else ()
    names = [(NAME, [_home(run)])]
    if run.planned is None:
        marks = frame.waypoints([(plan.round, plan.waypoints_m) for plan in plans])
        names += [(NAME, [Word("start", tuple(p.waypoints_m[0]), p.round) for p in plans])]
    else:
        marks = places(frame, run.planned)
        names.insert(0, (Look(), item_numbers(run.planned)))
    rings, zones = zones_of(run)
    scene = Scene(
        run.devices,
        rounds,
        rings,
        zones,
        buildings_of(run),
        [*run_lines(run, []), *(("planned", plan.round, plan.route_m) for plan in plans)],
        np.array(run.area.home_m),
        names=names,
        outcomes=("delivered", "lost", *late, NOT_SERVED) if run.uplinks else (),
    )
    between = [frame.home(run.area.home_m), *frame.lines(run_lines(run, plans)), *marks]
    title = _round_title(run, plans[0]) if len(plans) == 1 else "Planned and flown"
    return frame.finished(
        layers(frame, scene, between), heading(title, about) if about else {"text": title}
    )


def record_of(run: FlightData, plan: PlanRecord) -> RoundRecord | None:
    """Return the record of a plan's round; None where the round was not finished."""
    return next((record for record in run.rounds if record.round == plan.round), None)


def _round_title(run: FlightData, plan: PlanRecord) -> str:
    if run.planned is not None:
        return "Planned and flown; numbers: items of the plan"
    record = record_of(run, plan)
    if record is None:
        return f"round {plan.round}: planned"
    arrived = f"{record.delivered} of {record.scheduled} delivered"
    chosen = len({other.altitude_m for other in run.plans}) > 1
    height = f" · {plan.altitude_m:.0f} m high" if chosen else ""
    return f"round {plan.round} · {arrived} · {record.flown_path_m:.0f} m{height}"


def _sent(run: FlightData, number: int) -> dict[int, Sent]:
    """Transmissions of a round by device, from the true positions of the aircraft."""
    found = {}
    for item in run.uplinks:
        if item.round == number:
            met = math.isfinite(item.slot_t_s) and item.outcome != LATE
            from_m = np.array([item.true_x_m, item.true_y_m]) if met else None
            per, outcome, t_s = item.true_per, item.outcome, item.slot_t_s
            found[item.device] = Sent(number, item.device, item.step, from_m, per, outcome, t_s)
    return found


def _by_round(frame: MapFrame, lines: list[tuple[str, int, Floats]]) -> list[alt.Chart]:
    """Layers of flown paths, coloured by round; few rounds get widths, the later the thinner, and
    arrows of direction."""
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
    """Layer of direction arrows: one on each path with a length, each at another share of it."""
    moved = [(number, points) for _, number, points in lines if polyline.length(points) > 0.0]
    rows = []
    for (number, points), share in zip(moved, np.linspace(0.25, 0.75, len(moved)), strict=True):
        along = polyline.along(points)
        at_m = share * along[-1]
        leg = min(int(np.searchsorted(along, at_m, side="right")), len(points) - 1)
        x, y = polyline.at(at_m, along, points)
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
    """Words at the ends of flown paths: which rounds ended there."""
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


def _evenly(items: Sequence[PlanRecord], most: int) -> list[PlanRecord]:
    """At most `most` of the items, evenly spread, the first and the last among them."""
    if len(items) <= most:
        return list(items)
    return [items[round(index)] for index in np.linspace(0, len(items) - 1, most)]


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
