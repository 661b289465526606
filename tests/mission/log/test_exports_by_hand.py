"""A short log of our own, written by hand, and every number of what is exported from it."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pyulog import ULog

from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Innovation, Kinematics
from mission.base.area import Area
from mission.flight.logs.ulog_export import export_ulog
from mission.log.export import (
    export_geojson,
    export_kml,
    export_tables,
    feature_of,
    kml_colour,
)
from mission.log.reader import read_log
from mission.log.records import UNKNOWN_ROUND
from mission.log.values import Devices, MissionRecord, PlanRecord, Zone
from mission.log.writer import FlightLog
from sitl.observer import VehicleEvent, VehicleSample

S = 1_000_000_000
HOME = GeodeticPoint(47.0, 8.0, 500.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME)
WORLD = Devices(np.array([[10.0, 20.0], [100.0, 50.0]]), ("=a", "b"))
HALF = math.sqrt(0.5)
LAT_DEG = 1 / 111_171.6  # of a metre, at 47 degrees


def state(t_ns: int, at: tuple[float, float, float], vel: tuple[float, float, float]) -> Kinematics:
    """Headed by 60 degrees."""
    q = np.array([math.sqrt(0.75), 0.0, 0.0, 0.5])
    return Kinematics(t_ns, np.array(at), np.array(vel), q, np.zeros(3))


def control(t_ns: int) -> np.ndarray:
    """Trace: time, attitude, body rates, ordered attitude, rates, thrust, motors, place, velocity,
    acceleration, yaw and its rate."""
    east, north = [HALF, 0.0, 0.0, HALF], [1.0, 0.0, 0.0, 0.0]
    rates, ordered = [0.125, 0.25, 0.5], [1.0, 2.0, 3.0]
    rest = [10.0, 20.0, -30.0, 1.0, 2.0, -3.0, 4.0, 5.0, -6.0, 0.5, 0.25]
    return np.array([[t_ns, *east, *rates, *north, *ordered, 0.75, 0.1, 0.2, 0.3, 0.4, *rest]])


ITEMS = [
    (22, 3, 47.0, 8.0, 20.0), (19, 0, 47.001, 8.0, 530.0), (178, 2, 0.0, 0.0, 0.0),
    (16, 3, 47.0, 8.001, 25.0), (21, 3, 47.0, 8.0, 0.0),
]  # fmt: skip


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "x.mcap"
    outline = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 300.0]])
    fence = [Zone(outline, keep_in=True), Zone(outline / 4, keep_in=False)]
    with FlightLog(path, area=AREA, devices=WORLD, fence=fence) as made:
        points_m = np.array([[100.0, 50.0, 0.0], [100.0, 50.0, 20.0], [140.0, 80.0, 20.0]])
        plan = PlanRecord.of_flight(1, 0, points_m, slot_s=np.array([0.0, 10.0, 35.0]))
        schedule = np.array([[False, False], [False, True], [True, True]])
        made.plan_record(replace(plan, schedule=schedule, importance=np.array([0.5, 1.0])))
        rows = tuple(
            (float(n), float(command), float(frame), 0.0, 0.0, 0.0, 0.0, x, y, z, 1.0)
            for n, (command, frame, x, y, z) in enumerate(ITEMS)
        )
        made.mission(MissionRecord(S, "mission", rows))
        for t_s in range(5):
            t_ns = t_s * S
            truth = state(t_ns, (10.0 * t_s, 20.0, -30.0), (10.0, 1.0, -2.0))
            belief = state(t_ns, (10.0 * t_s + 1.0, 21.0, -32.0), (11.0, 2.0, -3.0))
            fix = GnssFix(t_ns - S // 4, truth.pos_ned_m, truth.vel_ned_mps, 2.0, 3.0, 0.1, 12)
            innovation = Innovation(
                t_ns - S // 4, "gnss position", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), 4.0, 16.0
            )
            baro = Innovation(t_ns - S // 4, "baro", (7.0,), (8.0,), 32.0, 16.0)
            made.sampled(VehicleSample(
                t_ns, truth, belief, fix, BatteryState(22.0 - t_s, 5.0, 10.0 * t_s, 0.5),
                "MISSION" if t_s else "HOLD", t_s > 0, np.array([3.0, 4.0, -5.0]),
                (innovation, baro), control(t_ns),
            ))  # fmt: skip
            if t_s >= 2:
                kind: Any = "reached"
                seq = {2: 0, 3: 1, 4: 4}[t_s]
                made.happened(VehicleEvent(t_ns, kind, f"item {seq}", truth, belief, seq))
        made.happened(VehicleEvent(4 * S, "status", "+done", truth, belief, None, 3))
        made.round(replace(UNKNOWN_ROUND, round=1, start_t_s=1.0, duration_s=2.0))
    return path


@pytest.fixture(scope="module")
def ulog(log: Path) -> ULog:
    return ULog(str(export_ulog(log, log.with_suffix(".ulg"))))


def topic(ulog: ULog, name: str) -> dict[str, Any]:
    return next(item.data for item in ulog.data_list if item.name == name)


def row(ulog: ULog, name: str, *fields: str, at: int = 2) -> list[float]:
    data = topic(ulog, name)
    return [float(data[field][at]) for field in fields]


def test_positions_attitudes_and_speeds_are_px4s(ulog: ULog) -> None:
    for suffix, more, alt in (("", 1.0, 532.0), ("_groundtruth", 0.0, 530.0)):
        name = f"vehicle_local_position{suffix}"
        place = row(ulog, name, "x", "y", "z", "vx", "vy", "vz")
        expected = [20 + more, 20 + more, -30 - 2 * more, 10 + more, 1 + more, -2 - more]
        assert place == pytest.approx(expected, abs=1e-3)
        assert row(ulog, name, "heading")[0] == pytest.approx(math.pi / 3, abs=1e-4)
        assert row(ulog, name, "ref_lat", "ref_lon", "ref_alt") == [47.0, 8.0, 500.0]
        flags = "xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "xy_global", "z_global"
        assert row(ulog, name, *flags) == [1.0] * 6
        lat, _, height = row(ulog, f"vehicle_global_position{suffix}", "lat", "lon", "alt")
        assert lat == pytest.approx(47.0 + (20 + more) * LAT_DEG, abs=1e-7)
        assert height == pytest.approx(alt, abs=1e-3)
    q = row(ulog, "vehicle_attitude_groundtruth", *(f"q[{n}]" for n in range(4)))
    assert q == pytest.approx([math.sqrt(0.75), 0.0, 0.0, 0.5], abs=1e-4)


def test_control_is_px4s(ulog: ULog) -> None:
    def of(name: str, field: str, count: int) -> tuple[float, ...]:
        return tuple(row(ulog, name, *(f"{field}[{n}]" for n in range(count))))

    def near(*values: float) -> Any:
        return pytest.approx(values, abs=2e-4)

    assert of("vehicle_attitude", "q", 4) == near(HALF, 0, 0, HALF)
    assert of("vehicle_angular_velocity", "xyz", 3) == near(0.125, 0.25, 0.5)
    assert of("vehicle_attitude_setpoint", "q_d", 4) == near(1, 0, 0, 0)
    for name in ("vehicle_attitude_setpoint", "vehicle_rates_setpoint"):
        assert of(name, "thrust_body", 3) == near(0.0, 0.0, -0.75)
    rates = row(ulog, "vehicle_rates_setpoint", "roll", "pitch", "yaw")
    assert tuple(rates) == near(1.0, 2.0, 3.0)
    motors = of("actuator_motors", "control", 12)
    assert motors[:4] == near(0.1, 0.2, 0.3, 0.4)
    assert np.isnan(motors[4:]).all()
    assert "control[12]" not in topic(ulog, "actuator_motors")
    name = "vehicle_local_position_setpoint"
    found = row(ulog, name, "x", "y", "z", "vx", "vy", "vz", "yaw", "yawspeed")
    assert tuple(found) == near(10, 20, -30, 1, 2, -3, 0.5, 0.25)
    assert of(name, "acceleration", 3) == near(4.0, 5.0, -6.0)


def test_sensors_and_states_are_px4s(ulog: ULog) -> None:
    gps = topic(ulog, "vehicle_gps_position")
    assert gps["timestamp"].tolist() == [n * 10**6 for n in range(5)]
    assert gps["timestamp_sample"].tolist() == [0, 750_000, 1_750_000, 2_750_000, 3_750_000]
    fields = "latitude_deg", "longitude_deg", "altitude_msl_m", "eph", "epv", "fix_type"
    lat, lon, alt, eph, epv, fix = row(ulog, "vehicle_gps_position", *fields)
    assert lat == pytest.approx(47.0 + 20 * LAT_DEG, abs=1e-7)
    assert lon > 8.0
    assert alt == pytest.approx(530.0, abs=1e-3)
    assert (eph, epv, fix) == (2.0, 3.0, 3.0)
    names = "connected", "voltage_v", "current_a", "discharged_mah", "remaining"
    assert row(ulog, "battery_status", *names) == [1.0, 20.0, 5.0, 20.0, 0.5]
    assert row(ulog, "wind", "windspeed_north", "windspeed_east") == [3.0, 4.0]
    assert len(topic(ulog, "home_position")["lat"]) == 1
    names = "lat", "lon", "alt", "valid_alt", "valid_hpos"
    assert row(ulog, "home_position", *names, at=0) == [47.0, 8.0, 500.0, 1.0, 1.0]
    status = topic(ulog, "vehicle_status")
    assert status["timestamp"].tolist() == [0, 10**6, 2 * 10**6, 3 * 10**6]
    assert status["nav_state"].tolist() == [4, 3, 3, 3]
    assert status["arming_state"].tolist() == [1, 2, 2, 2]
    assert status["nav_state_timestamp"].tolist() == [0, 10**6, 10**6, 10**6]
    assert status["vehicle_type"].tolist() == [1] * 4
    assert status["system_type"].tolist() == [2] * 4
    assert not status["failsafe"].any()
    (line,) = ulog.logged_messages
    assert (line.timestamp, line.message, line.log_level) == (4 * 10**6, "+done", ord("3"))


def test_missions_are_as_px4_tells_them(ulog: ULog) -> None:
    """Item 2 has no place, and with the last one the mission is over."""
    result = topic(ulog, "mission_result")
    found = zip(*(result[f"seq_{name}"].tolist() for name in ("reached", "current", "total")))  # noqa: B905
    assert list(found) == [(-1, 0, 5), (0, 1, 5), (1, 4, 5), (4, 5, 5)]
    assert result["finished"].tolist() == [0, 0, 0, 1]
    assert result["valid"].tolist() == [1] * 4
    assert result["timestamp"].tolist() == [n * 10**6 for n in (1, 2, 3, 4)]
    headed = topic(ulog, "position_setpoint_triplet")
    assert headed["current.type"].tolist() == [3, 0, 4]
    assert headed["current.lat"].tolist() == [47.0, 47.001, 47.0]
    assert headed["current.alt"].tolist() == [520.0, 530.0, 500.0]


def table(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


def test_tables_have_every_number_in_its_column(log: Path, tmp_path: Path) -> None:
    names = [path.name for path in export_tables(log, tmp_path / "t", "csv")]
    assert {"learning.csv", "uplinks.csv"}.isdisjoint(names)
    folder = tmp_path / "t"
    place = {name: float(value) for name, value in table(folder, "track")[2].items()}
    # Heights count from the globe, 0.06 mm farther down there.
    assert place == pytest.approx({
        "t_s": 2.0, "true_x_m": 120.0, "true_y_m": 70.0, "true_alt_m": 30.0,
        "est_x_m": 121.0, "est_y_m": 71.0, "est_alt_m": 32.0,
    }, abs=1e-4)  # fmt: skip
    assert table(folder, "plans")[2] == {
        "round": "1", "step": "2", "x_m": "140.0", "y_m": "80.0", "slot_s": "35.0",
        "devices": "0 1",
    }  # fmt: skip
    assert table(folder, "devices") == [
        {"device": "0", "community": "'=a", "x_m": "10.0", "y_m": "20.0"},
        {"device": "1", "community": "b", "x_m": "100.0", "y_m": "50.0"},
    ]
    first, *_, last = table(folder, "events")
    assert first == {
        "t_s": "2.0", "kind": "reached", "text": "item 0", "seq": "0", "severity": "6",
        "true_x_m": "120.0", "true_y_m": "70.0", "true_alt_m": "30.0",
    }  # fmt: skip
    assert (last["text"], last["seq"], last["severity"]) == ("'+done", "nan", "3")
    assert table(folder, "battery")[1] == {
        "t_s": "1.0", "voltage_v": "21.0", "current_a": "5.0", "consumed_mah": "10.0",
        "remaining": "0.5",
    }  # fmt: skip
    assert table(folder, "wind")[1] == {
        "t_s": "1.0", "east_mps": "4.0", "north_mps": "3.0", "up_mps": "5.0",
    }  # fmt: skip
    innovations = table(folder, "innovations")
    position = [row for row in innovations if row["sensor"] == "gnss position"]
    assert [(r["axis"], r["value"], r["std"]) for r in position[:3]] == [
        ("north", "1.0", "4.0"), ("east", "2.0", "5.0"), ("down", "3.0", "6.0"),
    ]  # fmt: skip
    assert (position[0]["ratio"], position[0]["accepted"].lower()) == ("0.5", "true")
    baro = next(row for row in innovations if row["sensor"] == "baro")
    assert (baro["axis"], baro["value"], baro["accepted"].lower()) == ("", "7.0", "false")
    control_ = table(folder, "control")[1]
    assert control_["t_s"] == "1.0"
    assert control_["thrust_setpoint"] == "0.75"
    assert float(control_["motors_3"]) == pytest.approx(0.4, abs=2e-4)


def test_kml_has_devices_fence_and_both_paths(log: Path, tmp_path: Path) -> None:
    root = ET.parse(export_kml(log, tmp_path / "x.kml")).getroot()
    at = {"k": "http://www.opengis.net/kml/2.2"}

    def lines(folder: str) -> list[tuple[str, list[list[float]]]]:
        found = []
        for each in root.iterfind(".//k:Folder", at):
            if each.findtext("k:name", namespaces=at) == folder:
                for mark in each.iterfind("k:Placemark", at):
                    told = mark.findtext(".//k:coordinates", namespaces=at) or ""
                    places = [[float(n) for n in place.split(",")] for place in told.split()]
                    found.append((mark.findtext("k:name", namespaces=at) or "", places))
        return found

    (_, ((lon, lat, alt),)), (name, ((lon2, lat2, _),)) = lines("devices")
    assert name == "1 b"
    assert (lon2, lat2, alt) == pytest.approx((8.0, 47.0, 500.0), abs=1e-3)
    assert lon < 8.0
    assert lat == pytest.approx(47.0 - 30 * LAT_DEG, abs=2e-8)
    (fence, ring), (keep_out, _) = lines("fence")
    assert (fence, keep_out) == ("fence", "no-fly area")
    assert len(ring) == 4
    assert ring[0] == ring[-1]
    ((planned, path),) = lines("planned")
    assert planned == "round 1"
    assert [round(alt) for _, _, alt in path] == [500, 520, 520]
    pieces = [(flown, len(track)) for flown, track in lines("flown")]
    assert pieces == [("to round 1", 2), ("round 1", 3), ("after the last round", 2)]
    (_, track), *_ = lines("flown")
    assert track[1][1] - track[0][1] == pytest.approx(10 * LAT_DEG, abs=2e-8)
    assert kml_colour("#12AbcD") == "ffcdab12"


def test_geojson_has_both_tracks_with_their_times(log: Path, tmp_path: Path) -> None:
    data = read_log(log)
    features = json.loads(export_geojson(data, tmp_path / "x.geojson").read_text())["features"]
    kinds = [each["properties"]["kind"] for each in features]
    assert kinds == ["planned", "true", "believed"]
    for each, north, up in ((features[1], 20.0, 530.0), (features[2], 21.0, 532.0)):
        assert each["properties"]["t_s"] == [0.0, 1.0, 2.0, 3.0, 4.0]
        _, lat, alt = each["geometry"]["coordinates"][2]
        assert lat == pytest.approx(47.0 + north * LAT_DEG, abs=2e-8)
        assert alt == pytest.approx(up, abs=2e-3)
    assert features[0]["properties"]["round"] == 1
    for only, left in (("believed", ["planned", "believed"]), ("true", ["planned", "true"])):
        told = replace(data, source=replace(data.source, only=only))
        text = export_geojson(told, tmp_path / f"{only}.geojson").read_text()
        assert [each["properties"]["kind"] for each in json.loads(text)["features"]] == left
    once = replace(data, truth=data.truth.between(0, 0), plans=())
    text = export_geojson(once, tmp_path / "once.geojson").read_text()
    assert [each["properties"]["kind"] for each in json.loads(text)["features"]] == ["believed"]
    point = feature_of(AREA, np.array([[100.0, 50.0, 20.0]]), name="x")
    assert point["geometry"] == {"type": "Point", "coordinates": (8.0, 47.0, 520.0)}


@pytest.mark.parametrize(
    ("mode", "state_"),
    [("RETURN_TO_LAUNCH", 5), ("RTL", 5), ("AUTO", 3), ("ALTCTL", 1), ("POSCTL", 2),
     ("FOLLOW_ME", 19), ("ACRO", 10), ("TAKEOFF", 17), ("LAND", 18), ("GUIDED", 255)],
)  # fmt: skip
def test_modes_of_any_autopilot_are_px4s_where_it_has_them(
    tmp_path: Path, mode: str, state_: int
) -> None:
    path = tmp_path / "x.mcap"
    with FlightLog(path, area=AREA, devices=Devices(np.zeros((0, 2)), ())) as made:
        for t_s in range(2):
            here = state(t_s * S, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            battery = BatteryState(22.0, 1.0, 0.0, 1.0)
            made.sampled(VehicleSample(t_s * S, here, here, None, battery, mode, armed=True))
    found = ULog(str(export_ulog(path, tmp_path / "x.ulg")))
    assert topic(found, "vehicle_status")["nav_state"].tolist() == [state_]
