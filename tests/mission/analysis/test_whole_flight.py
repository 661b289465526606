"""Failsafes, disarming, jumps and missions that go on, as each kind of log tells of them."""

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_logs import HOME, write_ulog
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.limits import verdicts
from mission.analysis.load import load_run
from mission.analysis.passes import judged
from mission.figures.frame import run_lines

UP_M, SPEED_MPS, STEP_S = 30.0, 8.0, 0.1
PLACES = ((0.0, 0.0), (0.0, 100.0), (120.0, 100.0), (120.0, -60.0))  # north, east
MODES = {  # nav_state of PX4, its main and sub mode, ArduCopter's number
    "MISSION": (3, 4, 4, 3), "RETURN": (5, 4, 5, 6), "LAND": (18, 4, 6, 9), "HOLD": (4, 4, 3, 5),
}  # fmt: skip
JUMP, RETURN = mav.MAV_CMD_DO_JUMP, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH
Items = Sequence[tuple[int, tuple[float, float] | None, tuple[float, float]]]
SQUARE: Items = [
    (mav.MAV_CMD_NAV_WAYPOINT if seq else mav.MAV_CMD_NAV_TAKEOFF, place, (0.0, 0.0))
    for seq, place in enumerate(PLACES)
]


@dataclass(frozen=True)
class Row:
    t_s: float
    place: tuple[float, float, float]  # north, east, up
    mode: str = "MISSION"
    current: int = 0
    armed: bool = True
    failing: bool = False

    @property
    def globe(self) -> tuple[float, float, float]:
        at = LocalFrame(HOME).to_geodetic(np.array([*self.place[:2], 0.0]))
        return at.lat_deg, at.lon_deg, HOME.alt_msl_m + self.place[2]


def rows(*parts: tuple[tuple[float, float, float], dict[str, Any]]) -> list[Row]:
    """Stand for five seconds, then go straight from place to place, each with what is then."""
    found = [Row(step * STEP_S, (0.0, 0.0, 0.0), "HOLD", armed=False) for step in range(50)]
    here, t_s = np.zeros(3), 5.0
    for place, what in parts:
        there = np.array(place)
        length_m = float(np.linalg.norm(there - here))
        steps = max(1, round(length_m / SPEED_MPS / STEP_S))
        if length_m == 0.0:
            steps = round(what["stays_s"] / STEP_S)
        known = {name: value for name, value in what.items() if name != "stays_s"}
        for step in range(steps):
            at = here + (there - here) * step / steps
            found.append(Row(t_s, (float(at[0]), float(at[1]), float(at[2])), **known))
            t_s += STEP_S
        here = there
    return found


def changes(flight: Sequence[Row], *names: str) -> Iterator[Row]:
    """The first row, and those in which something is another than in the one before."""
    yield flight[0]
    for before, row in pairwise(flight):
        if any(getattr(before, name) != getattr(row, name) for name in names):
            yield row


def tlog(
    path: Path, flight: Sequence[Row], items: Items, *, more: Sequence[tuple[float, Any]] = ()
) -> Path:
    """As a ground station of PX4 has it; `more` messages at their times, in order."""
    out, more = bytearray(), list(more)
    vehicle, station = mav.MAVLink(None, 1, 1), mav.MAVLink(None, 255, 190)

    def told(t_s: float, message: Any, by: mav.MAVLink = vehicle) -> None:
        out.extend(struct.pack(">Q", round((1e9 + t_s) * 1e6)) + bytes(message.pack(by)))

    def beat(row: Row) -> None:
        _, main, sub, _ = MODES[row.mode]
        custom, base = (main << 16) | (sub << 24), 29 | (128 * row.armed)
        state = mav.MAV_STATE_CRITICAL if row.failing else mav.MAV_STATE_ACTIVE
        told(row.t_s, mav.MAVLink_heartbeat_message(2, 12, base, custom, state, 3))

    beat(flight[0])
    told(0.0, mav.MAVLink_mission_count_message(1, 1, len(items), 0), station)
    for seq, (command, place, params) in enumerate(items):
        lat, lon, _ = Row(0.0, (*(place or (0.0, 0.0)), 0.0)).globe
        frame, x, y, z = (3, round(lat * 1e7), round(lon * 1e7), UP_M) if place else (2, 0, 0, 0.0)
        told(0.1, mav.MAVLink_mission_item_int_message(
            1, 1, seq, frame, command, 0, 1, *params, 0, 0, x, y, z, 0), station)  # fmt: skip
    told(0.1, mav.MAVLink_mission_ack_message(255, 190, 0, 0))
    states = {id(row) for row in changes(flight, "mode", "armed", "failing")}
    heading = {id(row) for row in changes(flight, "current")}
    for row in flight:
        while more and more[0][0] <= row.t_s:
            told(*more.pop(0))
        if id(row) in states:
            beat(row)
        if id(row) in heading:
            told(row.t_s, mav.MAVLink_mission_current_message(row.current))
        lat, lon, alt = row.globe
        where = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, 0, 0, 0, 0
        told(row.t_s, mav.MAVLink_global_position_int_message(round(row.t_s * 1e3), *where))
    path.write_bytes(out)
    return path


