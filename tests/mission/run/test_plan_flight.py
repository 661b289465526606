"""`aerofed fly`: plans of ground stations flown headless, planned against flown."""

import asyncio
import csv
import io
import json
import math
import re
import shutil
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_runs
from described import charts, rows
from drawing import drawn
from mcap.reader import make_reader
from patience import HANG_S
from small_runs import UP_AND_DOWN, refused, without_its_end
from test_planfile import HOME_ROW, ROW, plan_document, simple

from mission.analysis.load import load_run
from mission.cli import call
from mission.commands.options import load
from mission.flight.missions.plan_file import read_plan_file
from mission.log import DamagedLogError
from mission.log.reader import read_log
from mission.run import plan_flight

QUIET = (*small_runs.QUIET, *UP_AND_DOWN)
TAKE_OFF = simple(22, 15, 0, 0, None, 47.4, 8.5, 50)
SPEED = simple(178, 1, 15, -1, 0, 0, 0, 0, frame=2)
RETURN = simple(20, 0, 0, 0, 0, 0, 0, 0, frame=2)


def place(lat: float, lon: float, alt: float = 50, *, wait_s: float = 0) -> dict[str, Any]:
    return simple(16, wait_s, 3, 0, None, lat, lon, alt)


# 200 m north, 200 m east, back south: metres by the meridian and parallel arcs at 47.4 deg.
NORTH, EAST = 47.4 + 200 / 111_180.0, 8.5 + 200 / 75_480.0
CORNERS = [place(NORTH, 8.5), SPEED, place(NORTH, EAST, wait_s=4), place(47.4, EAST, 60)]


def written(folder: Path, *items: Any, name: str = "square.plan") -> Path:
    path = folder / name
    path.write_text(json.dumps(plan_document(*items)))
    return path


