"""When a plan file's places are passed, and when all is over, worked out by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import LimitsConfig
from flightdyn.state import GeodeticPoint
from mission.base.arrays import Floats
from mission.flight.missions.plan_check import checked_path, placed
from mission.flight.missions.plan_file import PlanFile
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.parameters import Parameters

HOME = GeodeticPoint(43.6145, 7.0715, 130.0)
DOWN_MPS, LAND_MPS, SLOW_M, RETURN_M = 2.5, 0.5, 8.0, 60.0
TAKES_OFF, STAYS, LANDS, RETURNS = (
    mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_LOITER_TIME, mav.MAV_CMD_NAV_LAND,
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
)  # fmt: skip
TURNS = mav.MAV_CMD_NAV_LOITER_TURNS


def slots(height_m: float, *ways: tuple[int, float, float], ends: int = LANDS) -> Floats:
    """Seconds (P,) of all points; `ways`: a command at the same height, its first parameter, and
    how many metres north of home it leads."""
    rows = [(TAKES_OFF, 0.0, 0.0), *ways, (ends, 0.0, 0.0)]
    items = []
    for seq, (command, first, north_m) in enumerate(rows):
        params = (first, 0.0, 20.0 if command == TURNS else 0.0, math.nan)  # circles of 20 m
        at = (HOME.lat_deg + north_m / 111_111.0, HOME.lon_deg, height_m)
        where = (0.0, 0.0, 0.0) if command == ends else at
        items.append(MissionItem(seq, command, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, params, *where))
    parameters = Parameters()
    parameters.apply(
        {"MPC_Z_VEL_MAX_DN": DOWN_MPS, "MPC_LAND_SPEED": LAND_MPS, "MPC_LAND_ALT2": SLOW_M,
         "RTL_RETURN_ALT": RETURN_M, "RTL_MIN_DIST": 25.0, "MPC_XY_CRUISE": 4.0}, "here",
    )  # fmt: skip
    plan = PlanFile(Path("a.plan"), b"", HOME, placed(items, HOME))
    return checked_path(plan, HOME, parameters=parameters, limits=LimitsConfig()).slot_s


def last_s(height_m: float, *ways: tuple[int, float, float], ends: int = LANDS) -> float:
    """From the last point in the air to the end."""
    *_, before_s, end_s = slots(height_m, *ways, ends=ends)
    return float(end_s - before_s)


def landed_s(height_m: float) -> float:
    """A landing from there, without the stop before it: fast, and below 8 m slowly."""
    return max(height_m - SLOW_M, 0.0) / DOWN_MPS + min(height_m, SLOW_M) / LAND_MPS


@pytest.mark.parametrize("height_m", [2.0, 8.0, 20.5, 120.0])
def test_a_landing_is_fast_and_then_slow(height_m: float) -> None:
    longer_s = last_s(height_m) - last_s(5.0)
    assert longer_s == pytest.approx(landed_s(height_m) - landed_s(5.0), abs=1e-3)
    assert last_s(5.0) == pytest.approx(landed_s(5.0), abs=1.0)


def test_a_return_lands_from_its_height_only_if_it_comes_from_afar() -> None:
    near, far = ((mav.MAV_CMD_NAV_WAYPOINT, 0.0, north_m) for north_m in (24.5, 25.5))
    assert last_s(40.0, near, ends=RETURNS) == pytest.approx(landed_s(40.0), abs=0.5)
    assert last_s(90.0, far, ends=RETURNS) == pytest.approx(landed_s(90.0), abs=0.5)
    # From 60 m, and it climbs there first, at 3 m/s and from rest to rest.
    longer_s = slots(40.0, far, ends=RETURNS)[-1] - slots(40.0, near, ends=RETURNS)[-1]
    assert longer_s == pytest.approx(landed_s(60.0) - landed_s(40.0) + 20.0 / 3.0, abs=2.0)


def test_waits_and_turns_last_as_long_as_they_are_given() -> None:
    assert np.diff([slots(40.0, (STAYS, s, 50.0))[-1] for s in (0.0, 3.0, 10.0)]) == (
        pytest.approx([3.0, 7.0])
    )
    assert np.diff([slots(40.0, (TURNS, n, 100.0))[-1] for n in (1.0, 2.0, 5.0)]) == (
        pytest.approx(np.array([1.0, 3.0]) * math.tau * 20.0 / 4.0)
    )


@pytest.mark.parametrize("wait_s", [3.0, 10.0])
def test_a_wait_leads_nowhere(wait_s: float) -> None:
    """So what is passed before it is passed as early, and what comes after so much later."""
    on = (mav.MAV_CMD_NAV_WAYPOINT, 0.0, 100.0)
    plain = slots(40.0, (STAYS, 0.0, 50.0), on)
    later = np.where(np.arange(len(plain)) < 4, 0.0, wait_s)
    assert slots(40.0, (STAYS, wait_s, 50.0), on) - plain == pytest.approx(later, abs=1e-6)
    twice = slots(40.0, (STAYS, wait_s, 50.0), (STAYS, wait_s, 100.0))
    assert twice[3] == pytest.approx(plain[3], abs=1e-6)
