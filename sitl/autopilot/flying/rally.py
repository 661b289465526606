"""Where a return leads: home, or a rally point that is closer."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot.flying.route import item_altitude
from sitl.autopilot.values.messages import MissionItem


@dataclass(frozen=True, slots=True)
class Refuge:
    """A place to return to; the way there is at least as high as the place itself."""

    name: str
    pos_ned_m: Vector


def refuge(
    here: Vector,
    rally: Sequence[MissionItem],
    *,
    home: GeodeticPoint,
    frame: LocalFrame,
    forbidden: Callable[[Vector], str],
) -> Refuge:
    """The closest of home and the rally points, horizontally; home where two are as close.

    Rally points that are `forbidden` are none. Home is always one.
    """
    found = Refuge("home", frame.to_ned(home.lat_deg, home.lon_deg, home.alt_msl_m))
    for item in rally:
        place = frame.to_ned(item.x, item.y, item_altitude(item, home))
        closer = _distance(here, place) < _distance(here, found.pos_ned_m)
        if closer and not forbidden(place):
            found = Refuge(f"rally point {item.seq}", place)
    return found


def _distance(a: Vector, b: Vector) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))
