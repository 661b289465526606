"""Protocol messages out: from our values to pymavlink's objects."""

import struct
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.message import MavlinkMessage
from sitl.autopilot.codec.units import deg_e7, int32
from sitl.autopilot.values import files as f
from sitl.autopilot.values import messages as m
from sitl.autopilot.values import parts as p
from sitl.autopilot.values.enums import GLOBAL_FRAMES, ParamType
from sitl.errors import ProtocolError

_TEXT_BYTES = 50  # of one STATUSTEXT
_SHELL_BYTES = 70  # of one SERIAL_CONTROL
_LOG_BYTES = 90  # of one LOG_DATA
_EVERYBODY = m.Peer(0, 0)


def _item(body: m.MissionItem, to: m.Peer) -> MavlinkMessage:
    coordinate = deg_e7 if body.frame in GLOBAL_FRAMES else int32
    return mav.MAVLink_mission_item_int_message(
        to.system,
        to.component,
        body.seq,
        body.frame,
        body.command,
        0,
        int(body.autocontinue),
        *body.params,
        coordinate(body.x),
        coordinate(body.y),
        body.z,
        int(body.mission_type),
    )


def _request(body: m.MissionRequest, to: m.Peer) -> MavlinkMessage:
    message = (
        mav.MAVLink_mission_request_message if body.old else mav.MAVLink_mission_request_int_message
    )
    return message(to.system, to.component, body.seq, int(body.mission_type))


def _count(body: m.MissionCount, to: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_mission_count_message(
        to.system, to.component, body.count, int(body.mission_type)
    )


def _mission_ack(body: m.MissionAck, to: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_mission_ack_message(
        to.system, to.component, int(body.result), int(body.mission_type)
    )


def _mission_current(body: m.MissionCurrent, _: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_mission_current_message(
        body.seq, body.total, int(body.state), 1 if body.in_mission_mode else 2
    )


def _command_ack(body: m.CommandAck, to: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_command_ack_message(
        body.command, int(body.result), target_system=to.system, target_component=to.component
    )


def _param_value(body: m.ParamValue, _: m.Peer) -> MavlinkMessage:
    value = body.value
    if body.kind is ParamType.INT32:
        value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
    return mav.MAVLink_param_value_message(
        body.name.encode(), value, int(body.kind), body.count, body.index
    )


def _param_refused(body: m.ParamRefused, to: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_param_error_message(
        to.system, to.component, body.name.encode(), body.index, int(body.error)
    )


def _pong(body: m.Pong, to: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_ping_message(body.time_us, body.seq, to.system, to.component)


def _interval(body: m.MessageInterval, _: m.Peer) -> MavlinkMessage:
    interval_us = body.interval_s * 1e6 if body.interval_s > 0 else body.interval_s
    return mav.MAVLink_message_interval_message(body.message_id, int32(interval_us))


def _log_entry(body: f.LogEntry, _: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_log_entry_message(
        body.log, body.count, body.last, body.written_s, min(body.size, 2**32 - 1)
    )


def _log_data(body: f.LogData, _: m.Peer) -> MavlinkMessage:
    padded = list(body.data.ljust(_LOG_BYTES, b"\0"))
    return mav.MAVLink_log_data_message(body.log, body.offset, len(body.data), padded)


def _ftp(body: f.FtpMessage, to: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_file_transfer_protocol_message(
        0, to.system, to.component, list(body.payload)
    )


def _shell(body: p.ShellOutput, _: m.Peer) -> MavlinkMessage:
    data = body.text.encode("ascii", "replace")[:_SHELL_BYTES]
    return mav.MAVLink_serial_control_message(
        body.device,
        mav.SERIAL_CONTROL_FLAG_REPLY,
        0,
        0,
        len(data),
        list(data.ljust(_SHELL_BYTES, b"\0")),
    )


def _extended_param(body: p.ExtendedParamRefused, _: m.Peer) -> MavlinkMessage:
    return mav.MAVLink_param_ext_ack_message(
        body.name.encode(), b"", mav.MAV_PARAM_EXT_TYPE_CUSTOM, mav.PARAM_ACK_FAILED
    )


_ENCODERS: dict[type, Callable[[Any, m.Peer], MavlinkMessage]] = {
    m.MissionItem: _item,
    m.MissionRequest: _request,
    m.MissionCount: _count,
    m.MissionAck: _mission_ack,
    m.MissionCurrent: _mission_current,
    m.MissionItemReached: lambda body, _: mav.MAVLink_mission_item_reached_message(body.seq),
    m.CommandAck: _command_ack,
    m.ParamValue: _param_value,
    m.ParamRefused: _param_refused,
    m.Pong: _pong,
    m.TimeSync: lambda body, _: mav.MAVLink_timesync_message(body.remote_ns, body.sender_ns),
    m.MessageInterval: _interval,
    p.ShellOutput: _shell,
    p.ExtendedParamRefused: _extended_param,
    f.LogEntry: _log_entry,
    f.LogData: _log_data,
    f.FtpMessage: _ftp,
}


class StatusTexts:
    """Splits status texts into messages; numbers those that need more than one."""

    def __init__(self) -> None:
        self._last_id = 0

    def encode(self, body: m.StatusText) -> Sequence[MavlinkMessage]:
        """The STATUSTEXT messages of one text, in order."""
        data = body.text.encode("ascii", "replace")
        if len(data) <= _TEXT_BYTES:
            return (mav.MAVLink_statustext_message(int(body.severity), data),)
        self._last_id = self._last_id % 65535 + 1
        chunks = [data[i : i + _TEXT_BYTES] for i in range(0, len(data), _TEXT_BYTES)]
        if len(chunks[-1]) == _TEXT_BYTES:
            chunks.append(b"")  # a text ends with a chunk that is not full
        return tuple(
            mav.MAVLink_statustext_message(int(body.severity), chunk, self._last_id, index)
            for index, chunk in enumerate(chunks)
        )


def encode(envelope: m.Envelope) -> MavlinkMessage:
    """The pymavlink message of an envelope that is no status text.

    Raises:
        ProtocolError: no message carries such a value.
    """
    encoder = _ENCODERS.get(type(envelope.body))
    if encoder is None:
        raise ProtocolError(f"no MAVLink message for {type(envelope.body).__name__}")
    return encoder(envelope.body, envelope.to or _EVERYBODY)
