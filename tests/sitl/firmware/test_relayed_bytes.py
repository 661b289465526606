"""Bytes that go between firmwares, stations and us, by MAVLink's tables."""

import struct
from typing import Any

import pytest
from pymavlink.dialects.v10 import common as old
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import frozen
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix
from sitl.autopilot.codec.wire import Seal
from sitl.firmware.px4 import gps_payload
from sitl.firmware.relay import Packet, Writer, packets

BEAT = mav.MAVLink_heartbeat_message(2, 12, 81, 65536, 4, 3)
NEW = bytes(BEAT.pack(mav.MAVLink(None, srcSystem=7, srcComponent=9)))
SIGNED = Seal(b"k" * 32, link_id=0).sealed(NEW)
OLD = bytes(
    old.MAVLink_heartbeat_message(2, 12, 81, 65536, 4, 3).pack(old.MAVLink(None, srcSystem=3))
)


def test_frames_of_both_versions_are_told_apart() -> None:
    named = mav.MAVLink_autopilot_version_message(0, 1, 2, 3, 4, [0] * 8, [0] * 8, [0] * 8, 5, 6, 7)
    long = bytes(named.pack(mav.MAVLink(None, srcSystem=1, srcComponent=1)))
    found = list(packets(NEW + OLD + SIGNED + long))
    assert found == [
        Packet(NEW, 0, 7, 9), Packet(OLD, 0, 3, 0), Packet(SIGNED, 0, 7, 9),
        Packet(long, 148, 1, 1),
    ]  # fmt: skip


@pytest.mark.parametrize("frame", [NEW, OLD, SIGNED], ids=["2", "1", "signed"])
def test_what_is_no_whole_frame_ends_a_datagram(frame: bytes) -> None:
    whole = list(packets(frame))
    assert len(whole) == 1
    for end in range(len(frame)):
        assert list(packets(frame[:end])) == []
        assert list(packets(frame + frame[:end])) == whole
    assert list(packets(frame + b"noise, noise" + frame)) == whole


def test_the_shortest_frames_are_whole() -> None:
    empty = b"\xfe\x00\x05\x01\x02\x42\x34\x12"
    assert list(packets(empty)) == [Packet(empty, 0x42, 1, 2)]
    empty = b"\xfd\x00\x00\x00\x05\x01\x02\x42\x01\x00\x34\x12"
    assert list(packets(empty)) == [Packet(empty, 0x142, 1, 2)]


def heard(data: bytes) -> Any:
    messages: Any = mav.MAVLink(None).parse_buffer(data)
    return messages[0]


def test_a_battery_is_said_in_the_units_of_the_table() -> None:
    writer = Writer(7)
    told = heard(writer.battery(BatteryState(15.2, 12.5, 1234.4, 0.5), 5000.0)).to_dict()
    assert told == {
        "mavpackettype": "BATTERY_STATUS", "id": 0, "battery_function": 1, "type": 1,
        "temperature": 2000, "voltages": [3800] * 4 + [65535] * 6, "current_battery": 1250,
        "current_consumed": 1234, "energy_consumed": -1, "battery_remaining": 50,
        "time_remaining": 720, "charge_state": 0, "voltages_ext": [0] * 4, "mode": 0,
        "fault_bitmask": 0,
    }  # fmt: skip
    # While the motors are off electronics take a tenth of an ampere.
    idle = heard(writer.battery(BatteryState(16.8, 0.0, 0.0, 0.01), 5000.0))
    assert (idle.time_remaining, idle.current_battery) == (1800, 0)
    assert (idle.get_srcSystem(), idle.get_srcComponent(), idle.get_seq()) == (7, 180, 1)


def test_parameters_are_numbered_like_all_that_is_sent() -> None:
    writer = Writer(7)
    for number in (*range(256), 0):
        said = heard(writer.parameter("SIM_GPS1_ENABLE", 0.5))
        assert said.get_seq() == number
    assert (said.target_system, said.target_component) == (0, 0)
    assert (said.param_id, said.param_value, said.param_type) == ("SIM_GPS1_ENABLE", 0.5, 9)


@pytest.mark.parametrize(("satellites", "said"), [(14, 14), (254, 254), (255, 254), (300, 254)])
def test_a_fix_for_px4_is_hil_gps(satellites: int, said: int) -> None:
    fix = GnssFix(1, frozen([0.0, 0.0, 0.0]), frozen([3.0, -4.0, 1.25]), 0.75, 1.5, 0.1, satellites)
    payload = gps_payload(123_456, fix, GeodeticPoint(47.5, -8.25, 500.125))
    assert struct.unpack("<QiiiHHHhhhHBB", payload) == (
        123_456, 475000000, -82500000, 500125, 75, 150, 500, 300, -400, 125, 65535, 3, said,
    )  # fmt: skip
