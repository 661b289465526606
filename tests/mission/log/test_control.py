"""Attitude, rates, setpoints and motors in the log, at the rate of the control."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pyulog import ULog
from scipy.spatial.transform import Rotation, Slerp
from synthetic_flight import AREA

import aerofed
from mission.base.tables import annotated
from mission.cli import call
from mission.log import ForeignLogError, control, topics
from mission.log.contents import load
from mission.log.reader import decode, read_log
from mission.log.values import ControlTrack, FlightData, Track

QUIET = ("--no-report", "--no-figures", "--quiet")


def fly(folder: Path, *keys: str) -> int:
    plan = folder / "p.waypoints"
    rows = [(22, 0.0, 0.0), (16, 0.0, 5e-4), (16, 5e-4, 5e-4)]
    lines = [
        f"{seq}\t0\t3\t{command}\t0\t0\t0\tnan\t{47 + north}\t{8 + east}\t20\t1"
        for seq, (command, north, east) in enumerate(rows)
    ]
    plan.write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    words = [word for key in keys for word in ("--set", key)]
    return call(["fly", str(plan), *QUIET, "--out", str(folder / "out"), *words])


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    assert fly(folder) == 0
    return folder / "out" / "flight.mcap"


@pytest.fixture(scope="module")
def data(flown: Path) -> FlightData:
    return read_log(flown)


def seen(data: FlightData) -> ControlTrack:
    assert data.control is not None
    return data.control


def test_it_is_there_fifty_times_a_second_while_armed(data: FlightData) -> None:
    t_ns = seen(data).t_ns
    assert set(np.diff(t_ns)) == {20_000_000}
    armed = [event.t_ns for event in data.events if event.kind == "armed"]
    assert 0 <= t_ns[0] - armed[0] <= 20_000_000
    assert 0 <= armed[1] - t_ns[-1] <= 100_000_000  # up to the last sample


def test_it_says_what_the_other_topics_say(flown: Path, data: FlightData) -> None:
    track, contents = seen(data), load(flown)
    poses = dict(contents.decoded(topics.EST_POSE))
    both = [k for k, t_ns in enumerate(track.t_ns.tolist()) if t_ns in poses]
    turns = [poses[t_ns].pose.orientation for t_ns in track.t_ns[both].tolist()]
    posed = Rotation.from_quat([(q.x, q.y, q.z, q.w) for q in turns])
    turned = Rotation.from_quat(track.attitude[both])
    assert (posed.inv() * turned).magnitude().max() < 3e-4


def test_rates_are_those_of_the_attitude_and_orders_are_followed(data: FlightData) -> None:
    track = seen(data)
    t_s = track.t_ns / 1e9
    turned = Rotation.from_quat(track.attitude)
    between = Slerp(t_s, turned)(t_s[:-1] + 0.01)
    turning = (turned[:-1].inv() * turned[1:]).as_rotvec() / 0.02
    rates = (track.rates_radps[:-1] + track.rates_radps[1:]) / 2
    assert np.sqrt(((turning - rates) ** 2).mean()) < 0.05
    assert len(between) == len(rates)
    ordered = Rotation.from_quat(track.attitude_setpoint)
    assert np.degrees((turned.inv() * ordered).magnitude()).mean() < 5.0
    air = track.position_setpoint_m[:, 2] > 5.0
    speed = np.gradient(track.position_setpoint_m[:, :2], t_s, axis=0)
    assert abs(speed - track.velocity_setpoint_mps[:, :2])[air].max() < 0.3
    east = np.argmax(track.velocity_setpoint_mps[:, 0])
    assert track.yaw_setpoint_rad[east, 0] == pytest.approx(0.0, abs=0.1)
    assert 0.1 < track.thrust_setpoint[air].mean() < 0.4
    assert 0.2 < track.motors[air].mean() < 0.6
    assert (track.motors[-1] < 0.2).all()  # idling


def test_rows_come_back_as_they_went() -> None:
    rows = np.random.default_rng(1).normal(size=(7, 31))
    rows[:, 0] = np.arange(7) * 20_000_000
    rows[3, 20:] = np.nan
    told_rows = list(control.messages(AREA, rows))
    times = np.array([t_ns for t_ns, _ in told_rows])
    track = control.track(times, [data for _, data in told_rows])
    np.testing.assert_array_equal(track.t_ns, rows[:, 0])
    frd_to_flu = np.array([1.0, -1.0, -1.0])
    np.testing.assert_allclose(track.rates_radps, rows[:, 5:8] * frd_to_flu, atol=2e-4)
    np.testing.assert_allclose(track.rates_setpoint_radps, rows[:, 12:15] * frd_to_flu, atol=2e-4)
    np.testing.assert_allclose(track.motors, rows[:, 16:20], atol=2e-4)
    enu = rows[:, [24, 23, 25]] * [1, 1, -1]
    np.testing.assert_allclose(track.velocity_setpoint_mps, enu, atol=2e-4)
    np.testing.assert_allclose(track.yaw_setpoint_rad[:, 0], np.pi / 2 - rows[:, 29], atol=2e-4)
    place = AREA.from_ned(rows[:, 20:23])
    np.testing.assert_allclose(track.position_setpoint_m[:, :2], place, atol=2e-4)
    assert np.isnan(track.position_setpoint_m[3]).all()
    ned_to_enu = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    flu_to_frd = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    for at, found in ((1, track.attitude), (8, track.attitude_setpoint)):
        given = Rotation.from_quat(rows[:, [at + 1, at + 2, at + 3, at]])
        apart = (ned_to_enu * given * flu_to_frd).inv() * Rotation.from_quat(found)
        assert apart.magnitude().max() < 1e-3


def test_what_was_told_and_done_is_north_east_down_in_degrees() -> None:
    row = np.arange(31.0) / 8.0
    row[0], row[1:5], row[8:12] = 2e9, [1.0, 0, 0, 0], np.array([1.0, 0, 0, 1.0]) / np.sqrt(2.0)
    (t_ns, data), *_ = control.messages(AREA, np.array([row, row]))
    track = control.track(np.array([t_ns]), [data])
    at = AREA.xyz(np.array([[1.0, 2.0, -3.0], [5.0, 2.0, -4.0]]))
    belief = Track(np.array([0, 2_000_000_000]), at)
    found = control.signals(AREA, track, belief)
    expected: dict[str, Any] = {
        "wanted_position_m": row[20:23], "wanted_velocity_mps": row[23:26],
        "wanted_attitude_deg": [0.0, 0.0, 90.0], "attitude_deg": [0.0, 0.0, 0.0],
        "wanted_rates_degps": np.degrees(row[12:15]), "rates_degps": np.degrees(row[5:8]),
        "motors": row[16:20], "position_m": [1.0, 2.0, -3.0], "velocity_mps": [2.0, 0.0, -0.5],
    }  # fmt: skip
    assert set(found) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name].values[0], values, atol=0.02, err_msg=name)
    assert found["motors"].t_s.tolist() == [2.0]
    assert found["position_m"].t_s.tolist() == [0.0, 2.0]
    alone = control.signals(AREA, track, Track(belief.t_ns[:1], at[:1]))
    assert not {"position_m", "velocity_mps"} & set(alone)


def test_any_reader_of_protobuf_reads_it(flown: Path, data: FlightData) -> None:
    track = seen(data)
    with flown.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = [row for *_, row in reader.iter_decoded_messages(topics=["/control"])]
    assert len(found) == len(track.t_ns)
    for name, axes in annotated(ControlTrack, tuple):
        values = np.array([getattr(row, name) for row in found])
        assert values.shape == (len(found), len(axes))
        np.testing.assert_array_equal(values, getattr(track, name))


def test_another_layout_is_refused(flown: Path) -> None:
    contents = load(flown)
    first = contents.messages["/control"][0]
    first.data = first.data[:-4]
    with pytest.raises(ForeignLogError, match=r"^[^\n]*a record is not what its schema says"):
        decode(contents)


def test_tables_and_ulog_have_it(flown: Path, data: FlightData, tmp_path: Path) -> None:
    track = seen(data)
    frame = aerofed.load(flown.parent).table("control")
    assert len(frame) == len(track.t_ns)
    np.testing.assert_array_equal(frame["motors_2"], track.motors[:, 2])
    for form in ("parquet", "ulog"):
        out = tmp_path / ("x.ulg" if form == "ulog" else "tables")
        assert call(["log", "export", str(flown), "--to", form, "--out", str(out)]) == 0
    table = pq.read_table(tmp_path / "tables" / "control.parquet")
    np.testing.assert_array_equal(table["attitude_w"], track.attitude[:, 3])
    found = {item.name: item.data for item in ULog(str(tmp_path / "x.ulg")).data_list}
    rates, local = found["vehicle_angular_velocity"], found["vehicle_local_position_setpoint"]
    np.testing.assert_array_equal(rates["timestamp"], track.t_ns // 1000)
    np.testing.assert_array_equal(rates["xyz[1]"], -track.rates_radps[:, 1].astype(np.float32))
    np.testing.assert_array_equal(local["vx"], track.velocity_setpoint_mps[:, 1].astype(np.float32))
    np.testing.assert_array_equal(
        found["actuator_motors"]["control[3]"], track.motors[:, 3].astype(np.float32)
    )
    wanted, attitude = found["vehicle_attitude_setpoint"], found["vehicle_attitude"]
    apart = [wanted[f"q_d[{k}]"] * attitude[f"q[{k}]"] for k in range(4)]
    assert np.abs(np.sum(apart, axis=0)).mean() > 0.999
    assert {"vehicle_rates_setpoint"} <= set(found)


def test_the_rate_is_a_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fly(tmp_path, "vehicle.control_rate_hz=30") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(r"control_rate_hz = 30: the guidance rate 50 is no multiple", line)
    assert fly(tmp_path, "vehicle.control_rate_hz=0") == 0
    assert read_log(tmp_path / "out" / "flight.mcap").control is None
    (tmp_path / "slow").mkdir()
    assert fly(tmp_path / "slow", "vehicle.control_rate_hz=10") == 0
    assert set(np.diff(seen(read_log(tmp_path / "slow/out/flight.mcap")).t_ns)) == {100_000_000}
