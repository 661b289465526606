"""Messages of the log and what viewers are shown, number by number."""

import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from fl.radio.city import Building
from fl.radio.per_grid import PerGrid
from flightdyn.frames import LocalFrame
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Innovation, Kinematics
from mission.base.area import Area
from mission.log import messages, scene, topics
from mission.log.records import UplinkRecord
from mission.log.topics import Topic
from mission.log.values import (
    BatteryTrack,
    Devices,
    EventRecord,
    FlightData,
    PlanRecord,
    Track,
    WindTrack,
    Zone,
)
from mission.log.vehicle import Every, VehicleTopics
from sitl.observer import VehicleEvent, VehicleSample

NAN = math.nan
S = 1_000_000_000
HOME = GeodeticPoint(47.0, 8.0, 500.0)
HALL = Building((np.array([[90.0, 90.0], [110.0, 90.0], [110.0, 120.0]]),), 12.0, 3.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME, buildings=(HALL,))
STILL = np.zeros(3)
WORLD = Devices(np.array([[10.0, 20.0], [30.0, 40.0], [50.0, 60.0]]), ("a", "b", "a"))


@cache
def _decoder(topic: Topic) -> Any:
    made = Schema(id=1, name=topic.schema_name, encoding="protobuf", data=topic.schema)
    return DecoderFactory().decoder_for("protobuf", made)


def decoded(topic: Topic, data: bytes) -> Any:
    return _decoder(topic)(data)


def xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def state(t_ns: int = 0, north: float = 0.0, east: float = 0.0, down: float = 0.0) -> Kinematics:
    level = np.array([1.0, 0.0, 0.0, 0.0])
    return Kinematics(t_ns, np.array([north, east, down]), np.array([1.0, 2.0, 3.0]), level, STILL)


def test_numbers_of_high_rate_are_rounded_to_their_grids() -> None:
    stamp = messages.timestamp(3 * S + 7)
    where = messages.area_pose(AREA, state(0, 1.0003, 2.0, -3.0))
    for topic, data in (
        (topics.TRUE_POSE, messages.pose(stamp, where)),
        (topics.TF, messages.transform(stamp, where)),
    ):
        got = decoded(topic, data)
        assert (got.timestamp.seconds, got.timestamp.nanos) == (3, 7)
        frame = got.frame_id if topic is topics.TRUE_POSE else got.parent_frame_id
        assert frame == "map"
        place = got.pose.position if topic is topics.TRUE_POSE else got.translation
        turn = got.pose.orientation if topic is topics.TRUE_POSE else got.rotation
        assert xyz(place) == (102.0, 51.0, 3.0)  # 1.0003 m is a third of a cell
        half = round(math.sqrt(0.5) * 2**16) / 2**16
        assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, half, half)  # to the north
    turned = state()._replace(q_frd_to_ned=np.array([0.1, 0.3, 0.5, 0.8]))
    got = decoded(topics.TRUE_POSE, messages.pose(stamp, messages.area_pose(AREA, turned)))
    found = got.pose.orientation
    given = [(0.3 + 0.5), (0.3 - 0.5), (0.1 - 0.8), (0.1 + 0.8)]
    expected = [round(value * math.sqrt(0.5) * 2**16) / 2**16 for value in given]
    assert [found.x, found.y, found.z, found.w] == expected
    got = decoded(topics.TRUE_VELOCITY, messages.velocity(np.array([1.0006, 2.0, 3.0])))
    assert xyz(got) == (2.0, 1.0 + 2**-10, -3.0)
    got = decoded(topics.PLAN_PATH, messages.path(stamp, [(1.003, 2.005, 3.0)]))
    assert xyz(got.poses[0].position) == (1.0, 2.0 + 2**-7, 3.0)
    assert (got.poses[0].orientation.w, got.frame_id) == (1.0, "map")


