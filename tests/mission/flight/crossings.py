"""Plans that cross, and how near two logged flights came, by another way."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.log.reader import read_log

HOME = GeodeticPoint(47.397742, 8.545594, 488.0)  # where PX4's simulators stand
FRAME = LocalFrame(HOME)


def plan(path: Path, *places: tuple[float, float, float], home: tuple[float, float]) -> Path:
    """A plan file: take off, the places (m east, north, up of HOME), return."""

    def item(command: int, params: list[float | None]) -> dict[str, Any]:
        return {"type": "SimpleItem", "command": command, "frame": 3, "params": params,
                "autoContinue": True}  # fmt: skip

    items = [item(22, [0, 0, 0, None, *at(*home)[:2], places[0][2]])]
    items += [item(16, [0, 1, 0, None, *at(x, y)[:2], up]) for x, y, up in places]
    items += [item(20, [0, 0, 0, 0, 0, 0, 0])]
    document = {
        "fileType": "Plan", "version": 1, "groundStation": "made up",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {"cruiseSpeed": 10, "hoverSpeed": 5, "firmwareType": 12, "vehicleType": 2,
                    "version": 2, "plannedHomePosition": at(*home), "items": items},
    }  # fmt: skip
    path.write_text(json.dumps(document))
    return path


def at(x: float, y: float) -> list[float]:
    place = FRAME.to_geodetic(np.array([y, x, 0.0]))
    return [place.lat_deg, place.lon_deg, HOME.alt_msl_m]


def crossing(folder: Path, apart_m: float = 0.0) -> list[Path]:
    """Two plans that cross over (30, 40) m, the second with its height so much greater."""
    return [
        plan(folder / "a.plan", (30, 0, 20), (30, 80, 20), home=(0, 0)),
        plan(folder / "b.plan", (0, 40, 20 + apart_m), (60, 40, 20 + apart_m), home=(5, 0)),
    ]


def independent(paths: list[Path]) -> tuple[float, float]:
    """The least distance of two logs' true tracks while one flies, and when (s): by a fine
    sampling of the cubic spline through the logged places."""
    areas, tracks = zip(*((log.area, log.truth) for log in map(read_log, paths)), strict=True)
    t = np.arange(max(track.t_ns[0] for track in tracks), min(track.t_ns[-1] for track in tracks),
                  1_000_000)  # fmt: skip
    places = [
        area.frame.in_frame(area.to_ned(spline[:, :2], spline[:, 2]), areas[0].frame)
        for area, track in zip(areas, tracks, strict=True)
        if (spline := CubicSpline(track.t_ns * 1e-9, track.pos_m)(t * 1e-9)) is not None
    ]
    apart = np.linalg.norm(places[0] - places[1], axis=1)
    apart[np.maximum(*(-each[:, 2] for each in places)) < 0.2] = math.inf
    return float(apart.min()), float(t[apart.argmin()] * 1e-9)
