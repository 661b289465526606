"""The MAVLink command protocol from the vehicle's side: one table, one answer to everything."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from sitl.autopilot.codec.names import command_name
from sitl.autopilot.reporter import Reporter
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Command, Result, Severity

_RETRANSMISSION_S = 5.0  # a repeated command gets the first one's answer for so long


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a command is not carried out."""

    result: Result
    reason: str = ""


Answer: TypeAlias = Refusal | None  # None: accepted
Handler: TypeAlias = Callable[[m.CommandOrder, float], Answer]


_UNKNOWN = Refusal(Result.UNSUPPORTED, "this vehicle has nothing for that")


@dataclass(frozen=True, slots=True)
class _Done:
    peer: m.Peer
    order: m.CommandOrder
    result: Result
    at: float

    def again(self, peer: m.Peer, order: m.CommandOrder, now: float) -> bool:
        """Whether `order` is a retransmission of this one."""
        return (
            order.confirmation > 0
            and now - self.at < _RETRANSMISSION_S
            and (peer, order.command) == (self.peer, self.order.command)
            and all(map(_same, order.params, self.order.params))
        )


def _same(a: float, b: float) -> bool:
    return a == b or (math.isnan(a) and math.isnan(b))  # NaN is "not given"


class CommandServer:
    """Carries out COMMAND_LONG and COMMAND_INT, by the handler of each command."""

    def __init__(
        self, outbox: m.Outbox, reporter: Reporter, handlers: Mapping[Command, Handler]
    ) -> None:
        self._outbox = outbox
        self._report = reporter
        self._last: _Done | None = None
        self._handlers = {int(command): handler for command, handler in handlers.items()}

    @property
    def known(self) -> frozenset[int]:
        """The commands that are not answered UNSUPPORTED."""
        return frozenset(self._handlers)

    def receive(self, peer: m.Peer, order: m.CommandOrder, now: float) -> None:
        """Carry out a command and answer it."""
        last = self._last
        if last is not None and last.again(peer, order, now):
            # Our answer was late or lost: answer again, do nothing again.
            self._answer(peer, order, last.result)
            return
        handler = self._handlers.get(order.command)
        refusal = _UNKNOWN if handler is None else handler(order, now)
        result = Result.ACCEPTED if refusal is None else refusal.result
        self._last = _Done(peer, order, result, now)
        self._answer(peer, order, result)
        if refusal is not None and refusal.reason:
            known = order.command in self._handlers
            name = Command(order.command).name if known else command_name(order.command)
            self._report.say(Severity.WARNING, f"{name} refused: {refusal.reason}")

    def _answer(self, peer: m.Peer, order: m.CommandOrder, result: Result) -> None:
        self._outbox.append(m.Envelope(m.CommandAck(order.command, result), peer))