def test_places_on_the_globe_have_their_variances_and_times() -> None:
    fix = GnssFix(5, np.array([10.0, 0.0, -20.0]), STILL, 2.0, 3.0, 0.1, 12)
    got = decoded(topics.GNSS, messages.gnss(AREA.frame, fix))
    assert list(got.position_covariance) == [4.0, 0, 0, 0, 4.0, 0, 0, 0, 9.0]
    assert got.position_covariance_type == 2  # the diagonal is known
    assert got.altitude == pytest.approx(520.0, abs=1e-3)
    assert got.longitude == 8.0
    assert got.latitude == pytest.approx(47.0 + 10 / 111_172, abs=2e-7)
    assert (got.timestamp.nanos, got.frame_id) == (5, "gnss")
    early = decoded(topics.GNSS, messages.gnss(AREA.frame, fix._replace(t_ns=-5)))
    assert (early.timestamp.seconds, early.timestamp.nanos) == (0, 0)
    at = messages.location(messages.timestamp(0), GeodeticPoint(47.0 + 3e-9, 8.0, 500.0002))
    got = decoded(topics.TRUE_LOCATION, at)
    assert (got.latitude, got.altitude, got.frame_id) == (47.0, 500.0, "base_link")


@pytest.mark.parametrize(
    ("severity", "level"), [(0, 5), (1, 5), (2, 5), (3, 4), (4, 3), (5, 2), (6, 2), (7, 1)]
)
def test_severities_are_foxgloves_levels(severity: int, level: int) -> None:
    """MAV_SEVERITY: 0 emergency to 7 debug. Foxglove: 1 debug, 2 info, 3 warning to 5 fatal."""
    got = decoded(topics.LOG, messages.log_line(S, "words", severity=severity, source="status"))
    assert (got.level, got.message, got.name, got.timestamp.seconds) == (
        level,
        "words",
        "status",
        1,
    )


