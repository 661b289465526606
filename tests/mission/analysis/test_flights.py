"""Flights of our own vehicle on its own, matched with the missions in their logs."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk
from sitl_mavsdk import HOME
from small_runs import refused

from flightdyn.frames import LocalFrame
from mission.analysis.compare import compare_run
from mission.analysis.comparison_text import in_words
from mission.analysis.load import LoadedRun, load_run
from mission.analysis.one_pass import _closest, _led_past
from mission.analysis.passes import judged
from mission.analysis.spikes import spikes
from mission.base.area import Area
from mission.base.errors import InputError
from mission.cli import call
from mission.flight.serve.flight_logs import FlightLogs
from mission.log.reader import read_log
from mission.log.values import NS_PER_S, EventRecord, FlightData, Track

NAN = math.nan
SQUARE = ((0.0, 100.0), (120.0, 100.0), (120.0, -60.0), (0.0, -60.0))
RELATIVE = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def item(seq: int, command: int, *params: float, at: tuple[float, ...] | None = None) -> Any:
    p1, p2, p3, p4 = (*params, *[0.0] * (4 - len(params)))
    x, y, z = 0, 0, 0.0
    if at is not None:
        place = LocalFrame(HOME).to_geodetic(np.array([*at[:2], 0.0]))
        x, y, z = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), at[2]
    frame = mav.MAV_FRAME_MISSION if at is None else RELATIVE
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, p1, p2, p3, p4, x, y, z, mav.MAV_MISSION_TYPE_MISSION
    )


def square() -> list[Any]:
    return [
        item(seq, mav.MAV_CMD_NAV_WAYPOINT, at=(*place, 30.0))
        for seq, place in enumerate(SQUARE, start=1)
    ]


def take_off() -> Any:
    return item(0, mav.MAV_CMD_NAV_TAKEOFF, at=(0.0, 0.0, 30.0))


def plain() -> list[Any]:
    return [take_off(), *square(), item(5, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)]


def mode(desk: Desk, sub: int) -> None:
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, sub) == mav.MAV_RESULT_ACCEPTED


def abort(desk: Desk) -> None:
    desk.fly(seconds=30)
    mode(desk, 3)
    desk.fly(seconds=8)
    desk.send(mav.MAVLink_mission_set_current_message(1, 1, 1))
    mode(desk, 4)


def flown(folder: Path, items: Sequence[Any], then: Callable[[Desk], None] | None = None) -> Path:
    """The log of a mission that was flown on a vehicle that stands alone."""
    logs = FlightLogs(folder, area=Area.at((400.0, 400.0), (200.0, 200.0), HOME))
    desk = Desk(orders=logs)
    desk.vehicle.add_observer(logs)
    assert desk.upload(list(items)) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == mav.MAV_RESULT_ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 0) == mav.MAV_RESULT_ACCEPTED
    if then is not None:
        then(desk)
    desk.fly()
    logs.close()
    return folder / "flight-0001.mcap"


def compared(log: Path, data: FlightData | None = None) -> Any:
    loaded = load_run(log)
    if data is not None:
        found = judged(log, data, None)
        loaded = LoadedRun(log, found.data, {}, judged=found)
    assert loaded.judged is not None, loaded.unjudged
    return compare_run(loaded)


def test_a_log_of_the_vehicle_alone_holds_its_missions_and_setpoints(tmp_path: Path) -> None:
    def replace_and_steer(desk: Desk) -> None:
        desk.fly(seconds=15)
        mode(desk, 3)  # hold
        desk.fly(seconds=5)
        assert desk.upload(plain()[:3]) == mav.MAV_MISSION_ACCEPTED
        fence = mav.MAVLink_mission_item_int_message(
            1, 1, 0, 0, mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 0, 1, 900.0, 0, 0, 0,
            round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7), 0, mav.MAV_MISSION_TYPE_FENCE,
        )  # fmt: skip
        assert desk.upload([fence], mav.MAV_MISSION_TYPE_FENCE) == mav.MAV_MISSION_ACCEPTED
        desk.send(
            mav.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0b110111000111, 0, 0, 0, 1.5, NAN, 0.5, 0, 0, 0, 0, 0
            )
        )
        desk.fly(seconds=1)

    log = flown(tmp_path, plain(), replace_and_steer)
    data = read_log(log)
    kinds = [(record.kind, len(record.items)) for record in data.missions]
    assert kinds == [("mission", 6), ("mission", 3), ("fence", 1)]
    first, second, fence = data.missions
    assert first.t_ns == data.truth.t_ns[0] or first.t_ns < data.truth.t_ns[0]
    assert second.t_ns == pytest.approx(first.t_ns + 20e9, abs=0.2e9)
    assert fence.items[0][3] == 900.0
    (zone,) = load_run(log).data.fence
    away_m = np.linalg.norm(zone.outline_m - data.area.home_m, axis=1)
    np.testing.assert_allclose(away_m, 900.0, atol=0.1)
    (setpoint,) = data.setpoints
    assert setpoint.message == "SET_POSITION_TARGET_LOCAL_NED"
    assert setpoint.values[3] == 1.5
    assert math.isnan(setpoint.values[4])
    assert setpoint.t_ns >= second.t_ns


def test_the_legs_of_a_mission_in_the_log_are_matched(tmp_path: Path) -> None:
    log = flown(tmp_path, plain())
    found = compared(log)
    rows = found.legs
    assert [row.item for row in rows] == [0, 1, 2, 3, 4, 5]
    assert [round(row.length_m) for row in rows] == [30, 100, 120, 160, 120, 90]
    assert all(row.cross_track_max_m < 6.0 for row in rows[:5])
    assert math.isnan(rows[5].cross_track_max_m)  # of a return only the time is compared
    assert found.total.slots_missed == 0
    assert found.total.height_max_m < 0.5
    assert call(["compare", str(log)]) == 0


@pytest.mark.parametrize("hold_s", [0.0, 5.0])
def test_another_recorder_of_a_flight_has_the_same_times_of_its_places(
    tmp_path: Path, hold_s: float
) -> None:
    """Positions at other instants and as MAVLink rounds them, and a return that is told later."""
    *before, last = square()
    last.param1 = hold_s
    items = [take_off(), *before, last, item(5, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)]
    log = flown(tmp_path, items)
    data, modes = read_log(log), read_log(log).modes
    track = data.truth.at(data.truth.t_ns[:-1] + np.diff(data.truth.t_ns) // 2)
    late_ns = [600_000_000 * name.startswith("RETURN") for name in modes.names]
    other = replace(
        data,
        truth=replace(track, pos_m=np.round(track.pos_m / 0.011) * 0.011),
        modes=replace(modes, t_ns=modes.t_ns + np.array(late_ns)),
    )
    found = []
    for one in (compared(log), compared(log, other)):
        (way,) = one.run.judged.passes
        found.append([p.t_s for p in way.passages[1:5]] + [leg.end_s for leg in one.legs[1:5]])
    assert found[1] == pytest.approx(found[0], abs=0.005)


def test_a_place_that_is_passed_at_speed_is_passed_where_it_is_closest() -> None:
    t_s = np.arange(0.03, 8.0, 0.1)
    pos_m = np.stack((8.0 * (t_s - 4.0), np.full(len(t_s), 0.4), np.zeros(len(t_s))), axis=1)
    t_ns, miss_m = _closest((1e9 * t_s).astype(int), pos_m)
    assert t_ns / 1e9 == pytest.approx(4.0, abs=1e-3)
    assert miss_m == pytest.approx([0.0, 0.4, 0.0], abs=1e-6)


@pytest.mark.parametrize("offset_m", [1.0, 3.0, 10.0])
def test_an_offset_is_found_at_its_leg(tmp_path: Path, offset_m: float) -> None:
    log = flown(tmp_path, plain())
    data = read_log(log)
    before = compared(log)
    third = before.legs[2]
    t_s = data.truth.t_ns / 1e9
    inside = (t_s > third.start_s + 4.0) & (t_s < third.end_s - 4.0)
    pos_m = data.truth.pos_m.copy()
    pos_m[inside, 0] += offset_m  # east of a leg that leads north
    gone = (EventRecord(int(1e9 * (third.start_s + 4.5)), "fault", "wind", None, 4, (0,) * 3, (0,) * 3),)  # noqa: E501  # fmt: skip
    moved = replace(data, truth=Track(data.truth.t_ns, pos_m), events=(*data.events, *gone))
    found = compared(log, moved)
    rows = found.legs
    assert rows[2].cross_track_max_m == pytest.approx(
        offset_m, abs=0.2 + before.total.straight_max_m
    )
    others = [row.cross_track_max_m for row in rows[:2] + rows[3:]]
    assert max(others) < 6.0
    if offset_m >= 3.0:
        (spike,) = [s for s in spikes(moved, found.measured)
                    if s.what == "cross-track" and s.peak_m > 0.9 * offset_m]  # fmt: skip
        assert "fault: wind" in spike.during
        assert spike.words.startswith(f"at {spike.start_s:.1f}-{spike.end_s:.1f} s cross-track")


@pytest.mark.parametrize(
    ("turns", "radius_m"), [(1.25, 40.0), (1.1, -40.0), (0.5, 40.0), (0.0, 40.0), (1.0, 0.0)]
)
def test_a_circle_is_compared_with_the_one_that_is_flown(
    tmp_path: Path, turns: float, radius_m: float
) -> None:
    round_a_place = item(1, mav.MAV_CMD_NAV_LOITER_TURNS, turns, 0.0, radius_m, at=(0, 120.0, 30.0))
    last = item(2, mav.MAV_CMD_NAV_WAYPOINT, at=(120.0, 120.0, 30.0))
    total = compared(flown(tmp_path, [take_off(), round_a_place, last])).total
    assert total.cross_track_max_m < 0.5
    assert total.plan_path_m == pytest.approx(total.flown_path_m, abs=1.0)
    assert total.slots_missed == 0


@pytest.mark.parametrize("height_m", [12.0, 50.0])
def test_a_take_off_in_the_air_is_compared_with_how_it_is_flown(
    tmp_path: Path, height_m: float
) -> None:
    """Straight to a lower place, where the comparison went straight down first."""
    again = item(2, mav.MAV_CMD_NAV_TAKEOFF, at=(120.0, 60.0, height_m))
    total = compared(flown(tmp_path, [take_off(), square()[0], again])).total
    assert (total.cross_track_max_m, total.height_max_m) == pytest.approx((0.0, 0.0), abs=0.5)
    assert total.slots_missed == 0


def never_reached(log: Path) -> list[int]:
    (one,) = compared(log).run.judged.passes
    return [passage.seq for passage in one.passages if math.isnan(passage.t_s)]


@pytest.mark.parametrize(
    ("after_s", "to", "left_out"), [(12, 3, [1, 2]), (15, 3, [1, 2]), (17, 2, [1]), (20, 4, [2, 3])]
)
def test_items_that_are_left_out_were_not_reached(
    tmp_path: Path, after_s: int, to: int, left_out: list[int]
) -> None:
    """However far the mission led past them: it was sent on to a later one, which was."""

    def skip(desk: Desk) -> None:
        desk.fly(seconds=after_s)
        desk.send(mav.MAVLink_mission_set_current_message(1, 1, to))

    assert never_reached(flown(tmp_path, plain(), skip)) == left_out


def test_a_return_that_is_ordered_near_the_last_place_leaves_it_out(tmp_path: Path) -> None:
    """The place after which the mission would return lies beside one on the way."""
    last = item(4, mav.MAV_CMD_NAV_WAYPOINT, at=(0.0, 92.0, 30.0))
    items = [*plain()[:4], last, plain()[5]]

    def ordered(desk: Desk) -> None:
        desk.fly(seconds=22)  # 10 m past the first place
        mode(desk, 5)

    assert never_reached(flown(tmp_path, items, ordered)) == [2, 3, 4, 5]


def test_laps_by_a_jump_are_told_apart(tmp_path: Path) -> None:
    items = [take_off(), *square(), item(5, mav.MAV_CMD_DO_JUMP, 1, 2)]
    found = compared(flown(tmp_path, items))
    rows = found.legs
    assert [row.item for row in rows] == [0, *(1, 2, 3, 4) * 3]
    assert all(row.cross_track_max_m < 6.0 for row in rows)
    starts = [row.start_s for row in rows]
    assert starts == sorted(starts)
    assert found.total.slots_missed == 0


def test_an_aborted_and_a_repeated_mission_are_two_passes(tmp_path: Path) -> None:
    found = compared(flown(tmp_path, plain(), abort))
    first, second = found.run.judged.passes
    assert first.record.round == 1
    assert [p.seq for p in first.passages if math.isnan(p.t_s)]
    assert not [p.seq for p in second.passages if math.isnan(p.t_s)]
    words = in_words(found.run.judged)
    assert any("HOLD 8." in line for line in words)
    assert any(line.startswith("items never reached: ") for line in words)
    assert len(found.rounds) == 2


@pytest.mark.parametrize("first", [None, 1])
def test_a_mission_that_goes_on_after_a_pause_is_one_pass(
    tmp_path: Path, first: int | None
) -> None:
    """Or back to an earlier item: then it is not. Our log says only what was reached."""

    def pause(desk: Desk) -> None:
        desk.fly(seconds=45)
        mode(desk, 3)
        desk.fly(seconds=8)
        if first is not None:
            desk.send(mav.MAVLink_mission_set_current_message(1, 1, first))
        mode(desk, 4)

    found = compared(flown(tmp_path, plain(), pause))
    if first is None:
        (only,) = found.run.judged.passes
        assert not [p.seq for p in only.passages if math.isnan(p.t_s)]
        assert found.total.slots_missed == 0
        assert found.total.cross_track_max_m < 6.0
        assert any("HOLD 8." in line for line in in_words(found.run.judged))
    else:
        assert len(found.run.judged.passes) > 1


@pytest.mark.parametrize("ordered", [5, 6])
def test_a_return_or_landing_that_is_broken_off_ends_a_pass(tmp_path: Path, ordered: int) -> None:
    """What is flown after it is judged, too: a return's own errors are none."""

    def breaks_off(desk: Desk) -> None:
        desk.fly(seconds=45)
        mode(desk, ordered)
        desk.fly(seconds=2)
        mode(desk, 4)

    found = compared(flown(tmp_path, plain(), breaks_off))
    assert len(found.run.judged.passes) > 1


