"""The log, read back by the format's own reader and by ours."""

import contextlib
import dataclasses
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import foxglove.channel
import numpy as np
import pymap3d
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation
from synthetic_flight import AREA, CONFIG, Fixed, devices, fly, fly_anew

from flightdyn.state import BatteryState, Kinematics
from mission.base.airspace import Airspace
from mission.base.errors import InputError
from mission.log import DamagedLogError, ForeignLogError, LogError
from mission.log.contents import load
from mission.log.reader import decode, read_log
from mission.log.sink import McapSink
from mission.log.topics import TOPICS, Topic, fields
from mission.log.vehicle import RATES_HZ
from mission.log.writer import FlightLog
from sitl.observer import VehicleEvent, VehicleSample


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fixed:
    return fly(tmp_path_factory.mktemp("run"), rounds=2)


def kinematics(t_ns: int, *, pos=(0.0, 0.0, 0.0), q=(1.0, 0.0, 0.0, 0.0)) -> Kinematics:
    zero = np.zeros(3)
    return Kinematics(t_ns, np.array(pos), zero, np.array(q), zero)


def sample(t_ns: int, **truth: tuple[float, ...]) -> VehicleSample:
    battery = BatteryState(22.0, 30.0, 100.0, 0.9)
    state = kinematics(t_ns, **truth)
    return VehicleSample(t_ns, state, state, None, battery, "hold", armed=True)


def messages(path: Path, topic: str) -> list[tuple[int, Any]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (m.message.log_time, m.decoded_message)
            for m in reader.iter_decoded_messages(topics=[topic])
        ]


def test_the_standard_reader_finds_index_statistics_and_well_known_schemas(made: Fixed) -> None:
    with made.log.open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.chunk_indexes
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
    found = {
        c.topic: summary.schemas[c.schema_id].name if c.schema_id else ""
        for c in summary.channels.values()
    }
    schemas = {topic.name: topic.schema_name for topic in TOPICS}
    missing = {"/fence", "/mission", "/setpoint", "/radio/believed", "/radio/true"}  # it has none
    assert found == {name: schemas[name] for name in schemas.keys() - missing}
    assert found["/true/pose"] == found["/est/pose"] == "foxglove.PoseInFrame"
    assert found["/tf"] == "foxglove.FrameTransform"
    assert found["/gnss"] == "foxglove.LocationFix"
    assert found["/scene/links"] == "foxglove.SceneUpdate"
    counts = {
        summary.channels[c].topic: n for c, n in summary.statistics.channel_message_counts.items()
    }
    assert counts["/true/pose"] == counts["/est/pose"] == len(made.samples)
    assert counts["/uplinks"] == len(made.uplinks)


def test_what_was_recorded_comes_back(made: Fixed) -> None:
    data = read_log(made.log)
    assert data.rounds == tuple(made.rounds)
    assert data.uplinks == tuple(made.uplinks)
    assert data.area == AREA
    assert data.devices.community == made.world.community
    np.testing.assert_array_equal(data.devices.pos_m, made.world.pos_m)
    assert [plan.round for plan in data.plans] == [1, 2]
    for plan, problem, record in zip(made.plans, made.problems, data.plans, strict=True):
        np.testing.assert_array_equal(record.waypoints_m, plan.waypoints_m)
        np.testing.assert_array_equal(record.schedule, plan.schedule[0])
        np.testing.assert_array_equal(record.importance, problem.importance)
        assert record.value == plan.value
        legs = np.linalg.norm(np.diff(plan.waypoints_m, axis=0), axis=1)
        np.testing.assert_allclose(record.slot_s[1:], np.cumsum(legs) / 20.0)
    assert data.attachments["config.toml"] == CONFIG
    assert data.metadata["run"] == {"seed": "1"}
    assert [item.community for item in data.learning] == ["digits", "colour-shapes"] * 2
    assert data.battery.remaining[0] == 1.0
    reached = [event for event in data.events if event.kind == "reached"]
    assert [event.seq for event in reached] == [
        step for plan in made.plans for step in range(len(plan.waypoints_m))
    ]


def test_tracks_are_the_samples_to_half_a_millimetre(made: Fixed) -> None:
    data = read_log(made.log)
    true = np.array([s.truth.pos_ned_m for s in made.samples])
    est = np.array([s.belief.pos_ned_m for s in made.samples])
    for ned, track in ((true, data.truth), (est, data.belief)):
        home = np.array([*AREA.home_m, 0.0])
        up = [AREA.frame.to_geodetic(row).alt_msl_m - AREA.home.alt_msl_m for row in ned]
        enu = np.column_stack((ned[:, 1], ned[:, 0], up)) + home
        np.testing.assert_array_equal(track.t_ns, [s.t_ns for s in made.samples])
        np.testing.assert_allclose(track.pos_m, enu, rtol=0, atol=0.5 / 2**10 + 1e-6)


