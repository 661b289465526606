"""MAVLink messages in: from pymavlink's objects to our values."""

import struct
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.message import MavlinkMessage
from sitl.autopilot.codec.setpoints import SETPOINT_DECODERS
from sitl.autopilot.codec.units import from_deg_e7
from sitl.autopilot.values import files as f
from sitl.autopilot.values import messages as m
from sitl.autopilot.values import parts as p
from sitl.autopilot.values.enums import (
    GLOBAL_FRAMES,
    Command,
    MissionResult,
    MissionType,
    ParamType,
)

# Commands whose fifth and sixth parameter are a position: COMMAND_INT carries it in degE7.
_POSITION_COMMANDS = frozenset(
    {
        Command.NAV_TAKEOFF,
        Command.NAV_LAND,
        Command.DO_SET_HOME,
        Command.DO_REPOSITION,
        Command.DO_ORBIT,
        Command.DO_SET_ROI_LOCATION,
        Command.DO_SET_ROI,
    }
)


def _command_long(msg: MavlinkMessage) -> m.CommandOrder:
    params = (msg.param1, msg.param2, msg.param3, msg.param4, msg.param5, msg.param6, msg.param7)
    return m.CommandOrder(msg.command, params, confirmation=msg.confirmation)


def _command_int(msg: MavlinkMessage) -> m.CommandOrder:
    x, y = float(msg.x), float(msg.y)
    if msg.command in _POSITION_COMMANDS and msg.frame in GLOBAL_FRAMES:
        x, y = from_deg_e7(msg.x), from_deg_e7(msg.y)
    params = (msg.param1, msg.param2, msg.param3, msg.param4, x, y, msg.z)
    return m.CommandOrder(msg.command, params, frame=msg.frame)


def _mission_type(value: int) -> MissionType | None:
    return MissionType(value) if value in MissionType.__members__.values() else None


def _item_int(msg: MavlinkMessage) -> m.MissionItem | None:
    if msg.frame in GLOBAL_FRAMES:
        return _item(msg, from_deg_e7(msg.x), from_deg_e7(msg.y))
    return _item(msg, float(msg.x), float(msg.y))


def _item_float(msg: MavlinkMessage) -> m.MissionItem | None:
    return _item(msg, msg.x, msg.y)


def _item(msg: MavlinkMessage, x: float, y: float) -> m.MissionItem | None:
    kind = _mission_type(msg.mission_type)
    if kind is None:
        return None
    return m.MissionItem(
        seq=msg.seq,
        command=msg.command,
        frame=msg.frame,
        params=(msg.param1, msg.param2, msg.param3, msg.param4),
        x=x,
        y=y,
        z=msg.z,
        mission_type=kind,
        autocontinue=bool(msg.autocontinue),
    )


def _mission_ack(msg: MavlinkMessage) -> m.MissionAck | None:
    kind = _mission_type(msg.mission_type)
    known = msg.type in MissionResult.__members__.values()
    result = MissionResult(msg.type) if known else MissionResult.ERROR
    return None if kind is None else m.MissionAck(result, kind)


def _with_type(
    make: Callable[[MavlinkMessage, MissionType], m.Incoming],
) -> Callable[[MavlinkMessage], m.Incoming | None]:
    """A decoder that drops messages about lists this autopilot has never heard of."""

    def decode(msg: MavlinkMessage) -> m.Incoming | None:
        kind = _mission_type(msg.mission_type)
        return None if kind is None else make(msg, kind)

    return decode


def _param_set(msg: MavlinkMessage) -> m.ParamSet:
    # PX4's bytewise encoding: integers travel as their bytes in the float field.
    value = msg.param_value
    if msg.param_type == ParamType.INT32:
        value = float(struct.unpack("<i", struct.pack("<f", value))[0])
    return m.ParamSet(msg.param_id, value, msg.param_type)


_PARTS = {
    mav.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_ATTITUDE: p.Part.GIMBAL,
    mav.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW: p.Part.GIMBAL,
    mav.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_MANUAL_CONTROL: p.Part.GIMBAL,
    mav.MAVLINK_MSG_ID_GPS_RTCM_DATA: p.Part.CORRECTIONS,
    mav.MAVLINK_MSG_ID_PLAY_TUNE: p.Part.TUNE,
}


