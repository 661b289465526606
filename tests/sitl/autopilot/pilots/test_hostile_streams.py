"""Setpoints, sticks, targets and files whose every field may hold anything: the vehicle lives."""

import math
import random
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of
from sitl_mavsdk import make_vehicle

from sitl.autopilot.flying.modes import Mode
from sitl.config import VehicleConfig

KINDS = (
    mav.MAVLink_set_position_target_local_ned_message,
    mav.MAVLink_set_position_target_global_int_message,
    mav.MAVLink_set_attitude_target_message,
    mav.MAVLink_manual_control_message,
    mav.MAVLink_rc_channels_override_message,
    mav.MAVLink_follow_target_message,
    mav.MAVLink_log_request_list_message,
    mav.MAVLink_log_request_data_message,
    mav.MAVLink_log_request_end_message,
    mav.MAVLink_log_erase_message,
    mav.MAVLink_file_transfer_protocol_message,
    mav.MAVLink_serial_control_message,
    mav.MAVLink_param_ext_set_message,
    mav.MAVLink_gps_rtcm_data_message,
    mav.MAVLink_play_tune_message,
)
COMMANDS = (
    mav.MAV_CMD_DO_ORBIT,
    mav.MAV_CMD_DO_CHANGE_ALTITUDE,
    mav.MAV_CMD_DO_SET_ROI,
    mav.MAV_CMD_DO_SET_ROI_LOCATION,
    mav.MAV_CMD_DO_SET_ROI_NONE,
)
HOSTILE = (0.0, -0.0, 1.0, -1.0, 5.0, 89.9, math.nan, math.inf, -math.inf, 1e-40, 3.4e38, -3.4e38)
_ADDRESSES = {"target_system": 1, "target_component": 1, "target": 1}


def anything(kind: Any, rng: random.Random) -> Any:
    """A message of a kind with hostile numbers in some fields and random bits in others."""
    values: list[Any] = []
    for name, form in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        count = kind.array_lengths[kind.ordered_fieldnames.index(name)]
        if name in _ADDRESSES:
            values.append(_ADDRESSES[name])
        elif form == "char":
            values.append(bytes(rng.randrange(1, 127) for _ in range(count)))
        else:
            parts = [_number(form, rng) for _ in range(max(count, 1))]
            values.append(parts if count else parts[0])
    return kind(*values)


def _number(form: str, rng: random.Random) -> float | int:
    if form == "float":
        return rng.choice(HOSTILE)
    size = {"8": 1, "1": 2, "3": 4, "6": 8}[form.removeprefix("u").removeprefix("int")[0]]
    letter = "bhxixxxq"[size - 1]
    bits = rng.randbytes(size) if rng.random() < 0.7 else b"\0" * size
    return int(struct.unpack("<" + (letter.upper() if form[0] == "u" else letter), bits)[0])


def alive(desk: Desk) -> bool:
    """Whether it still answers and flies on its own numbers."""
    place = of(desk.pass_wall_time(1.5), "GLOBAL_POSITION_INT")[-1]
    return abs(place.lat) <= 900_000_000 and "Internal" not in "".join(desk.texts())


@pytest.mark.parametrize("mode", [None, Mode.OFFBOARD, Mode.POSITION, Mode.STABILIZED, Mode.FOLLOW])
def test_anything_may_come_in_any_mode(mode: Mode | None) -> None:
    rng = random.Random(7)
    desk = Desk()
    desk.take_off()
    for turn in range(40):
        if mode is not None and turn % 10 == 0:
            desk.send(
                mav.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0),
                mav.MAVLink_set_position_target_local_ned_message(
                    0, 1, 1, 1, 0b110111000111, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
                ),
            )
            desk.command(mav.MAV_CMD_DO_SET_MODE, 129, *mode.value)
        for kind in KINDS:
            desk.send(anything(kind, rng))
        for command in COMMANDS:
            desk.command(command, *(rng.choice(HOSTILE) for _ in range(7)))
        desk.fly(seconds=0.1)
    assert alive(desk)
    assert desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 4, 3) == mav.MAV_RESULT_ACCEPTED


def test_the_real_aircraft_flies_on_whatever_is_streamed() -> None:
    """What passes the checks can be flown: the physics stays finite."""
    rng = random.Random(3)
    config = VehicleConfig.model_validate({"aircraft": {"sensors": {"kind": "perfect"}}})
    aircraft = make_vehicle(config=config).aircraft
    desk = Desk(aircraft=aircraft)
    desk.take_off(80.0)
    sane = mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b110111000111, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    for _ in range(100):
        desk.send(sane)
        if desk.vehicle.autopilot.mode is not Mode.TERMINATED:
            desk.command(mav.MAV_CMD_DO_SET_MODE, 129, 6, 0)
        for kind in KINDS[:2]:
            desk.send(anything(kind, rng))
        desk.fly(seconds=0.2)
    assert all(math.isfinite(part) for part in aircraft.truth.pos_ned_m)
    assert alive(desk)
