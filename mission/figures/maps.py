"""Maps of a run: planned against flown, round by round. Used by `figures`."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mission.analysis.load import extent, flown
from mission.base.palette import BAND, FENCE, FLOWN, PLANNED, community_colour, per_colour
from mission.figures.style import GRID, TEXT, add_legend, band, new_figure, plain
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.values import FlightData, Floats, PlanRecord

_MAPS = 12  # small multiples on one picture
_FAINT = 0.35
_HOVER_M = 1.0  # a shorter path is marked as a place
_FENCE_STYLE: Mapping[bool, Mapping[str, Any]] = {
    True: {"color": FENCE, "lw": 1.3, "ls": (0, (7, 2, 1, 2))},
    False: {"color": FENCE, "lw": 1.3, "ls": "-"},
}
_SIZES = (25.0, 170.0)  # marker areas of the least and the most important device


def overview(run: FlightData) -> Figure:
    """All rounds on one map: planned dashed, flown coloured by round."""
    figure = new_figure(8.4, 7.8)
    axes = figure.add_subplot()
    prepare_map(axes, run)
    records = {record.round: record for record in run.rounds}
    numbers = [plan.round for plan in run.plans]
    shades = _shades(numbers)
    for plan in run.plans:
        hover: dict[str, Any] = {"marker": "+", "ms": 9} if plan.path_m < _HOVER_M else {}
        axes.plot(*plan.waypoints_m.T, color=PLANNED, lw=0.9, ls=(0, (4, 3)), zorder=3.5, **hover)
        record = records.get(plan.round)
        if record is not None:
            track = flown(run, record).pos_m
            colour = _shade(shades, plan.round)
            axes.plot(track[:, 0], track[:, 1], color=colour, lw=1.6, alpha=0.9, zorder=3)
    importance = np.mean([plan.importance for plan in run.plans], axis=0)
    _devices(axes, run, importance, outcome={})
    for k, (x, y) in enumerate(run.devices.pos_m):
        axes.annotate(
            str(k), (x, y), xytext=(5, 5), textcoords="offset points", fontsize=8, color=TEXT,
            zorder=6,
        )  # fmt: skip
    if len(numbers) > 1:
        bar = figure.colorbar(shades, ax=axes, shrink=0.75, pad=0.02)
        bar.set_label("round", color=TEXT)
        bar.set_ticks(_ticks(numbers))
        bar.outline.set_visible(False)
    axes.set_title("Planned and flown paths", loc="left", fontsize=12, color=TEXT)
    add_legend(
        figure,
        [
            Line2D([], [], color=PLANNED, lw=1.2, ls=(0, (4, 3)), label="planned"),
            Line2D([], [], color=_shade(shades, numbers[0]), lw=2, label="flown"),
            *_community_handles(run),
            home_handle(),
            *fence_handles(run),
        ],
    )
    return figure


def round_maps(run: FlightData) -> Figure:
    """A map a round, at most twelve, evenly chosen: who was served, and where it flew."""
    chosen = _evenly([plan for plan in run.plans if _record(run, plan)], _MAPS)
    if not chosen:
        chosen = [run.plans[0]]
    columns = min(len(chosen), 3 if len(chosen) > 4 else 2)
    rows = math.ceil(len(chosen) / columns)
    figure = new_figure(4.1 * columns, 4.3 * rows + 1.0)  # titles and legend: an inch
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in panels.flat[len(chosen) :]:
        axes.set_visible(False)
    for number, plan in enumerate(chosen):
        axes = panels.flat[number]
        prepare_map(axes, run)
        _round_map(axes, run, plan)
        axes.set_ylabel("north (m)" if number % columns == 0 else "")
        below = number + columns >= len(chosen)
        axes.set_xlabel("east (m)" if below else "")
        axes.tick_params(labelbottom=below)
    add_legend(
        figure,
        [
            *path_handles(),
            _start_handle(),
            *_community_handles(run),
            _served_handle("delivered", filled=True),
            _served_handle("lost", filled=False),
            Line2D([], [], color=PLANNED, marker="o", ls="", alpha=_FAINT, label="not served"),
            *(
                Line2D([], [], color=per_colour(per), lw=1.2, label=f"link, PER {per:g}")
                for per in (0.0, 0.5, 1.0)
            ),
            *fence_handles(run),
        ],
        columns=4 if columns < 3 else 6,
    )
    return figure


def _round_map(axes: Axes, run: FlightData, plan: PlanRecord) -> None:
    band(axes, plan.waypoints_m)
    record = _record(run, plan)
    outcome: dict[int, UplinkRecord] = {}
    title = f"round {plan.round}"
    if record is not None:
        track = flown(run, record).pos_m
        axes.plot(track[:, 0], track[:, 1], color=FLOWN, lw=1.4, zorder=3)
        outcome = {u.device: u for u in run.uplinks if u.round == plan.round}
        _links(axes, run, outcome)
        title += f"  ·  {record.delivered} of {record.scheduled} delivered"
        title += f"  ·  {record.flown_path_m:.0f} m"
    axes.plot(*plan.waypoints_m[0], marker="D", ms=5, mfc="white", mec=FLOWN, mew=1.2, zorder=6)
    _devices(axes, run, plan.importance, outcome=outcome, faint=True)
    axes.set_title(title, loc="left", fontsize=10, color=TEXT)


def _links(axes: Axes, run: FlightData, outcome: Mapping[int, UplinkRecord]) -> None:
    """From where each transmission was met to its device, coloured by the true PER."""
    for device, uplink in outcome.items():
        if math.isfinite(uplink.slot_t_s):
            x, y = run.devices.pos_m[device].tolist()
            axes.plot(
                [uplink.true_x_m, x], [uplink.true_y_m, y],
                color=per_colour(uplink.true_per), lw=0.9, zorder=2,
            )  # fmt: skip


def prepare_map(axes: Axes, run: FlightData) -> None:
    """Axes in metres around everything that was planned and flown, with area, home and fence."""
    width, height = run.area.size_m
    low, high = extent(run, margin=0.04)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color=GRID, lw=1.2, zorder=1)
    axes.plot(*run.area.home_m, marker="s", ms=6, mfc="none", mec=TEXT, ls="", zorder=4)
    for zone in run.fence:
        closed = np.vstack((zone.outline_m, zone.outline_m[:1]))
        axes.plot(*closed.T, **_FENCE_STYLE[zone.keep_in], zorder=1.5)
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    plain(axes)


def _devices(
    axes: Axes,
    run: FlightData,
    importance: Floats,
    *,
    outcome: Mapping[int, UplinkRecord],
    faint: bool = False,
) -> None:
    """Colour: community. Area: importance. Filled: delivered; hollow with a cross: lost."""
    largest = float(importance.max(initial=0.0)) or 1.0
    small, large = _SIZES
    for k, (x, y) in enumerate(run.devices.pos_m):
        colour = community_colour(int(run.devices.community_of[k]))
        area = small + (large - small) * float(importance[k]) / largest
        served = outcome.get(k)
        if served is None:
            alpha = _FAINT if faint else 1.0
            axes.scatter(x, y, s=area, color=colour, alpha=alpha, lw=0, zorder=4)
        elif served.delivered:
            axes.scatter(x, y, s=area, color=colour, ec="white", lw=0.8, zorder=5)
        else:
            axes.scatter(x, y, s=area, fc="white", ec=colour, lw=1.6, zorder=5)
            axes.scatter(x, y, s=area * 0.45, marker="x", color=colour, lw=1.6, zorder=5.1)


def _shades(numbers: Sequence[int]) -> ScalarMappable:
    """A colour a round; without viridis's lightest end, which drowns on white."""
    colours = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.88, len(numbers))))
    edges = (*(number - 0.5 for number in numbers), numbers[-1] + 0.5)
    return ScalarMappable(BoundaryNorm(edges, len(numbers)), colours)