def _for_part(part: p.Part) -> Callable[[MavlinkMessage], p.ForPart]:
    return lambda _: p.ForPart(part)


def _heartbeat(msg: MavlinkMessage) -> m.Heartbeat:
    return m.Heartbeat(ground_station=msg.type == mav.MAV_TYPE_GCS)


def _partial(_: MavlinkMessage, kind: MissionType) -> m.MissionPartialList:
    return m.MissionPartialList(kind)


_DECODERS: dict[int, Callable[[MavlinkMessage], m.Incoming | None]] = {
    mav.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mav.MAVLINK_MSG_ID_COMMAND_LONG: _command_long,
    mav.MAVLINK_MSG_ID_COMMAND_INT: _command_int,
    mav.MAVLINK_MSG_ID_SET_MODE: lambda msg: m.SetMode(msg.custom_mode),
    mav.MAVLINK_MSG_ID_MISSION_ITEM_INT: _item_int,
    mav.MAVLINK_MSG_ID_MISSION_ITEM: _item_float,
    mav.MAVLINK_MSG_ID_MISSION_COUNT: _with_type(lambda msg, t: m.MissionCount(msg.count, t)),
    mav.MAVLINK_MSG_ID_MISSION_REQUEST_INT: _with_type(lambda msg, t: m.MissionRequest(msg.seq, t)),
    mav.MAVLINK_MSG_ID_MISSION_REQUEST: _with_type(lambda msg, t: m.MissionRequest(msg.seq, t)),
    mav.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: _with_type(lambda _, t: m.MissionRequestList(t)),
    mav.MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST: _with_type(_partial),
    mav.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: _with_type(_partial),
    mav.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: _with_type(lambda _, t: m.MissionClearAll(t)),
    mav.MAVLINK_MSG_ID_MISSION_ACK: _mission_ack,
    mav.MAVLINK_MSG_ID_MISSION_SET_CURRENT: lambda msg: m.MissionSetCurrent(msg.seq),
    mav.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: lambda _: m.ParamRequestList(),
    mav.MAVLINK_MSG_ID_PARAM_REQUEST_READ: lambda msg: m.ParamRequestRead(
        msg.param_id, msg.param_index
    ),
    mav.MAVLINK_MSG_ID_PARAM_SET: _param_set,
    mav.MAVLINK_MSG_ID_PING: lambda msg: m.Ping(msg.time_usec, msg.seq, msg.target_system),
    **SETPOINT_DECODERS,
    mav.MAVLINK_MSG_ID_SERIAL_CONTROL: lambda msg: p.ShellInput(
        msg.device, bool(msg.flags & mav.SERIAL_CONTROL_FLAG_RESPOND) and msg.count > 0
    ),
    mav.MAVLINK_MSG_ID_PARAM_EXT_SET: lambda msg: p.ExtendedParamSet(msg.param_id),
    **{number: _for_part(part) for number, part in _PARTS.items()},
    mav.MAVLINK_MSG_ID_LOG_REQUEST_LIST: lambda msg: f.LogRequestList(msg.start, msg.end),
    mav.MAVLINK_MSG_ID_LOG_REQUEST_DATA: lambda msg: f.LogRequestData(msg.id, msg.ofs, msg.count),
    mav.MAVLINK_MSG_ID_LOG_REQUEST_END: lambda _: f.LogRequestEnd(),
    mav.MAVLINK_MSG_ID_LOG_ERASE: lambda _: f.LogErase(),
    mav.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: lambda msg: f.FtpMessage(bytes(msg.payload)),
    mav.MAVLINK_MSG_ID_TIMESYNC: lambda msg: m.TimeSync(msg.tc1, msg.ts1),
}


def decode(msg: MavlinkMessage) -> m.Incoming | None:
    """The value of a pymavlink message; None for one that the autopilot has no use for."""
    decoder = _DECODERS.get(msg.get_msgId())
    return None if decoder is None else decoder(msg)
