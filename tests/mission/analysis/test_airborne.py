"""When a flight begins and ends, of tracks whose every place is given."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bare_flight import bare_flight

from mission.analysis.airborne import air_times, airborne, flown_modes, times_in_air
from mission.base.errors import InputError
from mission.log.values import EventRecord, FlightData, Modes


def data(up_m: Callable[[float], float], *, until_s: int) -> FlightData:
    """A log that tells ten heights a second, 3 m beside home and from 2 m on."""
    t_s = [step / 10 for step in range(10 * until_s + 1)]
    return bare_flight(t_s, [(3.0, 0.0, 2.0 + up_m(each)) for each in t_s])


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


def test_of_a_hop_half_its_height_is_off_the_ground() -> None:
    """It waits at less than that, or at more, from 5 s on, and rises to 2 m at 15 s."""

    def begins_s(waits_m: float) -> float:
        hop = data(lambda t_s: waits_m * (t_s >= 5.0) + (2.0 - waits_m) * (t_s >= 15.0), until_s=20)
        return airborne("a log", hop)[0] / 1e9

    assert begins_s(0.95) == pytest.approx(13.9)
    assert begins_s(1.05) == pytest.approx(3.9)


def test_a_log_that_begins_in_the_air_begins_the_flight() -> None:
    flight = data(lambda t_s: 5.0 * t_s, until_s=20)
    assert airborne("a log", flight)[0] == 0


def test_what_is_disarmed_at_the_end_has_landed_wherever_it_is_carried() -> None:
    flight = data(lambda t_s: 5.0 * t_s, until_s=20)
    times = np.array([0, 12_000_000_000])
    for last, end_s in (("DISARMED", 12.0), ("LAND", 20.0)):
        modes = Modes(times, ("DISARMED" if last == "LAND" else "LAND", last))
        assert airborne("a log", replace(flight, modes=modes))[1] / 1e9 == end_s


def test_modes_count_and_time_is_in_the_air_while_it_is_armed() -> None:
    """Two flights: from 2 to 5 s, in a mode that is told at 4 s only, and from 9 to 12 s."""
    flight = data(lambda t_s: t_s, until_s=20)
    told = ((2, "armed"), (5, "disarmed"), (9, "armed"), (12, "disarmed"))
    at = flight.truth.pos_m[0].tolist()
    events = [EventRecord(10**9 * t_s, "armed", said, None, 6, at, at) for t_s, said in told]
    modes = Modes(10**9 * np.array([4, 8, 10]), ("HOLD", "MISSION", "LAND"))
    flight = replace(flight, events=tuple(events), modes=modes)
    found = flown_modes(flight)
    assert dict(zip((found.t_ns / 1e9).tolist(), found.names, strict=True)) == {
        2: "mode unknown", 4: "HOLD", 5: "DISARMED", 8: "DISARMED", 9: "MISSION", 10: "LAND",
        12: "DISARMED",
    }  # fmt: skip
    assert air_times(flight, 10**9, 10 * 10**9) == [(2.0, 5.0), (9.0, 10.0)]
    assert air_times(flight, 9 * 10**9, 20 * 10**9) == [(9.0, 12.0)]
    assert air_times(flight, 6 * 10**9, 8 * 10**9) == [(6.0, 8.0)]  # never: all of it


def told(
    *events: tuple[float, str], up_m: Callable[[float], float], until_s: int = 40
) -> FlightData:
    flight = data(up_m, until_s=until_s)
    here = (3.0, 0.0, 2.0)
    return replace(
        flight,
        events=tuple(EventRecord(round(t * 1e9), "armed", of, None, 6, here, here)
                     for t, of in events),
        modes=Modes(np.zeros(1, dtype=np.int64), ("HOLD",)),
    )  # fmt: skip


def hop(t_s: float) -> float:
    """Up at 1 m/s from 10 s on, down to the ground at 30 s."""
    return max(0.0, min(t_s - 10.05, 30.05 - t_s))


def perch(t_s: float) -> float:
    """Up as before, and down to 5 m at 25 s."""
    return max(0.0, min(t_s - 10.05, max(5.0, 30.05 - t_s)))


ARMED, DISARMED_AT_35 = (5.0, "armed"), (35.0, "disarmed")


def test_in_the_air_it_is_from_0_7_m_on_and_down_to_that() -> None:
    found = times_in_air("a log", told(ARMED, DISARMED_AT_35, up_m=hop))
    assert found == [pytest.approx((10.8, 29.3))]
    found = times_in_air("a log", told(ARMED, DISARMED_AT_35, up_m=perch))
    assert found == [pytest.approx((10.8, 24.3))]
    # Where nobody says that it was disarmed, it may have been in the air to the end.
    assert times_in_air("a log", told(ARMED, up_m=perch)) == [pytest.approx((10.8, 40.0))]
    # Two flights in a log.
    twice = told((5.0, "armed"), (32.0, "disarmed"), (38.0, "armed"), (75.0, "disarmed"),
                 up_m=lambda t_s: hop(t_s) + hop(t_s - 35.0), until_s=80)  # fmt: skip
    assert times_in_air("a log", twice) == [
        pytest.approx((10.8, 29.3)), pytest.approx((45.8, 64.3))
    ]  # fmt: skip
    # Armed on the ground alone it does not fly.
    idle = told((5.0, "armed"), (8.0, "disarmed"), (9.0, "armed"), (35.0, "disarmed"), up_m=hop)
    assert times_in_air("a log", idle) == [pytest.approx((10.8, 29.3))]


def test_nobody_flies_all_of_a_run_without_a_flight() -> None:
    run = replace(
        told(ARMED, DISARMED_AT_35, up_m=hop),
        attachments={"config.toml": b"[mission]\nflight = 'none'\n"},
    )
    assert times_in_air("a run", run) == [(0.0, 40.0)]


@pytest.mark.parametrize(("later_s", "ends_s"), [(1.0, 24.3), (1.1, 40.0)])
def test_who_is_disarmed_after_the_last_position_may_have_flown_to_that(later_s, ends_s) -> None:
    found = times_in_air("a log", told(ARMED, (40.0 + later_s, "disarmed"), up_m=perch))
    assert found == [pytest.approx((10.8, ends_s))]


@pytest.mark.parametrize(("high_m", "armed_s", "begins_s"), [
    (2.0, -1.5, 0.0), (2.0, -1.0, 10.8), (0.9, -1.5, 10.8), (1.1, -1.5, 0.0),
])  # fmt: skip
def test_positions_that_begin_in_the_air_begin_the_flight(high_m, armed_s, begins_s) -> None:
    """A second after arming, and more than a metre above home."""
    flight = told((armed_s, "armed"), DISARMED_AT_35, up_m=lambda t_s: hop(t_s) + high_m - 2.0)
    assert times_in_air("a log", flight) == [pytest.approx((begins_s, 29.3))]


def test_who_is_wrecked_in_the_air_was_in_it_to_the_end() -> None:
    def fall(t_s: float) -> float:
        return min(max(0.0, t_s - 10.05), 12.0)

    # It moved by 0.29 m, or by 0.31 m, in its last second.
    for pace_mps, ends_s in ((0.29, 33.5), (0.31, 35.0)):

        def creep(t_s: float, pace: float = pace_mps) -> float:
            return fall(t_s) - 9.0 * (t_s > 33.5) - pace * min(max(0.0, t_s - 34.0), 1.0)

        found = times_in_air("a log", told(ARMED, DISARMED_AT_35, up_m=creep))
        assert found == [pytest.approx((10.8, ends_s))]
    stands = told(ARMED, DISARMED_AT_35, up_m=lambda t_s: fall(t_s) if t_s < 33.0 else 2.0)
    assert times_in_air("a log", stands)[0][1] == pytest.approx(32.9)
    for at_s, ends_s in ((35.5, 35.0), (36.5, 32.9)):
        modes = Modes((np.array([0.0, at_s]) * 1e9).astype(np.int64), ("HOLD", "TERMINATED"))
        ((_, end_s),) = times_in_air("a log", replace(stands, modes=modes))
        assert end_s == pytest.approx(ends_s)
