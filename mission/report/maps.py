"""The map of a report: every round as a layer, one of them shown at a time."""

import math
from html import escape

import numpy as np

from mission.log.values import FlightData, Floats, PlanRecord
from mission.palette import community_colour
from mission.records import RoundRecord, UplinkRecord
from mission.report.svg import path, ticks
from mission.rundata import flown

_TOLERANCE_M = 0.15  # what thinning may move a flown path: a tenth of a pixel
_MARGIN = 0.06


def map_svg(run: FlightData) -> str:
    """All rounds as groups `.round[data-round]`, under a common ground with axes."""
    frame = _Frame(run)
    layers = [_round(run, frame, plan) for plan in run.plans]
    return (
        f'<svg id="map" viewBox="0 0 {frame.width:.0f} {frame.height:.0f}" role="img" '
        f'aria-label="Map of planned and flown paths">{_ground(run, frame)}{"".join(layers)}</svg>'
    )


class _Frame:
    """From area metres to SVG units: a unit is a metre, scaled to 800 units across."""

    def __init__(self, run: FlightData) -> None:
        size = np.array(run.area.size_m)
        points = np.vstack((run.truth.pos_m[:, :2], *(plan.waypoints_m for plan in run.plans)))
        margin = _MARGIN * float(size.max())
        low = np.minimum(points.min(axis=0), 0.0) - margin
        high = np.maximum(points.max(axis=0), size) + margin
        self.low, self.scale = low, 800.0 / float(high[0] - low[0])
        self.width, self.height = (float(v) for v in (high - low) * self.scale)

    def at(self, xy: Floats) -> tuple[float, float]:
        x, y = (xy - self.low) * self.scale
        return float(x), self.height - float(y)

    def line(self, points_m: Floats) -> str:
        return path([self.at(point) for point in points_m])


def thin(points: Floats, tolerance: float) -> Floats:
    """Ramer-Douglas-Peucker: the fewest points of a path that stay within `tolerance` of it."""
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


def _ground(run: FlightData, frame: _Frame) -> str:
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
        parts.append(f'<text class="tick big" x="{x0 + 6:.1f}" y="{y - 5:.1f}">{value:.0f}</text>')
    hx, hy = frame.at(np.array(run.area.home_m))
    parts.append(
        f'<rect class="home" x="{hx - 7:.1f}" y="{hy - 7:.1f}" width="14" height="14">'
        "<title>home</title></rect>"
    )
    return "".join(parts)


def _round(run: FlightData, frame: _Frame, plan: PlanRecord) -> str:
    record = next((r for r in run.rounds if r.round == plan.round), None)
    parts = []
    if record is not None:
        track = thin(flown(run, record).pos_m[:, :2], _TOLERANCE_M)
        parts.append(f'<path class="flown" d="{frame.line(track)}"/>')
    parts.append(f'<path class="planned" d="{frame.line(plan.waypoints_m)}"/>')
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


def _devices(
    run: FlightData, frame: _Frame, plan: PlanRecord, record: RoundRecord | None
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
