"""The base of every map: its axes in metres, and layers of paths, outlines and areas."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self, TypeAlias

import altair as alt
import numpy as np

from fl.radio.city import Building
from mission.analysis.airborne import STANDING_M
from mission.analysis.holes import position_gaps
from mission.analysis.load import flown
from mission.base.airspace import thin
from mission.base.arrays import Floats
from mission.base.gaps import outside
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
from mission.log.values import NS_PER_S, FlightData, PlanRecord, Track

NoFly: TypeAlias = Mapping[str, Any]  # an area of `area.no_fly`, as the configuration has it
Lines: TypeAlias = list[tuple[str, int, Floats]]  # kind, round (0: of all), points (n, 2)

_MARGIN = 0.04  # of the extent, around it
_FENCE_SHOWN = 2.2  # times the rest: a larger one would make that small
TOLERANCE_M = 0.02  # what thinning may move a flown path: no corner of it is seen on any map
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
    """Collect the lines of a run's map: outlines, and each plan's planned and flown path."""
    fences = [zone.outline_m for zone in run.fence if zone.keep_in]
    lines = edges(fences, zones_of(run)[0], None if run.planned else run.area.size_m)
    lines += [("planned", plan.round, plan.route_m) for plan in plans]
    records = {record.round: record for record in run.rounds}
    for plan in plans:
        if plan.round in records:
            track = flown(run, records[plan.round])
            lines += [("flown", plan.round, part) for part in _flown_parts(run, track)]
    if run.planned is not None and not run.rounds:
        lines += [("flown", 0, part) for part in _flown_parts(run, run.truth)]
    elif run.planned is not None:
        end_ns = int(flown(run, run.rounds[-1]).t_ns[-1])
        rest = run.truth.between(end_ns, int(run.truth.t_ns[-1]))
        if len(rest.t_ns) > 1 and np.ptp(rest.pos_m[:, :2], axis=0).max() > STANDING_M:
            lines += [("after the last place", 0, part) for part in _flown_parts(run, rest)]
    return lines


def _flown_parts(run: FlightData, track: Track) -> Iterator[Floats]:
    """Yield a track's path (n, 2), thinned, in the parts between the holes of a log."""
    gaps_s = position_gaps(run, int(track.t_ns[0]), int(track.t_ns[-1]))
    for part in outside(track.pos_m[:, :2], track.t_ns / NS_PER_S, gaps_s):
        yield thin(part, TOLERANCE_M)


def edges(
    fences: Sequence[Floats], rings: Sequence[Floats], size_m: tuple[float, float] | None
) -> Lines:
    """Outlines of the area, if it has a size, of fences, and of what must not be flown."""
    x, y = size_m or (0.0, 0.0)
    area = [("area", np.array([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]]))] if size_m else []
    every = [*area, *(("fence", f) for f in fences), *(("no-fly area", ring) for ring in rings)]
    return [(kind, 0, np.vstack((points, points[:1]))) for kind, points in every]


