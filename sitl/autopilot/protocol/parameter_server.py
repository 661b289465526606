"""The MAVLink parameter protocol from the vehicle's side."""

import math
import struct
from pathlib import Path

from pymavlink.dialects.v20 import common as mav

from native.errors import InputError
from sitl.autopilot.codec.orders import CommandOrder, Handlers, Outbox, Peer
from sitl.autopilot.parameters import SPECS, TABLE, Parameters, load_parameters, save_parameters
from sitl.autopilot.protocol.commands import Commands, RefusedError, UnsupportedError
from sitl.autopilot.protocol.streams import Burst

_INDEX = {spec.name: index for index, spec in enumerate(TABLE)}
# Values travel bytewise, as with PX4: the field, a float, begins with the bytes of the number.
# Types of 64 bits do not fit into it.
_INT, _FLOAT = struct.Struct("<i"), struct.Struct("<f")
_TYPES = {
    mav.MAV_PARAM_TYPE_REAL32: _FLOAT,
    mav.MAV_PARAM_TYPE_INT32: _INT,
    mav.MAV_PARAM_TYPE_UINT32: struct.Struct("<I"),
    mav.MAV_PARAM_TYPE_INT16: struct.Struct("<h"),
    mav.MAV_PARAM_TYPE_UINT16: struct.Struct("<H"),
    mav.MAV_PARAM_TYPE_INT8: struct.Struct("<b"),
    mav.MAV_PARAM_TYPE_UINT8: struct.Struct("<B"),
}


class ParameterServer:
    """Reads, writes and lists parameters over MAVLink."""

    def __init__(self, outbox: Outbox, parameters: Parameters, file: Path | None) -> None:
        """`file`: where a ground station may save and load them; None refuses both."""
        self._outbox = outbox
        self._parameters = parameters
        self._file = file
        self.burst = Burst(outbox, at_once=20, every_s=0.01)
        self.handlers: Handlers = {
            mav.MAVLink_param_request_list_message: self._list,
            mav.MAVLink_param_request_read_message: self._read,
            mav.MAVLink_param_set_message: self._set,
        }
        self.commands: Commands = {mav.MAV_CMD_PREFLIGHT_STORAGE: self._store}

    def _store(self, order: CommandOrder) -> None:
        what = order.params[0]
        if what == 2.0:
            self._parameters.reset()
            return
        if what not in (0.0, 1.0):
            raise UnsupportedError
        if self._file is None:
            raise RefusedError("no parameter file is configured", mav.MAV_RESULT_FAILED)
        try:
            if what == 0.0:
                self._parameters.apply(load_parameters(self._file), "parameter file")
            else:
                save_parameters(self._file, self._parameters.as_dict())
        except InputError as error:
            raise RefusedError(str(error), mav.MAV_RESULT_FAILED) from None

    def _list(self, _peer: Peer, _msg: mav.MAVLink_message, now: float) -> None:
        values = (self._value(spec.name, index) for index, spec in enumerate(TABLE))
        self.burst.start(values, now)

    def _read(self, peer: Peer, msg: mav.MAVLink_param_request_read_message, _now: float) -> None:
        index = _INDEX.get(msg.param_id, -1) if msg.param_index == -1 else msg.param_index
        if 0 <= index < len(TABLE):
            self._outbox.append(self._value(TABLE[index].name, index))
        else:
            error = mav.MAV_PARAM_ERROR_DOES_NOT_EXIST
            self._refuse(peer, msg.param_id, msg.param_index, error)

    def _set(self, peer: Peer, msg: mav.MAVLink_param_set_message, _now: float) -> None:
        name, spec = msg.param_id, SPECS.get(msg.param_id)
        if spec is None:
            self._refuse(peer, name, -1, mav.MAV_PARAM_ERROR_DOES_NOT_EXIST)
            return
        matches = spec.whole == (msg.param_type != mav.MAV_PARAM_TYPE_REAL32)
        if not (matches and self._parameters.set(name, _number(msg))):
            self._refuse(peer, name, -1, mav.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)
        # Older ground stations know no error: the value that stayed tells them.
        self._outbox.append(self._value(name, _INDEX[name]))

    def _refuse(self, peer: Peer, name: str, index: int, error: int) -> None:
        named = name.encode()
        self._outbox.append(mav.MAVLink_param_error_message(*peer.ids, named, index, error), peer)

    def _value(self, name: str, index: int) -> mav.MAVLink_message:
        value, kind = self._parameters[name], mav.MAV_PARAM_TYPE_REAL32
        if SPECS[name].whole:
            value, kind = _FLOAT.unpack(_INT.pack(int(value)))[0], mav.MAV_PARAM_TYPE_INT32
        return mav.MAVLink_param_value_message(name.encode(), value, kind, len(TABLE), index)


def _number(msg: mav.MAVLink_param_set_message) -> float:
    """The number that a PARAM_SET means; NaN if its field holds none of the type that it names."""
    kind = _TYPES.get(msg.param_type)
    if kind is None:
        return math.nan
    field = _FLOAT.pack(msg.param_value)
    value = float(kind.unpack_from(field)[0])
    # Bytes behind a narrow number belong to another encoding: 4.0 as a float begins with a 0.
    rest = set(field[kind.size :])
    return value if rest in (set(), {0}) or (value < 0 and rest == {255}) else math.nan
