"""The ground of every map: axes in metres, and the lines on it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import altair as alt
import numpy as np

from mission.analysis.load import flown
from mission.base.airspace import Airspace
from mission.base.arrays import Floats
from mission.figures.style import (
    BAND,
    FENCE,
    FLOWN,
    GRID,
    PAPER,
    PLANNED,
    SOFT,
    Chart,
    Rows,
    layered,
    line_keys,
    named,
    table,
)
from mission.log.values import FlightData, PlanRecord

NoFly: TypeAlias = Mapping[str, Any]  # an area of `area.no_fly`, as the configuration has it
Lines: TypeAlias = list[tuple[str, int, Floats]]  # kind, round (0: of all), points (n, 2)

_NAME_PX = 10  # the font of areas' names
_ROOMY_PX = 500.0  # wide maps have room for names beside their areas
TOLERANCE_M = 0.15  # what thinning may move a flown path: a tenth of a pixel
# Colour, width and dashes of each kind of line, in the order in which they lie.
_LINES: Mapping[str, tuple[str, float, list[int]]] = {
    "area": (GRID, 1.4, [1, 0]),
    "fence": (FENCE, 1.4, [7, 2, 1, 2]),
    "no-fly area": (FENCE, 1.4, [1, 0]),
    "planned": (BAND, 5.0, [1, 0]),
    "flown": (FLOWN, 1.6, [1, 0]),
    "after the last place": (FLOWN, 1.1, [2, 3]),
}


def run_lines(run: FlightData, plans: Sequence[PlanRecord]) -> Lines:
    """The edges, and the planned and the flown path of every plan."""
    fences = [zone.outline_m for zone in run.fence if zone.keep_in]
    lines = edges(fences, zones_of(run)[0], None if run.plan_file else run.area.size_m)
    lines += [("planned", plan.round, plan.route_m) for plan in plans]
    records = {record.round: record for record in run.rounds}
    lines += [
        ("flown", plan.round, thin(flown(run, records[plan.round]).pos_m[:, :2], TOLERANCE_M))
        for plan in plans
        if plan.round in records
    ]
    if run.plan_file is not None and run.rounds:
        end_ns = int(flown(run, run.rounds[0]).t_ns[-1])
        rest = run.truth.between(end_ns, int(run.truth.t_ns[-1])).pos_m[:, :2]
        lines += [("after the last place", 0, thin(rest, TOLERANCE_M))] if len(rest) > 1 else []
    return lines


def edges(
    fences: Sequence[Floats], rings: Sequence[Floats], size_m: tuple[float, float] | None
) -> Lines:
    """Outlines of the area, if it has a size, of fences, and of what must not be flown."""
    x, y = size_m or (0.0, 0.0)
    area = [("area", np.array([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]]))] if size_m else []
    every = [*area, *(("fence", f) for f in fences), *(("no-fly area", ring) for ring in rings)]
    return [(kind, 0, np.vstack((points, points[:1]))) for kind, points in every]


class MapFrame:
    """Axes in metres, alike in both directions, between two corners (2,)."""

    def __init__(
        self, low: Floats, high: Floats, width: float, *, chosen: int | None = None
    ) -> None:
        self.width, self.height = width, width * float((high - low)[1] / (high - low)[0])
        self._low, self._high, self._chosen = low, high, chosen

    def x(self, field: str = "x:Q") -> alt.X:
        """Encoding of the east axis."""
        domain = [float(self._low[0]), float(self._high[0])]
        return alt.X(field, title="east (m)", scale=alt.Scale(domain=domain, nice=False))

    def y(self, field: str = "y:Q") -> alt.Y:
        """Encoding of the north axis."""
        domain = [float(self._low[1]), float(self._high[1])]
        scale = alt.Scale(domain=domain, nice=False)
        return alt.Y(field, title="north (m)", scale=scale, axis=alt.Axis(grid=False))

    def pixels(self, points_m: Floats) -> Floats:
        """(n, 2) from the upper left corner, of places (n, 2) on the map."""
        share = (points_m - self._low) / (self._high - self._low)
        return np.column_stack((share[:, 0] * self.width, (1.0 - share[:, 1]) * self.height))

    def chart(self, data: Rows) -> alt.Chart:
        """A layer at `x` and `y`, of the chosen `round` where one is chosen (0 is of all)."""
        made = alt.Chart(data).encode(self.x(), self.y())
        if self._chosen is None:
            return made
        chosen: alt.Chart = made.transform_filter("datum.round == 0 || datum.round == shown")
        return chosen

    def ground(self, run: FlightData) -> list[alt.Chart]:
        """What must not be flown, and home."""
        x, y = run.area.home_m
        home = self.chart(table(round=[0], x=[x], y=[y]))
        return [
            *self.areas(*zones_of(run)),
            home.mark_point(shape="square", stroke=SOFT, size=60, strokeWidth=1.5, opacity=1),
        ]

    def areas(self, rings: Sequence[Floats], zones: Sequence[NoFly]) -> list[alt.Chart]:
        """What must not be flown, filled, and those of `zones` that are flown above or below,
        dashed; and names, where there is room.

        A polygon is a closed line.
        """
        layers: list[alt.Chart] = []
        open_rings: list[Floats] = []
        for ring, name, is_open in _named(rings, zones):
            if is_open:
                open_rings.append(ring)
            at_m, below = self._place(ring, name)
            if (below and self.width < _ROOMY_PX) or not self._on_map(at_m):
                continue
            text = self.chart(table(round=[0], x=at_m[:1], y=at_m[1:]))
            layers.append(
                text.mark_text(text=name, fontSize=_NAME_PX, color=SOFT, dy=_NAME_PX * below)
            )
        looks: tuple[tuple[Sequence[Floats], dict[str, Any]], ...] = (
            (rings, {"strokeWidth": 0, "fill": FENCE, "fillOpacity": 0.12}),
            (open_rings, {"stroke": SOFT, "strokeWidth": 1.0, "strokeDash": [3, 3]}),
        )
        return layers + [
            alt.Chart(line_table([("no-fly area", 0, np.vstack((ring, ring[:1])))]))
            .mark_line(clip=True, **look)
            .encode(self.x(), self.y(), alt.Order("step:Q"))
            for some, look in looks
            for ring in some
        ]

    def names_beside(
        self, rings: Sequence[Floats], zones: Sequence[NoFly]
    ) -> list[tuple[str, Floats]]:
        """Names that `areas` has no room for, and the places beside which they may stand."""
        if self.width >= _ROOMY_PX:
            return []
        placed = ((name, self._place(ring, name)) for ring, name, _ in _named(rings, zones))
        return [(name, at_m) for name, (at_m, below) in placed if below and self._on_map(at_m)]

    def _on_map(self, at_m: Floats) -> bool:
        return bool(((at_m >= self._low) & (at_m <= self._high)).all())

    def _place(self, ring: Floats, name: str) -> tuple[Floats, bool]:
        """Where an area's name stands: in its middle, or where that has no room below it."""
        middle, metres = ring.mean(axis=0), (self._high - self._low)[0] / self.width
        half = np.array([0.28 * len(name), 0.5]) * _NAME_PX * metres
        box = np.array([(x, y) for x in np.linspace(-1.0, 1.0, 9) for y in (-1.0, 1.0)]) * half
        if Airspace(keep_in=ring).allows(middle + box).all():
            return middle, False
        lowest = ring[:, 1] <= ring[:, 1].min() + metres
        return np.asarray(ring[lowest].mean(axis=0)), True

    def lines(self, lines: Lines) -> list[alt.Chart]:
        """Paths by kind, in their own looks; of other rounds than the chosen one faintly."""
        kinds = [kind for kind in _LINES if any(kind == line[0] for line in lines)]
        if not kinds:
            return []
        styles = [_LINES[kind] for kind in kinds]
        colours, widths, dashes = (list(look) for look in zip(*styles, strict=True))
        key = line_keys(kinds)
        made = (
            alt.Chart(line_table(lines))
            .mark_line(clip=True)
            .encode(
                self.x(),
                self.y(),
                alt.Order("step:Q"),
                alt.Detail("part:N"),
                stroke=alt.Stroke("kind:O", scale=named(kinds, colours), legend=key),
                strokeWidth=alt.StrokeWidth("kind:O", scale=named(kinds, widths), legend=key),
                strokeDash=alt.StrokeDash("kind:O", scale=named(kinds, dashes), legend=key),
            )
        )
        if self._chosen is None:
            return [made]
        here = "datum.round == 0 || datum.round == shown"
        return [
            made.transform_filter(f"{here} || (everything && datum.kind == 'flown')").encode(
                opacity=alt.condition(here, alt.value(1), alt.value(0.25))
            )
        ]

    def waypoints(self, plans: Sequence[PlanRecord]) -> list[alt.Chart]:
        """Corners of the plans, and where they start."""
        data = table(
            round=[plan.round for plan in plans for _ in plan.waypoints_m],
            x=np.concatenate([plan.waypoints_m[:, 0] for plan in plans]),
            y=np.concatenate([plan.waypoints_m[:, 1] for plan in plans]),
            waypoint=[step for plan in plans for step in range(len(plan.waypoints_m))],
        )
        tip = [
            alt.Tooltip("waypoint:Q"),
            alt.Tooltip("x:Q", title="east (m)"),
            alt.Tooltip("y:Q", title="north (m)"),
        ]
        look: dict[str, Any] = {"fill": PAPER, "opacity": 1.0, "strokeWidth": 1.3}
        start = self.chart(data).transform_filter("datum.waypoint == 0")
        return [
            self.chart(data).mark_point(size=22, stroke=PLANNED, **look).encode(tooltip=tip),
            start.mark_point(size=70, shape="diamond", stroke=FLOWN, **look),
        ]

    def finished(self, layers: Sequence[alt.Chart], title: Chart) -> Chart:
        """Layered chart of the map."""
        chosen = {"shown": self._chosen, "everything": False} if self._chosen is not None else {}
        params = [{"name": name, "value": value} for name, value in chosen.items()]
        more = {"params": params} if params else {}
        return layered(layers, title=title, width=self.width, height=self.height, **more)