def ulg(path: Path, flight: Sequence[Row], items: Items) -> Path:
    """As PX4 has it: an item that leads nowhere shows as a number only, a jump as it is done."""
    left = {seq: int(i[2][1]) for seq, i in enumerate(items) if i[0] == JUMP}
    result: list[Any] = []
    targets = []
    for row in changes(flight, "current", "mode"):
        before = result[-1][2] if result else 0
        jump = next((seq for seq in left if row.current < before < seq), 0)
        if jump:
            left[jump] -= 1
        result.append((row.t_s, 7, row.current, False, bool(jump), jump, left.get(jump, 0)))
        place = items[row.current][1]
        if row.mode == "MISSION" and place is not None:
            lat, lon, alt = replace(row, place=(*place, UP_M)).globe
            targets.append((row.t_s, True, 0, lat, lon, alt))
    names = "item_do_jump_changed;uint16_t item_changed_index;uint16_t item_do_jump_remaining"
    setpoint = "bool current.valid;uint8_t current.type;double current.lat;double current.lon;float current.alt"  # noqa: E501
    status = [
        (row.t_s, MODES[row.mode][0], 2 if row.armed else 1, row.failing, 1)
        for row in changes(flight, "mode", "armed", "failing")
    ]
    state = "uint8_t nav_state;uint8_t arming_state;bool failsafe;uint8_t vehicle_type"
    return write_ulog(path, instead={
        "vehicle_global_position": (
            "double lat;double lon;float alt", "ddf", [(row.t_s, *row.globe) for row in flight]
        ),
        "vehicle_status": (state, "BB?B", status),
        "position_setpoint_triplet": (setpoint, "?Bddf", targets),
        "mission_result": (
            f"uint32_t mission_id;uint16_t seq_current;bool finished;bool {names}", "IH??HH", result
        ),
    })  # fmt: skip


ITEM = (
    "QHHHffffLLfB",
    "<QHHHffffiifB",
    "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame",
)
FORMATS = {
    "FMT": (128, "BBnNZ", "<BB4s16s64s", "Type,Length,Name,Format,Columns"),
    "POS": (1, "QLLf", "<Qiif", "TimeUS,Lat,Lng,Alt"),
    "MODE": (3, "QBBB", "<QBBB", "TimeUS,Mode,ModeNum,Rsn"),
    "CMD": (5, *ITEM),
    "MISE": (6, *ITEM),
    "EV": (9, "QB", "<QB", "TimeUS,Id"),
    "ERR": (10, "QBB", "<QBB", "TimeUS,Subsys,ECode"),
}  # fmt: skip


