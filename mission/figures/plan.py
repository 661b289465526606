"""A picture of one plan: path, devices sized by importance, served links coloured by PER."""

from collections.abc import Sequence

import altair as alt
import numpy as np

from mission.analysis.load import FENCE_SHOWN
from mission.base.arrays import Ints
from mission.base.palette import community_colour
from mission.figures.frame import MapFrame, NoFly, edges
from mission.figures.style import (
    CROWD,
    PAPER,
    PLANNED,
    RING,
    Chart,
    dot_radii,
    heading,
    importance_size,
    keys,
    named,
    per_key,
    per_scale,
    table,
)
from mission.figures.words import CROWDED, NAME, Drawn, Look, Word, words
from mission.planner.evaluate import success
from mission.planner.problem import RoundPlan, RoundProblem

_WIDTH = 560.0
_AIR = 0.06  # of the extent, around everything
_SERVED = ("served", "not served")
_START_PX = 6.0


def plan_picture(
    problem: RoundProblem,
    plan: RoundPlan,
    *,
    title: str,
    about: str = "",
    communities: Sequence[str] = (),
    size_m: tuple[float, float] | None = None,
    no_fly: Sequence[NoFly] = (),
) -> Chart:
    """The path with its slots, and the devices; one that is not served stays hollow.

    Where they are known, `about` says whose plan it is, `communities` (K,) each device's, `size_m`
    how large its area is, and `no_fly` the names of areas that must not be flown.
    """
    gap = f", gap {plan.gap:.2%}" if np.isfinite(plan.upper_bound) else ""
    height = "" if plan.altitude_m is None else f", {plan.altitude_m:.1f} m above home"
    served = int(plan.schedule.any(axis=0).sum())
    numbers = (
        f"value {plan.value:.4g}{gap}; {served} of {len(problem.devices_m)} devices "
        f"served (filled); {plan.path_m:.0f} of {problem.path_budget_m:.0f} m{height}"
    )
    space = problem.airspace
    fences = [] if space.keep_in is None else [space.keep_in]
    edge = () if size_m is None else (np.array([[0.0, 0.0], size_m]),)
    every = np.vstack((problem.devices_m, plan.route_m, *space.keep_out, *edge))
    widest = FENCE_SHOWN * np.ptp(every, axis=0).max()
    every = np.vstack((every, *(f for f in fences if np.all(np.ptp(f, axis=0) < widest))))
    low, high = every.min(axis=0), every.max(axis=0)
    air = _AIR * float((high - low).max() or 1.0)
    frame = MapFrame(low - air, high + air, _WIDTH)
    layers = [
        *frame.areas(space.keep_out, no_fly),
        *frame.lines(edges(fences, space.keep_out, size_m)),
        *_path(problem, plan, frame),
        *_devices(problem, plan, frame, communities),
        *_words(problem, plan, frame),
    ]
    return frame.finished(layers, heading(title, [numbers, *([about] if about else [])]))


def _served(plan: RoundPlan) -> tuple[Ints, Ints]:
    """Links from slots to the devices scheduled in them."""
    slots, devices = np.nonzero(plan.schedule)
    return slots, devices


def _path(problem: RoundProblem, plan: RoundPlan, frame: MapFrame) -> list[alt.Chart]:
    per = 1.0 - success(problem.at(plan.altitude_m), plan.waypoints_m)
    slots, devices = _served(plan)
    colour = alt.Color("per:Q", title="link: PER", scale=per_scale(), legend=per_key())
    links = table(
        x=plan.waypoints_m[slots, 0],
        y=plan.waypoints_m[slots, 1],
        x2=problem.devices_m[devices, 0],
        y2=problem.devices_m[devices, 1],
        per=per[slots, devices],
    )
    path = table(
        step=np.arange(len(plan.waypoints_m)), x=plan.waypoints_m[:, 0], y=plan.waypoints_m[:, 1]
    )
    route = table(step=np.arange(len(plan.route_m)), x=plan.route_m[:, 0], y=plan.route_m[:, 1])
    way = frame.chart(path)
    start = way.transform_filter("datum.step == 0")
    return [
        frame.chart(links)
        .mark_rule(strokeWidth=1.3)
        .encode(colour, alt.X2(field="x2"), alt.Y2(field="y2")),
        frame.chart(route).mark_line(stroke=PLANNED, strokeWidth=1.8).encode(alt.Order("step:Q")),
        way.mark_point(fill=PAPER, stroke=PLANNED, size=32, opacity=1),
        start.mark_point(fill=PLANNED, stroke=PLANNED, shape="square", size=70, opacity=1),
    ]


def _devices(
    problem: RoundProblem, plan: RoundPlan, frame: MapFrame, communities: Sequence[str]
) -> list[alt.Chart]:
    count = len(problem.devices_m)
    dots = table(
        x=problem.devices_m[:, 0],
        y=problem.devices_m[:, 1],
        importance=problem.importance,
        state=np.where(np.isin(np.arange(count), _served(plan)[1]), *_SERVED),
        community=list(communities) or [""] * count,
    )
    names = list(dict.fromkeys(communities))
    marks = frame.chart(dots).mark_point(stroke=None, fill=PLANNED, opacity=1)
    if names:
        scale = named(names, [community_colour(index) for index in range(len(names))])
        key = keys(names, symbolStrokeColor="transparent", symbolOpacity=1.0)
        marks = marks.encode(
            fill=alt.Fill("community:N", title=None, scale=scale, legend=key),
        )
    most = float(problem.importance.max(initial=0.0))
    hollow = alt.Shape("state:O", scale=named(_SERVED, ["circle", RING]), legend=None)
    return [marks.encode(size=importance_size(most, count), shape=hollow)]


def _words(problem: RoundProblem, plan: RoundPlan, frame: MapFrame) -> list[alt.Chart]:
    """The devices' numbers, and where the path starts."""
    most = float(problem.importance.max(initial=0.0))
    radii = dot_radii(problem.importance, most)
    slots, devices = _served(plan)
    lines = [(0, plan.route_m)]
    lines += [
        (0, np.stack((plan.waypoints_m[slot], problem.devices_m[device])))
        for slot, device in zip(slots, devices, strict=True)
    ]
    start = plan.waypoints_m[0]
    dots = np.vstack((np.column_stack((problem.devices_m, radii)), (*start, _START_PX)))
    look = CROWDED if len(radii) > CROWD else Look()
    each = [Word(str(k), tuple(at)) for k, at in enumerate(problem.devices_m)]
    return words(frame, [(look, each), (NAME, [Word("start", tuple(start))])], Drawn(dots, lines))
