"""The MAVLink command protocol from the vehicle's side: one table, one answer to everything, also
to messages that ask for a payload, which this vehicle does not have."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import (
    CommandOrder,
    Handlers,
    Outbox,
    Peer,
    bare_name,
    command_name,
    read_order,
)
from sitl.autopilot.protocol.order_rules import COMMAND_RULES, rule_of
from sitl.autopilot.reporter import Reporter

_RETRANSMISSION_S = 5.0  # a repeated command gets the first one's answer for so long
_PEERS = 16  # whose last commands are remembered
_NO_SHELL = b"There is no shell on this vehicle.\n"
_SHELL_BYTES = 70  # of one SERIAL_CONTROL
# What the vehicle has nothing for, and why: by name, also messages that name nobody.
_DROPPED = {
    name: why
    for names, why in {
        "GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_DEVICE_SET_ATTITUDE "
        "GIMBAL_MANAGER_SET_MANUAL_CONTROL": "Gimbal order dropped: there is no gimbal",
        "GPS_RTCM_DATA GPS_INJECT_DATA": "RTCM data dropped: the receiver takes no corrections",
        "PLAY_TUNE PLAY_TUNE_V2": "Tune dropped: there is no speaker",
        "GPS_INPUT HIL_GPS HIL_SENSOR HIL_STATE_QUATERNION HIL_OPTICAL_FLOW ODOMETRY "
        "ATT_POS_MOCAP VISION_POSITION_ESTIMATE VISION_SPEED_ESTIMATE VICON_POSITION_ESTIMATE "
        "GLOBAL_VISION_POSITION_ESTIMATE OPTICAL_FLOW OPTICAL_FLOW_RAD DISTANCE_SENSOR "
        "OBSTACLE_DISTANCE LANDING_TARGET": "Sensor data dropped: it flies by its own sensors",
        "SET_HOME_POSITION": "SET_HOME_POSITION dropped: DO_SET_HOME moves home",
        "SET_GPS_GLOBAL_ORIGIN": "SET_GPS_GLOBAL_ORIGIN dropped: the origin is where it started",
        "REQUEST_DATA_STREAM": "REQUEST_DATA_STREAM dropped: SET_MESSAGE_INTERVAL sets rates",
        "TRAJECTORY_REPRESENTATION_WAYPOINTS": "Trajectory dropped: send setpoints",
    }.items()
    for name in names.split()
}
_ANSWERS = {"COMMAND_ACK", "MISSION_ACK", "PARAM_ERROR"}  # which nobody answers


class RefusedError(Exception):
    """A command is refused; the message, if any, is sent as a status text."""

    def __init__(self, reason: str = "", result: int = mav.MAV_RESULT_DENIED) -> None:
        """`result`: the MAV_RESULT that the command is answered with."""
        super().__init__(reason)
        self.result = result


class UnsupportedError(RefusedError):
    """The vehicle cannot do what is asked for."""

    def __init__(self, reason: str = "") -> None:
        super().__init__(reason, mav.MAV_RESULT_UNSUPPORTED)


# Carries out a command, or raises RefusedError; by MAV_CMD.
Commands: TypeAlias = Mapping[int, Callable[[CommandOrder], None]]


def demand(reason: str | None) -> None:
    """Raise RefusedError (temporarily rejected) if there is a reason."""
    if reason:
        raise RefusedError(reason, mav.MAV_RESULT_TEMPORARILY_REJECTED)


def demand_within(what: str, value: float, allowed: ranges.Range) -> None:
    """Refuse a number that lies outside of what is allowed."""
    if value not in allowed:
        number = f"{value:g} {allowed.unit}".rstrip()
        raise RefusedError(f"{what} {number}: {allowed}")


@dataclass(frozen=True, slots=True)
class _Done:
    order: CommandOrder
    result: int
    at: float

    def again(self, order: CommandOrder, now: float) -> bool:
        """Whether `order` is a retransmission of this one."""
        return (
            order.confirmation > 0
            and now - self.at < _RETRANSMISSION_S
            and order.command == self.order.command
            and all(map(_same, order.params, self.order.params))
        )


def _same(a: float, b: float) -> bool:
    return a == b or (math.isnan(a) and math.isnan(b))  # NaN is "not given"


class CommandServer:
    """Carries out COMMAND_LONG and COMMAND_INT: one table says how, another what they may hold."""

    def __init__(self, outbox: Outbox, reporter: Reporter, commands: Commands) -> None:
        self._outbox = outbox
        self._report = reporter
        self._last: dict[Peer, _Done] = {}  # who was silent for longest first
        self._commands = commands
        self.handlers: Handlers = {
            mav.MAVLink_command_long_message: self._receive,
            mav.MAVLink_command_int_message: self._receive,
        }

    @property
    def known(self) -> frozenset[int]:
        """The commands that are not answered UNSUPPORTED."""
        return frozenset(self._commands)

    def give_up(self, peer: Peer, msg: Any) -> None:
        """Answer FAILED to a command whose handling raised an error."""
        self._answer(peer, msg.command, mav.MAV_RESULT_FAILED)

    def _answer(self, peer: Peer, command: int, result: int) -> None:
        system, component = peer.ids
        ack = mav.MAVLink_command_ack_message(
            command, result, target_system=system, target_component=component
        )
        self._outbox.append(ack, peer)

    def _receive(
        self,
        peer: Peer,
        msg: mav.MAVLink_command_long_message | mav.MAVLink_command_int_message,
        now: float,
    ) -> None:
        order, last = read_order(msg), self._last.get(peer)
        if last is not None and last.again(order, now):
            # Our answer was late or lost: answer again, do nothing again.
            self._answer(peer, order.command, last.result)
            return
        command = self._commands.get(order.command)
        result, reason = mav.MAV_RESULT_ACCEPTED, ""
        try:
            rule = rule_of(COMMAND_RULES, order)
            if command is None or rule is None:
                raise UnsupportedError("this vehicle has nothing for that")
            if (wrong := rule.wrong(order.params, order.frame)) is not None:
                raise RefusedError(rule.words(wrong, order.params[wrong], order.frame))
            command(order)
        except RefusedError as refused:
            result, reason = refused.result, str(refused)
        self._remember(peer, _Done(order, result, now))
        self._answer(peer, order.command, result)
        if reason:
            name = command_name if command is None else bare_name
            self._report.say(f"{name(order.command)} refused: {reason}")

    def _remember(self, peer: Peer, done: _Done) -> None:
        self._last.pop(peer, None)
        self._last[peer] = done
        if len(self._last) > _PEERS:
            del self._last[next(iter(self._last))]


class NoPayload:
    """Answers for cameras, gimbals, shells and speakers, which are not there, and for every other
    message to a vehicle that this one has nothing for.

    What MAVLink has an answer for is answered, what it has none for is said once in a status text.
    """

    def __init__(self, outbox: Outbox, reporter: Reporter) -> None:
        self._outbox = outbox
        self._report = reporter
        self._said: set[str] = set()
        dropped = [
            kind
            for kind in mav.mavlink_map.values()
            if kind.msgname in _DROPPED
            or ("target_system" in kind.fieldnames and kind.msgname not in _ANSWERS)
        ]
        self.handlers: Handlers = dict.fromkeys(dropped, self._drop) | {
            mav.MAVLink_serial_control_message: self._shell,
            mav.MAVLink_param_ext_set_message: self._refuse_parameter,
        }

    def _drop(self, _peer: Peer, msg: mav.MAVLink_message, _now: float) -> None:
        name = msg.get_type()
        text = _DROPPED.get(name, f"{name} dropped: this vehicle has nothing for that")
        meant = name in _DROPPED or getattr(msg, "target_system", 0) > 0  # not everybody
        if meant and text not in self._said:
            self._said.add(text)
            self._report.say(text, mav.MAV_SEVERITY_NOTICE)

    def _shell(self, _peer: Peer, msg: mav.MAVLink_serial_control_message, _now: float) -> None:
        if msg.flags & mav.SERIAL_CONTROL_FLAG_RESPOND and msg.count > 0:
            data = list(_NO_SHELL.ljust(_SHELL_BYTES, b"\0"))
            reply = mav.SERIAL_CONTROL_FLAG_REPLY
            self._outbox.append(
                mav.MAVLink_serial_control_message(msg.device, reply, 0, 0, len(_NO_SHELL), data)
            )

    def _refuse_parameter(
        self, _peer: Peer, msg: mav.MAVLink_param_ext_set_message, _now: float
    ) -> None:
        kind, failed = mav.MAV_PARAM_EXT_TYPE_CUSTOM, mav.PARAM_ACK_FAILED
        name = msg.param_id.encode()
        self._outbox.append(mav.MAVLink_param_ext_ack_message(name, b"", kind, failed))
