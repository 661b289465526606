"""What a telemetry log says, message by message: MAVLink's numbers, units and unknown values."""

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as apm
from pymavlink.dialects.v20 import common as mav

from mission.base.errors import InputError
from mission.flight.logs.tlog import KIND
from mission.flight.missions.mission_path import items_of
from mission.log.values import COPTER, PLANE, ROVER, FlightData

NAN = math.nan
S = 1_000_000_000
BEGIN_S = 1e9  # of the recorder's clock
Told = tuple[float, Any]  # when (s of the vehicle, and of the recorder since it began), what
PX4, ARDUPILOT = 12, 3


def heartbeat(
    autopilot: int = PX4, custom: int = 0, *, kind: int = 2, base: int = 1, state: int = 4
) -> Any:
    return mav.MAVLink_heartbeat_message(kind, autopilot, base, custom, state, 3)


def position(t_s: float, north: int = 0, alt_mm: int = 500_000) -> Any:
    return mav.MAVLink_global_position_int_message(
        round(1e3 * t_s), 470_000_000 + north, 80_000_000, alt_mm, 1000, 100, -200, 300, 0
    )


def content(told: Sequence[tuple[Any, ...]], *, first: bool = False) -> bytes:
    """Messages, with `first` as MAVLink 1: each with its time, and the system and component that
    say it; 1, 1 unless they are given."""
    out, senders = bytearray(), dict[tuple[int, int], Any]()
    for t_s, message, *who in told:
        system, component = (*who, 1, 1)[:2] if len(who) != 1 else (who[0], 1)
        sender = senders.setdefault((system, component), apm.MAVLink(None, system, component))
        stamp = struct.pack(">Q", round((BEGIN_S + t_s) * 1e6))
        out += stamp + bytes(message.pack(sender, force_mavlink1=first))
        sender.seq = (sender.seq + 1) % 256
    return bytes(out)


def read(path: Path, *told: tuple[Any, ...], first: Any = None) -> FlightData:
    """A log that begins with a heartbeat and a position, and ends with one 100 s later."""
    ends = [(0.0, first or heartbeat()), (0.0, position(0.0)), *told, (100.0, position(100.0, 100))]
    (path / "x.tlog").write_bytes(content(ends))
    return KIND.flight(path / "x.tlog")


def test_positions_have_their_units(tmp_path: Path) -> None:
    found = read(tmp_path, (50.0, position(50.0, 200, 520_000)))
    assert found.belief.t_ns.tolist() == [0, 50 * S, 100 * S]
    home = found.area.home
    assert (home.lat_deg, home.lon_deg, home.alt_msl_m) == (47.0, 8.0, 500.0)
    # 200 * 1e-7 degrees of latitude.
    np.testing.assert_allclose(np.diff(found.belief.pos_m[:2, 1]), 2.2239, atol=2e-3)
    np.testing.assert_allclose(found.belief.pos_m[:, 2], [0.0, 20.0, 0.0], atol=1e-6)
    signals = found.signals
    assert signals["velocity_mps"].values[0].tolist() == [1.0, -2.0, 3.0]
    assert signals["height_m"].values[:, 0].tolist() == [1.0] * 3


@pytest.mark.parametrize(
    ("kind", "vehicle"),
    [
        (1, PLANE), (2, COPTER), (3, COPTER), (4, COPTER), (10, ROVER), (11, ROVER), (13, COPTER),
        (19, PLANE), (20, PLANE), (21, PLANE), (22, PLANE), (23, PLANE), (24, PLANE), (25, PLANE),
        (29, COPTER), (35, COPTER), (12, COPTER),
    ],
)  # fmt: skip
def test_a_vehicle_is_what_its_heartbeat_says(tmp_path: Path, kind: int, vehicle: str) -> None:
    assert read(tmp_path, first=heartbeat(kind=kind)).vehicle == vehicle


@pytest.mark.parametrize("kind", [5, 6, 18, 26, 27, 28, 30, 34, 37, 42])
def test_what_is_no_vehicle_is_not_the_autopilot(tmp_path: Path, kind: int) -> None:
    """MAV_TYPE: antenna tracker 5, ground station 6, gimbal 26, and so on."""
    with pytest.raises(InputError, match="no positions"):
        read(tmp_path, first=heartbeat(kind=kind))


