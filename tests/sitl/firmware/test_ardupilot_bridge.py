"""The bridge to ArduPilot, against what its JSON backend sends and reads."""

import ctypes
import json
import math
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from firmware_stand_ins import ArduPilotStandIn, plant

from native.errors import FirmwareRestartedError, LinkLostError
from sitl.config import FirmwareConfig, VehicleConfig
from sitl.firmware.ardupilot import RATE_HZ, ArduPilotBridge
from sitl.firmware.native.library import Json, json_send
from sitl.firmware.vehicle import plant_rate_hz


@pytest.fixture
def bridge() -> Iterator[ArduPilotBridge]:
    bridge = ArduPilotBridge(plant(RATE_HZ), port=0)
    bridge.open()
    yield bridge
    bridge.close()


@pytest.fixture
def ardupilot(bridge: ArduPilotBridge) -> Iterator[ArduPilotStandIn]:
    stand_in = ArduPilotStandIn(bridge.port)
    yield stand_in
    stand_in.close()


@pytest.mark.parametrize(
    ("parameters", "rate_hz"),
    [({}, 800), ({"SCHED_LOOP_RATE": 200}, 400), ({"SCHED_LOOP_RATE": 100}, 250)],
)
def test_the_rate_follows_from_the_loops_of_the_firmware(
    parameters: dict[str, float], rate_hz: int
) -> None:
    firmware = FirmwareConfig(path=Path("arducopter"), parameters=parameters)
    vehicle = VehicleConfig(autopilot="ardupilot", firmware=firmware)
    assert plant_rate_hz(vehicle) == rate_hz