def test_a_return_that_is_ordered_late_belongs_to_its_mission(tmp_path: Path) -> None:
    def wait(desk: Desk) -> None:
        desk.fly()
        desk.fly(seconds=15)
        mode(desk, 5)

    log = flown(tmp_path, plain()[:-1], wait)
    data = read_log(log)
    (mission,) = data.missions
    back = (5.0, float(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH), 2.0, *[0.0] * 7, 1.0)
    data = replace(data, missions=(replace(mission, items=(*mission.items, back)),))
    assert compared(log, data).total.slots_missed == 0


@pytest.mark.parametrize(("next_m", "past"), [(52.0, True), (700.0, False)])
def test_a_climb_that_is_broken_off_is_no_return(next_m: float, past: bool) -> None:
    """Its last place is on the way back home, too: what is matched with that led past nothing."""
    fit: Any = SimpleNamespace(along_m=np.array([0.0, 22.0, next_m]))
    track: Any = SimpleNamespace(pos_m=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 22.0], [0, 0, 24.0]]))
    assert _led_past(fit, track, 1, 50.0) is past


def test_a_plan_of_another_place_and_a_flight_without_a_mission_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def take_home(desk: Desk) -> None:
        desk.fly(seconds=20)

    log = flown(tmp_path, plain()[:2], take_home)
    plan = tmp_path / "far.waypoints"
    # It takes off on the spot and returns to home, as this flight did.
    rows = "0 0 3 22 0 0 0 0 0 0 30 1", "1 0 3 16 0 0 0 0 48.0 8.5 30 1", "2 0 3 20 0 0 0 0 0 0 0 1"
    plan.write_text("\n".join(["QGC WPL 110", *("\t".join(row.split()) for row in rows)]) + "\n")
    assert call(["compare", str(log), "--plan", str(plan)]) == 2
    words = "far.waypoints is of another place: its nearest item is", "km from the flight"
    refused(capsys, *words)
    data = replace(read_log(log), missions=())
    with pytest.raises(InputError, match="the log has no mission to compare with; give the plan"):
        judged(log, data, None)
    nowhere = replace(data, truth=Track(data.truth.t_ns[:0], data.truth.pos_m[:0]))
    with pytest.raises(InputError, match="the log has no positions"):
        judged(log, nowhere, None)


