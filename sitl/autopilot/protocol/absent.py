"""What a vehicle without payload answers to those who ask for one.

Commands are answered UNSUPPORTED by the command protocol. Here is the rest: what MAVLink has an
answer for is answered, and what it has none for is said once in a status text.
"""

from collections.abc import Mapping

from sitl.autopilot.reporter import Reporter
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Severity
from sitl.autopilot.values.parts import (
    ExtendedParamRefused,
    ExtendedParamSet,
    ForPart,
    Part,
    ShellInput,
    ShellOutput,
)

_SHELL = "There is no shell on this vehicle.\n"
_ABSENT: Mapping[Part, str] = {
    Part.GIMBAL: "Gimbal order dropped: there is no gimbal",
    Part.CORRECTIONS: "RTCM data dropped: the receiver takes no corrections",
    Part.TUNE: "Tune dropped: there is no speaker",
}


class Absent:
    """Answers for the parts that are not there."""

    def __init__(self, outbox: m.Outbox, reporter: Reporter) -> None:
        self._outbox = outbox
        self._report = reporter
        self._said: set[Part] = set()

    def receive(self, peer: m.Peer, body: m.Incoming, _now: float) -> bool:
        """Answer a message to a part that is not there; False for what is none."""
        match body:
            case ShellInput(device, answer_wanted):
                if answer_wanted:
                    self._outbox.append(m.Envelope(ShellOutput(device, _SHELL), peer))
            case ExtendedParamSet(name):
                self._outbox.append(m.Envelope(ExtendedParamRefused(name), peer))
            case ForPart(part):
                if part not in self._said:
                    self._said.add(part)
                    self._report.say(Severity.NOTICE, _ABSENT[part])
            case _:
                return False
        return True

    def poll(self, now: float) -> None:
        """Nothing is answered later than at once."""

    def due(self) -> float | None:
        """When there is something to do: never."""
        return None