def summary(folder: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return loaded


@dataclass(frozen=True)
class Square:
    """The corners, flown once for all who only look."""

    plan: Path
    out: Path
    printed: str


@pytest.fixture(scope="module")
def square(tmp_path_factory: pytest.TempPathFactory) -> Square:
    folder = tmp_path_factory.mktemp("square")
    plan, printed = written(folder, TAKE_OFF, *CORNERS, RETURN), io.StringIO()
    with drawn(), redirect_stdout(printed):
        assert call(["fly", str(plan), "--out", str(folder / "out")]) == 0
    return Square(plan, folder / "out", printed.getvalue())


@pytest.mark.slow
def test_a_plan_is_flown_and_compared(square: Square) -> None:
    plan, out, printed = square.plan, square.out, square.printed
    assert "cross-track" in printed
    assert not (out / "checkpoint").exists()  # which is of runs that go on
    assert re.search(r"t \d+\.\d s: item 4 \(4 of 4\), 60 m high, battery \d+ %", printed)
    found = summary(out)["planned_and_flown"]
    assert found["plan_path_m"] == pytest.approx(800, abs=1.0)
    assert found["flown_path_m"] == pytest.approx(800, rel=0.03)
    # Up at 3 m/s, 200 m at the default 10 m/s, 400 m at 15 m/s, 4 s of waiting, home; and braking.
    assert found["plan_duration_s"] > 50 / 3 + 20 + 400 / 15 + 4 + 20
    assert found["duration_s"] == pytest.approx(found["plan_duration_s"], rel=0.02)
    assert summary(out)["energy_used_j"] == found["energy_j"] > 0
    assert 0 < found["cross_track_rms_m"] < 1.5
    assert found["cross_track_max_m"] < 5
    assert (found["slots"], found["slots_missed"]) == (5, 0)
    assert found["height_max_m"] < 1
    # No radio, so nothing is said of one.
    assert not [key for key in found if "per" in key or "objective" in key]
    assert summary(out)["rounds"] == 1
    assert summary(out)["flown_in_rounds_m"] == found["flown_path_m"]
    with (out / "track.csv").open(newline="") as file:
        track = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    # From home up and round and, by the last item, back home and down.
    home = (track[0]["true_x_m"], track[0]["true_y_m"])
    assert math.dist(home, (track[-1]["true_x_m"], track[-1]["true_y_m"])) < 4
    assert max(row["true_alt_m"] for row in track) == pytest.approx(60, abs=1)
    assert abs(track[-1]["true_alt_m"]) < 0.5
    assert max(row["true_x_m"] for row in track) - home[0] == pytest.approx(200, abs=4)
    with (out / "flight.mcap").open("rb") as log:
        reader = make_reader(log)
        counts = reader.get_summary()
        assert counts is not None
        assert counts.statistics.message_count > 1000
        assert "/plan/path" in {channel.topic for channel in counts.channels.values()}
        assert "square.plan" in {a.name for a in reader.iter_attachments()}
    assert (out / "square.plan").read_bytes() == plan.read_bytes()


@pytest.mark.slow
def test_the_waypoint_file_of_the_same_plan_gives_the_same_flight_watched_live(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A plan without take-off and without an end: straight up first, and home afterwards.
    plan = written(tmp_path, place(47.401, 8.5, 60), place(47.402, 8.5, 60))
    second = ROW.format(2).replace("47.401", "47.402")
    rows = tmp_path / "line.waypoints"
    lines = (ROW.format(1) + second).replace("\t0\t5\t0\t0\t", "\t0\t3\t0\tnan\t")  # any heading
    rows.write_text("QGC WPL 110\n" + HOME_ROW + lines)
    tracks = []
    live = ("--live", "--live-port", "0")
    for number, source in enumerate(([str(plan)], [str(rows), *live])):
        out = tmp_path / str(number)
        assert call(["fly", *source, "--out", str(out), *QUIET]) == 0
        tracks.append((out / "track.csv").read_bytes())
    assert tracks[0] == tracks[1]
    assert capsys.readouterr().out == ""
    data = np.genfromtxt(tmp_path / "0" / "track.csv", delimiter=",", names=True)
    assert abs(data["true_alt_m"][-1]) < 0.5


@pytest.mark.slow
def test_landing_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = written(
        tmp_path, TAKE_OFF, place(47.401, 8.5), simple(21, 0, 0, 0, None, 47.4015, 8.5, 0)
    )
    out, verdict = tmp_path / "out", tmp_path / "verdict.xml"
    wanted = ["--json", "--no-report", "--junit", str(verdict)]
    assert call(["fly", str(plan), "--out", str(out), *wanted]) == 0
    assert "<testsuite" in verdict.read_text()  # also where nothing is limited
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"folder": str(out), **summary(out)}
    assert not (out / "report.html").exists()
    assert call(["fly", str(plan), "--out", str(out), "--json"]) == 2
    assert capsys.readouterr().out == ""  # not what the flight before it said
    data = np.genfromtxt(tmp_path / "out" / "track.csv", delimiter=",", names=True)
    assert data["true_y_m"][-1] - data["true_y_m"][0] == pytest.approx(0.0015 * 111_180, abs=4)
    assert abs(data["true_alt_m"][-1]) < 0.5


def test_heights_above_sea_level_are_no_orders_for_an_external_vehicle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    above_sea = simple(16, 0, 3, 0, None, NORTH, 8.5, 538, frame=0)
    plan, out = written(tmp_path, TAKE_OFF, above_sea), tmp_path / "out"
    url = "udpout://127.0.0.1:9"  # nobody is asked
    assert call(["fly", str(plan), "--out", str(out), "--vehicle", url]) == 2
    refused(capsys, "item 1, NAV_WAYPOINT", "--vehicle")
    assert not out.exists()


@pytest.mark.parametrize("command", ["run", "fly"])
def test_waiting_for_a_vehicle_ends_once_however_often_it_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    told: list[str] = []

    @asynccontextmanager
    async def waiting(*_: object, **__: object) -> AsyncIterator[None]:
        try:
            signal.raise_signal(signal.SIGINT)
            await asyncio.sleep(HANG_S)
            yield
        finally:
            while len(told) < 3:
                signal.raise_signal(signal.SIGINT)
                await asyncio.sleep(0)
                told.append("parting")

    monkeypatch.setattr("mission.flight.flyers.external.located", waiting)
    what = ("fly", str(written(tmp_path, TAKE_OFF, *CORNERS))) if command == "fly" else ("run",)
    out = tmp_path / "out"
    assert (
        call(
            [
                *what,
                "--vehicle",
                "udpout://127.0.0.1:9",
                "--out",
                str(out),
                "--quiet",
                "--no-report",
            ]
        )
        == 130
    )
    assert told == ["parting"] * 3
    assert not out.exists()


REFUSED = {
    "unknown": ([simple(9999, 0, 0, 0, 0, 0, 0, 0)], ["item 0", "unknown command (9999)"]),
    "jump": (
        [TAKE_OFF, simple(177, 0, 5, 0, 0, 0, 0, 0, frame=2)],
        ["DO_JUMP (177)", "doJumpId = 0"],
    ),
    "parachute": (
        [TAKE_OFF, simple(208, 1, 0, 0, 0, 0, 0, 0)],
        ["item 1", "DO_PARACHUTE (208): not flown here; docs/vehicles.md, Fly a plan, says"],
    ),
    "endless": ([simple(17, 0, 0, 0, 0, 47.4, 8.5, 50)], ["NAV_LOITER_UNLIM (17)"]),
    "terrain": (
        [simple(16, 0, 3, 0, None, 47.4, 8.5, 50, frame=10)],
        ["item 0", "frame 10", "terrain", "Relative To Launch"],
    ),
    "far": ([TAKE_OFF, place(48.4, 8.5)], ["item 1", "from home"]),
    "sea": ([simple(16, 0, 3, 0, None, 47.4, 8.5, 50, frame=0)], ["item 0", "-438", "above home"]),
    "high": ([place(47.4, 8.5, 900)], ["item 0", "900", "500 m"]),
    "low": ([place(47.4, 8.5, -3)], ["item 0", "-3.0 m above home"]),
    "null island": ([place(0, 0)], ["item 0", "no position"]),
    "speed": ([TAKE_OFF, simple(178, 1, 80, -1, 0, 0, 0, 0, frame=2)], ["item 1", "80 m/s"]),
    "after": ([TAKE_OFF, RETURN, place(47.401, 8.5)], ["item 1", "nothing may come after"]),
    "late": ([place(47.401, 8.5), TAKE_OFF], ["item 1", "first"]),
    "nowhere": ([SPEED, RETURN], ["no item leads anywhere"]),
    "wait": ([place(47.401, 8.5, wait_s=1e6)], ["item 0", "3600 s"]),
    "radius": (
        [simple(16, 0, -3, 0, None, 47.4, 8.5, 50)],
        ["item 0", "parameter 2 = -3"],
    ),
    "stop": ([{**place(47.4, 8.5), "autoContinue": False}], ["item 0", "autocontinue"]),
    "empty": ([], ["mission is empty"]),
    "latitude": ([place(91, 8.5)], ["item 0, NAV_WAYPOINT (16): latitude 91, -90 to 90"]),
    "null": ([simple(16, 0, 0, 0, 0, 47.4, None, 50)], ["item 0", "longitude nan, -180 to 180"]),
    "half a place": ([simple(22, 0, 0, 0, 0, None, 8.5, 50)], ["item 0, NAV_TAKEOFF", "latitude"]),
}


@pytest.mark.slow
def test_a_delay_on_the_ground_comes_before_the_take_off(tmp_path: Path) -> None:
    """As ArduPilot flies it; 30 s is longer than an armed PX4 stands about."""
    delay = simple(93, 30, 0, 0, 0, 0, 0, 0, frame=2)
    plan, out = written(tmp_path, delay, TAKE_OFF, place(NORTH, 8.5), RETURN), tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 0
    log = read_log(out / "flight.mcap")
    assert log.events[0].text == "Ready for takeoff"
    armed_s = next(e.t_ns for e in log.events if e.kind == "armed" and e.text == "armed") / 1e9
    up_s = log.truth.t_ns[log.truth.pos_m[:, 2] > 1.0][0] / 1e9
    assert 30.0 < up_s - armed_s < 36.0
    assert summary(out)["planned_and_flown"]["slots_missed"] == 0


@pytest.mark.parametrize("case", REFUSED)
def test_what_may_not_be_flown_is_named_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    items, words = REFUSED[case]
    plan, out = written(tmp_path, *items), tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out)]) == 2
    refused(capsys, str(plan), *words)
    assert not out.exists()


