"""Passes through a mission by vehicles that fly straight from place to place at given times.

Up 30 m above home in 5 s, then 100 m each to the north, east and south at 10 m/s.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pymap3d
import pytest
from bare_flight import bare_flight
from pymavlink.dialects.v20 import common as mav

from mission.analysis.one_pass import Pass
from mission.analysis.passes import Judged, Plan, judged
from mission.base.errors import InputError
from mission.flight.missions.mission_path import record_of
from mission.log.values import EventRecord, FlightData, Modes, PlanRecord
from sitl.autopilot.codec.orders import MissionItem

HOME = bare_flight([0.0], [(0.0, 0.0, 0.0)]).area.home
Place = tuple[float, float, float, float]  # seconds, east, north, up
UP: list[Place] = [(0, 0, 0, 0), (5, 0, 0, 0), (10, 0, 0, 30)]
WAY: list[Place] = [*UP, (20, 0, 100, 30), (30, 100, 100, 30), (40, 100, 0, 30), (50, 100, 0, 30)]
PLACES = [(0.0, 0.0), (0.0, 100.0), (100.0, 100.0), (100.0, 0.0)]


def item(seq: int, east_m: float, north_m: float, *, command: int | None = None) -> MissionItem:
    usual = mav.MAV_CMD_NAV_WAYPOINT if seq else mav.MAV_CMD_NAV_TAKEOFF
    lat, lon, _ = pymap3d.ned2geodetic(
        north_m, east_m, 0.0, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m
    )
    relative = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return MissionItem(seq, command or usual, relative, (0.0, 0.0, 0.0, 0.0), lat, lon, 30.0)


MISSION = tuple(item(seq, *place) for seq, place in enumerate(PLACES))
RETURN = item(4, 0.0, 0.0, command=mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)


def flight(
    way: Sequence[Place],
    modes: Sequence[tuple[float, str]],
    current: Sequence[tuple[float, int]] = (),
    *,
    items: Sequence[MissionItem] = MISSION,
    **more: Any,
) -> FlightData:
    t_s, *axes = np.array(way, dtype=float).T
    every = np.arange(t_s[0], t_s[-1] + 0.1, 0.1)
    data = bare_flight(every, np.column_stack([np.interp(every, t_s, axis) for axis in axes]))
    times_ns = (np.array([t for t, _ in modes]) * 1e9).astype(np.int64)
    now = np.array([(round(t * 1e9), seq) for t, seq in current], dtype=np.int64).reshape(-1, 2)
    record = record_of(0, mav.MAV_MISSION_TYPE_MISSION, items)
    known = Modes(times_ns, tuple(name for _, name in modes))
    more = {"missions": (record,), "modes": known, "current": (now[:, 0], now[:, 1]), **more}
    return replace(data, **more)


def passes(data: FlightData, given: Plan | None = None) -> tuple[Pass, ...]:
    return judged("a log", data, given).passes


def places(one: Pass) -> list[tuple[int, float]]:
    return [(p.seq, p.t_s) for p in one.passages]


FLOWN = [(0.0, "HOLD"), (5.0, "MISSION")]
HEADED = [(5.0, 0), (10.0, 1), (20.0, 2), (30.0, 3)]


@pytest.mark.parametrize("current", [[], HEADED])
def test_places_are_passed_where_it_was_nearest_or_came_to_stay(current: Any) -> None:
    """A corner in its middle; of a hover, a second from where it comes within a metre."""
    (one,) = passes(flight(WAY, FLOWN, current))
    found = places(one)
    assert [seq for seq, _ in found] == [0, 1, 2, 3]
    # 1 m below at 6 m/s, and 1 m to the north at 10 m/s.
    expected = [10.0 + (0.1 - 1 / 6) / 2, 20.0, 30.0, 40.9]
    assert [t_s for _, t_s in found] == pytest.approx(expected, abs=0.01)
    for passage in one.passages:
        assert np.linalg.norm(passage.miss_m) == pytest.approx(0.0, abs=0.02)
    record = one.record
    assert (record.round, one.plan.round) == (1, 1)
    # From where it leaves its place on: a metre up; and to where it stays.
    assert record.start_t_s == pytest.approx(5.0, abs=0.2)
    assert record.start_t_s + record.duration_s == pytest.approx(40.0, abs=0.11)
    assert record.flown_path_m == record.budget_used_m == pytest.approx(300.0, abs=0.05)
    assert record.plan_path_m == pytest.approx(300.0, abs=0.05)
    assert record.time_used_s == record.duration_s
    assert one.fit.length_m == pytest.approx(330.0, abs=0.1)
    assert one.begin_ns == 5 * 10**9
    assert one.known_height.all()
    assert np.isnan(one.plan.slot_s).all()


@pytest.mark.parametrize(("off_m", "reached"), [(6.9, True), (7.2, False)])
def test_a_place_is_reached_within_ten_metres_where_the_log_names_no_item(
    off_m: float, reached: bool
) -> None:
    """It flies towards the second one along its leg, and ends beside it."""
    data = flight([*WAY[:4], (27, 70, 100, 30), (30, 100 - off_m, 100 - off_m, 30)], FLOWN)
    (one,) = passes(data)
    seq, t_s = places(one)[2]
    assert seq == 2
    assert math.isnan(t_s) != reached
    assert all(math.isnan(t) for _, t in places(one)[3:])


@pytest.mark.parametrize(("moved_m", "count"), [(29.0, 1), (31.0, 2)])
@pytest.mark.parametrize(("seq", "more"), [(2, 0), (1, 1)])
def test_a_mission_goes_on_within_thirty_metres_and_at_no_earlier_item(
    moved_m: float, count: int, seq: int, more: int
) -> None:
    """It is left half way to the second place at 25 s, and goes on at 35 s."""
    way = [*WAY[:4], (25, 50, 100, 30), (30, 50 + moved_m, 100, 30), (35, 50 + moved_m, 100, 30),
           (40, 100, 100, 30), (50, 100, 0, 30), (60, 100, 0, 30)]  # fmt: skip
    modes = [*FLOWN, (25.0, "HOLD"), (35.0, "MISSION")]
    current = [(5.0, 0), (10.0, 1), (20.0, 2), (35.0, seq), (36.0, 2), (40.0, 3)]
    found = passes(flight(way, modes, current))
    assert len(found) == min(2, count + more)
    times = [at for one in found for at in places(one)]
    assert (2, pytest.approx(40.0, abs=0.2)) in times
    assert (3, pytest.approx(50.9, abs=0.1)) in times
    if len(found) == 1:
        assert found[0].record.duration_s == pytest.approx(45.0, abs=0.3)
    for ended in ("LAND", "RETURN"):  # what ends it is no pause
        other = [*FLOWN, (25.0, ended), (28.0, "HOLD"), (35.0, "MISSION")]
        assert len(passes(flight(way, other, current))) == 2


@pytest.mark.parametrize(("until_s", "flown"), [(11.9, False), (12.0, True)])
def test_a_pass_lasts_two_seconds_at_least(until_s: float, flown: bool) -> None:
    modes = [(0.0, "HOLD"), (10.0, "MISSION"), (until_s + 1e-9, "HOLD")]
    data = flight(WAY, modes)
    if flown:
        assert len(passes(data)) == 1
        return
    with pytest.raises(InputError, match=r"its mission was never flown \(modes: HOLD, MISSION\)"):
        passes(data)


@pytest.mark.parametrize(("away_m", "near"), [(1990.0, True), (2010.0, False)])
def test_a_plan_is_of_another_place_from_two_kilometres_on(away_m: float, near: bool) -> None:
    items = (MISSION[0], item(1, 100.0, 100.0 + away_m), item(2, 100.0, 9000.0))
    given = Plan("b.plan", items, logged=False)
    data = flight(WAY, FLOWN, items=())
    if near:
        (one,) = passes(data, given)
        assert places(one)[0][1] == pytest.approx(9.97, abs=0.01)
        return
    with pytest.raises(InputError, match=r"b\.plan is of another place: .* is 2\.0 km from the f"):
        passes(data, given)


BACK: list[Place] = [*WAY[:6], (50, 0, 0, 30), (60, 0, 0, 0), (65, 0, 0, 0)]


@pytest.mark.parametrize("told", [True, False])
def test_a_return_has_no_errors_and_ends_with_the_landing(told: bool) -> None:
    """Told by its mode from 40 s on, or by the item that is flown to."""
    modes = [*FLOWN, *[(40.0, "RETURN")] * told]
    data = flight(BACK, modes, [*HEADED, (40.0, 4)], items=(*MISSION, RETURN))
    (one,) = passes(data)
    t_s = one.track.t_ns / 1e9
    # Its way begins where it was nearest to the last place.
    assert np.isnan(one.fit.cross_m[t_s > 40.2]).all()
    assert np.isfinite(one.fit.cross_m[t_s < 39.8]).all()
    assert [p.seq for p in one.passages] == [0, 1, 2, 3, 4]
    *_, last, landed = one.passages
    assert last.t_s == pytest.approx(40.0, abs=0.1)
    assert landed.t_s == pytest.approx(60.0, abs=0.4)
    assert np.isnan(landed.miss_m).all()
    assert not one.known_height[t_s > 50.2].any()
    assert one.known_height[t_s < 39.0].all()


def test_a_landing_in_the_mission_has_its_errors_but_none_of_height() -> None:
    land = item(4, 0.0, 0.0, command=mav.MAV_CMD_NAV_LAND)
    (one,) = passes(flight(BACK, FLOWN, [*HEADED, (40.0, 4)], items=(*MISSION, land)))
    t_s = one.track.t_ns / 1e9
    *_, landed = one.passages
    assert landed.t_s == pytest.approx(60.0, abs=0.4)
    assert landed.miss_m == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
    assert one.fit.cross_m == pytest.approx(0.0, abs=0.02)
    assert one.known_height[t_s < 39.9].all()
    assert not one.known_height[t_s > 40.1].any()  # how high it comes down nobody knows
    # Not at home: it comes by 4 m beside it.
    beside = item(4, 3.0, -4.0, command=mav.MAV_CMD_NAV_LAND)
    (one,) = passes(flight(BACK, FLOWN, [*HEADED, (40.0, 4)], items=(*MISSION, beside)))
    assert one.passages[-1].miss_m == pytest.approx([0.0, 4.0, 0.0], abs=0.2)


@pytest.mark.parametrize(("count", "kept"), [(6, True), (5, False), (7, False)])
def test_times_are_foreseen_by_who_ordered_the_mission(count: int, kept: bool) -> None:
    """From its start, straight up, to four places; of another way only how long it takes."""
    slot_s = 7.0 * np.arange(float(count))
    plan = PlanRecord.of_flight(1, 0, np.ones((count, 3)) * slot_s[:, None], slot_s=slot_s)
    (one,) = passes(flight(WAY, FLOWN, HEADED, plans=(plan,)))
    expected = slot_s if kept else [*[math.nan] * 5, slot_s[-1]]
    np.testing.assert_array_equal(one.plan.slot_s, expected)
    (late,) = passes(flight(WAY, [(0.0, "HOLD"), (12.0, "MISSION")], HEADED[1:], plans=(plan,)))
    assert np.isnan(late.plan.slot_s).all()  # it began with another item
    given = Plan("b.plan", MISSION, logged=False)
    (other,) = passes(flight(WAY, FLOWN, HEADED, plans=(plan,)), given)
    assert np.isnan(other.plan.slot_s).all()


def test_each_upload_is_a_mission_of_its_own_and_going_back_a_pass() -> None:
    second = replace(record_of(0, mav.MAV_MISSION_TYPE_MISSION, MISSION[:3]), t_ns=25 * 10**9)
    data = flight(WAY, FLOWN)
    found = passes(replace(data, missions=(*data.missions, second)))
    assert [one.plan.round for one in found] == [1, 2]
    assert [one.begin_ns / 1e9 for one in found] == [5.0, 25.0]
    again = [*WAY[:4], (30, 100, 100, 30), (50, 0, 100, 30), (60, 100, 100, 30), (70, 100, 0, 30)]
    current = [(5.0, 0), (10.0, 1), (20.0, 2), (30.0, 1), (50.0, 2), (60.0, 3)]
    one, other = passes(flight(again, FLOWN, current))
    assert one.track.t_ns[-1] == pytest.approx(30e9, abs=2e8)
    assert [seq for seq, _ in places(other)] == [1, 2, 3]
    assert [t for _, t in places(other)][:2] == pytest.approx([50.0, 60.0], abs=0.2)


def test_what_was_flown_outside_is_counted_by_mode() -> None:
    modes = [*FLOWN, (30.0, "HOLD"), (37.0, "OFFBOARD")]
    found: Judged = judged("a log", flight(WAY, modes, HEADED), None)
    # Before the mission a second of standing; and what is shorter than two is left out.
    assert found.apart == {
        "HOLD": pytest.approx(8.0, abs=0.01), "OFFBOARD": pytest.approx(13.0, abs=0.01)
    }  # fmt: skip
    still = judged("a log", flight(WAY, [*FLOWN, (43.0, "OFFBOARD")], HEADED), None)
    assert still.apart == {}
    short = judged("a log", flight(WAY, [*modes[:3], (31.9, "ACRO"), (33.8, "MISSION")]), None)
    assert short.apart == {"HOLD": pytest.approx(2.9, abs=0.01)}
    assert found.left_out == {}
    assert found.data.planned is not None
    assert found.data.planned.reached == {0, 1, 2}
    assert found.data.planned.source == "mission in the log"
    assert list(found.data.planned.places_m) == [0, 1, 2, 3]
    assert found.data.planned.places_m[2] == pytest.approx([100.0, 100.0, 30.0], abs=0.05)
    assert not found.data.planned.in_holes


def test_without_a_log_of_items_what_was_reached_tells_which_came_next() -> None:
    at = (0.0, 0.0, 0.0)
    events = tuple(
        EventRecord(round(t * 1e9), "reached", f"item {seq}", seq, 6, at, at)
        for t, seq in ((10.0, 0), (20.0, 1), (30.0, 2), (40.0, 3))
    )
    (one,) = passes(flight(WAY, FLOWN, events=events))
    assert [t for _, t in places(one)] == pytest.approx([9.97, 20.0, 30.0, 40.9], abs=0.02)


def test_logs_without_positions_missions_or_a_flight_are_refused() -> None:
    data = flight(WAY, FLOWN)
    for wrong, why in (
        (replace(data, truth=data.truth.between(0, 0)), "the log has no positions"),
        (replace(data, missions=()), "the log has no mission to compare with"),
        (flight([(0, 0, 0, 0), (9, 0, 0, 0.5)], FLOWN), "it never left the ground"),
        (flight(WAY, [(0.0, "HOLD")]), r"its mission was never flown \(modes: HOLD\)"),
    ):
        with pytest.raises(InputError, match=why):
            passes(wrong)