def zones_of(run: FlightData) -> tuple[list[Floats], list[NoFly]]:
    """The outlines that a run keeps out of, and all areas of its configuration."""
    rings = [zone.outline_m for zone in run.fence if not zone.keep_in]
    return rings, list(run.config.get("area", {}).get("no_fly", ()))


def _named(rings: Sequence[Floats], zones: Sequence[NoFly]) -> Iterator[tuple[Floats, str, bool]]:
    """Outline and name of every area, and whether the flight is above or below it."""
    for zone in zones:
        ring, name = np.asarray(zone["polygon_m"], dtype=np.float64), zone["name"]
        is_open = not any(np.array_equal(ring, other) for other in rings)
        yield ring, f"{name} {_heights(zone)}" if is_open else name, is_open


def _heights(zone: NoFly) -> str:
    """Where an area counts that the flight is above or below."""
    low, high = zone.get("from_m"), zone.get("to_m")
    if high is None:
        return f"from {low:g} m"
    return f"{low:g} to {high:g} m" if low else f"up to {high:g} m"


def line_table(lines: Lines) -> Rows:
    """Paths as rows: `part` tells them apart, `step` orders their points."""
    return table(
        kind=[kind for kind, _, points in lines for _ in points],
        round=[number for _, number, points in lines for _ in points],
        part=[index for index, (_, _, points) in enumerate(lines) for _ in points],
        step=[step for _, _, points in lines for step in range(len(points))],
        x=np.concatenate([points[:, 0] for _, _, points in lines]),
        y=np.concatenate([points[:, 1] for _, _, points in lines]),
    )


def thin(points: Floats, tolerance: float) -> Floats:
    """Ramer-Douglas-Peucker: points of a path, enough for the others to lie within `tolerance`."""
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    stack = [(0, len(points) - 1)]
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        between = points[first + 1 : last] - points[first]
        way = points[last] - points[first]
        square = float(way @ way)
        share = np.clip(between @ way / square, 0.0, 1.0) if square else np.zeros(len(between))
        away = np.linalg.norm(between - share[:, None] * way, axis=1)
        worst = int(away.argmax())
        if away[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            stack += [(first, middle), (middle, last)]
    return points[keep]