def dataflash(path: Path, flight: Sequence[Row], items: Items, *, failsafe: int = 8) -> Path:
    """As ArduCopter has it: item 0 is home, and a log begins when it is armed, which is no event of
    it; `failsafe`: LogErrorSubsystem, 8 is that of the ground station."""
    out = bytearray()

    def said(name: str, *values: Any) -> None:
        number, _, packed, _ = FORMATS[name]
        out.extend(b"\xa3\x95" + bytes([number]) + struct.pack(packed, *values))

    for name, (number, form, packed, columns) in FORMATS.items():
        size = 3 + struct.calcsize(packed)
        said("FMT", number, size, name.encode(), form.encode(), columns.encode())
    flight = [row for row in flight if row.t_s >= 4.0]
    total = len(items) + 1
    listed: list[tuple[Any, ...]] = [(total, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0)]
    for seq, (command, place, params) in enumerate(items, start=1):
        lat, lon, _ = Row(0.0, (*(place or (0.0, 0.0)), 0.0)).globe
        at = (round(lat * 1e7), round(lon * 1e7), UP_M, 3) if place else (0, 0, 0.0, 2)
        first, second = params
        first += command == JUMP
        listed.append((total, seq, command, first, second, 0, 0, *at))
    for values in listed:
        said("CMD", 1000, *values)
    before = replace(flight[0], mode="", current=-1, armed=True, failing=False)
    for row in flight:
        t_us, lat, lon, alt = round(row.t_s * 1e6), *row.globe
        if row.armed != before.armed and row.t_s > 5.0:
            said("EV", t_us, 10 if row.armed else 11)
        if row.mode != before.mode:
            said("MODE", t_us, MODES[row.mode][3], MODES[row.mode][3], 2)
        if row.failing != before.failing:
            said("ERR", t_us, failsafe, int(row.failing))
        if row.current != before.current:
            said("MISE", t_us, *listed[row.current + 1])
        said("POS", t_us, round(lat * 1e7), round(lon * 1e7), alt)
        before = row
    path.write_bytes(out)
    return path


WRITERS: dict[str, Callable[[Path, Sequence[Row], Items], Path]] = {
    ".tlog": tlog, ".ulg": ulg, ".bin": dataflash,
}  # fmt: skip
EVERY = pytest.mark.parametrize("end", sorted(WRITERS))


def compared(log: Path) -> RunComparison:
    loaded = load_run(log)
    assert loaded.judged is not None, loaded.unjudged
    return compare_run(loaded)


def square(**last: Any) -> list[Row]:
    """All places, and what comes `last`."""
    return rows(
        ((0.0, 0.0, UP_M), {"current": 0}),
        *(((*place, UP_M), {"current": seq}) for seq, place in enumerate(PLACES) if seq),
        ((*PLACES[-1], UP_M), {"current": 3, "mode": "HOLD", "stays_s": 5.0}),
        ((*PLACES[-1], 0.0), {"current": 3, "mode": "LAND"}),
        ((*PLACES[-1], 0.0), {"current": 3, "armed": False, "stays_s": 20.0, **last}),
    )


@EVERY
@pytest.mark.parametrize("failing", [False, True])
def test_a_failsafe_that_ended_the_mission_counts(tmp_path: Path, end: str, failing: bool) -> None:
    """It comes as the mission mode ends, or after it: no pass through the mission has it."""
    flight = [replace(row, failing=failing and row.mode == "LAND") for row in square(mode="HOLD")]
    found = compared(WRITERS[end](tmp_path / f"x{end}", flight, SQUARE))
    assert found.total.failsafes == int(failing)
    (verdict,) = verdicts(found, {"failsafes": 0.0})
    at_s = next(row.t_s for row in flight if row.mode == "LAND")
    assert verdict.met is not failing
    assert verdict.where.startswith(f"first at {at_s:.1f} s: failsafe" if failing else "")
    assert found.total.mode_changes >= 2  # HOLD and LAND


@pytest.mark.parametrize(("subsystem", "counts"), [(24, 0), (16, 0), (31, 1), (17, 1), (9, 1)])
def test_failsafes_of_dataflash_have_ardupilots_numbers(
    tmp_path: Path, subsystem: int, counts: int
) -> None:
    """`LogErrorSubsystem`: 24 is another core of the filter, 16 its check, 31 dead reckoning."""
    flight = [replace(row, failing=row.mode == "LAND") for row in square(mode="HOLD")]
    log = dataflash(tmp_path / "x.bin", flight, SQUARE, failsafe=subsystem)
    assert compared(log).total.failsafes == counts