def test_a_fault_counts_once_and_a_leg_that_was_not_flown_has_no_numbers(tmp_path: Path) -> None:
    def stop(desk: Desk) -> None:
        desk.fly(seconds=25)
        mode(desk, 3)
        desk.fly(seconds=5)
        desk.send(mav.MAVLink_mission_clear_all_message(1, 1))
        mode(desk, 6)

    log = flown(tmp_path, plain(), stop)
    data = read_log(log)
    at = next(event for event in data.events if event.kind == "reached")
    begun = replace(at, kind="fault", text="Fault begins: gnss_off")
    ended = replace(at, kind="fault", text="Fault ends: gnss_off", t_ns=at.t_ns + 2 * NS_PER_S)
    found = compared(log, replace(data, events=(*data.events, begun, ended)))
    assert found.total.faults == 1
    every = found.legs
    not_flown = [leg for leg in every if math.isnan(leg.start_s)]
    assert not_flown
    assert all(math.isnan(leg.height_max_m) for leg in not_flown)


def test_json_has_legs_spikes_and_what_was_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = flown(tmp_path, plain())
    assert call(["compare", str(log), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert {"legs", "spikes", "not_compared_s", "log", "plan"} <= set(found)
    assert found["log"]["kind"] == "MCAP"
    assert len(found["legs"]) == 6


def test_a_flight_of_two_passes_has_its_pictures_and_its_page(tmp_path: Path) -> None:
    log, page = flown(tmp_path, plain(), abort), tmp_path / "page.html"
    assert call(["report", str(log), "--out", str(page)]) == 0
    text = page.read_text()
    assert "Time line" in text
    assert "items never reached" in text
    picture = tmp_path / "picture.svg"
    assert call(["compare", str(log), "--figure", str(picture)]) == 0
    assert "pass 2" in picture.read_text()