@pytest.mark.parametrize(
    ("message", "state"),
    [
        ((12_000, 250, 80), (12.0, 2.5, 0.8)),
        ((65_535, -1, 0), (NAN, NAN, 0.0)),
        ((65_534, -100, 100), (65.534, NAN, 1.0)),
        ((12_000, -2, 80), (12.0, -0.02, 0.8)),
        ((12_000, 250, -1), None),
    ],
)
def test_a_battery_has_its_units_and_what_is_not_known(
    tmp_path: Path, message: tuple[int, int, int], state: tuple[float, ...] | None
) -> None:
    told = mav.MAVLink_sys_status_message(0, 0, 0, 0, *message, 0, 0, 0, 0, 0, 0)
    # Another reading, so that a battery has a voltage at all.
    usual = mav.MAVLink_sys_status_message(0, 0, 0, 0, 11_000, 100, 50, 0, 0, 0, 0, 0, 0)
    got = read(tmp_path, (10.0, told), (20.0, usual)).battery
    assert got.t_ns.tolist() == [10 * S, 20 * S][state is None :]
    assert np.isnan(got.consumed_mah).all()
    first = got.voltage_v[0], got.current_a[0], got.remaining[0]
    np.testing.assert_allclose(first, state or (11.0, 1.0, 0.5))


