"""What all readers of other programs' logs make of the rows that they find, by hand."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from mission.base.errors import InputError, NoFlightError
from mission.flight.logs.flight import DAMAGE, LogRows, alone, ardupilot_mode
from mission.flight.missions.mission_path import items_of
from mission.log.signals import Signal
from mission.log.values import COPTER, HEIGHTS, LOCAL, PLANE, ROVER
from sitl.autopilot.codec.orders import MissionItem

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


@pytest.mark.parametrize(("spread_s", "known"), [(0.45, True), (0.5, True), (0.55, False)])
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
    changes = [(t_ns, text) for t_ns, kind, text, *_ in rows.events if kind == "mode"]
    assert changes == rows.modes
    rows.armed(4, on=True)
    for t_ns, on in enumerate((True, True, False, True, True), start=5):
        rows.failing(t_ns, "battery", on=on)
    assert [row[0] for row in rows.events if row[1] == "failsafe"] == [2, 8]  # it lasted


def test_positions_of_one_instant_are_one_and_no_step_back() -> None:
    assert found((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (2.0, 2.0)).flight().truth.t_ns.tolist() == [
        0, S, 2 * S,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("row", "read"),
    [
        ((S, 0.0, 0.0, 5.0), False), ((S, 1e-9, 1e-9, 5.0), False), ((S, 1.2e-9, 0.0, 5.0), True),
        ((S, 0.0, -2e-9, 5.0), True), ((S, 90.0, 0.0, 5.0), False), ((S, -89.9, 0.0, 5.0), True),
        ((S, 0.0, 360.0, 5.0), False), ((S, 47.0, 8.0, 1e6), False), ((S, 47.0, 8.0, -9e5), True),
        ((S, math.nan, 8.0, 5.0), False), ((9e18, 47.0, 8.0, 5.0), False),
    ],
)  # fmt: skip
def test_a_place_that_is_none_is_counted(row: tuple[float, ...], read: bool) -> None:
    rows = found((0.0, 0.0), (2.0, 0.0))
    rows.places.insert(1, row)
    flight = rows.flight()
    assert len(flight.truth.t_ns) == 2 + read
    assert flight.source.skipped == ({} if read else {"position without a value": 1})


def test_a_row_without_a_time_is_counted_wherever_it_stands() -> None:
    rows = found((0.0, 0.0), (1.0, 1.0))
    never = 9 * 10**18
    rows.modes = [(0, "HOLD"), (never, "AUTO")]
    rows.events = [(never, "status", "x", None, 6), (-never, "status", "y", None, 6)]
    rows.events.append((never - 10**4, "status", "z", None, 6))
    rows.battery = [(never, 1.0, 1.0, 1.0, 1.0)]
    rows.wind = [(never, 1.0, 1.0)]
    rows.current = [(never, 3)]
    rows.fixes = [S, never]
    flight = rows.flight()
    assert flight.source.skipped == {"row without a time": 6}
    assert flight.modes.names == ("HOLD",)
    assert [event.text for event in flight.events] == ["z"]
    assert flight.gnss_ns.tolist() == [S]
    assert not len(flight.battery.t_ns) + len(flight.wind.t_ns) + len(flight.current[0])


def test_what_a_monitor_or_a_filter_does_not_have_it_writes_as_zeros() -> None:
    rows = found((0.0, 0.0), (1.0, 1.0))
    rows.battery = [(0, 0.0, 0.0, 7.0, 0.5), (S, -1.0, 0.0, 8.0, 0.4)]
    rows.wind = [(0, 0.0, 0.0), (S, 0.0, 0.0)]
    none = rows.flight()
    assert np.isnan(none.battery.voltage_v).all()
    assert np.isnan(none.battery.current_a).all()
    assert none.battery.consumed_mah.tolist() == [7.0, 8.0]
    assert none.battery.remaining.tolist() == [0.5, 0.4]
    assert len(none.wind.t_ns) == 0
    rows.battery.append((2 * S, 0.1, 0.0, 9.0, 0.3))
    rows.wind.append((2 * S, 0.0, -0.5))
    some = rows.flight()
    assert some.battery.voltage_v.tolist() == [0.0, -1.0, 0.1]
    assert some.battery.current_a.tolist() == [0.0, 0.0, 0.0]
    assert some.wind.vel_mps.tolist() == [[0, 0, 0], [0, 0, 0], [0, -0.5, 0]]


def test_an_event_is_where_the_vehicle_was_then_or_next() -> None:
    rows = found((0.0, 0.0), (1.0, 10.0), (2.0, 20.0))
    for t_s in (3.0, -1.0, 1.0, 1.5):
        rows.event(round(t_s * S), "status", str(t_s))
    events = rows.flight().events
    assert [event.text for event in events] == ["-1.0", "1.0", "1.5", "3.0"]
    north_m = [event.true_m[1] - events[0].true_m[1] for event in events]
    assert north_m == pytest.approx([0.0, 10.0, 20.0, 20.0], rel=0.01)
    assert all(event.true_m == event.est_m for event in events)
    assert {(event.seq, event.severity) for event in events} == {(None, 6)}


@pytest.mark.parametrize(
    ("first_s", "last_s", "spans"),
    [(0.0, 30.0, True), (6.0, 24.0, True), (6.01, 24.0, False), (6.0, 23.99, False)],
)
def test_a_truth_counts_from_a_second_after_it_leaves_to_one_before_it_is_back(
    first_s: float, last_s: float, spans: bool
) -> None:
    """It stands until 5 s, and from 25 s on; places a metre away are where it stood."""
    north_m = [0.0, 0.9, *[50.0] * 21, *[0.5] * 5]
    rows = found(*zip(np.arange(3.0, 31.0), north_m, strict=True))
    rows.places = [(*row[:3], 600.0) for row in rows.places]
    rows.truth = [
        (t_s * S, 47.0 + 3.0 / DEG_M, 8.0, 600.0) for t_s in np.linspace(first_s, last_s, 91)
    ]
    flight = rows.flight()
    what = "position of a ground truth that does not span the log"
    assert flight.source.only == (None if spans else "believed")
    assert flight.source.skipped.get(what, 0) == (0 if spans else len(rows.truth))
    apart_m = flight.truth.pos_m[10, 1] - flight.belief.pos_m[10, 1]
    assert apart_m == pytest.approx(-47.0 if spans else 0.0, rel=0.01)


NORTH = Signal(np.arange(5.0), np.column_stack((np.arange(5.0), np.zeros(5), -2.0 * np.arange(5))))
HEIGHT = Signal(np.arange(3.0), np.array([[1.0], [3.0], [2.0]]))


def signals_alone(**signals: Signal) -> LogRows:
    rows = LogRows(Path("a log"), "made up", "its own clock")
    rows.signals = signals
    return rows


def test_without_places_it_flew_around_where_its_filter_began() -> None:
    flight = signals_alone(position_m=NORTH, height_m=HEIGHT).flight()
    assert flight.source.only == LOCAL
    assert flight.truth.t_ns.tolist() == [0, S, 2 * S, 3 * S, 4 * S]
    np.testing.assert_allclose(np.ptp(flight.truth.pos_m, axis=0), [0.0, 4.0, 8.0])
    assert flight.truth.pos_m[4, 2] == 8.0
    assert (flight.area.home.lat_deg, flight.area.home.lon_deg) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("signals", "heights"),
    [
        ({"height_m": HEIGHT}, [1.0, 3.0, 2.0]),
        ({"position_m": Signal(NORTH.t_s, NORTH.values * [math.nan, 1, 1])}, [0, 2, 4, 6, 8]),
        ({"position_m": Signal(NORTH.t_s, NORTH.values[:, 2:])}, [0, 2, 4, 6, 8]),
        ({"position_m": Signal(NORTH.t_s[:1], NORTH.values[:1]), "height_m": HEIGHT}, [1, 3, 2]),
    ],
)  # fmt: skip
def test_of_heights_alone_all_is_above_where_it_began(
    signals: dict[str, Signal], heights: list[float]
) -> None:
    flight = signals_alone(**signals).flight()
    assert flight.source.only == HEIGHTS
    assert flight.truth.pos_m[:, 2].tolist() == heights
    assert np.ptp(flight.truth.pos_m[:, :2], axis=0).tolist() == [0.0, 0.0]


def test_of_a_log_of_heights_a_day_beside_the_rest_is_damage() -> None:
    t_s = np.array([0.0, 10.0, 20.0, 10.0 + 86_399.0, 10.0 + 86_400.0])
    rows = signals_alone(height_m=Signal(np.sort(t_s), np.ones((5, 1))))
    # Around the median, 20 s.
    assert rows.flight().truth.t_ns.tolist() == [0, 10 * S, 20 * S, 86_409 * S, 86_410 * S]
    t_s[4] = 86_420.0
    rows = signals_alone(height_m=Signal(np.sort(t_s), np.ones((5, 1))))
    assert rows.flight().truth.t_ns.tolist() == [0, 10 * S, 20 * S, 86_409 * S]


def test_without_a_position_there_is_no_flight_and_what_was_not_read_is_said() -> None:
    with pytest.raises(NoFlightError, match=r"^a log: the log has no positions[^;]*$"):
        signals_alone().flight()
    rows = found((0.0, 0.0))
    with pytest.raises(NoFlightError):
        rows.flight()
    rows = found((0.0, 0.0))
    rows.skipped["thing"] = 2
    rows.skipped["other"] = 0
    with pytest.raises(InputError, match=r"; not read: 2 things$") as error:
        rows.flight()
    assert not isinstance(error.value, NoFlightError)


def item(seq: int, command: int = 16) -> MissionItem:
    return MissionItem(seq, command, 3, (1.0, 2.0, 3.0, 4.0), 47.0, 8.0, 20.0)


def test_a_list_is_noted_unless_it_equals_the_last_of_its_kind() -> None:
    rows = found((0.0, 0.0), (1.0, 1.0))
    fence = mav.MAV_MISSION_TYPE_FENCE
    rows.add_list(1, {0: item(0), 2: item(2)})
    rows.add_list(2, {0: item(0), 2: item(2)})
    rows.add_list(3, {0: item(0)}, fence)
    rows.add_list(4, {0: item(0), 2: item(2)})
    rows.add_list(5, {0: item(0, 22)})
    rows.add_list(6, {0: item(0), 2: item(2)})
    rows.add_list(7, {})
    assert [(m.t_ns, m.kind, len(m.items)) for m in rows.missions] == [
        (1, "mission", 3), (3, "fence", 1), (5, "mission", 1), (6, "mission", 3),
        (7, "mission", 0),
    ]  # fmt: skip
    missing = items_of(rows.missions[0])[1]
    assert (missing.seq, missing.command, missing.params) == (1, 0, (0.0,) * 4)
    assert (missing.x, missing.y, missing.z) == (0.0, 0.0, 0.0)


def test_an_item_counts_once_while_it_is_flown_to() -> None:
    rows = found((0.0, 0.0), (1.0, 1.0))
    for t_ns, seq in enumerate((1, 1, 2, 2, 1)):
        rows.heads_for(t_ns, seq)
    assert rows.current == [(0, 1), (2, 2), (4, 1)]


@pytest.mark.parametrize(
    ("content", "messages", "skipped"),
    [
        (b"..M2abM0", ["M2ab", "M0"], {}),
        (b"..xxM1aM1b", ["M1a", "M1b"], {DAMAGE: 2}),
        (b"..M1axyzM0", ["M1a", "M0"], {DAMAGE: 3}),
        (b"..M0M3ab", ["M0"], {"message that the end cut off": 1}),
        (b"..M0xx", ["M0"], {"message that the end cut off": 1}),
        (b"..M0xxx", ["M0"], {DAMAGE: 3}),
        (b"..M0xxxM9", ["M0"], {DAMAGE: 5}),
        (b"..", [], {}),
    ],
)
def test_bytes_that_are_of_no_message_are_damage(
    content: bytes, messages: list[str], skipped: dict[str, int]
) -> None:
    """A message here: M, how many letters it has, and these; two bytes come before all."""
    rows = LogRows(Path("a log"), "made up", "its own clock")

    def end_of(at: int) -> int:
        told = re.compile(rb"M(\d)").match(content, at)
        return at + 2 + int(told[1]) if told else at

    read = rows.messages(content, re.compile(b"M"), end_of, begin=2)
    assert [content[at:end].decode() for at, end in read] == messages
    assert +rows.skipped == skipped


def test_the_clock_is_back_from_the_byte_on_that_is_nearer_to_what_follows() -> None:
    rows = LogRows(Path("a log"), "made up", "its own clock", range(10, 20))
    regular = [100, 101, 102, 102, 103, 104, 1, 2, 3, 4, 5, 6]
    for n, t_ns in enumerate(regular):
        assert rows.counts(10 * n, "POS", t_ns) is (n == 1)
    for at, t_ns in ((52, 106), (54, 107), (56, 0), (58, 1)):
        rows.counts(at, "MSG", t_ns)
    assert rows.cuts(("none", "POS", "MSG")) == [55]
    assert rows.cuts(("none",)) == []
    few = LogRows(Path("a log"), "made up", "its own clock")
    for n, t_ns in enumerate(regular[:10]):  # four after the step: damage
        few.counts(10 * n, "POS", t_ns)
    assert few.cuts(("POS",)) == []
    few.counts(100, "POS", 5)
    assert few.cuts(("POS",)) == [51]
