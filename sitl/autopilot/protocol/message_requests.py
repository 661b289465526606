"""What ground stations want to be told: messages on request and at intervals."""

import math
from collections.abc import Mapping

from sitl.autopilot.codec.instruments import INSTRUMENTED
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.autopilot.protocol.commands import Answer, Handler, Refusal
from sitl.autopilot.protocol.streams import Streams
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Command, Message, Result

_ON_DEMAND = TELEMETRY | INSTRUMENTED | {Message.MISSION_CURRENT}


class MessageCommands:
    """Handlers of the commands about messages; `asked` are those to be sent once."""

    def __init__(self, outbox: m.Outbox, streams: Streams) -> None:
        self.asked: list[Message] = []
        self._outbox = outbox
        self._streams = streams

    def handlers(self) -> Mapping[Command, Handler]:
        """Who answers which command."""
        return {
            Command.GET_HOME_POSITION: lambda *_: self._ask(Message.HOME_POSITION),
            Command.REQUEST_AUTOPILOT_CAPABILITIES: lambda *_: self._ask(Message.AUTOPILOT_VERSION),
            Command.REQUEST_MESSAGE: self._request_message,
            Command.SET_MESSAGE_INTERVAL: self._set_interval,
            Command.GET_MESSAGE_INTERVAL: self._get_interval,
        }

    def _ask(self, kind: Message) -> Answer:
        self.asked.append(kind)
        return None

    def _request_message(self, order: m.CommandOrder, _now: float) -> Answer:
        kind = _message(order.params[0])
        return Refusal(Result.UNSUPPORTED) if kind is None else self._ask(kind)

    def _set_interval(self, order: m.CommandOrder, now: float) -> Answer:
        kind = _message(order.params[0])
        interval_us = order.params[1]
        if kind is None:
            return Refusal(Result.UNSUPPORTED)
        if not math.isfinite(interval_us):
            return Refusal(Result.DENIED, "no interval")
        self._streams.set_interval(kind, interval_us * 1e-6, now=now)
        return None

    def _get_interval(self, order: m.CommandOrder, _now: float) -> Answer:
        kind = _message(order.params[0])
        if kind is None:
            return Refusal(Result.UNSUPPORTED)
        body = m.MessageInterval(kind, self._streams.interval_s(kind))
        self._outbox.append(m.Envelope(body))
        return None


def _message(number: float) -> Message | None:
    if not math.isfinite(number) or int(number) not in _ON_DEMAND:
        return None
    return Message(int(number))