def test_state_and_events_are_the_vehicles(tmp_path: Path) -> None:
    armed, manual = 128 | 1, 1 << 16
    mission, hold = 4 << 16 | 4 << 24, 4 << 16 | 3 << 24
    found = read(
        tmp_path,
        (10.0, heartbeat(custom=mission, base=armed)),
        (11.0, heartbeat(custom=hold, base=armed, state=5)),
        (12.0, heartbeat(custom=hold, base=armed, state=6)),
        (13.0, heartbeat(custom=hold, base=armed, state=4)),
        (14.0, heartbeat(custom=hold, base=armed, state=8)),
        (15.0, mav.MAVLink_fence_status_message(1, 1, 1, 0)),
        (16.0, mav.MAVLink_statustext_message(3, b"look out")),
        (17.0, mav.MAVLink_mission_item_reached_message(4)),
        (18.0, mav.MAVLink_mission_current_message(5)),
        (19.0, mav.MAVLink_mission_current_message(5)),
        (20.0, heartbeat(8, custom=mission, base=armed)),  # of no autopilot: a camera, say
        (21.0, heartbeat(custom=hold, base=1)),
        (22.0, mav.MAVLink_fence_status_message(1, 1, 1, 0)),
        first=heartbeat(custom=manual, base=1),
    )
    told = [(e.t_ns // S, e.kind, e.text, e.severity, e.seq) for e in found.events]
    modes = [(row[0], row[2]) for row in told if row[1] == "mode"]
    assert modes == [(0, "MANUAL"), (10, "MISSION"), (11, "LOITER")]
    assert [row for row in told if row[1] != "mode"] == [
        (10, "armed", "armed", 6, None),
        (11, "failsafe", "failsafe", 4, None),
        (14, "failsafe", "failsafe", 4, None),
        (15, "failsafe", "fence breached", 4, None),
        (16, "status", "look out", 3, None),
        (17, "reached", "item 4", 6, 4),
        (21, "armed", "disarmed", 6, None),
    ]
    assert [each.tolist() for each in found.current] == [[18 * S], [5]]


def test_wind_home_and_fixes_have_their_fields(tmp_path: Path) -> None:
    home = 469_000_000, 79_000_000, 490_000, 0, 0, 0, [1.0, 0, 0, 0], 0, 0, 0

    def fix(kind: int) -> Any:
        return mav.MAVLink_gps_raw_int_message(0, kind, 470_000_000, 80_000_000, 1, 2, 3, 4, 5, 6)

    found = read(
        tmp_path,
        (1.0, mav.MAVLink_home_position_message(*home)),
        (2.0, mav.MAVLink_wind_cov_message(0, 3.0, 4.0, 0, 0, 0, 0, 0, 0)),
        *((float(10 + kind), fix(kind)) for kind in range(1, 5)),
    )
    home_ = found.area.home
    assert (home_.lat_deg, home_.lon_deg, home_.alt_msl_m) == (46.9, 7.9, 490.0)
    assert found.wind.vel_mps.tolist() == [[4.0, 3.0, 0.0]]
    assert found.gnss_ns.tolist() == [13 * S, 14 * S]


def test_without_the_vehicles_own_positions_the_receivers_count(tmp_path: Path) -> None:
    def fix(t_s: float, kind: int, alt_mm: int) -> Told:
        at = 470_000_000, 80_000_000, alt_mm
        return t_s, mav.MAVLink_gps_raw_int_message(0, kind, *at, 2, 3, 4, 5, 6)

    def attitude(t_s: float, boot_s: float) -> Told:
        return t_s, mav.MAVLink_attitude_message(round(1e3 * boot_s), 0, 0, 0, 0, 0, 0)

    told: list[Told] = [
        (0.0, heartbeat()), attitude(0.0, 60.0), fix(5.0, 3, 500_000), fix(5.5, 2, 0),
        attitude(10.0, 80.0), fix(15.0, 3, 530_000),
    ]  # fmt: skip
    (tmp_path / "x.tlog").write_bytes(content(told))
    found = KIND.flight(tmp_path / "x.tlog")
    # Between two times of the vehicle's, and past the last by the recorder's.
    assert found.belief.t_ns.tolist() == [70 * S, 85 * S]
    assert found.area.home.alt_msl_m == 500.0
    assert found.source.utc_ns is None  # the clocks do not go equally fast


def test_utc_is_the_vehicles_word_or_else_the_recorders(tmp_path: Path) -> None:
    assert read(tmp_path).source.utc_ns == round(BEGIN_S * S)
    system_time = mav.MAVLink_system_time_message
    found = read(
        tmp_path,
        (1.0, system_time(0, 1000)),
        (2.0, system_time(5, 0)),
        (3.0, system_time(1_700_000_003_000_000, 3000)),
    )
    assert found.source.utc_ns == 1_700_000_000 * S


def test_signals_have_their_units_and_masks(tmp_path: Path) -> None:
    degree = math.pi / 180

    def told(t_s: float) -> list[Told]:
        ms = round(1e3 * t_s)
        return [
            (t_s, message)
            for message in (
                mav.MAVLink_attitude_message(
                    ms, 1 * degree, 2 * degree, 3 * degree, 4 * degree, 5 * degree, 6 * degree
                ),
                mav.MAVLink_nav_controller_output_message(7, 8, 9, 0, 0, 1.5, 0, 0),
                mav.MAVLink_local_position_ned_message(ms, 1, 2, -3, 4, 5, -6),
                mav.MAVLink_vibration_message(0, 1, 2, 3, 4, 5, 6),
                apm.MAVLink_ekf_status_report_message(0, 0.1, 0.2, 0.3, 0.4, 0.5),
                mav.MAVLink_gps_raw_int_message(0, 3, 1, 1, 1, 120, 3, 4, 5, 14, h_acc=1500),
                mav.MAVLink_position_target_global_int_message(
                    ms, 6, 0, 471_000_000, 81_000_000, 5, 0, 0, 0, 0, 0, 0, 0, 0
                ),
                mav.MAVLink_position_target_local_ned_message(
                    ms, 1, 8, 1, 2, 3, 4, 5, 6, 0, 0, 0, 0, 0
                ),
                mav.MAVLink_battery_status_message(
                    1, 0, 0, 0, [4000, 3900] + [65535] * 8, 250, 0, 0, 90
                ),
            )
        ]

    for autopilot in (PX4, ARDUPILOT):
        got = read(tmp_path, *told(10.0), *told(20.0), first=heartbeat(autopilot)).signals
        expected = {
            "attitude_deg": [1.0, 2.0, 3.0], "rates_degps": [4.0, 5.0, 6.0],
            "wanted_attitude_deg": [7.0, 8.0, 9.0], "height_error_m": [1.5],
            "position_m": [1.0, 2.0, -3.0], "velocity_mps": [4.0, 5.0, -6.0],
            "clips": [4.0, 5.0, 6.0], "innovation_ratio": [0.1, 0.2, 0.3, 0.4],
            "gnss_fix": [3.0], "satellites": [14.0], "hdop": [1.2], "gnss_accuracy_m": [1.5],
            "goal_deg": [47.1, 8.1], "voltage_v": [NAN, 7.9], "current_a": [NAN, 2.5],
            "remaining": [NAN, 0.9],
            "vibration_mps2": [1.0, 2.0, 3.0] if autopilot == ARDUPILOT else [3.0],
        }  # fmt: skip
        if autopilot == PX4:
            expected["wanted_position_m"] = [1.0, 2.0, 3.0]
            assert "wanted_velocity_mps" not in got  # masked
        for name, values in expected.items():
            np.testing.assert_allclose(got[name].values[-1], values, rtol=1e-6, err_msg=name)
        assert got["attitude_deg"].t_s.tolist() == [10.0, 20.0]


def upload(
    to: int, rows: Sequence[tuple[int, int]], *, kind: int = 0, sender: int = 255
) -> list[tuple[Any, ...]]:
    """A count and items (number, command) to a system."""
    told: list[tuple[Any, ...]] = [
        (20.0, mav.MAVLink_mission_count_message(to, 1, len(rows), kind), sender, 190)
    ]
    for seq, command in rows:
        item = mav.MAVLink_mission_item_int_message(
            to, 1, seq, 3, command, 0, 1, 1.0, 2.0, 3.0, 4.0, 471_000_000, 81_000_000, 25.0, kind
        )
        told.append((20.0, item, sender, 190))
    return told


def ack(kind: int = 0, result: int = 0, to: int = 255) -> tuple[Any, ...]:
    return 21.0, mav.MAVLink_mission_ack_message(to, 190, result, kind)


ITEMS = [(0, 16), (1, 22)]


@pytest.mark.parametrize(
    ("told", "kinds"),
    [
        ([*upload(1, ITEMS), ack()], ["mission"]),
        ([*upload(1, ITEMS, kind=1), ack(1)], ["fence"]),
        ([*upload(1, ITEMS, kind=2), ack(2)], ["rally"]),
        ([*upload(1, ITEMS, kind=3), ack(3)], []),
        ([*upload(1, ITEMS), ack(1)], []),  # of another list
        ([*upload(1, ITEMS), ack(0, 1)], []),  # refused
        ([*upload(1, ITEMS), ack(0, 13), ack()], ["mission"]),  # a number out of turn: goes on
        ([*upload(1, ITEMS)[:2], ack()], []),  # not whole
        ([*upload(1, ITEMS), ack(), ack()], ["mission"]),
        ([*upload(1, ITEMS), ack(to=254)], []),
        ([*upload(1, ITEMS)[1:], ack()], []),  # nobody counted them
        ([*upload(1, []), ack()], []),
    ],
)
def test_a_list_counts_when_it_is_accepted_whole(
    tmp_path: Path, told: list[tuple[Any, ...]], kinds: list[str]
) -> None:
    found = read(tmp_path, *told)
    assert [mission.kind for mission in found.missions] == kinds
    for mission in found.missions:
        first, second = items_of(mission)
        assert mission.t_ns == 21 * S
        assert (first.command, second.command) == (16, 22)
        assert second.params == (1.0, 2.0, 3.0, 4.0)
        assert (second.x, second.y, second.z) == (47.1, 8.1, 25.0)


def test_item_0_of_ardupilot_is_home(tmp_path: Path) -> None:
    for kind, command in ((0, 0), (2, 16)):
        told = [*upload(1, ITEMS, kind=kind), ack(kind)]
        (mission,) = read(tmp_path, *told, first=heartbeat(ARDUPILOT)).missions
        assert [item.command for item in items_of(mission)] == [command, 22]


def test_a_position_that_comes_late_is_not_read(tmp_path: Path) -> None:
    """By the vehicle's numbers, which go round at 256."""
    whole = content([(0.0, heartbeat()), *((float(t), position(t)) for t in range(1, 300))])
    packets, at = list[bytes](), 0
    while at < len(whole):
        end = at + 8 + whole[at + 9] + 12
        packets.append(whole[at:end])
        at = end
    for n in (50, 256):  # beside the turn of the numbers
        packets[n], packets[n + 1] = packets[n + 1], packets[n]
    (tmp_path / "x.tlog").write_bytes(b"".join(packets))
    found = KIND.flight(tmp_path / "x.tlog")
    assert found.source.skipped == {"position that came late": 2}
    assert len(found.belief.t_ns) == 297


@pytest.mark.parametrize(("late", "read"), [(1, 299), (127, 299), (128, 300), (200, 300)])
def test_what_is_late_by_half_of_all_numbers_is_ahead(tmp_path: Path, late: int, read: int) -> None:
    """Positions each 10 ms, one of which comes so many numbers later."""
    packets = [content([(0.0, heartbeat())])]
    sender = mav.MAVLink(None, 1, 1)
    for n in range(300):
        sender.seq = (n + 1) % 256
        stamp = struct.pack(">Q", round((BEGIN_S + 0.01 * n) * 1e6))
        packets.append(stamp + bytes(position(0.01 * n).pack(sender)))
    packets.insert(20 + late, packets.pop(20))
    (tmp_path / "x.tlog").write_bytes(b"".join(packets))
    assert KIND.flight(tmp_path / "x.tlog").source.skipped.get("position that came late", 0) == (
        300 - read
    )


def test_only_a_clock_of_the_recorder_that_was_set_back_by_a_second_is_mended(
    tmp_path: Path,
) -> None:
    """What has no time of the vehicle's own lies between its neighbours."""
    text = mav.MAVLink_statustext_message(6, b"here")
    for back_s, at_s in ((0.5, 30.0), (1.5, 29.0), (1.501, 30.0), (60.0, 30.0)):
        later_s = back_s if back_s > 2.0 else 0.0
        told = [
            (0.0, heartbeat()), (0.0, position(0.0)), (30.0, position(30.0)),
            (30.5 - back_s, text), (31.0 - later_s, position(31.0)),
            (40.0 - later_s, position(40.0)),
        ]  # fmt: skip
        (tmp_path / "x.tlog").write_bytes(content(told))
        (event,) = (e for e in KIND.flight(tmp_path / "x.tlog").events if e.kind == "status")
        assert event.t_ns / S == pytest.approx(at_s, abs=1e-3)


def test_another_dialect_and_damage_are_counted(tmp_path: Path) -> None:
    whole = content([(0.0, heartbeat()), (0.0, position(0.0)), (9.0, position(9.0, 100))])
    stamp = whole[:8]
    frame = b"\xfd\x03\x00\x00\x00\x01\x01\xff\xff\x7f" + b"abc" + b"\0\0"
    (tmp_path / "x.tlog").write_bytes(whole + b"damage" + whole[:29] + stamp + frame)
    found = KIND.flight(tmp_path / "x.tlog")
    assert found.source.skipped["byte with damage"] >= 6


def test_of_another_component_what_is_the_autopilots_is_counted(tmp_path: Path) -> None:
    said = [
        (5.0, position(5.0), 1, 2), (5.0, mav.MAVLink_statustext_message(6, b"x"), 1, 2),
        (5.0, mav.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0), 1, 2),
        (5.0, position(5.0), 2, 1), (5.0, mav.MAVLink_statustext_message(6, b"x"), 2, 1),
    ]  # fmt: skip
    found = read(tmp_path, *said)
    assert found.source.skipped == {
        "message of another component": 2, "position of another vehicle": 1,
    }  # fmt: skip
    assert not [e for e in found.events if e.kind == "status"]
    assert found.belief.t_ns.tolist() == [0, 100 * S]


@pytest.mark.parametrize("first", [False, True])
def test_of_two_starts_that_were_joined_the_longer_flight_counts(
    tmp_path: Path, first: bool
) -> None:
    """The only heartbeat stands before both."""
    begun = heartbeat(custom=4 << 16 | 4 << 24 | 7, base=1)
    told: list[Told] = [(0.0, mav.MAVLink_statustext_message(6, b"hello")), (0.0, begun)]
    told += [(float(t), position(t, 1000 * t)) for t in range(50, 60)]
    told += [(60.0 + t, position(t, 1000 * t)) for t in range(30)]
    (tmp_path / "x.tlog").write_bytes(content(told, first=first))
    found = KIND.flight(tmp_path / "x.tlog")
    assert found.belief.t_ns.tolist() == [t * S for t in range(30)]
    (said,) = (words for words in found.source.skipped if words.startswith("stretch"))
    assert said.startswith("stretch of 50.0 to 59.0 s")


def test_motors_are_the_outputs_that_parameters_name(tmp_path: Path) -> None:
    outputs = [1000 + 25 * n for n in range(16)]
    named = [
        mav.MAVLink_param_value_message(f"SERVO{servo}_FUNCTION".encode(), function, 9, 1, 0)
        for servo, function in ((1, 34.0), (16, 33.0))
    ]
    servos = mav.MAVLink_servo_output_raw_message(0, 0, *outputs[:8], *outputs[8:])
    found = read(
        tmp_path, *((1.0, each) for each in named), (2.0, servos), (3.0, servos),
        first=heartbeat(ARDUPILOT),
    )  # fmt: skip
    np.testing.assert_allclose(found.signals["motors"].values, [[0.375, 0.0]] * 2)
