"""MAVLink between a firmware and a ground station, as far as a relay has to understand it."""

from collections.abc import Iterator
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mav

from flightdyn.physics.battery import CELLS
from flightdyn.state import BatteryState
from sitl.autopilot.codec.orders import Fields

HEARTBEAT = mav.MAVLINK_MSG_ID_HEARTBEAT
# What a ground station says again and again, whatever it wants.
CHATTER = frozenset({HEARTBEAT, mav.MAVLINK_MSG_ID_PING, mav.MAVLINK_MSG_ID_TIMESYNC})
_EVENT = 410  # of the events interface, not in this dialect
# Of these each one counts; of all others the newest.
EACH_COUNTS = frozenset(
    {
        mav.MAVLINK_MSG_ID_COMMAND_ACK,
        mav.MAVLINK_MSG_ID_STATUSTEXT,
        mav.MAVLINK_MSG_ID_PARAM_VALUE,
        mav.MAVLINK_MSG_ID_PARAM_EXT_VALUE,
        mav.MAVLINK_MSG_ID_PARAM_EXT_ACK,
        mav.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
        mav.MAVLINK_MSG_ID_MISSION_ITEM,
        mav.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        mav.MAVLINK_MSG_ID_MISSION_REQUEST,
        mav.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mav.MAVLINK_MSG_ID_MISSION_COUNT,
        mav.MAVLINK_MSG_ID_MISSION_ACK,
        mav.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
        mav.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        mav.MAVLINK_MSG_ID_LOG_ENTRY,
        mav.MAVLINK_MSG_ID_LOG_DATA,
        mav.MAVLINK_MSG_ID_TIMESYNC,
        _EVENT,
    }
)


@dataclass(frozen=True, slots=True)
class Frame:
    """One MAVLink frame, whole but not checked."""

    data: bytes
    number: int  # of the message
    system: int
    component: int


def frames(datagram: bytes) -> Iterator[Frame]:
    """The frames in a datagram; what is none ends it."""
    at = 0
    while at + 8 <= len(datagram):
        if datagram[at] == 0xFD and at + 12 <= len(datagram):
            end = at + datagram[at + 1] + (25 if datagram[at + 2] & 1 else 12)
            number = int.from_bytes(datagram[at + 7 : at + 10], "little")
            system, component = datagram[at + 5], datagram[at + 6]
        elif datagram[at] == 0xFE:
            end = at + datagram[at + 1] + 8
            system, component, number = datagram[at + 3 : at + 6]
        else:
            return
        if end > len(datagram):
            return
        yield Frame(datagram[at:end], number, system, component)
        at = end


class Reader:
    """Frames as messages: a dictionary of fields by MAVLink's names."""

    def __init__(self) -> None:
        self._mav = mav.MAVLink(None)

    def read(self, frame: Frame) -> tuple[str, Fields] | None:
        """The message's name and fields; None where the frame is damaged."""
        try:
            message = self._mav.decode(bytearray(frame.data))
        except mav.MAVError:
            return None
        fields = message.to_dict()
        del fields["mavpackettype"]
        return message.get_type(), fields


class Writer:
    """What the relay itself says to the firmware, as a part of its vehicle."""

    def __init__(self, system: int) -> None:
        self._mav = mav.MAVLink(None, srcSystem=system, srcComponent=mav.MAV_COMP_ID_BATTERY)

    def battery(self, state: BatteryState) -> bytes:
        """BATTERY_STATUS of a smart battery."""
        cell = round(state.voltage_v * 1e3 / CELLS)
        return self._pack(
            mav.MAVLink_battery_status_message(
                id=0,
                battery_function=mav.MAV_BATTERY_FUNCTION_ALL,
                type=mav.MAV_BATTERY_TYPE_LIPO,
                temperature=2000,
                voltages=[cell] * CELLS + [65535] * (10 - CELLS),
                current_battery=round(state.current_a * 100),
                current_consumed=round(state.consumed_mah),
                energy_consumed=-1,
                battery_remaining=round(100 * state.remaining),
            )
        )

    def parameter(self, name: str, value: float) -> bytes:
        """PARAM_SET of a number, as ArduPilot reads it."""
        return self._pack(
            mav.MAVLink_param_set_message(0, 0, name.encode(), value, mav.MAV_PARAM_TYPE_REAL32)
        )

    def _pack(self, message: mav.MAVLink_message) -> bytes:
        data = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return data
