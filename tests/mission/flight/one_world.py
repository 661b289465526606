"""Made-up logs of ours, of vehicles of one world."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from told_logs import HOME

from flightdyn.frames import LocalFrame
from flightdyn.state import BatteryState, Kinematics
from mission.base.area import Area
from mission.log.values import NOBODY
from mission.log.writer import FlightLog
from sitl.observer import VehicleEvent, VehicleSample

Floats = NDArray[np.float64]
Way = Callable[[Floats], Floats]  # times (n,) -> NED (n, 3) from HOME
UNTIL_S = 50.0


def straight(at_s: float, there: ArrayLike, vel: ArrayLike) -> Way:
    return lambda t_s: np.asarray(there) + (t_s - at_s)[:, None] * np.asarray(vel)


def write_ours(
    path: Path, way: Way, *, east_m: float = 0.0, from_s: float = 0.0, hole_s: Any = (0, 0)
) -> Path:
    """A log of ours, of a vehicle whose home is to the east of the other ones'."""
    path.parent.mkdir(parents=True, exist_ok=True)
    home = LocalFrame(HOME).to_geodetic(np.array([0.0, east_m, 0.0]))
    home = replace(home, alt_msl_m=HOME.alt_msl_m)
    t_s = from_s + np.arange(0.0, UNTIL_S, 0.1)
    battery = BatteryState(22.2, 10.0, 100.0, 0.9)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    area = Area.at((800.0, 800.0), (400.0, 300.0), home)
    with FlightLog(path, area=area, devices=NOBODY, start_ns=round(from_s * 1e9)) as log:
        for at_s, ned in zip(t_s.tolist(), way(t_s), strict=True):
            t_ns, here = round(at_s * 1e9), ned - np.array([0.0, east_m, 0.0])
            state = Kinematics(t_ns, here, np.zeros(3), level, np.zeros(3))
            if at_s == from_s:
                log.happened(VehicleEvent(t_ns, "armed", "armed", state, state))
            if not hole_s[0] < at_s < hole_s[1]:
                log.sampled(VehicleSample(t_ns, state, state, None, battery, "OFFBOARD", True))
        log.happened(VehicleEvent(t_ns, "armed", "disarmed", state, state))
    return path


def head_on(folder: Path, *, apart_m: float = 3.0, **more: Any) -> Path:
    """A folder of one world: two meet at 20 s, 50 m high, one to the right of the other."""
    east = straight(20.0, (0.0, 0.0, -50.0), (0.0, 5.0, 0.0))
    west = straight(20.0, (apart_m, 0.0, -50.0), (0.0, -5.0, 0.0))
    write_ours(folder / "vehicle-1" / "flight-0001.mcap", east, east_m=-100.0)
    write_ours(folder / "vehicle-2" / "flight-0001.mcap", west, east_m=100.0, **more)
    return folder
