"""Pictures of flights of plan files: profiles along the planned path."""

from collections.abc import Sequence

import numpy as np

from mission.analysis.compare import RunComparison
from mission.analysis.load import ground_speed
from mission.base import polyline
from mission.base.arrays import Floats
from mission.base.palette import community_colour
from mission.figures.charts import Series, line_chart
from mission.figures.frame import thin
from mission.figures.render import stacked
from mission.figures.style import COOL, FLOWN, GOOD, PLANNED, Chart
from mission.log.values import NS_PER_S

_TOLERANCE = 0.02  # metres, or metres a second, that thinning may move a line
_ALONG = "along the plan (m)"


def profiles(flights: Sequence[RunComparison]) -> Chart:
    """The charts of `profile_charts` under each other, as one picture."""
    about = flights[0].run.about if len(flights) == 1 else f"{len(flights)} flights"
    return stacked(profile_charts(flights), title="Along the plan", about=about)


def profile_charts(flights: Sequence[RunComparison]) -> list[Chart]:
    """Height, distance from the path, ground speed and error of the estimate, a line a flight."""
    plan = flights[0].run.data.plans[0]
    planned_m = np.column_stack((polyline.along(plan.route_m), plan.route_height_m))
    height = [Series("planned", PLANNED, planned_m[:, 0], planned_m[:, 1], dashed=True)]
    cross, speed, error = [], [], []
    for index, flight in enumerate(flights):
        alone = len(flights) == 1
        name, colour = ("flown", FLOWN) if alone else (flight.run.about, community_colour(index))
        (measured,) = flight.measured
        track, fit = measured.truth, measured.fit
        away_m = measured.belief.pos_m - track.pos_m
        t_s = (track.t_ns - track.t_ns[0]) / NS_PER_S
        height.append(_thinned(name, colour, fit.along_m, track.pos_m[:, 2]))
        if fit.length_m > 0:
            cross.append(_thinned(name, colour, fit.along_m, fit.cross_m))
        speed.append(_thinned(name, colour, fit.along_m, ground_speed(track)))
        sides = ("horizontal", COOL), ("height", GOOD)
        both = (np.hypot(*away_m[:, :2].T), np.abs(away_m[:, 2]))
        for (side, shade), values in zip(sides, both, strict=True):
            label = side if alone else f"{side}, {name}"
            error.append(_thinned(label, shade if alone else colour, t_s, values))
            if not alone:
                break  # the horizontal one is enough to compare
    return [
        line_chart("Height above home", height, x=_ALONG, y="height (m)"),
        *([line_chart("Distance from the path", cross, x=_ALONG, y="distance (m)")] * bool(cross)),
        line_chart("Ground speed", speed, x=_ALONG, y="speed (m/s)"),
        line_chart("Estimate against the truth", error, x="time in the mission (s)", y="error (m)"),
    ]


def _thinned(label: str, colour: str, x: Floats, y: Floats) -> Series:
    kept = thin(np.column_stack((x, y)), _TOLERANCE)
    return Series(label, colour, kept[:, 0], kept[:, 1])
