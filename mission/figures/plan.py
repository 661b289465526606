"""A picture of one plan: paths, devices sized by importance, served links coloured by PER."""

from collections.abc import Sequence
from dataclasses import replace

import altair as alt
import numpy as np

from fl.radio.city import Building
from mission.base.palette import community_colour
from mission.figures.frame import MapFrame, NoFly, edges, line_table
from mission.figures.marks import NOT_SERVED, RoundMarks, Scene, Sent, layers
from mission.figures.style import Chart, heading
from mission.figures.words import NAME, Word
from mission.log.values import Devices
from mission.planner.evaluate import success
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

_WIDTH = 560.0


def plan_picture(
    problem: RoundProblem,
    plan: RoundPlan,
    *,
    title: str,
    about: str = "",
    aircraft: Sequence[str] = (),
    communities: Sequence[str] = (),
    size_m: tuple[float, float] | None = None,
    no_fly: Sequence[NoFly] = (),
    buildings: Sequence[Building] = (),
) -> Chart:
    """The paths with their slots, a hue for each of several, and the devices; one that is not
    served stays hollow.

    Where they are known, `about` says whose plan it is, `aircraft` (A,) the names of several,
    `communities` (K,) each device's, `size_m` how large its area is, `no_fly` the names of areas
    that must not be flown, and which `buildings` stand there.
    """
    gap = f", gap {plan.gap:.2%}" if np.isfinite(plan.upper_bound) else ""
    heights = [path.altitude_m for path in plan.paths if path.altitude_m is not None]
    height = f", {' and '.join(f'{of:.1f}' for of in heights)} m above home" if heights else ""
    budget_m = sum(start.path_budget_m for start in problem.starts)
    served = int(plan.schedule.any(axis=(0, 1)).sum())
    numbers = (
        f"value {plan.value:.4g}{gap}; {served} of {len(problem.devices_m)} devices "
        f"served (filled); {plan.path_m:.0f} of {budget_m:.0f} m{height}"
    )
    space = problem.airspace
    fences = [] if space.keep_in is None else [space.keep_in]
    edge = () if size_m is None else (np.array([[0.0, 0.0], size_m]),)
    points = (problem.devices_m, *(path.route_m for path in plan.paths), *space.keep_out, *edge)
    frame = MapFrame.around(points, fences, _WIDTH)
    names = tuple(communities) or ("",) * len(problem.devices_m)
    devices = Devices(problem.devices_m, names)
    sent, hues = dict[int, Sent](), list[alt.Chart]()
    called = [(NAME, [Word("start", tuple(plan.paths[0].waypoints_m[0]))])]
    for a, path in enumerate(plan.paths):
        per = 1.0 - success(problem.alone(a).at(path.altitude_m), path.waypoints_m)
        for n, k in np.argwhere(plan.schedule[a]).tolist():
            sent[k] = Sent(0, k, n, path.waypoints_m[n], float(per[n, k]), "served")
        if len(plan.paths) > 1:
            hue = community_colour(len(devices.communities) + a)
            own = frame.chart(line_table([("", 0, path.route_m)]))
            hues.append(own.mark_line(stroke=hue, strokeWidth=2.4).encode(alt.Order("step:Q")))
            name = aircraft[a] if aircraft else f"aircraft {a + 1}"
            called.append((replace(NAME, colour=hue), [Word(name, tuple(path.route_m[-1]))]))
    start_m = plan.paths[0].waypoints_m[0]
    lines = [
        *edges(fences, space.keep_out, size_m),
        *(("planned", 0, path.route_m) for path in plan.paths),
    ]
    waypoints = [(0, path.waypoints_m) for path in plan.paths]
    scene = Scene(
        devices,
        [RoundMarks(0, problem.importance, sent)],
        space.keep_out,
        no_fly,
        buildings,
        lines,
        start_m,
        names=called,
        outcomes=("served", NOT_SERVED),
    )
    drawn = layers(frame, scene, [*frame.lines(lines), *hues, *frame.waypoints(waypoints)])
    return frame.finished(drawn, heading(title, [numbers, *([about] if about else [])]))
