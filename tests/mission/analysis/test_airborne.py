"""When a flight begins and ends, of tracks whose every place is given."""

from collections.abc import Callable

import numpy as np
import pytest

from flightdyn.state import GeodeticPoint
from mission.analysis.airborne import airborne
from mission.base.area import Area
from mission.base.errors import InputError
from mission.log.values import BatteryTrack, FlightData, Track, WindTrack


def data(up_m: Callable[[float], float], *, until_s: int) -> FlightData:
    """A log that tells only heights, ten a second."""
    times = range(10 * until_s + 1)
    t_ns = np.array([100_000_000 * n for n in times], dtype=np.int64)
    track = Track(t_ns, np.array([(0.0, 0.0, up_m(n / 10)) for n in times]))
    none = np.zeros(0)
    return FlightData(
        area=Area.at((9.0, 9.0), (0.0, 0.0), GeodeticPoint(47.0, 8.0, 400.0)),
        truth=track,
        belief=track,
        battery=BatteryTrack(none.astype(np.int64), none, none, none, none),
        wind=WindTrack(none.astype(np.int64), np.zeros((0, 3))),
        events=(),
    )


@pytest.mark.parametrize(("wandered_m", "begins_s"), [(0.0, 20.0), (2.9, 20.0), (3.1, 10.0)])
def test_a_flight_begins_where_it_stands_last_within_three_metres(
    wandered_m: float, begins_s: float
) -> None:
    """At 1 m/s up to where it waits until 20 s, then on. Of standing, its last second counts."""

    def up_m(t_s: float) -> float:
        return min(max(0.0, t_s - 10.0), wandered_m) + max(0.0, t_s - 20.0)

    begin_ns, end_ns = airborne("a log", data(up_m, until_s=40))
    # It stands until it has moved by 0.3 m in a second.
    assert begins_s <= begin_ns / 1e9 + 1.0 < begins_s + 0.3
    assert end_ns == 40_000_000_000


@pytest.mark.parametrize(("creeps_mps", "begins_s"), [(0.29, 14.0), (0.31, 4.0)])
def test_who_moves_by_less_than_0_3_m_in_a_second_stands(
    creeps_mps: float, begins_s: float
) -> None:
    """From 5 s on for ten seconds, then it leaves at 10 m/s."""

    def up_m(t_s: float) -> float:
        return creeps_mps * min(max(0.0, t_s - 5.0), 10.0) + 10.0 * max(0.0, t_s - 15.0)

    begin_ns, _ = airborne("a log", data(up_m, until_s=20))
    assert begin_ns / 1e9 == pytest.approx(begins_s, abs=1.0)


def test_a_hop_is_a_flight_from_0_7_m_on() -> None:
    def hop(most_m: float) -> tuple[int, int]:
        return airborne("a log", data(lambda t_s: most_m * (10.0 <= t_s < 15.0), until_s=20))

    begin_ns, end_ns = hop(0.71)
    assert (begin_ns, end_ns) == (8_900_000_000, 14_900_000_000)
    with pytest.raises(InputError, match="never left the ground"):
        hop(0.69)
