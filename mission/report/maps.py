"""The map of a report: every round as a layer, one of them shown at a time."""

import math
from html import escape

import numpy as np

from mission.analysis.load import extent, flown
from mission.base.palette import community_colour, css_colour, per_colour
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.values import FlightData, Floats, PlanRecord
from mission.report import html
from mission.report.svg import path, ticks

_TOLERANCE_M = 0.15  # what thinning may move a flown path: a tenth of a pixel
_MARGIN = 0.05
_AXIS = 0.06  # of the width, for the numbers of the vertical axis


def map_svg(run: FlightData, *, above: str = "") -> str:
    """All rounds as groups `.round[data-round]`, under a common ground with axes.

    `above` is SVG that lies on top of everything, in the units of `MapFrame`.
    """
    frame = MapFrame(run)
    layers = [_round(run, frame, plan) for plan in run.plans]
    layers[:1] = [layer.replace('class="round"', 'class="round on"', 1) for layer in layers[:1]]
    return (
        f'<svg id="map" viewBox="0 0 {frame.width:.0f} {frame.height:.0f}" role="img" '
        f'aria-label="Map of planned and flown paths">{_ground(run, frame)}{"".join(layers)}'
        f"{above}</svg>"
    )


def map_legend(run: FlightData) -> list[str]:
    """What the lines of the map are."""
    keys = [
        html.key("border-top:8px solid var(--band)", "planned"),
        html.key("border-top:2px solid var(--flown)", "flown"),
    ]
    for keep_in, name in ((True, "fence"), (False, "no entry")):
        if any(zone.keep_in is keep_in for zone in run.fence):
            kind = "dashed" if keep_in else "solid"
            keys.append(html.key(f"border-top:2px {kind} var(--fence)", name))
    return keys


class MapFrame:
    """From area metres to SVG units: a unit is a metre, scaled to 800 units across."""

    def __init__(self, run: FlightData) -> None:
        low, high = extent(run, margin=_MARGIN)
        # Room for the numbers of the vertical axis, which no device may hide.
        low[0] -= _AXIS * float(high[0] - low[0])
        self.low, self.scale = low, 800.0 / float(high[0] - low[0])
        self.width, self.height = (float(v) for v in (high - low) * self.scale)

    def at(self, xy: Floats) -> tuple[float, float]:
        """The SVG coordinates of a point (2,)."""
        x, y = (xy - self.low) * self.scale
        return float(x), self.height - float(y)

    def line(self, points_m: Floats) -> str:
        """SVG path data of points (n, 2)."""
        return path([self.at(point) for point in points_m])


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


def _ground(run: FlightData, frame: MapFrame) -> str:
    width, height = run.area.size_m
    x0, y1 = frame.at(np.array([0.0, 0.0]))
    x1, y0 = frame.at(np.array([width, height]))
    parts = [
        f'<rect class="area" x="{x0:.1f}" y="{y0:.1f}" width="{x1 - x0:.1f}" '
        f'height="{y1 - y0:.1f}"/>'
    ]
    for value in ticks(0.0, width):
        x, _ = frame.at(np.array([value, 0.0]))
        parts.append(
            f'<text class="tick big" x="{x:.1f}" y="{y1 + 24:.1f}" text-anchor="middle">'
            f"{value:.0f}</text>"
        )
    for value in ticks(0.0, height)[1:]:
        _, y = frame.at(np.array([0.0, value]))
        parts.append(f'<text class="tick big" x="4" y="{y + 6:.1f}">{value:.0f}</text>')
    for zone in run.fence:
        kind, name = ("fence", "fence") if zone.keep_in else ("fence out", "no entry")
        parts.append(
            f'<path class="{kind}" d="{frame.line(zone.outline_m)}Z"><title>{name}</title></path>'
        )
    hx, hy = frame.at(np.array(run.area.home_m))
    parts.append(
        f'<rect class="home" x="{hx - 7:.1f}" y="{hy - 7:.1f}" width="14" height="14">'
        "<title>home</title></rect>"
    )
    return "".join(parts)


def _round(run: FlightData, frame: MapFrame, plan: PlanRecord) -> str:
    record = next((r for r in run.rounds if r.round == plan.round), None)
    parts = [f'<path class="planned" d="{frame.line(plan.waypoints_m)}"/>']
    if record is not None:
        parts += _links(run, frame, plan.round)
        track = thin(flown(run, record).pos_m[:, :2], _TOLERANCE_M)
        parts.append(f'<path class="flown" d="{frame.line(track)}"/>')
    for step, point in enumerate(plan.waypoints_m):
        x, y = frame.at(point)
        parts.append(
            f'<circle class="waypoint" cx="{x:.1f}" cy="{y:.1f}" r="4.5">'
            f"<title>waypoint {step}</title></circle>"
        )
    x, y = frame.at(plan.waypoints_m[0])
    parts.append(
        f'<path class="start" d="M{x:.1f} {y - 9:.1f}l9 9l-9 9l-9-9z"><title>start</title></path>'
    )
    parts += _devices(run, frame, plan, record)
    return f'<g class="round" data-round="{plan.round}">{"".join(parts)}</g>'


def _links(run: FlightData, frame: MapFrame, number: int) -> list[str]:
    """From where each transmission was met to its device, coloured by the true PER."""
    parts = []
    for uplink in run.uplinks:
        if uplink.round == number and math.isfinite(uplink.slot_t_s):
            x1, y1 = frame.at(np.array([uplink.true_x_m, uplink.true_y_m]))
            x2, y2 = frame.at(run.devices.pos_m[uplink.device])
            parts.append(
                f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" '
                f'stroke="{css_colour(per_colour(uplink.true_per))}" stroke-width="2"/>'
            )
    return parts


def _devices(
    run: FlightData, frame: MapFrame, plan: PlanRecord, record: RoundRecord | None
) -> list[str]:
    served: dict[int, UplinkRecord] = {}
    if record is not None:
        served = {u.device: u for u in run.uplinks if u.round == plan.round}
    largest = float(plan.importance.max(initial=0.0)) or 1.0
    parts = []
    for k, point in enumerate(run.devices.pos_m):
        x, y = frame.at(point)
        colour = community_colour(int(run.devices.community_of[k]))
        radius = 7.0 + 9.0 * math.sqrt(max(float(plan.importance[k]) / largest, 0.0))
        uplink = served.get(k)
        tip = f"device {k} ({run.devices.community[k]}), importance {plan.importance[k]:.3g}"
        if uplink is None:
            style = f"fill:{colour};opacity:.3"
            tip += ", not served"
        elif uplink.delivered:
            style = f"fill:{colour}"
            tip += f", delivered at PER {uplink.true_per:.3g}"
        else:
            style = f"fill:var(--paper);stroke:{colour};stroke-width:3.5"
            tip += f", lost at PER {uplink.true_per:.3g}"
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" style="{style}">'
            f"<title>{escape(tip)}</title></circle>"
        )
        if uplink is not None and not uplink.delivered:
            arm = radius * 0.45
            parts.append(
                f'<path d="M{x - arm:.1f} {y - arm:.1f}l{2 * arm:.1f} {2 * arm:.1f}'
                f"M{x + arm:.1f} {y - arm:.1f}l{-2 * arm:.1f} {2 * arm:.1f}"
                f'" stroke="{colour}" stroke-width="3"/>'
            )
        parts.append(f'<text class="tick" x="{x + radius + 3:.1f}" y="{y - radius:.1f}">{k}</text>')
    return parts
