"""A flight that knows nothing but where it was."""

import numpy as np
from numpy.typing import ArrayLike

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.log.values import BatteryTrack, FlightData, Track, WindTrack


def bare_flight(t_s: ArrayLike, pos_m: ArrayLike) -> FlightData:
    """Of its times (n,) and places (n, 3)."""
    t_ns = np.round(np.multiply(t_s, 1e9)).astype(np.int64)
    track = Track(t_ns, np.array(pos_m, dtype=np.float64))
    none = np.zeros(0)
    never = none.astype(np.int64)
    return FlightData(
        area=Area.at((9.0, 9.0), (0.0, 0.0), GeodeticPoint(47.0, 8.0, 400.0)),
        truth=track,
        belief=track,
        battery=BatteryTrack(never, none, none, none, none),
        wind=WindTrack(never, np.zeros((0, 3))),
        events=(),
    )
