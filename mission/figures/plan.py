"""A picture of one plan: path, devices sized by importance, served links coloured by PER."""

from collections.abc import Sequence

import numpy as np

from fl.radio.city import Building
from mission.figures.frame import MapFrame, NoFly, edges
from mission.figures.marks import NOT_SERVED, RoundMarks, Scene, Sent, layers
from mission.figures.style import Chart, heading
from mission.figures.words import NAME, Word
from mission.log.values import Devices
from mission.planner.evaluate import success
from mission.planner.problem import RoundPlan, RoundProblem

_WIDTH = 560.0


def plan_picture(
    problem: RoundProblem,
    plan: RoundPlan,
    *,
    title: str,
    about: str = "",
    communities: Sequence[str] = (),
    size_m: tuple[float, float] | None = None,
    no_fly: Sequence[NoFly] = (),
    buildings: Sequence[Building] = (),
) -> Chart:
    """The path with its slots, and the devices; one that is not served stays hollow.

    Where they are known, `about` says whose plan it is, `communities` (K,) each device's, `size_m`
    how large its area is, `no_fly` the names of areas that must not be flown, and which `buildings`
    stand there.
    """
    gap = f", gap {plan.gap:.2%}" if np.isfinite(plan.upper_bound) else ""
    height = "" if plan.altitude_m is None else f", {plan.altitude_m:.1f} m above home"
    served = int(plan.schedule.any(axis=(0, 1)).sum())
    numbers = (
        f"value {plan.value:.4g}{gap}; {served} of {len(problem.devices_m)} devices "
        f"served (filled); {plan.path_m:.0f} of {problem.path_budget_m:.0f} m{height}"
    )
    space = problem.airspace
    fences = [] if space.keep_in is None else [space.keep_in]
    edge = () if size_m is None else (np.array([[0.0, 0.0], size_m]),)
    points = (problem.devices_m, plan.route_m, *space.keep_out, *edge)
    frame = MapFrame.around(points, fences, _WIDTH)
    names = tuple(communities) or ("",) * len(problem.devices_m)
    devices = Devices(problem.devices_m, names)
    per = 1.0 - success(problem.at(plan.altitude_m), plan.waypoints_m)
    sent = {
        int(k): Sent(0, int(k), int(n), plan.waypoints_m[n], float(per[n, k]), "served")
        for n, k in np.argwhere(plan.schedule[0])
    }
    start_m = plan.waypoints_m[0]
    lines = [*edges(fences, space.keep_out, size_m), ("planned", 0, plan.route_m)]
    scene = Scene(
        devices,
        [RoundMarks(0, problem.importance, sent)],
        space.keep_out,
        no_fly,
        buildings,
        lines,
        start_m,
        names=[(NAME, [Word("start", tuple(start_m))])],
        outcomes=("served", NOT_SERVED),
    )
    drawn = layers(frame, scene, [*frame.lines(lines), *frame.waypoints([(0, plan.waypoints_m)])])
    return frame.finished(drawn, heading(title, [numbers, *([about] if about else [])]))
