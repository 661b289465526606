"""Missions as logs tell them: take-offs that name a place, missions known by what was started."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import made_up_logs
import numpy as np
import pytest
from made_up_logs import CORNERS, HEIGHT_M, HOME, write_dataflash, write_tlog, write_ulog
from pymavlink.dialects.v20 import common as mav
from test_flights import flown, item, square

from flightdyn.frames import LocalFrame
from flightdyn.state import Kinematics
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.load import LoadedRun, load_run
from mission.analysis.passes import judged
from mission.base.area import Area
from mission.base.errors import InputError
from mission.flight.serve.flight_logs import FlightLogs
from mission.log.reader import read_log
from mission.log.values import EventRecord
from sitl.observer import EventKind, VehicleEvent

AWAY = (55.0, -40.0)  # m north and east of home, which no leg of the square comes near


def compared(loaded: LoadedRun) -> RunComparison:
    assert loaded.judged is not None, loaded.unjudged
    return compare_run(loaded)


def take_off_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the take-offs of made-up logs name a place away from where they are."""
    rows = made_up_logs.places()
    at = LocalFrame(HOME).to_geodetic(np.array([*AWAY, 0.0]))
    there = [(rows[0][0], at.lat_deg, at.lon_deg), *rows[1:]]
    monkeypatch.setattr(made_up_logs, "places", lambda: there)


@pytest.mark.parametrize("planned", [False, True])
@pytest.mark.parametrize("end", [".bin", ".tlog"])
def test_arducopter_climbs_straight_up_whatever_place_its_take_off_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, planned: bool
) -> None:
    take_off_there(monkeypatch)
    log, plan = tmp_path / f"x{end}", None
    if end == ".bin":
        write_dataflash(log)
    else:
        write_tlog(log, ardupilot=True)
    if planned:
        plan = tmp_path / "x.waypoints"
        rows = [
            f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{lat_deg}\t{lon_deg}\t{HEIGHT_M}\t1"
            for seq, (command, lat_deg, lon_deg) in enumerate(made_up_logs.places())
        ]
        plan.write_text("\n".join(["QGC WPL 110", *rows]) + "\n")
    total = compared(load_run(log, plan)).total
    assert total.cross_track_max_m < 0.05
    assert (total.slots, total.slots_missed) == (len(CORNERS), 0)


@pytest.mark.parametrize("write", [write_ulog, write_tlog])
def test_others_fly_to_the_place_of_their_take_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Any
) -> None:
    take_off_there(monkeypatch)
    log = write(tmp_path / ("x.ulg" if write is write_ulog else "x.tlog"))
    assert compared(load_run(log)).total.cross_track_max_m > 20.0


def test_in_our_log_of_an_arducopter_it_climbs_straight_up(tmp_path: Path) -> None:
    """Flown by our own vehicle without its take-off's place: as ArduCopter does, as is noted."""
    up = item(0, mav.MAV_CMD_NAV_TAKEOFF, at=(0.0, 0.0, 30.0))
    log = flown(tmp_path, [up, *square()])
    data = read_log(log)
    (mission,) = data.missions
    at = LocalFrame(data.area.home).to_geodetic(np.array([*AWAY, 0.0]))
    first = (*mission.items[0][:7], at.lat_deg, at.lon_deg, *mission.items[0][9:])
    data = replace(data, missions=(replace(mission, items=(first, *mission.items[1:])),))
    note = EventRecord(0, "status", "autopilot: ArduPilot 4.6.3", None, 6, (0,) * 3, (0,) * 3)
    for events, missed in (((note, *data.events), 0), (data.events, 1)):
        found = judged(log, replace(data, events=events), None)
        total = compared(LoadedRun(log, found.data, {}, judged=found)).total
        assert total.slots_missed == missed
        assert (total.cross_track_max_m < 6.0) == (missed == 0)


def test_the_log_of_a_flight_names_the_autopilot_that_was_found_before_it(tmp_path: Path) -> None:
    still = Kinematics(0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
    logs = FlightLogs(tmp_path, area=Area.at((9.0, 9.0), (0.0, 0.0), HOME))
    happened: tuple[tuple[int, EventKind, str], ...] = (
        (1, "status", "autopilot: ArduPilot 4.6.3"),
        (5, "armed", "armed"),
        (9, "armed", "disarmed"),
    )
    for t_ns, kind, text in happened:
        logs.happened(VehicleEvent(t_ns, kind, text, still, still))
    data = read_log(tmp_path / "flight-0001.mcap")
    assert data.climbs_straight
    assert [event.t_ns for event in data.events] == [5, 5, 9]


def elsewhere(count: int) -> list[tuple[int, int, int]]:
    """Home, a take-off and places 80 m apart, as rows of a list."""
    frame, rows = LocalFrame(HOME), []
    for number in range(count):
        at = frame.to_geodetic(np.array([-80.0 * number, 80.0 * number, 0.0]))
        command = mav.MAV_CMD_NAV_TAKEOFF if number == 1 else mav.MAV_CMD_NAV_WAYPOINT
        rows.append((command, round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)))
    return rows


@pytest.mark.parametrize("started", ["CMD", "MISE"])
@pytest.mark.parametrize("new", [b"New mission", b"of the text nothing is left"])
@pytest.mark.parametrize("count", [4, 5])  # of the other mission's rows; this one has 5
def test_a_mission_that_is_known_by_its_started_items_is_the_one_that_was_flown(
    tmp_path: Path, started: str, new: bytes, count: int
) -> None:
    log = write_dataflash(
        tmp_path / "x.bin", before=elsewhere(count), listed=False, started=started, new=new
    )
    found = compared(load_run(log))
    assert [len(record.items) for record in found.run.data.missions[:1]] == [count]
    assert found.total.cross_track_max_m < 0.05
    assert [leg.item for leg in found.legs] == [1, 2, 3, 4]
    assert (found.total.slots, found.total.slots_missed) == (len(CORNERS), 0)
    assert not found.run.data.source.skipped


@pytest.mark.parametrize("started", ["CMD", "MISE"])
def test_a_listed_mission_stays_one_while_its_items_are_started(
    tmp_path: Path, started: str
) -> None:
    log = write_dataflash(tmp_path / "x.bin", before=elsewhere(5), started=started, returns=True)
    found = compared(load_run(log))
    sizes = [len(r.items) for r in found.run.data.missions if r.kind == "mission"]
    assert sizes == [5, 6]
    assert [leg.item for leg in found.legs] == [1, 2, 3, 4, 5]


def test_a_mission_that_is_left_within_two_seconds_was_not_flown(tmp_path: Path) -> None:
    up = item(0, mav.MAV_CMD_NAV_TAKEOFF, at=(0.0, 0.0, 30.0))
    log = flown(tmp_path, [up, *square()])
    data = read_log(log)
    begin_ns = int(data.modes.t_ns[data.modes.names.index("MISSION")])

    def left_after(seconds: float) -> None:
        until_ns = begin_ns + int(seconds * 1e9)
        modes = replace(
            data.modes, t_ns=np.array([begin_ns, until_ns]), names=("MISSION", "STICKS")
        )
        judged(log, replace(data, modes=modes), None)

    left_after(2.1)
    with pytest.raises(InputError, match=r"its mission was never flown"):
        left_after(1.9)