def test_what_is_said_of_failsafes_is_none_and_a_breached_fence_is_one(tmp_path: Path) -> None:
    more = [
        (3.0, mav.MAVLink_fence_status_message(1, 1, 1, 0)),  # before it is armed
        (30.0, mav.MAVLink_statustext_message(4, b"GCS Failsafe Cleared")),
        (31.0, mav.MAVLink_fence_status_message(0, 1, 1, 0)),
        (32.0, mav.MAVLink_fence_status_message(1, 2, 1, 0)),
        (33.0, mav.MAVLink_fence_status_message(1, 2, 1, 0)),
    ]
    found = compared(tlog(tmp_path / "x.tlog", square(mode="HOLD"), SQUARE, more=more))
    (verdict,) = verdicts(found, {"failsafes": 0.0})
    assert (verdict.value, verdict.where) == (1, "first at 32.0 s: fence breached")


@pytest.mark.parametrize(("off_m", "moves"), [(2.9, False), (3.1, True)])
def test_who_wanders_by_three_metres_after_its_mission_has_flown_on(
    tmp_path: Path, off_m: float, moves: bool
) -> None:
    north, east = PLACES[-1]
    flight = rows(
        ((0.0, 0.0, UP_M), {"current": 0}),
        *(((*place, UP_M), {"current": seq}) for seq, place in enumerate(PLACES) if seq),
        ((north + off_m, east, UP_M), {"current": 3, "mode": "HOLD"}),
        ((north + off_m, east, UP_M), {"current": 3, "mode": "HOLD", "stays_s": 20.0}),
    )
    run = compared(tlog(tmp_path / "x.tlog", flight, SQUARE)).run
    assert run.judged is not None
    assert run.judged.apart == ({"LOITER": pytest.approx(20.3, abs=0.2)} if moves else {})
    drawn = [kind for kind, _, _ in run_lines(run.data, [])]
    assert ("after the last place" in drawn) is moves


@EVERY
def test_a_mission_mode_on_the_ground_flies_nothing(tmp_path: Path, end: str) -> None:
    """PX4 and ArduPilot go back to it when they are disarmed."""
    found = compared(WRITERS[end](tmp_path / f"x{end}", square(mode="MISSION"), SQUARE))
    assert len(found.rounds) == 1
    assert found.total.slots_missed == 0
    assert found.run.judged is not None
    assert not {"MISSION", "AUTO", "DISARMED"} & set(found.run.judged.apart)


@EVERY
def test_a_jump_is_flown_as_often_as_the_log_says(tmp_path: Path, end: str) -> None:
    items: Items = [*SQUARE[:3], (JUMP, None, (1.0, 2.0)), SQUARE[3]]
    order = (0, 1, 2, 1, 2, 1, 2, 4)
    flight = rows(
        *(((*(items[seq][1] or (0.0, 0.0)), UP_M), {"current": seq}) for seq in order),
        ((*PLACES[-1], UP_M), {"current": 4, "mode": "HOLD", "stays_s": 5.0}),
    )
    found = compared(WRITERS[end](tmp_path / f"x{end}", flight, items))
    first = int(end == ".bin")
    assert found.run.judged is not None
    (only,) = found.run.judged.passes
    assert [p.seq - first for p in only.passages] == list(order)
    assert found.total.slots_missed == 0
    assert found.total.cross_track_max_m < 0.5


@EVERY
@pytest.mark.parametrize("returns", [False, True])
def test_a_mission_that_goes_on_after_a_failsafe_has_all_its_places(
    tmp_path: Path, end: str, returns: bool
) -> None:
    """Its own return, where it has one, is not that of the failsafe."""
    if returns and end == ".ulg":
        pytest.skip("a ULog of PX4 does not hold a return")
    items: Items = [*SQUARE, (RETURN, None, (0.0, 0.0))] if returns else SQUARE
    back: dict[str, Any] = {"current": 2, "mode": "RETURN", "failing": True}
    flight = rows(
        ((0.0, 0.0, UP_M), {"current": 0}),
        ((*PLACES[1], UP_M), {"current": 1}),
        ((60.0, 100.0, UP_M), {"current": 2}),
        ((20.0, 30.0, UP_M), back),
        ((*PLACES[2], UP_M), {"current": 2}),
        ((*PLACES[3], UP_M), {"current": 3}),
        ((0.0, 0.0, UP_M), {"current": 4 if returns else 3, "mode": "RETURN"}),
        ((0.0, 0.0, 0.0), {"current": 4 if returns else 3, "mode": "RETURN"}),
    )
    found = compared(WRITERS[end](tmp_path / f"x{end}", flight, items))
    assert found.run.judged is not None
    first, second = found.run.judged.passes
    assert found.total.slots_missed == 0
    assert found.total.slots == len(items)
    assert found.total.failsafes == 1
    assert found.total.cross_track_max_m < 0.5
    left_s = next(row.t_s for row in flight if row.mode == "RETURN")
    assert first.track.t_ns[-1] / 1e9 <= left_s
    assert second.track.t_ns[0] / 1e9 > left_s


