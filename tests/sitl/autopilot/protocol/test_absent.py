"""Payload that this vehicle does not have: asked for, it is answered at once."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of, the

PAYLOAD = (
    mav.MAV_CMD_IMAGE_START_CAPTURE,
    mav.MAV_CMD_VIDEO_START_CAPTURE,
    mav.MAV_CMD_SET_CAMERA_MODE,
    mav.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    mav.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
    mav.MAV_CMD_DO_MOUNT_CONTROL,
    mav.MAV_CMD_DO_GRIPPER,
    mav.MAV_CMD_DO_WINCH,
    mav.MAV_CMD_DO_ADSB_OUT_IDENT,
    mav.MAV_CMD_PREFLIGHT_CALIBRATION,
    mav.MAV_CMD_DO_SET_ACTUATOR,
    mav.MAV_CMD_LOGGING_START,
)
# Messages that no server here takes, which are orders or data for a vehicle.
MEANT = (
    mav.MAVLINK_MSG_ID_CHANGE_OPERATOR_CONTROL,
    mav.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN,
    mav.MAVLINK_MSG_ID_SET_HOME_POSITION,
    mav.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,
    mav.MAVLINK_MSG_ID_SAFETY_SET_ALLOWED_AREA,
    mav.MAVLINK_MSG_ID_PARAM_MAP_RC,
    mav.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
    mav.MAVLINK_MSG_ID_SETUP_SIGNING,
    mav.MAVLINK_MSG_ID_GPS_INPUT,
    mav.MAVLINK_MSG_ID_GPS_INJECT_DATA,
    mav.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE,
    mav.MAVLINK_MSG_ID_ODOMETRY,
    mav.MAVLINK_MSG_ID_TRAJECTORY_REPRESENTATION_WAYPOINTS,
    mav.MAVLINK_MSG_ID_PARAM_EXT_REQUEST_READ,
    mav.MAVLINK_MSG_ID_TUNNEL,
)


@pytest.mark.parametrize("command", PAYLOAD)
def test_commands(command: int) -> None:
    desk = Desk()
    assert desk.command(command, 1, 1) == mav.MAV_RESULT_UNSUPPORTED
    name = mav.enums["MAV_CMD"][command].name.removeprefix("MAV_CMD_")
    assert f"{name} ({command}) refused: this vehicle has nothing for that" in "".join(desk.texts())


def test_messages_that_it_does_not_have() -> None:
    desk = Desk()
    adsb = mav.MAVLINK_MSG_ID_ADSB_VEHICLE
    for command in (mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAV_CMD_REQUEST_MESSAGE):
        assert desk.command(command, adsb, 0) == mav.MAV_RESULT_UNSUPPORTED


def test_a_shell_says_that_there_is_none() -> None:
    desk = Desk()
    typed = list(b"ver all\n".ljust(70, b"\0"))
    ask = mav.SERIAL_CONTROL_FLAG_RESPOND | mav.SERIAL_CONTROL_FLAG_EXCLUSIVE
    shell = mav.SERIAL_CONTROL_DEV_SHELL
    answer = the(
        desk.send(mav.MAVLink_serial_control_message(shell, ask, 0, 0, 8, typed)), "SERIAL_CONTROL"
    )
    assert (answer.device, answer.flags) == (shell, mav.SERIAL_CONTROL_FLAG_REPLY)
    assert bytes(answer.data[: answer.count]) == b"There is no shell on this vehicle.\n"
    assert not desk.send(mav.MAVLink_serial_control_message(shell, 0, 0, 0, 8, typed))


def test_what_mavlink_has_no_answer_for_is_said_once() -> None:
    desk = Desk()
    for _ in range(3):
        desk.send(
            mav.MAVLink_gps_rtcm_data_message(0, 3, [1] * 180),
            mav.MAVLink_play_tune_message(1, 1, b"L8 C"),
            mav.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 0, 0, 0, 0, 0),
        )
    said = "".join(desk.texts())
    for text in ("RTCM data dropped", "Tune dropped", "there is no gimbal"):
        assert said.count(text) == 1


@pytest.mark.parametrize("name", sorted(mav.mavlink_map[number].msgname for number in MEANT))
def test_no_message_to_the_vehicle_is_dropped_without_a_word(name: str) -> None:
    """Each of those that common.xml addresses to a vehicle is answered, or named in a text."""
    kind: Any
    (kind,) = (kind for kind in mav.mavlink_map.values() if kind.msgname == name)
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    values: Any = [
        b"x" if type_ == "char" else [1] * lengths[field] if lengths[field] else 1
        for field, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    ]
    desk = Desk()
    before = len(desk.heard)
    desk.send(kind(*values))
    texts = [m.text for m in of(desk.heard[before:], "STATUSTEXT")]
    assert name in "".join(texts) or "dropped" in "".join(texts)
    before = len(desk.heard)
    desk.send(kind(*values))
    assert not of(desk.heard[before:], "STATUSTEXT")


def test_what_is_meant_for_everybody_is_no_order() -> None:
    desk = Desk()
    desk.send(mav.MAVLink_v2_extension_message(0, 0, 0, 1, [0] * 249))
    assert not [text for text in desk.texts() if "V2_EXTENSION" in text]


def test_a_cameras_parameter_is_not_set() -> None:
    desk = Desk()
    heard = desk.send(mav.MAVLink_param_ext_set_message(1, 1, b"CAM_MODE", b"1", 1))
    answer = of(heard, "PARAM_EXT_ACK")[-1]
    assert (answer.param_id, answer.param_result) == ("CAM_MODE", mav.PARAM_ACK_FAILED)