def _shade(shades: ScalarMappable, number: int) -> tuple[float, float, float, float]:
    red, green, blue, alpha = shades.to_rgba(np.array([number]))[0]
    return (float(red), float(green), float(blue), float(alpha))


def _ticks(numbers: Sequence[int]) -> list[int]:
    return sorted({numbers[round(i)] for i in np.linspace(0, len(numbers) - 1, 9)})


def _community_handles(run: FlightData) -> list[Line2D]:
    return [
        Line2D([], [], color=community_colour(index), marker="o", ls="", ms=8, label=name)
        for index, name in enumerate(run.devices.communities)
    ]


def _served_handle(label: str, *, filled: bool) -> Line2D:
    marker, face = ("o", PLANNED) if filled else ("X", "white")
    return Line2D([], [], color=PLANNED, mfc=face, marker=marker, ls="", ms=8, label=label)


def _start_handle() -> Line2D:
    return Line2D([], [], marker="D", ms=5, mfc="white", mec=FLOWN, mew=1.2, ls="", label="start")


def path_handles() -> list[Line2D]:
    """Of `band` and of the line in it."""
    return [
        Line2D([], [], color=BAND, lw=5, marker="o", ms=3.5, mfc="white", mec=PLANNED,
               label="planned"),
        Line2D([], [], color=FLOWN, lw=1.8, label="flown"),
    ]  # fmt: skip


def fence_handles(run: FlightData) -> list[Line2D]:
    """Of the kinds of fence that there are."""
    kinds = sorted({zone.keep_in for zone in run.fence}, reverse=True)
    return [
        Line2D([], [], **_FENCE_STYLE[kind], label="fence" if kind else "no entry")
        for kind in kinds
    ]


def home_handle() -> Line2D:
    """Of the take-off point."""
    return Line2D([], [], marker="s", ms=6, mfc="none", mec=TEXT, ls="", label="home")


def _record(run: FlightData, plan: PlanRecord) -> RoundRecord | None:
    return next((record for record in run.rounds if record.round == plan.round), None)


def _evenly(items: Sequence[PlanRecord], most: int) -> list[PlanRecord]:
    """At most `most` of the items, evenly spread, the first and the last among them."""
    if len(items) <= most:
        return list(items)
    return [items[round(index)] for index in np.linspace(0, len(items) - 1, most)]