def test_our_records_have_as_many_digits_as_a_meter() -> None:
    data = messages.battery(BatteryState(12.34567, 1.23456, 7.89123, 0.12345678))
    assert json.loads(data) == {
        "voltage_v": 12.346, "current_a": 1.235, "consumed_mah": 7.89, "remaining": 0.123457,
    }  # fmt: skip
    none = json.loads(messages.battery(BatteryState(NAN, math.inf, 1.0, 1.0)))
    assert (none["voltage_v"], none["current_a"]) == (None, None)
    items = [
        Innovation(3 * S // 2, "baro", (1.23456,), (0.5,), 4.0, 16.0),
        Innovation(3 * S // 2, "gnss position", (1.0, -2.00049, 12345.6), (1, 2, 3), 16.0, 16.0),
    ]
    assert json.loads(messages.innovations(items)) == {
        "t_s": 1.5, "gnss_velocity": None, "heading": None,
        "baro": {"values": [1.235], "stds": [0.5], "ratio": 0.5, "accepted": True},
        "gnss_position": {
            "values": [1.0, -2.0, 12350.0], "stds": [1.0, 2.0, 3.0], "ratio": 1.0,
            "accepted": False,
        },
    }  # fmt: skip


@pytest.mark.parametrize(("places", "every"), [(81, 1), (82, 2), (163, 3)])
def test_a_grid_has_at_most_81_places_a_side_and_a_byte_for_each_device(
    places: int, every: int
) -> None:
    success = np.zeros((2, 3, places))
    success[0, 0, 0], success[1, 0, 0], success[1, 0, every] = 1.0, 0.5, 0.25
    got = decoded(topics.RADIO_TRUE, messages.success_grid(S, PerGrid(success, (10.0, 20.0), 4.0)))
    assert got.column_count == math.ceil(places / every)
    assert (got.cell_size.x, got.cell_size.y) == (4.0 * every, 4.0 * every)
    assert xyz(got.pose.position) == (10.0 - 2.0 * every, 20.0 - 2.0 * every, 0.0)
    assert (got.cell_stride, got.row_stride) == (2, 2 * got.column_count)
    assert [(f.name, f.offset, f.type) for f in got.fields] == [
        ("device 0", 0, 1),
        ("device 1", 1, 1),
    ]
    assert list(got.data[:4]) == [255, 128, 0, 64]
    assert len(got.data) == got.row_stride * math.ceil(3 / every)
    tall = messages.success_grid(S, PerGrid(success.swapaxes(1, 2), (10.0, 20.0), 4.0))
    assert decoded(topics.RADIO_TRUE, tall).column_count == math.ceil(3 / every)
    assert len(decoded(topics.RADIO_TRUE, tall).data) == len(got.data)


@pytest.mark.parametrize("rate_hz", [2.0, 1.0, 0.3])
def test_a_rate_is_kept_on_its_grid(rate_hz: float) -> None:
    every, period_ns = Every(rate_hz), round(S / rate_hz)
    assert every.due(0)
    assert not every.due(period_ns - 1)
    assert every.due(period_ns)
    assert every.due(4 * period_ns + 5)  # late, and the next in time all the same
    assert not every.due(5 * period_ns - 1)
    assert every.due(5 * period_ns)


def test_how_often_each_kind_is_written() -> None:
    """10 Hz for 40 s: poses at each sample, others by their rates, the path every five seconds."""
    written: list[tuple[str, int]] = []
    made = VehicleTopics(AREA, lambda topic, t_ns, _: written.append((topic.name, t_ns)))
    battery = BatteryState(1, 1, 1, 1)
    for n in range(400):
        t_ns = n * S // 10
        ok = Innovation(t_ns, "baro", (1.0,), (1.0,), 1.0, 2.0)
        bad = ok._replace(nis=3.0)
        made.sample(VehicleSample(
            t_ns, state(t_ns), state(t_ns), None, battery, "HOLD" if n < 30 else "LAND", True,
            STILL, (bad if n == 15 else ok,),
        ))  # fmt: skip
    made.write_all()
    counts = {name: sum(of == name for of, _ in written) for name, _ in written}
    assert counts == {
        "/tf": 80, "/true/pose": 400, "/est/pose": 400, "/true/velocity": 80, "/est/velocity": 80,
        "/true/location": 40, "/battery": 40, "/true/wind": 40, "/mode": 2, "/innovations": 41,
        "/flown/path": 8,
    }  # fmt: skip
    paths = [t_ns // S for name, t_ns in written if name == "/flown/path"]
    assert paths == [0, 5, 10, 15, 20, 25, 30, 35]
    assert ("/innovations", 15 * S // 10) in written


def test_a_long_path_is_written_at_each_twentieth_of_it() -> None:
    written: list[int] = []

    def write(topic: Topic, t_ns: int, _: bytes) -> None:
        if topic is topics.FLOWN_PATH:
            written.append(t_ns // S)

    made = VehicleTopics(AREA, write)
    made.write_path(0)  # nothing yet
    for n in range(300):
        made.sample(
            VehicleSample(n * S, state(), state(), None, BatteryState(1, 1, 1, 1), "", True)
        )
    made.write_samples()
    steps = np.diff(written)
    assert written[0] == 0
    assert set(steps[: 119 // 5]) == {5}
    assert steps[-1] == max(5, (written[-2] + 1) // 20)
    assert steps.max() > 10


@pytest.mark.parametrize(
    ("kind", "told", "severity"),
    [("status", 3, 3), ("failsafe", 6, 4), ("fault", 6, 4), ("mode", 2, 6), ("reached", 1, 6)],
)
def test_an_event_is_a_line_and_a_record(kind: Any, told: int, severity: int) -> None:
    written: dict[str, bytes] = {}
    made = VehicleTopics(AREA, lambda topic, _, data: written.update({topic.name: data}))
    made.event(VehicleEvent(S, kind, "text", state(S, 1, 2, -3), state(S, 4, 5, -6), 7, told))
    assert json.loads(written["/events"]) == {
        "kind": kind, "text": "text", "seq": 7, "severity": severity,
        "true_m": [102.0, 51.0, 3.0], "est_m": [105.0, 54.0, 6.0],
    }  # fmt: skip
    assert decoded(topics.LOG, written["/log"]).name == kind


def entities(topic: Topic, data: bytes) -> dict[str, Any]:
    return {entity.id: entity for entity in decoded(topic, data).entities}


def points(line: Any) -> list[tuple[float, float, float]]:
    return [xyz(point) for point in line.points]


def test_the_ground_has_the_areas_edge_home_and_fence() -> None:
    outline = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 7.0]])
    fence = [Zone(outline, keep_in=True), Zone(outline + 10.0, keep_in=False)]
    found = entities(topics.SCENE_GROUND, scene.ground(S, AREA, fence))
    edge = found["area"].lines[0]
    assert points(edge) == [(0, 0, 0), (400, 0, 0), (400, 300, 0), (0, 300, 0)]
    assert edge.type == 1  # closed
    assert xyz(found["home"].cylinders[0].pose.position)[:2] == (100.0, 50.0)
    assert xyz(found["home"].texts[0].pose.position)[:2] == (100.0, 50.0)
    assert {entity.frame_id for entity in found.values()} == {"map"}
    for name, zone, words, keep in (
        ("fence 0", fence[0], "fence", "in"), ("fence 1", fence[1], "no-fly area", "out"),
    ):  # fmt: skip
        made = found[name]
        assert points(made.lines[0]) == [(x, y, 0.0) for x, y in zone.outline_m.tolist()]
        assert made.lines[0].type == 1
        assert made.texts[0].text == words
        assert xyz(made.texts[0].pose.position)[:2] == tuple(zone.outline_m[0].tolist())
        assert [(pair.key, pair.value) for pair in made.metadata] == [("keep", keep)]


def test_a_building_has_walls_of_two_triangles_a_side_and_a_flat_roof() -> None:
    walls, roof = entities(topics.SCENE_BUILDINGS, scene.buildings(S, AREA))["buildings"].triangles
    corners = [xyz(point) for point in walls.points]
    ring = [tuple(row) for row in HALL.outlines_m[0].tolist()]
    assert len(corners) == 3 * 2 * 3
    area_m2 = 0.0
    for a, b, c in zip(*(iter(np.array(corners)),) * 3, strict=True):
        area_m2 += float(np.linalg.norm(np.cross(b - a, c - a))) / 2
        assert set(np.array([a, b, c])[:, 2]) == {3.0, 12.0}
        assert {tuple(p[:2].tolist()) for p in (a, b, c)} <= set(ring)
    around_m = 20.0 + 30.0 + math.hypot(20.0, 30.0)
    assert area_m2 == pytest.approx(9.0 * around_m)
    tops = [xyz(point) for point in roof.points]
    assert {z for _, _, z in tops} == {12.0}
    a, b, c = np.array(tops)[:, :2]
    assert abs(np.cross(np.append(b - a, 0), np.append(c - a, 0))[2]) / 2 == pytest.approx(300.0)


@pytest.mark.parametrize(
    ("importance", "sizes"),
    [((1.0, 0.25, 0.0), (22.0, 15.0, 8.0)), ((0.0, 0.0, 0.0), (8.0,) * 3),
     ((0.5, -0.1, 0.5), (22.0, 8.0, 22.0))],
)  # fmt: skip
def test_a_device_is_as_large_as_the_root_of_its_importance(
    importance: tuple[float, ...], sizes: tuple[float, ...]
) -> None:
    found = entities(topics.SCENE_DEVICES, scene.devices(S, WORLD, np.array(importance)))
    for k, size in enumerate(sizes):
        made = found[f"device {k}"]
        body = made.spheres[0]
        assert xyz(body.size) == pytest.approx((size,) * 3)
        x, y = WORLD.pos_m[k]
        assert xyz(body.pose.position) == pytest.approx((x, y, size / 2))  # on the ground
        assert xyz(made.texts[0].pose.position) == pytest.approx((x, y, size + 18.0))
        assert made.texts[0].text == str(k)
        assert {pair.key: pair.value for pair in made.metadata} == {
            "device": str(k), "community": WORLD.community[k], "importance": repr(importance[k]),
        }  # fmt: skip
    colours = [found[f"device {k}"].spheres[0].color for k in range(3)]
    assert colours[0] == colours[2] != colours[1]
    assert colours[0].a == 1.0


@pytest.mark.parametrize(("delivered", "thickness"), [(True, 4.0), (False, 1.5)])
def test_a_link_leads_from_the_aircraft_to_its_device(delivered: bool, thickness: float) -> None:
    record = UplinkRecord(
        1, 2, "a", 3, 4.0, 5, 6, 7, 8, 9, 10.0, 11.0, 12.0, 0.1, 0.2, 0.3, 0.4, delivered
    )
    made = entities(topics.SCENE_LINKS, scene.link(S, record, WORLD))["link 2"]
    assert points(made.lines[0]) == [(10.0, 11.0, 12.0), (50.0, 60.0, 0.0)]
    assert made.lines[0].thickness == thickness
    assert made.lines[0].type == 0  # open
    assert (made.lifetime.seconds, made.timestamp.seconds) == (4, 1)


def test_the_map_has_the_path_the_devices_and_the_fence() -> None:
    route = np.array([[100.0, 50.0], [100.0, 150.0]])
    slot_s = np.array([0.0, 10.0])
    plan = PlanRecord.of_flight(2, S, np.column_stack((route, [20.0, 20.0])), slot_s=slot_s)
    plan = PlanRecord(**{**vars(plan), "importance": np.array([1.0, 0.0, 0.0])})
    zones = [Zone(np.array([[100.0, 50.0], [200.0, 50.0], [200.0, 150.0]]), keep_in=keep)
             for keep in (True, False)]  # fmt: skip
    got = json.loads(decoded(topics.PLAN_MAP, scene.plan_map(AREA, WORLD, zones, plan)).geojson)[
        "features"
    ]
    path, *discs = got[:4]
    assert path["geometry"]["type"] == "LineString"
    first, last = path["geometry"]["coordinates"]
    assert first == [8.0, 47.0]
    assert (last[1] - 47.0) * 111_172 == pytest.approx(100.0, abs=0.1)
    assert path["properties"]["name"] == "round 2: plan"
    assert [disc["properties"]["name"] for disc in discs] == [
        "device 0 (a)", "device 1 (b)", "device 2 (a)",
    ]  # fmt: skip
    for disc, diameter in zip(discs, (22.0, 8.0, 8.0), strict=True):
        (ring,) = disc["geometry"]["coordinates"]
        assert ring[0] == ring[-1]
        assert len(ring) == 9
        lats = [lat for _, lat in ring]
        assert (max(lats) - min(lats)) * 111_172 == pytest.approx(diameter, abs=0.01)
    for shown, name in zip(got[4:], ("fence", "no-fly area"), strict=True):
        assert shown["properties"]["name"] == name
        ring = shown["geometry"]["coordinates"]
        assert ring[0] == ring[-1] == [8.0, 47.0]
        assert len(ring) == 4


def test_several_aircraft_have_their_paths_bodies_and_crosses() -> None:
    flown, planned = np.array([[0.0, 1, 2], [3, 4, 5]]), np.array([[0.0, 1], [3, 4]])
    paths = [("north", "#ff0000", 2.0, flown), ("south", "#00ff00", 2.0, flown),
             ("north", "#ff0000", 1.0, planned)]  # fmt: skip
    found = entities(
        topics.SCENE_LINKS, scene.world(S, paths, [(np.array([10.0, 20.0, 30.0]), "near")])
    )
    assert list(found) == ["paths of north", "north", "paths of south", "south", "near"]
    lines = found["paths of north"].lines
    assert [line.thickness for line in lines] == [2.0, 1.0]
    assert points(lines[0]) == [(0, 1, 2), (3, 4, 5)]
    assert points(lines[1]) == [(0, 1, 0), (3, 4, 0)]
    assert found["north"].frame_id == "north"
    assert (found["south"].spheres[0].color.r, found["south"].spheres[0].color.g) == (0.0, 1.0)
    one, two = (points(line) for line in found["near"].lines)
    assert sorted([*one, *two]) == sorted([(7.0, 20, 27), (13, 20, 33), (13, 20, 27), (7, 20, 33)])
    for (x, _, z), (x2, _, z2) in (one, two):  # across
        assert (x - 10) * (x2 - 10) < 0 > (z - 30) * (z2 - 30)


def data_of(events: list[tuple[int, str]], end_s: int = 100) -> FlightData:
    t_ns = np.array([0, end_s * S])
    track = Track(t_ns, np.zeros((2, 3)))
    at = (0.0, 0.0, 0.0)
    return FlightData(
        AREA, track, track, BatteryTrack(t_ns, *np.zeros((4, 2))),
        WindTrack(t_ns, np.zeros((2, 3))),
        tuple(EventRecord(t * S, "armed", text, None, 6, at, at) for t, text in events),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("events", "spans"),
    [
        ([], [(0, 100 * S + 1)]),
        ([(10, "armed"), (20, "disarmed")], [(10 * S, 20 * S)]),
        ([(20, "disarmed")], [(0, 20 * S)]),
        ([(10, "armed")], [(10 * S, 100 * S + 1)]),
        ([(10, "armed"), (12, "armed"), (20, "disarmed"), (22, "disarmed"), (30, "armed")],
         [(10 * S, 20 * S), (30 * S, 100 * S + 1)]),
    ],
)  # fmt: skip
def test_it_was_armed_between_its_words(
    events: list[tuple[int, str]], spans: list[tuple[int, int]]
) -> None:
    found = data_of(events)
    assert found.armed_ns == tuple(spans)
    flown = [event.t_ns for event in found.flown_events]
    assert flown == [t * S for t, _ in events if any(a <= t * S < b for a, b in spans)]


def test_energy_is_of_charge_or_else_of_current() -> None:
    """10 V; 1 mAh is 3.6 As."""
    t_ns = np.arange(5) * 2 * S
    charge = np.array([0.0, 1.0, NAN, 5.0, 6.0])
    made = BatteryTrack(t_ns, np.full(5, 10.0), np.full(5, 0.5), charge, np.linspace(1.0, 0.6, 5))
    assert made.energy_j(0, 8 * S) == pytest.approx(36.0 + 10.0 + 10.0 + 36.0)
    assert made.energy_j(0, 2 * S) == pytest.approx(36.0)
    assert math.isnan(made.energy_j(0, 2 * S - 1))
    assert made.left(2 * S) == 0.9
    assert made.left(2 * S - 1) == 1.0
    assert math.isnan(made.left(-1))
    wind = WindTrack(t_ns[:3], np.array([[3.0, 4.0, 9.0], [0, 1, 0], [6, 8, 0]]))
    assert wind.across_mps(0, 2 * S).tolist() == [5.0, 1.0]
    assert wind.across_mps(1, 4 * S).tolist() == [1.0, 10.0]


def test_a_track_is_cut_at_both_ends_and_read_between_samples() -> None:
    track = Track(np.array([0, 10, 20, 30]), np.arange(12.0).reshape(4, 3))
    assert track.between(10, 20).t_ns.tolist() == [10, 20]
    assert track.between(11, 19).t_ns.tolist() == []
    assert track.at(np.array([5, 30])).pos_m.tolist() == [[1.5, 2.5, 3.5], [9.0, 10.0, 11.0]]


def test_the_plan_of_a_flight_is_its_points_and_times() -> None:
    points_m = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 30.0], [40.0, 30.0, 30.0]])
    plan = PlanRecord.of_flight(3, 5, points_m, slot_s=np.array([0.0, 10.0, 40.0]))
    assert (plan.round, plan.t_ns, plan.value, plan.duration_s) == (3, 5, 0.0, 40.0)
    assert math.isnan(plan.upper_bound)
    assert (plan.path_budget_m, plan.path_m, plan.speed_mps) == (50.0, 50.0, 2.0)
    assert plan.altitude_m == 30.0
    assert plan.height_m.tolist() == [0.0, 30.0, 30.0]
    assert plan.schedule.shape == (3, 0)
    assert not plan.schedule.any()
    assert plan.importance.shape == (0,)
    assert plan.stops_at.tolist() == [0, 1, 2]
    assert plan.route_3d_m.tolist() == points_m.tolist()
    around = PlanRecord(**{**vars(plan), "route_m": np.zeros((5, 2))})
    assert around.route_height_m.tolist() == [30.0] * 5


def test_our_frame_is_the_areas_own() -> None:
    at = LocalFrame(HOME).to_ned(47.001, 8.001, 500.0)
    assert messages.area_xyz(AREA, at)[:2] == pytest.approx((100 + 76.06, 50 + 111.17), abs=0.05)