class MapFrame:
    """The axes of a map in metres, with one scale for both, between two corners (2,)."""

    def __init__(
        self, low: Floats, high: Floats, width: float, *, chosen: int | None = None
    ) -> None:
        self.width, self.height = width, width * float((high - low)[1] / (high - low)[0])
        self._low, self._high, self._chosen = low, high, chosen

    @classmethod
    def around(
        cls,
        points: Sequence[Floats],
        fences: Sequence[Floats],
        width: float,
        *,
        chosen: int | None = None,
    ) -> Self:
        """The frame of all points (n, 2), and of those fences that do not make the rest small."""
        every = np.vstack(points)
        widest = _FENCE_SHOWN * np.ptp(every, axis=0).max()
        every = np.vstack((every, *(f for f in fences if np.ptp(f, axis=0).max() < widest)))
        low, high = every.min(axis=0), every.max(axis=0)
        air = _MARGIN * float((high - low).max() or 1.0)
        return cls(low - air, high + air, width, chosen=chosen)

    def _axes(self) -> tuple[alt.X, alt.Y]:
        """Encodings of the east and the north axis."""
        ends = np.stack((self._low, self._high), axis=1).tolist()
        east, north = (alt.Scale(domain=domain, nice=False) for domain in ends)
        plain = alt.Axis(grid=False)
        return (
            alt.X("x:Q", title="east (m)", scale=east),
            alt.Y("y:Q", title="north (m)", scale=north, axis=plain),
        )

    def pixels(self, points_m: Floats) -> Floats:
        """Convert places (n, 2) in metres to pixels (n, 2) from the upper left corner."""
        share = (points_m - self._low) / (self._high - self._low)
        return np.column_stack((share[:, 0] * self.width, (1.0 - share[:, 1]) * self.height))

    def chart(self, data: Rows) -> alt.Chart:
        """Make a layer of rows at `x` and `y`; if a round is chosen, of its `round` and of 0."""
        made = alt.Chart(data).encode(*self._axes())
        if self._chosen is None:
            return made
        chosen: alt.Chart = made.transform_filter("datum.round == 0 || datum.round == shown")
        return chosen

    def home(self, at_m: tuple[float, float]) -> alt.Chart:
        """The mark of home."""
        x, y = at_m
        made: alt.Chart = self.chart(table(round=[0], x=[x], y=[y])).mark_point(
            shape="square", stroke=SOFT, size=60, strokeWidth=1.5, opacity=1
        )
        return made

    def buildings(self, some: Sequence[Building]) -> list[alt.Chart]:
        """Layers of building footprints, the darker the higher, with courtyards left open."""
        if not some:
            return []
        key = alt.Legend(
            title="building: height (m)", columns=5, tickCount=3, symbolType="square",
            symbolFillColor=SOFT, symbolStrokeColor="transparent", symbolSize=120,
        )  # fmt: skip
        dark = alt.Scale(domain=[0.0, max(one.height_m for one in some)], range=[0.12, 0.62])
        data = _closed([one.outlines_m[0] for one in some])
        for row in data["values"]:
            row["height"] = some[row["part"]].height_m
        houses = self._closed_lines(data, strokeWidth=0, fill=SOFT)
        courts = _closed([ring for one in some for ring in one.outlines_m[1:]])
        return [
            houses.encode(alt.Opacity("height:Q", scale=dark, legend=key)),
            *([self._closed_lines(courts, strokeWidth=0, fill=PAPER)] if courts["values"] else []),
        ]

    def outlines(self, some: Sequence[Building]) -> list[alt.Chart]:
        """Layer of the outlines of buildings, over what lies beneath."""
        rings = [ring for one in some for ring in one.outlines_m]
        return [self._closed_lines(_closed(rings), stroke=PAPER, strokeWidth=0.8)] if rings else []

    def areas(self, rings: Sequence[Floats], zones: Sequence[NoFly]) -> list[alt.Chart]:
        """Layers of no-fly areas: `rings` filled, and dashed those of `zones` that the flight
        passes above or below."""
        open_rings = [ring for ring, _, is_open in named_areas(rings, zones) if is_open]
        looks: tuple[tuple[Sequence[Floats], dict[str, Any]], ...] = (
            (rings, {"strokeWidth": 0, "fill": FENCE, "fillOpacity": 0.12}),
            (open_rings, {"stroke": SOFT, "strokeWidth": 1.0, "strokeDash": [3, 3]}),
        )
        return [self._closed_lines(_closed(some), **look) for some, look in looks if len(some)]

    def _closed_lines(self, data: Rows, **look: Any) -> alt.Chart:
        """Polygons, which are closed lines."""
        made: alt.Chart = (
            alt.Chart(data)
            .mark_line(clip=True, **look)
            .encode(*self._axes(), alt.Order("step:Q"), alt.Detail("part:N"))
        )
        return made

    @property
    def pixel_m(self) -> float:
        """Metres of one pixel."""
        return float((self._high - self._low)[0]) / self.width

    def shows(self, at_m: Floats) -> bool:
        """Whether a place (2,), or all of many (n, 2), are on the map."""
        return bool(((at_m >= self._low) & (at_m <= self._high)).all())

    def lines(self, lines: Lines) -> list[alt.Chart]:
        """Layer of paths, styled by kind; flown paths of rounds not chosen are faint."""
        kinds = [kind for kind in _LINES if any(kind == line[0] for line in lines)]
        if not kinds:
            return []
        styles = [_LINES[kind] for kind in kinds]
        colours, widths, dashes = (list(look) for look in zip(*styles, strict=True))
        key = line_keys(kinds)
        # Where nothing lies beyond, clipping takes half of the time that drawing the map takes.
        whole = all(self.shows(points) for _, _, points in lines)
        made = (
            alt.Chart(line_table(lines))
            .mark_line(clip=alt.Undefined if whole else True)
            .encode(
                *self._axes(),
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

    def waypoints(self, paths: Sequence[tuple[int, Floats]]) -> list[alt.Chart]:
        """Layers of the waypoints (N, 2) of paths, each with its round, and of their starts."""
        x, y = np.concatenate([points for _, points in paths]).T
        data = table(
            round=[number for number, points in paths for _ in points],
            x=x,
            y=y,
            waypoint=[step for _, points in paths for step in range(len(points))],
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


def run_frame(run: FlightData, width: float, *, chosen: int | None = None) -> MapFrame:
    """A map of a run's area, and of all that was planned and flown."""
    corners = run.area.home_m if run.planned else ((0.0, 0.0), run.area.size_m)
    points = [np.array(corners).reshape(-1, 2), run.truth.pos_m[:, :2]]
    points += [plan.route_m for plan in run.plans]
    fences = [zone.outline_m for zone in run.fence]
    return MapFrame.around(points, fences, width, chosen=chosen)


def zones_of(run: FlightData) -> tuple[list[Floats], list[NoFly]]:
    """Outlines (n, 2) that a run keeps out of, and all no-fly areas of its configuration."""
    rings = [zone.outline_m for zone in run.fence if not zone.keep_in]
    return rings, list(run.config.get("area", {}).get("no_fly", ()))


def buildings_of(run: FlightData) -> tuple[Building, ...]:
    """The buildings in a run's area, by its configuration."""
    return tuple(Building.of(**one) for one in run.config.get("area", {}).get("buildings", ()))


def named_areas(
    rings: Sequence[Floats], zones: Sequence[NoFly]
) -> Iterator[tuple[Floats, str, bool]]:
    """Outline and name of every area, and whether the flight is above or below it."""
    for zone in zones:
        ring, name = np.asarray(zone["polygon_m"], dtype=np.float64), zone["name"]
        is_open = not any(np.array_equal(ring, other) for other in rings)
        yield ring, f"{name} {_heights(zone)}" if is_open else name, is_open


def _heights(zone: NoFly) -> str:
    """Format the range of heights in which a no-fly area counts."""
    low, high = zone.get("from_m", 0.0), zone.get("to_m")
    if high is None:
        return f"from {low:g} m"
    return f"{low:g} to {high:g} m" if low else f"up to {high:g} m"


def _closed(rings: Sequence[Floats]) -> Rows:
    return line_table([("ring", 0, np.vstack((ring, ring[:1]))) for ring in rings])


def line_table(lines: Lines) -> Rows:
    """Paths as rows: `part` tells them apart, `step` orders their points."""
    return table(
        kind=[kind for kind, _, points in lines for _ in points],
        round=[number for _, number, points in lines for _ in points],
        part=[index for index, (_, _, points) in enumerate(lines) for _ in points],
        step=[step for _, _, points in lines for step in range(len(points))],
        x=np.concatenate([[], *(points[:, 0] for _, _, points in lines)]),
        y=np.concatenate([[], *(points[:, 1] for _, _, points in lines)]),
    )