@pytest.mark.parametrize(
    "lat_lon", [(474_000_000.0, 85_000_000.0), (88.0, 8.5), (None, 8.5), (47.4, None)]
)
def test_a_first_place_that_cannot_be_home_is_named_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lat_lon: tuple[float | None, float | None]
) -> None:
    """Where no home is planned; in ten-millionths of a degree, or half a place, too."""
    plan, out = tmp_path / "homeless.plan", tmp_path / "out"
    first = simple(22, 0, 0, 0, None, *lat_lon, 20)
    plan.write_text(json.dumps(plan_document(first, *CORNERS, plannedHomePosition=None)))
    assert call(["fly", str(plan), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "item 0, the first place, which counts as home" in said
    assert "latitude is -85..85" in said
    assert not out.exists()


@pytest.mark.parametrize("lat_lon", [(None, None), (0.0, 0.0)])
def test_home_is_the_first_item_that_has_a_place(
    tmp_path: Path, lat_lon: tuple[float | None, float | None]
) -> None:
    plan = tmp_path / "homeless.plan"
    first = simple(22, 0, 0, 0, None, *lat_lon, 20)
    plan.write_text(json.dumps(plan_document(first, *CORNERS, plannedHomePosition=None)))
    found = read_plan_file(plan)
    assert found.home is None
    order = plan_flight.order_of(load(None, ()), found)
    assert (order.area.home.lat_deg, order.area.home.lon_deg) == pytest.approx((NORTH, 8.5))


@pytest.mark.slow
def test_a_plan_of_many_waits_takes_as_long_as_foreseen(tmp_path: Path) -> None:
    """Within a second, where a stop that is foreseen 0.25 s too long adds up to four."""
    ends = [place(47.4003 if n % 2 else 47.4, 8.5, wait_s=1) for n in range(1, 17)]
    plan, out = written(tmp_path, TAKE_OFF, *ends, RETURN), tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 0
    found = summary(out)["planned_and_flown"]
    assert found["duration_s"] == pytest.approx(found["plan_duration_s"], abs=1.0)
    judged = load_run(out).judged
    assert judged is not None
    (flown,) = judged.passes
    passed_s = [p.t_s for p in flown.passages if 0 < p.seq < len(ends)]
    planned_s = flown.plan.slot_s[(flown.path.seqs > 0) & (flown.path.seqs < len(ends))]
    assert np.array(passed_s) - passed_s[0] == pytest.approx(planned_s - planned_s[0], abs=1.0)


def test_turns_are_timed_by_their_number(tmp_path: Path) -> None:
    def planned_s(turns: float) -> float:
        circle = simple(18, turns, 0, 20, 0, 47.401, 8.5, 50)
        plan = read_plan_file(written(tmp_path, TAKE_OFF, circle, RETURN))
        return float(plan_flight.order_of(load(None, ()), plan).path.slot_s[-1])

    each_s = 2.0 * math.pi * 20.0 / math.sqrt(2.0 * 20.0)  # no faster than presses with 2 m/s2
    assert planned_s(8) - planned_s(3) == pytest.approx(5.0 * each_s)


def fenced(tmp_path: Path, *circles: tuple[bool, float, float]) -> Path:
    """To the north and home, with circles: whether to stay inside, their latitude and radius."""
    document = plan_document(TAKE_OFF, place(NORTH, 8.5), RETURN)
    document["geoFence"]["circles"] = [
        {"inclusion": inside, "version": 1, "circle": {"center": [lat, 8.5], "radius": radius_m}}
        for inside, lat, radius_m in circles
    ]
    plan = tmp_path / "fenced.plan"
    plan.write_text(json.dumps(document))
    return plan


@pytest.mark.slow
def test_a_fence_of_the_plan_is_in_the_log(tmp_path: Path) -> None:
    out = tmp_path / "out"
    plan = fenced(tmp_path, (True, 47.4, 1000.0))
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 0
    # 1000 m about home, whose place on the map is 50 m from the corner.
    (zone,) = read_log(out / "flight.mcap").fence
    assert zone.keep_in
    away = np.linalg.norm(zone.outline_m - np.array([50.0, 50.0]), axis=1)
    np.testing.assert_allclose(away, 1000.0, atol=0.1)


@pytest.mark.parametrize(
    ("circle", "words"),
    [
        (
            (True, 47.4, 100.0),
            "item 1, NAV_WAYPOINT (16): the way there is partly outside",
        ),
        # Between two places, neither of which lies in it.
        ((False, (47.4 + NORTH) / 2, 10.0), "the way there is partly inside an excluded area"),
    ],
)
def test_a_way_against_the_plans_own_fence_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], circle: Any, words: str
) -> None:
    out = tmp_path / "out"
    assert call(["fly", str(fenced(tmp_path, circle)), "--out", str(out), *QUIET]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


WEST = [[47.398, 8.498], [47.403, 8.498], [47.403, 8.501], [47.398, 8.501]]  # of the second place
AROUND = [[47.398, 8.498], [47.403, 8.498], [47.403, 8.504], [47.398, 8.504]]
BOW = [AROUND[0], AROUND[2], AROUND[1], AROUND[3]]
BAD_FENCES: dict[str, tuple[list[list[list[float]]], str]] = {
    # A .plan has no groups: all are of one, whose areas all count.
    "inside one of two": (
        [AROUND, WEST], "item 2, NAV_WAYPOINT (16): the way there is partly outside the fence"
    ),
    "bow-tie": (
        [AROUND, BOW],
        ": fence area 1 (points 4 to 7) crosses itself: its edges 4-5 and 6-7 meet",
    ),
    "on one parallel": (
        [[[47.4, 8.4], [47.4, 8.5], [47.4, 8.6]]], "(points 0 to 2) has no area: its corners lie on"
    ),
    "two corners": ([AROUND[:2]], "geoFence.polygons[0].polygon"),
    "no corners": ([AROUND, []], "geoFence.polygons[1].polygon"),
}  # fmt: skip


def within(tmp_path: Path, *polygons: list[list[float]]) -> Path:
    """To the north and on to the east, and areas to stay in."""
    document = plan_document(TAKE_OFF, place(NORTH, 8.5), place(NORTH, EAST), RETURN)
    document["geoFence"]["polygons"] = [
        {"inclusion": True, "version": 1, "polygon": polygon} for polygon in polygons
    ]
    plan = tmp_path / "within.plan"
    plan.write_text(json.dumps(document))
    return plan


@pytest.mark.parametrize("case", BAD_FENCES)
def test_areas_to_stay_in_that_are_none_or_left_are_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    polygons, words = BAD_FENCES[case]
    plan, out = within(tmp_path, *polygons), tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 2
    refused(capsys, str(plan), words)
    assert not out.exists()


def test_a_plan_within_all_of_its_areas_is_taken(tmp_path: Path) -> None:
    order = plan_flight.order_of(load(None, ()), read_plan_file(within(tmp_path, AROUND, AROUND)))
    assert [seq for seq, _ in order.path.places] == [0, 1, 2]


def with_rally(folder: Path, *points: list[float], circle_m: float = 0.0) -> Path:
    """Out to the north and an end in the air, from where the vehicle returns by itself."""
    document = plan_document(TAKE_OFF, place(NORTH, 8.5))
    document["rallyPoints"]["points"] = list(points)
    if circle_m:
        circle = {"center": [47.4, 8.5], "radius": circle_m}
        document["geoFence"]["circles"] = [{"inclusion": True, "version": 1, "circle": circle}]
    path = folder / "rally.plan"
    path.write_text(json.dumps(document))
    return path


@pytest.mark.slow
def test_the_return_leads_to_the_closest_rally_point(tmp_path: Path) -> None:
    # 50 m east of the last place, and one that is farther from there than home.
    plan = with_rally(tmp_path, [47.4, 8.5 - 100 / 75_480, 0], [NORTH, 8.5 + 50 / 75_480, 0])
    out = tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 0
    data = np.genfromtxt(out / "track.csv", delimiter=",", names=True)
    east, north = (data[f"true_{axis}_m"][-1] - data[f"true_{axis}_m"][0] for axis in "xy")
    assert (east, north) == pytest.approx((50, 200), abs=4)
    assert abs(data["true_alt_m"][-1]) < 0.5
    log = read_log(out / "flight.mcap")
    assert "Returning to rally point 1" in {event.text for event in log.events}
    # All of it lies on the map, which tells where they are.
    assert (data["true_x_m"].min(), data["true_x_m"].max()) == pytest.approx((150, 200), abs=4)
    assert call(["report", str(out)]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    places = rows(charts(page)["Planned and flown; numbers: items of the plan"], "item", "kind")
    assert [row["kind"] for row in places].count("rally point") == 2


@pytest.mark.parametrize(
    ("point", "words"),
    [
        ([0, 0, 0], "it has no position"),
        ([99, 8.5, 0], "latitude 99, -90 to 90 deg are allowed"),
        ([48.4, 8.5, 0], "111 km from home, MIS_DIST_1WP allows 20 km"),
        ([NORTH, 8.5, 501], "501.0 m above home; 0 to 500 m are allowed"),
        ([NORTH, 8.5, -1], "-1.0 m above home; 0 to 500 m are allowed"),
        ([47.4 + 400 / 111_180, 8.5, 0], "it is outside the fence"),
    ],
)
def test_a_rally_point_of_no_use_is_named_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], point: list[float], words: str
) -> None:
    plan, out = with_rally(tmp_path, [47.4, 8.501, 0], point, circle_m=300), tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out)]) == 2
    assert (
        capsys.readouterr().err
        == f"aerofed: {plan}: rally point 1, NAV_RALLY_POINT (5100): {words}\n"
    )
    assert not out.exists()


