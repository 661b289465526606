"""What all readers of other programs' logs make of the rows that they find, by hand."""

from pathlib import Path

import numpy as np
import pytest

from mission.base.errors import InputError
from mission.flight.logs.flight import LogRows, alone, ardupilot_mode
from mission.log.values import COPTER, PLANE, ROVER

S = 1_000_000_000
DEG_M = 111_195.0  # of latitude, within half a percent


def found(*places: tuple[float, float]) -> LogRows:
    """Rows of places: when (s), and how far north (m), 100 m up after the first."""
    rows = LogRows(Path("a log"), "made up", "its own clock")
    rows.places = [
        (t_s * S, 47.0 + north_m / DEG_M, 8.0, 500.0 + 100.0 * (n > 0))
        for n, (t_s, north_m) in enumerate(places)
    ]
    return rows


def test_the_area_has_fifty_metres_around_a_flight() -> None:
    area = found((0.0, 0.0), (10.0, 300.0), (20.0, -100.0)).flight().area
    assert area.size_m == pytest.approx((100.0, 500.0), rel=0.01)
    assert area.home_m == pytest.approx((50.0, 150.0), rel=0.01)


def test_positions_are_thinned_to_twenty_milliseconds() -> None:
    rows = found(*((n / 250.0, 0.0) for n in range(251)))
    assert len(rows.flight().truth.t_ns) == 51
    apart = found(*((n / 45.0, 0.0) for n in range(46)))  # 22 ms: all of them
    assert len(apart.flight().truth.t_ns) == 46


def test_a_clock_that_goes_back_is_said_with_its_times() -> None:
    rows = found((0.0, 0.0), (5.25, 1.0), (5.5, 2.0), (3.0, 3.0), (3.5, 4.0), (9.0, 5.0))
    with pytest.raises(InputError, match=r"goes back from 5\.50 to 3\.00 s; cut it there"):
        rows.flight()


@pytest.mark.parametrize(("spread_s", "known"), [(0.45, True), (0.55, False)])
def test_utc_is_told_by_most_instants_if_they_agree_to_half_a_second(
    spread_s: float, known: bool
) -> None:
    rows = found((0.0, 0.0), (1.0, 1.0))
    late_s = [0.0] * 6 + [spread_s] * 3
    rows.utc_ns = [(n * S, n * S + round((1e9 + late) * S)) for n, late in enumerate(late_s)]
    rows.utc_ns.append((9 * S, 3 * S))  # a first fix is wrong, be it by years
    assert rows.flight().source.utc_ns == (10**9 * S if known else None)
    rows.utc_ns = []
    assert rows.flight().source.utc_ns is None


def test_times_that_two_neighbours_contradict_stand_alone() -> None:
    assert alone(np.array([0, 1, 2, 50, 3, 4, 5])).tolist() == [0, 0, 0, 1, 0, 0, 0]
    assert alone(np.array([10, 11, 12, 1, 13, 14])).tolist() == [0, 0, 0, 1, 0, 0]
    assert not alone(np.array([5, 6, 7, 1, 2, 3])).any()  # back for good
    assert alone(np.array([90, 1, 2, 3])).tolist() == [1, 0, 0, 0]
    assert alone(np.array([1, 2, 3, 0])).tolist() == [0, 0, 0, 1]


def test_modes_have_the_names_of_the_kind_of_vehicle() -> None:
    """As ArduPilot's parameter lists have them."""
    assert ardupilot_mode(COPTER, 5) == "LOITER"
    assert ardupilot_mode(PLANE, 5) == "FBWA"
    assert ardupilot_mode(ROVER, 4) == "HOLD"
    assert ardupilot_mode(COPTER, 199) == "MODE 199"


def test_only_changes_count_and_only_of_who_is_armed() -> None:
    rows = found((0.0, 0.0), (1.0, 1.0))
    for t_ns, name in enumerate(("HOLD", "HOLD", "AUTO", "HOLD")):
        rows.mode(t_ns, name)
    for t_ns, on in enumerate((False, True, True, False)):
        rows.failing(t_ns, "battery", on=True)
        rows.armed(t_ns, on=on)
    assert rows.modes == [(0, "HOLD"), (2, "AUTO"), (3, "HOLD")]
    told = [(t_ns, text) for t_ns, kind, text, *_ in rows.events if kind != "mode"]
    assert told == [(1, "armed"), (2, "battery"), (3, "disarmed")]