def test_attitude_and_gnss_agree_with_scipy_and_pymap3d(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RATES_HZ, "location", 10.0)
    monkeypatch.setitem(RATES_HZ, "tf", 10.0)
    world = devices(np.random.default_rng(5))
    log_path = tmp_path / "a.mcap"
    quaternions = Rotation.random(20, random_state=5).as_quat(scalar_first=True)
    with FlightLog(log_path, area=AREA, devices=world) as log:
        for index, q in enumerate(quaternions):
            log.sampled(sample(index * 100_000_000, pos=(10.0 * index, -7.0 * index, -60.0), q=q))
    frd_to_flu = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    ned_to_enu = Rotation.from_matrix([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    for (_, message), (_, tf), q in zip(
        messages(log_path, "/true/pose"), messages(log_path, "/tf"), quaternions, strict=True
    ):
        o = message.pose.orientation
        expected = ned_to_enu * Rotation.from_quat(q, scalar_first=True) * frd_to_flu.inv()
        error = Rotation.from_quat([o.x, o.y, o.z, o.w]) * expected.inv()
        assert error.magnitude() < 5e-5
        assert str(tf.rotation) == str(o)
        assert str(tf.translation) == str(message.pose.position)
        assert (tf.parent_frame_id, tf.child_frame_id) == ("map", "base_link")
    home = AREA.home
    for index, (_, fix) in enumerate(messages(log_path, "/true/location")):
        lat, lon, alt = pymap3d.ned2geodetic(
            10.0 * index, -7.0 * index, -60.0, home.lat_deg, home.lon_deg, home.alt_msl_m
        )
        assert fix.latitude == pytest.approx(lat, abs=4e-9)
        assert fix.longitude == pytest.approx(lon, abs=4e-9)
        assert fix.altitude == pytest.approx(alt, abs=6e-4)


def test_gnss_carries_the_instant_it_describes_and_its_variance(made: Fixed) -> None:
    fixes = [s.gnss for s in made.samples if s.gnss is not None]
    logged = messages(made.log, "/gnss")
    assert len(logged) == len(fixes)
    for (_, message), fix in zip(logged[:50], fixes, strict=False):
        assert message.timestamp.ToNanoseconds() == fix.t_ns
        assert message.position_covariance[0] == pytest.approx(0.81)
        assert message.position_covariance[8] == pytest.approx(2.25)


def test_the_same_run_gives_the_same_bytes(made: Fixed, tmp_path: Path) -> None:
    again = fly_anew(tmp_path, rounds=2)
    assert again.log.read_bytes() == made.log.read_bytes()
    for name in ("rounds.csv", "uplinks.csv"):
        assert (tmp_path / name).read_bytes() == (made.log.parent / name).read_bytes()
    other = tmp_path / "other"
    other.mkdir()
    assert fly(other, rounds=2, seed=2).log.read_bytes() != made.log.read_bytes()


@pytest.mark.parametrize(("pace", "most_s"), [(1.0, 2), (math.inf, 10)])
def test_at_most_ten_seconds_are_not_yet_on_their_way_to_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pace: float, most_s: int
) -> None:
    """Of simulated time; two where it runs at the pace of wall time."""
    t_ns = 0
    clock = SimpleNamespace(monotonic=lambda: t_ns * 1e-9 / pace)
    monkeypatch.setattr("mission.log.writer.time", clock)
    path = tmp_path / "open.mcap"
    log = FlightLog(path, area=AREA, devices=devices(np.random.default_rng(1)))
    for index in range(450):
        t_ns = index * 50_000_000
        log.sampled(sample(t_ns))
        newest = 0
        with path.open("rb") as stream, contextlib.suppress(McapError):  # it has no end yet
            for record in StreamReader(stream).records:
                newest = max(newest, getattr(record, "log_time", 0))
        assert t_ns - newest < most_s * 1_000_000_000
    log.close()


class Viewer:
    """A sink that remembers what it was shown."""

    def __init__(self) -> None:
        self.shown: list[tuple[str, int]] = []
        self.bytes = 0
        self.closed = False

    def write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        self.shown.append((topic.name, t_ns))
        self.bytes += len(data)

    def flush(self) -> None: ...

    def close(self) -> None:
        self.closed = True


def test_viewers_are_sent_away_from_a_file_that_cannot_be_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: McapSink) -> None:
        raise LogError(tmp_path, "No space left on device")

    viewer = Viewer()
    log = FlightLog(
        tmp_path / "a.mcap",
        area=AREA,
        devices=devices(np.random.default_rng(1)),
        mirrors=[viewer],
    )
    monkeypatch.setattr(McapSink, "close", full)
    with pytest.raises(LogError, match="No space left"):
        log.close()
    assert viewer.closed
    monkeypatch.undo()
    log.close()


