"""A picture of one plan: path, devices sized by importance, served links coloured by PER."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mission.base.palette import PLANNED, per_colour
from mission.planner.evaluate import success
from mission.planner.problem import RoundPlan, RoundProblem

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AREAS = (20.0, 220.0)  # of the markers of the least and the most important device


def draw_plan(problem: RoundProblem, plan: RoundPlan, path: Path, *, title: str) -> None:
    """Write the picture of a plan to `path` (PNG, or what the suffix says).

    Raises:
        InputError: the file cannot be written.
    """
    # Importing matplotlib takes as long as planning many rounds.
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    from mission.base.errors import InputError
    from mission.figures.style import GRID, TEXT, new_figure, plain

    figure = new_figure(7.4, 6.6)
    axes = figure.add_subplot()
    plain(axes)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    _devices(axes, problem, plan)
    axes.plot(*plan.waypoints_m.T, color=PLANNED, lw=1.8, zorder=3)
    axes.plot(*plan.waypoints_m.T, "o", color="white", mec=PLANNED, mew=1.4, ms=5.5, zorder=4)
    axes.plot(*problem.start_m, "s", color=PLANNED, ms=9, zorder=5)
    axes.annotate(
        "start", (float(problem.start_m[0]), float(problem.start_m[1])), xytext=(8, -12),
        textcoords="offset points", fontsize=9, color=TEXT,
    )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    ramp = LinearSegmentedColormap.from_list("per", [per_colour(p) for p in (0.0, 0.5, 1.0)])
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, 1.0), ramp), ax=axes, shrink=0.7, pad=0.02)
    bar.set_label("packet error rate of a served link", color=TEXT)
    bar.outline.set_visible(False)
    gap = f", gap {plan.gap:.2%}" if np.isfinite(plan.upper_bound) else ""
    served = int(plan.schedule.sum())
    axes.set_title(
        f"{title}\nvalue {plan.value:.4g}{gap}; {served} of {len(problem.devices_m)} devices "
        f"served; {plan.path_m:.0f} of {problem.path_budget_m:.0f} m",
        loc="left", fontsize=11, color=TEXT,
    )  # fmt: skip
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    except OSError as error:
        raise InputError(f"{path}: cannot write the figure: {error.strerror}") from None


def _devices(axes: "Axes", problem: RoundProblem, plan: RoundPlan) -> None:
    """Devices and the links that serve them; a device that is not served stays hollow."""
    per = 1.0 - success(problem, plan.waypoints_m)
    for n, k in np.argwhere(plan.schedule):
        link = np.stack([plan.waypoints_m[n], problem.devices_m[k]])
        axes.plot(*link.T, color=per_colour(float(per[n, k])), lw=1.3, zorder=2)
    most = max(float(problem.importance.max(initial=0.0)), 1e-300)
    area = _AREAS[0] + (_AREAS[1] - _AREAS[0]) * problem.importance / most
    served = plan.schedule.any(axis=0)
    best = np.where(plan.schedule, per, 1.0).min(axis=0, initial=1.0)
    x, y = problem.devices_m.T
    axes.scatter(
        x[served], y[served], s=area[served], color=[per_colour(p) for p in best[served]],
        edgecolors="white", linewidths=0.8, zorder=3.5,
    )  # fmt: skip
    axes.scatter(
        x[~served], y[~served], s=area[~served], facecolors="none", edgecolors=PLANNED,
        linewidths=1.0, zorder=3.5,
    )  # fmt: skip
