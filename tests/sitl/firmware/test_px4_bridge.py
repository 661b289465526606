"""The bridge to PX4, against pymavlink's reading and writing of the same messages."""

import ctypes
import math
import socket
import struct
from collections.abc import Iterator
from typing import Any

import pytest
from firmware_stand_ins import Px4StandIn, plant
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME

from flightdyn.config import SensorsConfig
from flightdyn.faults import GnssOff
from native.errors import FirmwareError, FirmwareRestartedError, InputError, LinkLostError
from sitl.firmware.bridge import give_up_soon
from sitl.firmware.native.library import GONE, NOTHING, ORDERED, Hil, hil_send, hil_wait
from sitl.firmware.px4 import Px4Bridge


@pytest.fixture
def bridge() -> Iterator[Px4Bridge]:
    bridge = Px4Bridge(plant(), port=0)
    bridge.open()
    yield bridge
    bridge.close()


@pytest.fixture
def px4(bridge: Px4Bridge) -> Iterator[Px4StandIn]:
    stand_in = Px4StandIn(bridge.port)
    yield stand_in
    stand_in.close()


def fly(bridge: Px4Bridge, px4: Px4StandIn, ticks: int, *motors: float) -> None:
    for _ in range(ticks):
        px4.control(bridge.plant.t_ns // 1000, motors)
        while not bridge.run(1):
            pass


def tick_often(bridge: Px4Bridge) -> None:
    for _ in range(100):
        bridge.run(1)


def test_sensor_frames_are_what_pymavlink_reads(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    fly(bridge, px4, 100)
    sensors = [m for m in px4.hear() if m.get_type() == "HIL_SENSOR"]
    assert [m.time_usec for m in sensors] == [4000 * n for n in range(1, 101)]
    assert all(m.id == 0 for m in sensors)
    for n, m in enumerate(sensors, start=1):
        baro, mag = n % 20 == 0, n % 50 == 0  # every 0.08 s and 0.2 s
        assert m.fields_updated == 0x3F | 0x1A00 * baro | 0x1C0 * mag
        assert (m.abs_pressure != 0.0) == baro
        assert (m.xmag != 0.0) == mag
    rest = sensors[10:]
    mean = [sum(getattr(m, f"{axis}acc") for m in rest) / len(rest) for axis in "xyz"]
    assert mean == pytest.approx([0.0, 0.0, -9.8], abs=0.7)  # the turn-on bias has a std of 0.2
    assert all(abs(m.zgyro) < 0.05 for m in rest)
    assert sensors[19].abs_pressure == pytest.approx(
        bridge.plant.vehicle.pressure_pa() / 100, abs=0.1
    )
    assert sensors[19].pressure_alt == pytest.approx(HOME.alt_msl_m, abs=2.0)
    field = math.hypot(sensors[49].xmag, sensors[49].ymag, sensors[49].zmag)
    assert field == pytest.approx(math.hypot(0.214, 0.013, 0.430), abs=0.03)


def test_gnss_solutions_come_at_their_rate_and_with_their_delay(
    bridge: Px4Bridge, px4: Px4StandIn
) -> None:
    fly(bridge, px4, 250)
    fixes = [m for m in px4.hear() if m.get_type() == "HIL_GPS"]
    assert [m.time_usec for m in fixes] == [200_000 * n + 120_000 for n in range(1, 5)]
    for m in fixes:
        assert m.fix_type == 3
        assert m.lat / 1e7 == pytest.approx(HOME.lat_deg, abs=5e-5)
        assert m.lon / 1e7 == pytest.approx(HOME.lon_deg, abs=5e-5)
        assert m.alt / 1e3 == pytest.approx(HOME.alt_msl_m, abs=12.0)
        assert (m.eph, m.epv, m.satellites_visible) == (70, 197, 14)
        assert math.hypot(m.vn, m.ve) == pytest.approx(m.vel, abs=1.0)


def test_a_receiver_that_is_off_gives_no_solutions(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    bridge.plant.inject(GnssOff())
    fly(bridge, px4, 100)
    assert not [m for m in px4.hear() if m.get_type() == "HIL_GPS"]


def test_each_tick_waits_for_the_answer_to_the_one_before(
    bridge: Px4Bridge, px4: Px4StandIn
) -> None:
    assert bridge.run(1)  # PX4 boots: it answers nothing yet
    assert bridge.run(1)
    px4.control(8000)
    while not bridge.motors or bridge.booting:
        bridge.run(1)
    ticks = bridge.plant.clock.tick
    for _ in range(3):
        assert not bridge.run(1)  # nothing was answered since
    assert bridge.plant.clock.tick == ticks
    px4.control((ticks - 1) * 4000)
    assert not bridge.run(1)  # late: an answer to the tick before that
    px4.control(ticks * 4000)
    assert bridge.run(1)


def test_the_motors_turn_as_px4_says_and_in_its_order(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    fly(bridge, px4, 50, 0.0, 0.2, 0.4, 0.6)
    rotors = bridge.plant.vehicle.rotor_speeds_radps()
    assert rotors[0] == pytest.approx(0.0, abs=1.0)
    assert 0 < rotors[1] < rotors[2] < rotors[3]


def test_full_power_lifts_the_aircraft(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    fly(bridge, px4, 125, 0.9, 0.9, 0.9, 0.9)
    assert bridge.plant.truth.alt_rel_m > 1.0


def test_other_and_damaged_frames_are_passed_over(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    bridge.run(1)
    out = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    whole = bytes(mav.MAVLink_hil_actuator_controls_message(4000, [0.5] * 16, 129, 1).pack(out))
    damaged = bytearray(whole)
    damaged[40] ^= 0xFF
    command = bytes(
        mav.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0).pack(out)
    )
    px4.send_bytes(b"\x00\xfd\x13junk" + bytes(damaged) + command + whole[:30])
    bridge.run(1)
    assert bridge.motors == (0.0, 0.0, 0.0, 0.0)
    px4.send_bytes(whole[30:])
    bridge.run(1)
    assert bridge.motors == (0.5, 0.5, 0.5, 0.5)


@pytest.mark.parametrize("chunk", [1, 7, 50, 1000])
def test_frames_are_found_however_they_arrive(
    bridge: Px4Bridge, px4: Px4StandIn, chunk: int
) -> None:
    out = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    bridge.run(1)
    bridge.run(1)
    for n in range(20):
        answered = bridge.plant.t_ns // 1000
        sent = b"".join(
            bytes(message.pack(out))
            for message in (
                mav.MAVLink_hil_actuator_controls_message(answered - 4000, [0.9] * 16, 129, 1),
                mav.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3),
                mav.MAVLink_hil_actuator_controls_message(answered, [n / 20] * 16, 129, 1),
                mav.MAVLink_statustext_message(6, b"and more"),
            )
        )
        for at in range(0, len(sent), chunk):
            px4.send_bytes(sent[at : at + chunk])
        while not bridge.run(1):
            pass
        assert bridge.motors == pytest.approx((n / 20,) * 4)


def test_px4_without_lockstep_is_refused(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    bridge.run(1)
    px4.control(4000, flags=0)
    with pytest.raises(FirmwareError, match="without lockstep"):
        tick_often(bridge)


def test_an_answer_to_what_was_sent_last_is_not_waited_for_again() -> None:
    for sent_us, answered_us, ordered in ((8000, 8000, True), (8000, 4000, False), (0, 0, False)):
        state = Hil(socket=-1, sent_us=sent_us, answered_us=answered_us)
        assert (hil_wait(ctypes.addressof(state), 0) == ORDERED) is ordered


def test_px4_that_hangs_up_is_noticed(bridge: Px4Bridge, px4: Px4StandIn) -> None:
    bridge.run(1)
    px4.close()
    with pytest.raises(FirmwareRestartedError, match="hung up"):
        tick_often(bridge)


def test_a_wait_for_px4_ends_after_a_tenth_of_a_second() -> None:
    """The kernel counts it, in its own ticks."""
    with socket.socket() as ours:
        give_up_soon(ours)
        for way in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            seconds, rest_us = struct.unpack("ll", ours.getsockopt(socket.SOL_SOCKET, way, 16))
            assert seconds + rest_us / 1e6 == pytest.approx(0.1, abs=0.02)


def test_what_px4_does_not_take_is_sent_when_it_does() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        give_up_soon(ours)
        theirs.setblocking(False)
        link = Hil(socket=ours.fileno())
        at, sent = ctypes.addressof(link), 0
        while link.left == 0:
            sent += 1
            link.world.t_ns = 4_000_000 * sent
            assert hil_send(at, bytes(36)) == (NOTHING if link.left else ORDERED)
        assert hil_wait(at, True) == NOTHING  # in bounded time
        assert link.left > 0
        reader, heard = mav.MAVLink(None), list[Any]()
        while link.left:
            heard += reader.parse_buffer(theirs.recv(1 << 20)) or []
            assert hil_wait(at, True) == NOTHING
        heard += reader.parse_buffer(theirs.recv(1 << 20)) or []
        assert [m.time_usec for m in heard if m.get_type() == "HIL_SENSOR"] == [
            4000 * n for n in range(1, sent + 1)
        ]
        theirs.close()
        assert hil_send(at, None) == GONE


def test_a_port_that_is_taken_is_named(bridge: Px4Bridge) -> None:
    other = Px4Bridge(plant(), port=bridge.port)
    with pytest.raises(LinkLostError, match=f"TCP port {bridge.port}: .*in use"):
        other.open()


def test_a_firmware_flies_on_sensors() -> None:
    perfect = plant(sensors=SensorsConfig(kind="perfect"))
    with pytest.raises(InputError, match="must be 'realistic'"):
        Px4Bridge(perfect)
