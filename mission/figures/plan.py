"""A picture of one plan: path, devices sized by importance, served links coloured by PER."""

import altair as alt
import numpy as np

from mission.figures.charts import LayerChart
from mission.figures.render import heading
from mission.figures.style import (
    FENCE,
    INK,
    PAPER,
    PLANNED,
    SOFT,
    importance_size,
    named,
    per_key,
    per_scale,
    table,
)
from mission.planner.evaluate import success
from mission.planner.problem import RoundPlan, RoundProblem

_WIDTH = 560.0
_AIR = 0.06  # of the extent, around everything
_SERVED = ("served", "not served")


def plan_picture(
    problem: RoundProblem, plan: RoundPlan, *, title: str, about: str = ""
) -> LayerChart:
    """The path with its slots, and the devices; one that is not served stays hollow.

    `about` says whose plan it is.
    """
    gap = f", gap {plan.gap:.2%}" if np.isfinite(plan.upper_bound) else ""
    height = "" if plan.altitude_m is None else f", {plan.altitude_m:.1f} m above home"
    served = int(plan.schedule.any(axis=0).sum())
    numbers = (
        f"value {plan.value:.4g}{gap}; {served} of {len(problem.devices_m)} devices "
        f"served (filled); {plan.path_m:.0f} of {problem.path_budget_m:.0f} m{height}"
    )
    every = np.vstack((problem.devices_m, plan.route_m, *problem.airspace.keep_out))
    low, high = every.min(axis=0), every.max(axis=0)
    air = _AIR * float((high - low).max() or 1.0)
    low, high = low - air, high + air
    x = alt.X("x:Q", title="east (m)", scale=_scale(low[0], high[0]))
    y = alt.Y("y:Q", title="north (m)", scale=_scale(low[1], high[1]))
    words = heading(title, [numbers, *([about] if about else [])])
    return alt.LayerChart(layer=_layers(problem, plan, x, y)).properties(
        width=_WIDTH, height=_WIDTH * float((high - low)[1] / (high - low)[0]), title=words
    )


def _layers(problem: RoundProblem, plan: RoundPlan, x: alt.X, y: alt.Y) -> list[alt.Chart]:
    per = 1.0 - success(problem.at(plan.altitude_m), plan.waypoints_m)
    slots, devices = np.nonzero(plan.schedule)
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
    count, served = len(problem.devices_m), np.isin(np.arange(len(problem.devices_m)), devices)
    dots = table(
        device=np.arange(count),
        x=problem.devices_m[:, 0],
        y=problem.devices_m[:, 1],
        importance=problem.importance,
        state=np.where(served, *_SERVED),
    )
    way = alt.Chart(path).encode(x, y)
    device = alt.Chart(dots).encode(x, y)
    start = way.transform_filter("datum.step == 0")
    return [
        *_outlines(problem, x, y),
        alt.Chart(links).mark_rule(strokeWidth=1.3).encode(x, y, colour, x2="x2", y2="y2"),
        alt.Chart(route).mark_line(stroke=PLANNED, strokeWidth=1.8).encode(x, y, order="step:Q"),
        way.mark_point(fill=PAPER, stroke=PLANNED, size=32, opacity=1),
        start.mark_point(fill=PLANNED, stroke=PLANNED, shape="square", size=70, opacity=1),
        start.mark_text(text="start", dy=-13, fontSize=10, color=SOFT),
        device.mark_point(stroke=PLANNED, fill=PLANNED, opacity=1).encode(
            size=importance_size(float(problem.importance.max(initial=0.0)), count),
            fillOpacity=alt.FillOpacity("state:O", scale=named(_SERVED, [1.0, 0.0]), legend=None),
        ),
        device.mark_text(align="left", dx=8, dy=-7, fontSize=9, color=INK).encode(text="device:Q"),
    ]


def _outlines(problem: RoundProblem, x: alt.X, y: alt.Y) -> list[alt.Chart]:
    """Areas that must not be flown, and the fence."""
    space = problem.airspace
    made = []
    for ring, fill in (
        *((ring, FENCE) for ring in space.keep_out),
        *(((space.keep_in, None),) if space.keep_in is not None else ()),
    ):
        closed = np.vstack((ring, ring[:1]))
        data = table(step=np.arange(len(closed)), x=closed[:, 0], y=closed[:, 1])
        made.append(
            alt.Chart(data)
            .mark_line(stroke=FENCE, strokeWidth=1.4, fill=fill, fillOpacity=0.12, clip=True)
            .encode(x, y, order="step:Q")
        )
    return made


def _scale(low: float, high: float) -> alt.Scale:
    return alt.Scale(domain=[float(low), float(high)], nice=False)