def test_what_happens_is_written_after_the_samples_before_it(tmp_path: Path) -> None:
    viewer = Viewer()
    world = devices(np.random.default_rng(1))
    with FlightLog(tmp_path / "a.mcap", area=AREA, devices=world, mirrors=[viewer]) as log:
        for t_ns in (0, 100_000_000, 200_000_000):
            log.sampled(sample(t_ns))
        log.happened(VehicleEvent(250_000_000, "mode", "HOLD", kinematics(0), kinematics(0)))
        log.sampled(sample(300_000_000))
        log.note("a line of our own")
        log.sampled(sample(400_000_000))
    pose, line = "/true/pose", "/log"
    assert [(topic, t_ns / 1e9) for topic, t_ns in viewer.shown if topic in {pose, line}] == [
        *((pose, 0.0), (pose, 0.1), (pose, 0.2), (line, 0.25)),
        *((pose, 0.3), (line, 0.3), (pose, 0.4)),
    ]
    with (tmp_path / "a.mcap").open("rb") as stream:
        written = [
            m.log_time for _, c, m in make_reader(stream).iter_messages() if c.topic == "/est/pose"
        ]
    assert written == [0, 1e8, 2e8, 3e8, 4e8]


def test_a_log_that_is_closed_leaves_nothing_in_the_library(tmp_path: Path) -> None:
    before = len(foxglove.channel._channels_by_id)
    FlightLog(tmp_path / "a.mcap", area=AREA, devices=devices(np.random.default_rng(1))).close()
    assert len(foxglove.channel._channels_by_id) == before


def test_ground_and_devices_come_with_every_plan(made: Fixed) -> None:
    """Viewers drop what comes at the very start of a log."""
    plans = [t_ns for t_ns, _ in messages(made.log, "/plan/path")]
    assert len(plans) == 2
    assert [t_ns for t_ns, _ in messages(made.log, "/scene/ground")] == [0, *plans]


def test_slots_never_reached_and_missing_bounds_survive(tmp_path: Path) -> None:
    made = fly(tmp_path, rounds=1)
    nan = math.nan
    missed = dataclasses.replace(
        made.uplinks[0], slot_t_s=nan, est_x_m=nan, est_y_m=nan, est_alt_m=nan, true_x_m=nan,
        true_y_m=nan, true_alt_m=nan, est_per=nan, true_per=1.0, delivered=False,
    )  # fmt: skip
    unbound = dataclasses.replace(made.rounds[0], upper_bound=nan)
    path = tmp_path / "missed.mcap"
    with FlightLog(path, area=AREA, devices=made.world) as log:
        log.plan(0, 0, made.problems[0], dataclasses.replace(made.plans[0], upper_bound=nan),
                 speed_mps=20.0)  # fmt: skip
        log.uplinks([missed])
        log.round(unbound)
    data = read_log(path)
    assert repr(data.uplinks) == repr((missed,))  # NaN is not equal to itself, its text is
    assert repr(data.rounds) == repr((unbound,))
    assert math.isnan(data.plans[0].upper_bound)
    assert not messages(path, "/scene/links")


def fits(value: object, schema: dict[str, Any]) -> bool:
    """Whether a value is of a JSON schema's type (the parts of the standard that are used)."""
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if isinstance(value, list):
        return "array" in kinds and all(fits(item, schema["items"]) for item in value)
    if isinstance(value, dict):
        named, others = schema.get("properties", {}), schema.get("additionalProperties")
        return "object" in kinds and all(
            fits(item, named.get(key, others)) for key, item in value.items()
        )
    names = {bool: "boolean", int: "integer", float: "number", str: "string", type(None): "null"}
    name = names[type(value)]
    return name in kinds or (name == "integer" and "number" in kinds)


def test_json_schemas_describe_every_field_that_is_written(made: Fixed) -> None:
    with made.log.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding == "json":
                assert schema is not None
                described = fields(schema.data)
                values = json.loads(message.data)
                assert list(values) == list(described), channel.topic
                for key, value in values.items():
                    assert "description" in described[key]
                    assert fits(value, described[key]), (channel.topic, key, value)


