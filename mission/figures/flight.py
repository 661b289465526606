"""Pictures of flights of plan files: the map, and profiles along the planned path."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mission.analysis.alignment import align
from mission.analysis.compare_plan import PlanFlight
from mission.analysis.load import flown, ground_speed
from mission.base.palette import FENCE, FLOWN, PLANNED, community_colour
from mission.figures.maps import fence_handles, home_handle, path_handles, prepare_map
from mission.figures.style import GRID, TEXT, add_legend, band, new_figure, plain, save_figures
from mission.log.values import Floats

_RALLY_STYLE: dict[str, Any] = {"marker": "^", "ms": 7, "mfc": "none", "mec": TEXT, "ls": ""}
_NEAR_M = 1.0  # places closer than this share one label


def draw_flight(flight: PlanFlight, folder: Path) -> None:
    """Draw `map.png` and `profile.png` into `folder`.

    Raises:
        InputError: they cannot be written.
    """
    pictures = {"map.png": flight_map(flight), "profile.png": profiles([flight])}
    save_figures(pictures, folder)


def flight_map(flight: PlanFlight) -> Figure:
    """Planned and flown path, the places with the numbers of their items, and the way home."""
    figure = new_figure(8.4, 8.0)
    axes = figure.add_subplot()
    run = flight.data
    prepare_map(axes, run)
    band(axes, flight.plan.waypoints_m)
    track = flown(run, flight.record)
    axes.plot(*track.pos_m[:, :2].T, color=FLOWN, lw=1.5, zorder=3)
    rest = run.truth.between(int(track.t_ns[-1]), int(run.truth.t_ns[-1]))
    axes.plot(*rest.pos_m[:, :2].T, color=FLOWN, lw=0.9, ls=(0, (1, 2)), zorder=2.5)
    _places(axes, flight)
    for place in flight.rally_m:
        axes.plot(*place[:2], **_RALLY_STYLE, zorder=4)
    axes.set_title(f"{flight.source}: planned and flown", loc="left", fontsize=12, color=TEXT)
    missed = len(flight.places_m) - len(flight.reached)
    add_legend(
        figure,
        [
            *path_handles(),
            Line2D([], [], color=FLOWN, lw=1.2, ls=(0, (1, 2)), label="after the last place"),
            home_handle(),
            *([Line2D([], [], **_RALLY_STYLE, label="rally point")] * bool(flight.rally_m)),
            *([Line2D([], [], color=FENCE, marker="x", ls="", label="not reached")] * bool(missed)),
            *fence_handles(run),
        ],
    )
    return figure


def profiles(flights: Sequence[PlanFlight]) -> Figure:
    """Height, cross-track error and ground speed along the planned path, a line a flight."""
    figure = new_figure(8.4, 8.4)
    height, cross, speed = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    for index, flight in enumerate(flights):
        colour = FLOWN if len(flights) == 1 else community_colour(index)
        plan, track = flight.plan, flown(flight.data, flight.record)
        fit = align(track.pos_m[:, :2], plan.waypoints_m)
        legs_m = np.linalg.norm(np.diff(plan.waypoints_m, axis=0), axis=1)
        along_m = np.concatenate(([0.0], np.cumsum(legs_m)))
        band(height, np.column_stack((along_m, plan.height_m)))
        for axes, values in (
            (height, track.pos_m[:, 2]),
            (cross, fit.cross_m),
            (speed, ground_speed(track)),
        ):
            axes.plot(fit.along_m, values, color=colour, lw=1.3, zorder=3)
    for axes, label in (
        (height, "height above home (m)"),
        (cross, "distance from the path (m)"),
        (speed, "ground speed (m/s)"),
    ):
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0)
        axes.yaxis.grid(visible=True, color=GRID, lw=0.8)
        axes.set_axisbelow(True)
        plain(axes)
    speed.set_xlabel("along the planned path (m)")
    height.set_title("Along the plan", loc="left", fontsize=12, color=TEXT)
    figure.align_ylabels()
    handles = path_handles()
    if len(flights) > 1:
        handles = handles[:1] + [
            Line2D([], [], color=community_colour(index), lw=2, label=flight.run.name)
            for index, flight in enumerate(flights)
        ]
    add_legend(figure, handles, columns=4)
    return figure


def _places(axes: Axes, flight: PlanFlight) -> None:
    labels: list[tuple[Floats, list[int]]] = []
    for seq, place in flight.places_m.items():
        if seq not in flight.reached:
            axes.plot(*place[:2], marker="x", color=FENCE, ms=8, mew=1.8, ls="", zorder=5)
        for at, numbers in labels:
            if np.linalg.norm(at - place[:2]) < _NEAR_M:
                numbers.append(seq)
                break
        else:
            labels.append((place[:2], [seq]))
    for at, numbers in labels:
        axes.annotate(
            ", ".join(map(str, numbers)), tuple(at), xytext=(6, 6), textcoords="offset points",
            fontsize=9, color=PLANNED, zorder=6,
        )  # fmt: skip