def test_a_request_is_one_tick_and_one_answer(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    for count in range(5):
        ardupilot.ask(count)
        assert bridge.run(1)
        answer = ardupilot.answer()
        assert answer["timestamp"] == pytest.approx((count + 1) / RATE_HZ)
    assert answer["imu"]["accel_body"] == pytest.approx([0, 0, -9.8], abs=1.0)
    assert answer["velocity"] == pytest.approx([0, 0, 0], abs=1.0)
    assert answer["attitude"][:2] == pytest.approx([0.0, 0.0], abs=0.02)
    assert math.cos(answer["attitude"][2]) == pytest.approx(1.0)
    assert answer["no_time_sync"] == 1
    assert ardupilot.lines() == []


def test_nothing_is_stepped_without_a_request(bridge: ArduPilotBridge) -> None:
    assert not bridge.run(1)
    assert bridge.plant.clock.tick == 0


def test_a_repeated_request_is_answered_again_without_a_step(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    ardupilot.ask(7)
    bridge.run(1)
    ardupilot.ask(7)
    assert not bridge.run(1)
    first, again = ardupilot.lines()
    assert first == again
    assert bridge.plant.clock.tick == 1


def test_requests_repeated_while_time_stands_still_are_answered_once(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    ardupilot.ask(1)
    bridge.run(1)
    ardupilot.answer()
    for _ in range(3):
        ardupilot.ask(2)
        bridge.rest()
    assert ardupilot.lines() == []
    assert bridge.run(1)
    assert ardupilot.answer()["timestamp"] == pytest.approx(2 / RATE_HZ)


def test_positions_have_the_errors_of_receiver_and_barometer(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    for count in range(RATE_HZ):
        ardupilot.ask(count)
        bridge.run(1)
        answer = ardupilot.answer()
    sensors, vehicle = bridge.plant.sensors, bridge.plant.vehicle
    assert sensors is not None
    n, e, d = vehicle.position_ned()
    en, ee, _ = sensors.receiver.error_ned_m
    assert answer["position"][:2] == pytest.approx([n + en, e + ee], abs=1e-4)
    assert 0.0 < abs(answer["position"][2] - d) < 1.0
    vn, ve, vd = vehicle.velocity_ned()
    un, ue, ud = sensors.receiver.velocity_error_ned_mps
    assert answer["velocity"] == pytest.approx([vn + un, ve + ue, vd + ud], abs=1e-4)


def test_its_port_is_free_again_once_it_is_closed() -> None:
    first = ArduPilotBridge(plant(RATE_HZ), port=0)
    first.open()
    second = ArduPilotBridge(plant(RATE_HZ), port=first.port)
    with pytest.raises(LinkLostError):
        second.open()
    first.close()
    second.open()
    second.close()


@pytest.mark.parametrize("magic", [18458, 29569])
def test_pulses_turn_the_motors_in_its_order(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn, magic: int
) -> None:
    for count in range(160):
        ardupilot.ask(count, (1000, 1200, 1400, 1600), magic=magic)
        bridge.run(1)
    rotors = bridge.plant.vehicle.rotor_speeds_radps()
    assert rotors[0] == pytest.approx(0.0, abs=1.0)
    assert 0 < rotors[1] < rotors[2] < rotors[3]


@pytest.mark.parametrize(
    ("pulses", "as_if"),
    [((2200, 2001, 2000, 2000), (2000,) * 4), ((800, 999, 0, 1000), (1000,) * 4)],
)
def test_a_pulse_out_of_range_is_one_at_its_end(
    ardupilot: ArduPilotStandIn,
    bridge: ArduPilotBridge,
    pulses: tuple[int, ...],
    as_if: tuple[int, ...],
) -> None:
    other = ArduPilotBridge(plant(RATE_HZ), port=0)
    other.open()
    beside = ArduPilotStandIn(other.port)
    for count in range(160):
        ardupilot.ask(count, pulses)
        beside.ask(count, as_if)
        assert bridge.run(1)
        assert other.run(1)
    turned = bridge.plant.vehicle.rotor_speeds_radps()
    assert turned == pytest.approx(other.plant.vehicle.rotor_speeds_radps(), rel=1e-12)
    assert (max(turned) > 100.0) == (as_if[0] > 1000)
    beside.close()
    other.close()


@pytest.mark.parametrize(
    ("stray", "said"),
    [
        (b"", "0 bytes"),
        (b"hello", "5 bytes"),
        (b"\x00" * 40, "magic number 0"),
        (b"\x1a\x48" + b"\x00" * 50, "52 bytes with the magic number 18458"),
    ],
)
def test_another_program_on_the_port_is_warned_of_once_and_not_taken_for_ardupilot(
    bridge: ArduPilotBridge,
    ardupilot: ArduPilotStandIn,
    caplog: pytest.LogCaptureFixture,
    stray: bytes,
    said: str,
) -> None:
    other = ArduPilotStandIn(bridge.port)
    for _ in range(3):
        other.send_bytes(stray)
        assert not bridge.run(1)
    assert not bridge.connected
    ardupilot.ask(0)
    assert bridge.run(1)
    assert ardupilot.answer()
    assert other.lines() == []
    assert caplog.text.count(said) == 1
    other.close()


def test_a_flood_does_not_keep_the_loop_from_returning(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    """A peer may repeat a request for ever, and each time it is answered."""
    ardupilot.ask(0)
    assert bridge.run(1)
    for _ in range(150):
        ardupilot.ask(0)
    assert not bridge.run(1)
    assert 1 < len(ardupilot.lines()) < 150


def test_a_new_process_is_followed_and_the_one_before_is_not_heard_again(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    for count in range(3):
        ardupilot.ask(count)
        assert bridge.run(1)
        ardupilot.answer()
    rebooted = ArduPilotStandIn(bridge.port)  # speaks from a port of its own
    rebooted.ask(0)
    with pytest.raises(FirmwareRestartedError, match="anew"):
        bridge.run(1)
    ardupilot.ask(3, (2000,) * 4)
    rebooted.ask(0)
    with pytest.raises(FirmwareRestartedError, match="anew"):
        bridge.run(1)
    assert ardupilot.lines() == []
    rebooted.close()


def test_a_count_that_falls_back_is_a_restart(
    bridge: ArduPilotBridge, ardupilot: ArduPilotStandIn
) -> None:
    ardupilot.ask(1000)
    bridge.run(1)
    ardupilot.ask(0)
    with pytest.raises(FirmwareRestartedError, match="anew"):
        bridge.run(1)


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (0.0, "0.00000"),
        (-0.0, "-0.00000"),
        (1.0, "1.00000"),
        (-12.345678, "-12.34568"),
        (0.000004, "0.00000"),
        (-0.000006, "-0.00001"),
        (99999.999996, "100000.00000"),
        (123456789.5, "123456789.50000"),
        (1e300, "1e+300"),
        (math.inf, "inf"),
        (-math.inf, "-inf"),
        (math.nan, "nan"),
    ],
)
def test_numbers_are_written_as_printf_does(value: float, written: str) -> None:
    state = Json(socket=-1, state=(value,), errors=(-0.0,))
    json_send(ctypes.addressof(state))  # to no socket
    text = bytes(state.reply[: state.size]).decode()
    assert f'"position":[{written},0.00000,0.00000]' in text


def test_numbers_are_what_python_writes_but_for_ties() -> None:
    rng = random.Random(1)
    for _ in range(2000):
        values = [rng.uniform(-1, 1) * 10 ** rng.randint(-6, 5) for _ in range(15)]
        state = Json(socket=-1, sample=tuple(values[:6]), state=tuple(values[6:]))
        state.world.t_ns = 1_234_500_000_000
        json_send(ctypes.addressof(state))
        answer = json.loads(bytes(state.reply[: state.size]))
        imu = answer["imu"]
        assert answer["timestamp"] == 1234.5
        for name, got, digits in (
            ("gyro", imu["gyro"], 8),
            ("accel_body", imu["accel_body"], 7),
            ("position", answer["position"], 5),
            ("velocity", answer["velocity"], 5),
            ("attitude", answer["attitude"], 7),
        ):
            expected, values = values[:3], values[3:]
            assert got == pytest.approx(expected, abs=0.51 * 10.0**-digits, rel=1e-14), name