def test_json_schemas_are_plain_enough_for_the_viewers() -> None:
    """Lichtblick and Foxglove Studio 1.48 refuse a topic with any other kind of property."""
    for topic in TOPICS:
        if topic.schema_encoding == "jsonschema":
            schema = json.loads(topic.schema)
            for name, field in schema["properties"].items():
                kind = field["items"]["type"] if field["type"] == "array" else field["type"]
                assert kind in {"boolean", "string", "number", "integer"}, (topic.name, name)
            patterns = {
                name
                for name in fields(topic.schema)
                if any(re.search(pattern, name) for pattern in schema["patternProperties"])
            }
            assert not patterns & set(schema["properties"])
            assert patterns | set(schema["properties"]) == set(schema["required"])


def test_severity_becomes_the_level_of_a_log_line(tmp_path: Path) -> None:
    path = tmp_path / "levels.mcap"
    state = kinematics(5)
    with FlightLog(path, area=AREA, devices=devices(np.random.default_rng(1))) as log:
        for severity in range(8):
            event = VehicleEvent(5, "status", f"s{severity}", state, state, severity=severity)
            log.happened(event)
        log.happened(VehicleEvent(5, "failsafe", "battery low", state, state))
    levels = [message.level for _, message in messages(path, "/log")]
    assert levels == [5, 5, 5, 4, 3, 2, 2, 1, 3]


def test_an_exception_in_the_run_leaves_a_complete_log(tmp_path: Path) -> None:
    path = tmp_path / "failed.mcap"

    def fail() -> None:
        with FlightLog(path, area=AREA, devices=devices(np.random.default_rng(1))) as log:
            log.sampled(sample(0))
            raise RuntimeError("in flight")

    with pytest.raises(RuntimeError, match="in flight"):
        fail()
    assert len(read_log(path).truth.t_ns) == 1


def test_an_area_with_its_airspace_is_logged_without_it(tmp_path: Path) -> None:
    """The vehicle's fence says what of it was flown by."""
    ring = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]])
    site = dataclasses.replace(AREA.site, airspace=Airspace((ring,), 50.0 * ring))
    area = dataclasses.replace(AREA, site=site)
    world = devices(np.random.default_rng(1))
    FlightLog(tmp_path / "a.mcap", area=area, devices=world).close()
    assert read_log(tmp_path / "a.mcap").area == AREA


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.mcap: cannot be read: No such file"):
        read_log(tmp_path / "gone.mcap")
    text = tmp_path / "text.mcap"
    text.write_text("not a log")
    with pytest.raises(ForeignLogError, match=r"text\.mcap: not an MCAP file"):
        read_log(text)
    with pytest.raises(InputError, match="cannot write"):
        FlightLog(tmp_path / "no" / "a.mcap", area=AREA, devices=devices(np.random.default_rng(1)))


def test_an_unfinished_log_is_named_as_cut(tmp_path: Path, made: Fixed) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(made.log.read_bytes()[:20_000])
    with pytest.raises(DamagedLogError, match=r"damaged at byte \d+: the file ends .*log recover"):
        read_log(cut)


def test_a_corner_in_the_place_of_the_next_waypoint_is_not_taken_for_it(tmp_path: Path) -> None:
    made = fly(tmp_path, rounds=1)
    waypoints = made.plans[0].waypoints_m
    none = np.empty((0, 2))
    via = (np.array([waypoints[1], waypoints[1] + 9.0]), *[none] * (len(waypoints) - 2))
    path = tmp_path / "around.mcap"
    with FlightLog(path, area=AREA, devices=made.world) as log:
        log.plan(0, 0, made.problems[0], made.plans[0].with_own(via_m=via),
                 speed_mps=20.0)  # fmt: skip
    (plan,) = read_log(path).plans
    np.testing.assert_array_equal(plan.stops_at, [0, *range(3, len(waypoints) + 2)])
    np.testing.assert_array_equal(plan.route_m[plan.stops_at], waypoints)


def test_a_log_of_another_version_is_refused_in_one_line(made: Fixed) -> None:
    contents = load(made.log)
    contents.metadata["aerofed"]["format"] = "1"
    with pytest.raises(ForeignLogError, match=r"log format '1', this version reads '2'"):
        decode(contents)


@pytest.mark.parametrize("part", [r"message \d+", "its schema"])
def test_what_is_no_protobuf_is_refused_in_one_line(made: Fixed, part: str) -> None:
    contents = load(made.log)
    if part == "its schema":
        contents.schema("/true/pose").data = b"\xff" * 9
    else:
        contents.messages["/true/pose"][7].data = b"\xff" * 9
    with pytest.raises(ForeignLogError, match=rf"^.*/true/pose: {part} does not decode: .*$"):
        decode(contents)