def test_a_mission_that_begins_anew_has_its_places_twice(tmp_path: Path) -> None:
    flight = rows(
        ((0.0, 0.0, UP_M), {"current": 0}),
        ((*PLACES[1], UP_M), {"current": 1}),
        ((60.0, 100.0, UP_M), {"current": 2}),
        ((20.0, 30.0, UP_M), {"current": 2, "mode": "RETURN"}),
        *(((*place, UP_M), {"current": seq}) for seq, place in enumerate(PLACES) if seq),
    )
    found = compared(tlog(tmp_path / "x.tlog", flight, SQUARE))
    assert found.total.slots_missed == 2


@EVERY
def test_the_last_place_is_passed_when_it_is_whatever_the_mode(tmp_path: Path, end: str) -> None:
    """ArduPilot and PX4 end a mission in their own time: 0.2 s before it is there, or later."""
    times = []
    for early in (False, True):
        flight = square(mode="HOLD")
        there_s = next(row.t_s for row in flight if row.mode == "HOLD" and row.t_s > 5.0)
        held = [
            replace(row, mode="HOLD" if early else "MISSION")
            if there_s - 0.2 <= row.t_s < there_s + 5.0
            else row
            for row in flight
        ]
        log = WRITERS[end](tmp_path / f"{early}{end}", held, SQUARE)
        judged = compared(log).run.judged
        assert judged is not None
        times.append(judged.passes[0].passages[-1].t_s)
    assert times[1] == pytest.approx(times[0], abs=0.02)


def elsewhere(flight: Sequence[Row], *, after_s: float) -> list[Row]:
    """The same flight, 500 m to the north, and so long after the end of itself."""
    later_s = flight[-1].t_s + after_s
    return [
        replace(row, t_s=row.t_s + later_s, place=(row.place[0] + 500.0, *row.place[1:]))
        for row in flight
    ]


@EVERY
def test_what_moves_the_vehicle_between_two_flights_is_not_flown(tmp_path: Path, end: str) -> None:
    """It is carried while it is disarmed, and the log pauses."""
    hop = rows(
        ((0.0, 0.0, UP_M), {"mode": "HOLD"}),
        ((0.0, 80.0, UP_M), {"mode": "HOLD"}),
        ((0.0, 0.0, UP_M), {"mode": "HOLD"}),
        ((0.0, 0.0, 0.0), {"mode": "LAND"}),
        ((0.0, 0.0, 0.0), {"mode": "LAND", "armed": False, "stays_s": 5.0}),
    )
    both = [*hop, *elsewhere(hop, after_s=60.0)]
    one, two = (
        compare_run(load_run(WRITERS[end](tmp_path / f"{n}{end}", flight, SQUARE))).total
        for n, flight in enumerate((hop, both))
    )
    assert one.flown_path_m == pytest.approx(160.0, abs=1.0)
    assert two.flown_path_m == pytest.approx(2 * one.flown_path_m, abs=1.0)
    assert two.duration_s == pytest.approx(2 * one.duration_s, abs=3.0)  # begins when it is armed
    assert two.speed_max_mps == pytest.approx(one.speed_max_mps, abs=0.1)


def test_a_pause_of_the_log_after_landing_is_no_time_of_the_landing(tmp_path: Path) -> None:
    flight = square()
    log = tlog(tmp_path / "x.tlog", [*flight, *elsewhere(flight, after_s=600.0)], SQUARE)
    data = load_run(log).data
    (_, disarmed_ns), (armed_ns, _) = data.armed_ns
    t_ns = data.truth.t_ns
    logged = data.truth.at(t_ns[(t_ns < disarmed_ns) | (t_ns >= armed_ns)])
    apart = judged(log, replace(data, truth=logged, belief=logged), None).apart
    assert sum(apart.values()) < 60.0
