"""Plan files: written as uploaded, read as MAVSDK reads them, refused when damaged."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import InputError
from mission.flight.missions.plan_file import read_plan_file, write_round_plan
from mission.flight.missions.round_mission import FlightPlan, mission_items
from mission.flight.pilot.dialects import raw_items
from mission.planner.flyable import Stop
from sitl.autopilot.protocol.order_rules import check_item

HOME = GeodeticPoint(43.6145, 7.0715, 130.0)


def plan_document(*items: Any, **mission: Any) -> dict[str, Any]:
    """What QGroundControl 4.4 saves, in short."""
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": 12,
            "vehicleType": 2,
            "cruiseSpeed": 15,
            "hoverSpeed": 5,
            "plannedHomePosition": [47.4, 8.5, 488.0],
            "items": list(items),
            **mission,
        },
    }


def simple(command: int, *params: float | None, frame: int = 3, **more: Any) -> dict[str, Any]:
    return {
        "type": "SimpleItem", "autoContinue": True, "command": command, "frame": frame,
        "params": list(params), **more,
    }  # fmt: skip


WAYPOINT = simple(16, 0, 5, 0, None, 47.401, 8.5, 60)


def test_what_is_written_is_what_is_uploaded(tmp_path: Path) -> None:
    # Many points, because degrees times 1e7 must come back as the same integers.
    area = Area.at((800.0, 800.0), (400.0, 400.0), HOME)
    rng = np.random.default_rng(7)
    stops = [Stop(xy, (n,), 2.5 * (n == 3)) for n, xy in enumerate(rng.uniform(0, 800, (300, 2)))]
    plan = FlightPlan(tuple(stops), 60.0, 20.0, 5.0)
    path = tmp_path / "plans" / "round-001.plan"
    write_round_plan(path, plan, area)
    file = read_plan_file(path)
    assert file.home == HOME
    back = raw_items(file.items)
    uploaded = raw_items(mission_items(plan, area))
    assert len(back) == len(uploaded) == 301
    for ours, theirs in zip(uploaded, back, strict=True):
        for name in ("seq", "command", "current", "x", "y", "z"):
            assert getattr(theirs, name) == getattr(ours, name), name
        for name in ("param1", "param2", "param3", "param4"):
            assert getattr(theirs, name) == pytest.approx(getattr(ours, name), nan_ok=True), name
        # PX4 knows what has no place in MAV_FRAME_MISSION only.
        assert (ours.frame, theirs.frame) == ((2, 2) if ours.command == 178 else (6, 3))


def test_a_qgroundcontrol_plan_is_read(tmp_path: Path) -> None:
    document = plan_document(simple(22, 15, 0, 0, None, 47.4, 8.5, 50), WAYPOINT)
    document["rallyPoints"]["points"] = [[47.4, 8.5, 30], [47.41, 8.49, 0]]
    document["geoFence"]["polygons"] = [
        {"inclusion": True, "version": 1, "polygon": [[47.3, 8.4], [47.5, 8.4], [47.5, 8.6]]}
    ]
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(document))
    file = read_plan_file(path)
    assert file.home == GeodeticPoint(47.4, 8.5, 488.0)
    assert [(i.seq, i.command, i.x, i.y, i.z) for i in file.items] == [
        (0, 22, 47.4, 8.5, 50.0), (1, 16, 47.401, 8.5, 60.0)
    ]  # fmt: skip
    assert [item.autocontinue for item in (*file.fence, *file.rally)] == [True] * 5
    rally = [(i.seq, i.command, i.frame, i.x, i.y, i.z) for i in file.rally]
    assert rally == [(0, 5100, 3, 47.4, 8.5, 30.0), (1, 5100, 3, 47.41, 8.49, 0.0)]


ROW = "{}\t0\t3\t16\t0\t5\t0\t0\t47.401\t8.5\t60\t1\n"
HOME_ROW = "0\t1\t0\t16\t0\t0\t0\t0\t47.4\t8.5\t488\t1\n"


def test_a_fence_as_older_versions_draw_it_is_one_to_keep_to(tmp_path: Path) -> None:
    """And the place to return to after a breach is an item, for whoever flies it to refuse."""
    path = tmp_path / "old.plan"
    ring = [[47.39, 8.49], [47.41, 8.49], [47.41, 8.51]]
    fence = {"polygon": ring, "version": 1, "breachReturn": [47.4, 8.5, 30]}
    path.write_text(json.dumps(plan_document(WAYPOINT) | {"geoFence": fence}))
    *corners, back = read_plan_file(path).fence
    assert [(item.command, item.params[0], item.x, item.y) for item in corners] == [
        (mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, 3, lat, lon) for lat, lon in ring
    ]
    assert (back.command, back.x, back.y, back.z) == (
        mav.MAV_CMD_NAV_FENCE_RETURN_POINT, 47.4, 8.5, 30.0
    )  # fmt: skip
    assert "is not supported" in check_item(back)[1]


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_a_waypoint_file_is_read_without_its_home(tmp_path: Path, line_end: str) -> None:
    path = tmp_path / "a.waypoints"
    text = "QGC WPL 110\n" + HOME_ROW + ROW.format(1)
    path.write_bytes(text.replace("\n", line_end).encode())
    file = read_plan_file(path)
    assert file.home == GeodeticPoint(47.4, 8.5, 488.0)
    assert [(i.seq, i.command, i.x) for i in file.items] == [(0, 16, 47.401)]


def test_a_waypoint_file_may_have_no_home(tmp_path: Path) -> None:
    path = tmp_path / "a.waypoints"
    path.write_text("QGC WPL 110\n" + ROW.format(0) + ROW.format(1))
    file = read_plan_file(path)
    assert file.home is None
    assert [item.seq for item in file.items] == [0, 1]


HOMES = {
    "as Mission Planner has it": ("0\t1\t0\t0\t0\t0\t0\t0\t47.4\t8.5\t488\t1", 488.0),
    "a placeholder": ("0\t1\t0\t16\t0\t0\t0\t0\t0\t0\t0\t1", None),
    "a placeholder, relative": ("0\t1\t3\t16\t0\t0\t0\t0\t0\t0\t0\t1", None),
    "relative": ("0\t0\t3\t16\t0\t0\t0\t0\t47.4\t8.5\t0\t1", math.nan),
}


@pytest.mark.parametrize("name", HOMES)
def test_row_0_is_a_home_of_any_kind(tmp_path: Path, name: str) -> None:
    """It is no item: as one it would be refused (no place, no height) or flown to."""
    row, height_m = HOMES[name]
    path = tmp_path / "a.txt"
    path.write_text(f"QGC WPL 110\n{row}\n" + ROW.format(1))
    file = read_plan_file(path)
    assert [(item.seq, item.x) for item in file.items] == [(0, 47.401)]
    if height_m is None:
        assert file.home is None
    else:
        assert file.home is not None
        assert (file.home.lat_deg, file.home.lon_deg) == (47.4, 8.5)
        assert file.home.alt_msl_m == pytest.approx(height_m, nan_ok=True)


@pytest.mark.parametrize("nothing", [[0, 0, 0], [0, 0], [None, None, None], None])
def test_a_planned_home_that_is_none(tmp_path: Path, nothing: Any) -> None:
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(plan_document(WAYPOINT, plannedHomePosition=nothing)))
    assert read_plan_file(path).home is None


@pytest.mark.parametrize("suffix", [".waypoints", ".txt", ".mission", ".TXT"])
def test_comments_and_what_is_left_open(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    take_off = "1 0 3 22 nan 0 0 nan nan nan 10 1  # where it stands\n"
    path.write_text(f"\n# by hand\nQGC WPL 110\n# home\n\n{HOME_ROW}#\n{take_off}" + ROW.format(2))
    items = read_plan_file(path).items
    assert [item.command for item in items] == [22, 16]
    assert np.isnan([items[0].x, items[0].y, items[0].params[3]]).all()


def rally_damage(points: Any) -> str:
    return json.dumps(plan_document(WAYPOINT) | {"rallyPoints": {"points": points}})


def fence_damage(**changes: Any) -> str:
    return json.dumps(plan_document(WAYPOINT) | {"geoFence": changes})


def json_damage(**changes: Any) -> str:
    return json.dumps(plan_document({**WAYPOINT, **changes}))


DAMAGED = {
    "missing": (None, "a.plan", "No such file"),
    "suffix": ("x", "a.kml", "neither a .plan nor a waypoint file (.waypoints, .txt, .mission)"),
    "other text": ("x", "a.txt", "not a waypoint file: the first line is not 'QGC WPL 110'"),
    "comments": ("# QGC WPL 110\n\n", "a.waypoints", "the first line is not"),
    "empty": ("", "a.plan", "empty"),
    "cut": (json.dumps(plan_document(WAYPOINT))[:300], "a.plan", "Invalid JSON: EOF"),
    "binary": (b"\xff\xfe\x00", "a.plan", "UTF-8"),
    "deep": ("[" * 100_000, "a.plan", "Invalid JSON: recursion limit exceeded"),
    "list": ("[]", "a.plan", "should be an object"),
    "newer": (json.dumps(plan_document(WAYPOINT) | {"version": 42}), "a.plan", "version = 42"),
    "newer mission": (json.dumps(plan_document(WAYPOINT, version=7)), "a.plan",
                      "mission.version = 7"),
    "newer fence": (fence_damage(version=3), "a.plan", "geoFence.version = 3"),
    "half a return": (fence_damage(breachReturn=[47.4, 8.5]), "a.plan", "breachReturn"),
    "other": ('{"fileType": "Parameters"}', "a.plan", "fileType"),
    "no mission": ('{"fileType": "Plan"}', "a.plan", "mission: Field required"),
    "no items": (json.dumps(plan_document()), "a.plan", "mission is empty"),
    "item": (json.dumps(plan_document(5)), "a.plan", "mission.items[0]"),
    "type": (json_damage(type="Waypoint"), "a.plan", "'Waypoint'"),
    "command": (json_damage(command="16"), "a.plan", "command = '16'"),
    "frame": (json_damage(frame="3"), "a.plan", "frame = '3'"),
    "short": (json_damage(params=[0, 0, 0, None, 47.4]), "a.plan", "List should have at least 7"),
    "words": (json_damage(params=[0, 0, 0, 0, "47", 8, 50]), "a.plan", "params[4] = '47'"),
    "nan": (json_damage(params=[0, 0, 0, 0, float("nan"), 8, 50]), "a.plan", "params[4] = nan"),
    "scan": (json_damage(type="ComplexItem", complexItemType="StructureScan"), "a.plan",
             "mission.items[0].version: Field required"),
    "undrawn": (
        json.dumps(plan_document(WAYPOINT, {
            "type": "ComplexItem", "complexItemType": "survey",
            "TransectStyleComplexItem": {"Items": []},
        })),
        "a.plan", "mission.items[1].TransectStyleComplexItem.Items: empty: the scan has no path",
    ),
    "pattern": (json_damage(type="ComplexItem", complexItemType="fwLandingPattern"), "a.plan",
                "mission.items[0]: a landing of aeroplanes, and this is a multirotor: plan Land"),
    "other scan": (json_damage(type="ComplexItem", complexItemType="SpiralScan"), "a.plan",
                   "'SpiralScan'"),
    "home": (json.dumps(plan_document(WAYPOINT, plannedHomePosition="x")), "a.plan", "'x'"),
    "pole": (json.dumps(plan_document(WAYPOINT, plannedHomePosition=[91, 0, 0])), "a.plan", "91"),
    "rally": (rally_damage([[47.4, 8.5, 0], [47, 8]]), "a.plan", "rallyPoints.points[1][2]"),
    "rally words": (rally_damage([["47", 8, 0]]), "a.plan", "rallyPoints.points[0][0] = '47'"),
    "rally table": (rally_damage({}), "a.plan", "rallyPoints.points"),
    "header": ("QGC WPL 120\n" + HOME_ROW, "a.waypoints", "QGC WPL 110"),
    "rows": ("QGC WPL 110\n", "a.waypoints", "mission is empty"),
    "home only": ("QGC WPL 110\n" + HOME_ROW, "a.waypoints", "mission is empty"),
    "columns": ("QGC WPL 110\n" + HOME_ROW + "1\t0\t3\n", "a.waypoints", "line 3"),
    "half a home": (
        "QGC WPL 110\n" + HOME_ROW.replace("47.4", "nan") + ROW.format(1), "a.txt", "home nan, 8.5"
    ),
    "index": ("QGC WPL 110\n" + HOME_ROW + ROW.format("nan"), "a.txt", "line 3: index"),
    "letters": ("QGC WPL 110\n" + HOME_ROW + ROW.format("one"), "a.waypoints", "line 3"),
    "order": ("QGC WPL 110\n" + HOME_ROW + ROW.format(2), "a.waypoints", "item 1 is missing"),
}  # fmt: skip


@pytest.mark.parametrize("case", DAMAGED)
def test_what_is_damaged_is_named(tmp_path: Path, case: str) -> None:
    content, name, words = DAMAGED[case]
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as refused:
        read_plan_file(path)
    assert str(refused.value).startswith(str(path))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def scan(**changes: Any) -> dict[str, Any]:
    return {
        "type": "ComplexItem", "complexItemType": "StructureScan", "version": 3,
        "CameraCalc": {
            "AdjustedFootprintFrontal": 10, "AdjustedFootprintSide": 12, "DistanceToSurface": 15,
        },
        "EntranceAltitude": 40, "ScanBottomAlt": 10, "StructureHeight": 30, "StartFromTop": False,
        "Layers": 2, "GimbalPitch": -20,
        "polygon": [[47.4, 8.5], [47.4, 8.501], [47.401, 8.501]], **changes,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "items"),
    [
        ({"Layers": 1}, 4 + 6), ({"Layers": 100}, 4 + 600), ({"Layers": 0}, 0),
        ({"Layers": 101}, 0),
        ({"Layers": 1.5}, 0), ({"polygon": [[47.4, 8.5], [47.4, 8.501]]}, 0),
        ({"CameraCalc": {"AdjustedFootprintFrontal": 0, "AdjustedFootprintSide": 1,
                         "DistanceToSurface": 1}}, 0),
    ],
)  # fmt: skip
def test_a_structure_scan_has_layers_and_corners(
    tmp_path: Path, changes: dict[str, Any], items: int
) -> None:
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(plan_document(scan(**changes))))
    if items:
        assert len(read_plan_file(path).items) == items
    else:
        with pytest.raises(InputError):
            read_plan_file(path)


def test_a_building_drawn_the_other_way_round_is_gone_around_outside_too(tmp_path: Path) -> None:
    path, found = tmp_path / "a.plan", []
    corners = scan()["polygon"]
    for ring in (corners, [corners[0], *corners[:0:-1]]):
        path.write_text(json.dumps(plan_document(scan(polygon=ring, Layers=1))))
        flown = [item for item in read_plan_file(path).items if item.command == 16]
        found.append({(round(item.x, 6), round(item.y, 6)) for item in flown})
    assert found[0] == found[1]
    (south, *_), (*_, north) = sorted(found[0]), sorted(found[0])
    assert south[0] < 47.4 - 14 / 111_200
    assert north[0] > 47.401 + 14 / 111_200


@pytest.mark.parametrize(
    ("key", "value", "taken"),
    [
        ("command", 0xFFFF, True),
        ("command", 0x10000, False),
        ("command", -1, False),
        ("frame", 0xFF, True),
        ("frame", 0x100, False),
        ("frame", -1, False),
        ("params", [0] * 7, True),
        ("params", [0] * 8, False),
        ("params", [0] * 6, False),
    ],
)
def test_numbers_of_an_item_fit_its_message(
    tmp_path: Path, key: str, value: Any, taken: bool
) -> None:
    path = tmp_path / "a.plan"
    path.write_text(json_damage(**{key: value}))
    if taken:
        assert len(read_plan_file(path).items) == 1
    else:
        with pytest.raises(InputError, match=f"items.0..{key}"):
            read_plan_file(path)