def test_a_used_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, out = written(tmp_path, *CORNERS), tmp_path / "out"
    out.mkdir()
    (out / "mine").write_text("mine")
    assert call(["fly", str(plan), "--out", str(out)]) == 2
    assert "already used" in capsys.readouterr().err
    assert {path.name for path in out.iterdir()} == {"mine"}


@pytest.mark.slow
def test_its_folder_has_the_after_care_of_a_run(
    square: Square, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = square.out, tmp_path / "b"
    shutil.copytree(first, second)
    printed = square.printed.splitlines()
    printed = printed[next(n for n, line in enumerate(printed) if "Planned and" in line) :]
    assert {path.name for path in (first / "figures").iterdir()} == {"map.png", "profile.png"}
    assert all(path.stat().st_size > 5000 for path in (first / "figures").iterdir())
    assert call(["compare", str(first)]) == 0
    assert (
        capsys.readouterr().out.splitlines()
        == printed[: printed.index(f"results in {first}: open report.html in a browser")]
    )
    assert call(["compare", str(first), str(second / "flight.mcap"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [item.pop("source") for item in found] == [str(first), str(second / "flight.mcap")]
    assert found[0] == found[1]
    assert [leg["item"] for leg in found[0]["legs"]] == [0, 1, 3, 4, 5]
    assert call(["compare", str(first), "--plan", str(square.plan), "--json"]) == 0
    (again,) = json.loads(capsys.readouterr().out)
    assert again["total"]["flown_path_m"] == found[0]["total"]["flown_path_m"]
    assert not [spike for spike in again["spikes"] if spike["what"] == "cross-track"]  # corners
    total = {key: value for key, value in found[0]["total"].items() if value is not None}
    assert total == summary(first)["planned_and_flown"]
    profile = tmp_path / "both.svg"
    assert call(["compare", str(first), str(second), "--figure", str(profile)]) == 0
    assert "Runs side by side" in capsys.readouterr().out
    assert profile.stat().st_size > 10_000
    page = (first / "report.html").read_text(encoding="utf-8")
    for words in ("5 / 5</b>", "Height above home", "Ground speed", "Wall time", "Legs</h2>"):
        assert words in page
    assert call(["compare", str(first), str(tmp_path)]) == 2
    assert "no flight.mcap" in capsys.readouterr().err


@pytest.mark.slow
def test_a_flight_that_was_killed_is_compared_as_far_as_it_came(
    square: Square, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(square.out, out)
    # As a kill in mid-flight leaves it.
    log = out / "flight.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    killed = {key: value for key, value in summary(out).items() if key != "planned_and_flown"}
    (out / "summary.json").write_text(json.dumps(killed | {"status": "running"}))
    assert call(["compare", str(out), "--json"]) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)[0]["total"]
    assert 0 < found["slots_missed"] < found["slots"] == 5
    assert 0 < found["cross_track_rms_m"] < 1.5
    assert "killed, or is still under way; this is what was flown" in printed.err
    assert call(["report", str(out)]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "items never reached: 4, 5" in page


@pytest.mark.slow
def test_a_flight_whose_pictures_fail_is_not_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, seen = tmp_path / "out", []

    def fail(*_: object) -> None:
        seen.append(summary(out)["status"])
        raise DamagedLogError(out / "flight.mcap", "no room", 3)

    monkeypatch.setattr("mission.figures.run.draw_run", fail)
    plan = written(tmp_path, TAKE_OFF, place(NORTH, 8.5), RETURN)
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 2
    assert "no room" in capsys.readouterr().err
    assert seen == ["running"]
    assert summary(out)["status"] == "failed"


@pytest.mark.slow
def test_a_flight_that_misses_its_end_has_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = "mission.run.plan_flight.load_run"
    monkeypatch.setattr(cut, lambda path: without_its_end(load_run(path)))
    plan, out = written(tmp_path, TAKE_OFF, place(NORTH, 8.5), RETURN), tmp_path / "out"
    assert call(["fly", str(plan), "--out", str(out), *QUIET]) == 4
    said = "item 2 was never reached"
    assert capsys.readouterr().err == f"aerofed: {said}; the files are in {out}\n"
    assert (summary(out)["status"], summary(out)["error"]) == ("failed", said)
    assert (out / "track.csv").is_file()


def test_a_live_port_that_is_none_or_in_use_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, out = written(tmp_path, TAKE_OFF, place(NORTH, 8.5), RETURN), tmp_path / "out"
    fly = ["fly", str(plan), "--out", str(out), "--live", "--live-port"]
    assert call([*fly, "70000"]) == 2
    assert "--live-port 70000: must be from 0 to 65535" in capsys.readouterr().err
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert call([*fly, str(port)]) == 5
    assert f"127.0.0.1:{port}: the port is in use" in capsys.readouterr().err
    assert not out.exists()


SURVEY = Path(__file__).parents[3] / "examples" / "survey.plan"


def passed(out: Path) -> list[int | None]:
    """Items in the order in which they were reached."""
    events = read_log(out / "flight.mcap").events
    return [event.seq for event in events if event.kind == "reached"]


@pytest.mark.slow
def test_a_survey_is_flown_as_it_was_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert call(["fly", str(SURVEY), "--out", str(out), "--no-figures", "--no-report"]) == 0
    # A take-off and four legs of four places each; the camera's items lie between them.
    legs = [
        place for first in range(1, 24, 6) for place in (first, *range(first + 1, first + 6, 2))
    ]
    assert passed(out) == [0, *legs, 25]
    found = summary(out)["planned_and_flown"]
    assert (found["slots"], found["slots_missed"]) == (18, 0)
    assert found["straight_max_m"] < 1.0
    assert found["duration_s"] == pytest.approx(found["plan_duration_s"], rel=0.02)
    printed = capsys.readouterr().out
    assert printed.count("Skipped, as not on board: 8 x DO_SET_CAM_TRIGG_DIST (camera)") == 1
    assert not (out / "figures").exists()


@pytest.mark.slow
def test_jumps_turns_waits_and_speeds_are_flown(tmp_path: Path) -> None:
    def numbered(jump_id: int, item: Any) -> Any:
        return {**item, "doJumpId": jump_id}

    slow = simple(178, 1, 5, -1, 0, 0, 0, 0, frame=2)
    items = [
        numbered(11, TAKE_OFF), numbered(12, slow), numbered(13, place(47.4005, 8.5)),
        numbered(14, place(47.4005, 8.501)),
        numbered(15, simple(177, 13, 1, 0, 0, 0, 0, 0, frame=2)),
        numbered(16, simple(18, 2, 0, 20, 1, 47.4, 8.501, 50)),
        numbered(17, simple(93, 5, -1, -1, -1, 0, 0, 0, frame=2)),
        numbered(18, simple(19, 6, 0, 0, None, 47.4, 8.5, 40)),
        numbered(19, simple(177, 18, 1, 0, 0, 0, 0, 0, frame=2)), numbered(20, RETURN),
    ]  # fmt: skip
    out = tmp_path / "out"
    plan = written(tmp_path, *items)
    assert call(["fly", str(plan), "--out", str(out), *QUIET, "--no-figures"]) == 0
    assert passed(out) == [0, 2, 3, 2, 3, 5, 6, 7, 7, 9]
    found = summary(out)["planned_and_flown"]
    assert found["duration_s"] == pytest.approx(found["plan_duration_s"], rel=0.03)
    log = read_log(out / "flight.mcap")
    at_s = {event.seq: event.t_ns / 1e9 for event in log.events if event.kind == "reached"}
    assert at_s[6] - at_s[5] == pytest.approx(5.0, abs=0.1)
    # Two turns of a radius of 20 m at 5 m/s, from the west; the middle is 75 m east of home.
    middle = np.array(log.area.home_m) + np.array([75.48, 0.0])
    time_s = log.truth.t_ns / 1e9
    turning = (time_s > at_s[5] - 2 * np.pi * 40 / 5) & (time_s < at_s[5])
    way = log.truth.pos_m[turning, :2] - middle
    assert np.linalg.norm(way, axis=1) == pytest.approx(np.full(len(way), 20.0), abs=2.0)
    turned = np.unwrap(np.arctan2(way[:, 0], way[:, 1]))
    assert turned[-1] - turned[0] == pytest.approx(4 * np.pi, abs=0.3)


@pytest.mark.slow
def test_a_mission_that_is_aborted_is_compared_as_far_as_it_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    fault = 'vehicle.aircraft.faults=[{kind="gnss_off", after=7, at_s=1}]'
    assert call(["fly", str(SURVEY), "--out", str(out), "--set", fault, "--no-report"]) == 4
    printed = capsys.readouterr()
    assert re.search(r"t 4\d\.\d s: Fault begins: gnss_off", printed.out)
    assert "left the mission for LAND" in printed.err
    assert summary(out)["status"] == "failed"
    assert 0 < summary(out)["planned_and_flown"]["slots_missed"] < 18
    assert passed(out)[:6] == [0, 1, 2, 4, 6, 7]


@pytest.mark.slow
@pytest.mark.parametrize(("top", "heights"), [(False, [15, 25]), (True, [25, 15])])
def test_a_structure_scan_goes_round_the_building(
    tmp_path: Path, top: bool, heights: list[float]
) -> None:
    corners = [[47.4005, 8.5], [47.4005, 8.5005], [47.4008, 8.5005], [47.4008, 8.5]]
    scan = {
        "type": "ComplexItem", "complexItemType": "StructureScan", "version": 3,
        "CameraCalc": {
            "AdjustedFootprintFrontal": 10, "AdjustedFootprintSide": 12, "DistanceToSurface": 15,
            "CameraName": "Manual (no camera specs)", "DistanceMode": 1, "version": 2,
        },
        "EntranceAltitude": 40, "ScanBottomAlt": 10, "StructureHeight": 30, "StartFromTop": top,
        "Layers": 2, "GimbalPitch": 0, "polygon": corners,
    }  # fmt: skip
    out = tmp_path / "out"
    plan = written(tmp_path, TAKE_OFF, scan, RETURN)
    assert call(["fly", str(plan), "--out", str(out), *QUIET, "--no-figures"]) == 0
    run = load_run(out)
    assert run.judged is not None
    way = run.judged.passes[0].path
    flown = way.points_m[way.seqs >= 0][1:-1]  # without take-off and return
    assert [round(at[2]) for at in flown] == [40, *[heights[0]] * 5, *[heights[1]] * 5, 40]
    # 15 m outside of every wall, from the first corner round to it.
    south_west = np.array(run.data.area.home_m) + np.array([-15.0, 0.0005 * 111_180 - 15.0])
    for begin in (1, 6):
        ring = np.array(flown[begin : begin + 5])[:, :2]
        np.testing.assert_allclose(ring[[0, 4]], [south_west] * 2, atol=0.1)
        size = np.ptp(ring, axis=0)
        np.testing.assert_allclose(size, [0.0005 * 75_480 + 30, 0.0003 * 111_180 + 30], atol=0.1)
    assert summary(out)["planned_and_flown"]["slots_missed"] == 0


@pytest.mark.parametrize(
    ("after", "words"),
    [("26", "examples/survey.plan has the items 0 to 25"), ('"landing"', "'arming' or 'take-off'")],
)
def test_a_fault_after_what_never_comes_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], after: str, words: str
) -> None:
    fault = f'vehicle.aircraft.faults=[{{kind="gnss_off", after={after}}}]'
    assert call(["fly", str(SURVEY), "--out", str(tmp_path / "out"), "--set", fault]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
