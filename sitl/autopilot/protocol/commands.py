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
_NO_GIMBAL = "Gimbal order dropped: there is no gimbal"
_DROPPED: dict[type[mav.MAVLink_message], str] = {
    mav.MAVLink_gimbal_manager_set_attitude_message: _NO_GIMBAL,
    mav.MAVLink_gimbal_manager_set_pitchyaw_message: _NO_GIMBAL,
    mav.MAVLink_gimbal_manager_set_manual_control_message: _NO_GIMBAL,
    mav.MAVLink_gps_rtcm_data_message: "RTCM data dropped: the receiver takes no corrections",
    mav.MAVLink_play_tune_message: "Tune dropped: there is no speaker",
}


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
    """Answers for cameras, gimbals, shells and speakers, which are not there.

    What MAVLink has an answer for is answered, what it has none for is said once in a status text.
    """

    def __init__(self, outbox: Outbox, reporter: Reporter) -> None:
        self._outbox = outbox
        self._report = reporter
        self._said: set[str] = set()
        self.handlers: Handlers = dict.fromkeys(_DROPPED, self._drop) | {
            mav.MAVLink_serial_control_message: self._shell,
            mav.MAVLink_param_ext_set_message: self._refuse_parameter,
        }

    def _drop(self, _peer: Peer, msg: mav.MAVLink_message, _now: float) -> None:
        text = _DROPPED[type(msg)]
        if text not in self._said:
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
