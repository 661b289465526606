"""The MAVLink parameter protocol from the vehicle's side."""

from collections import deque

from sitl.autopilot.parameters import SPECS, TABLE, Parameters
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import ParamError, ParamType

_BY_NAME = 65535  # index of a value that nobody asked for by index
_BURST = 20  # values of a list sent at a time, so that no receiver's buffer overflows
_BURST_EVERY_S = 0.01
_INDEX = {spec.name: index for index, spec in enumerate(TABLE)}
# The types a ground station may send a value in; the value is what counts.
_INTEGER_TYPES = frozenset(range(1, 9))


class ParameterServer:
    """Reads, writes and lists parameters over MAVLink."""

    def __init__(self, outbox: m.Outbox, parameters: Parameters) -> None:
        self._outbox = outbox
        self._parameters = parameters
        self._listing: deque[int] = deque()
        self._next_burst = 0.0

    def receive(self, peer: m.Peer, message: m.Incoming, now: float) -> bool:
        """Handle a message of the parameter protocol; False for one that is none."""
        match message:
            case m.ParamRequestList():
                self._listing = deque(range(len(TABLE)))
                self._next_burst = now
            case m.ParamRequestRead():
                self._read(peer, message)
            case m.ParamSet():
                self._set(peer, message)
            case _:
                return False
        return True

    def poll(self, now: float) -> None:
        """Send the next values of a list that was asked for."""
        if not self._listing or now < self._next_burst:
            return
        for _ in range(min(_BURST, len(self._listing))):
            index = self._listing.popleft()
            self._send(TABLE[index].name, index)
        self._next_burst = now + _BURST_EVERY_S

    def due(self) -> float | None:
        """When `poll` has something to do; None for never."""
        return self._next_burst if self._listing else None

    def _read(self, peer: m.Peer, message: m.ParamRequestRead) -> None:
        if 0 <= message.index < len(TABLE):
            self._send(TABLE[message.index].name, message.index)
        elif message.index == -1 and message.name in SPECS:
            self._send(message.name, _INDEX[message.name])
        else:
            self._refuse(peer, message.name, message.index, ParamError.DOES_NOT_EXIST)

    def _set(self, peer: m.Peer, message: m.ParamSet) -> None:
        spec = SPECS.get(message.name)
        error: ParamError | None = ParamError.DOES_NOT_EXIST
        if spec is not None:
            matches = (spec.kind is ParamType.INT32) == (message.kind in _INTEGER_TYPES)
            error = (
                self._parameters.set(message.name, message.value)
                if matches
                else ParamError.VALUE_OUT_OF_RANGE
            )
        if error is not None:
            self._refuse(peer, message.name, -1, error)
        if spec is not None:
            # Older ground stations know no error: the value that stayed tells them.
            self._send(message.name, _BY_NAME)

    def _refuse(self, peer: m.Peer, name: str, index: int, error: ParamError) -> None:
        self._outbox.append(m.Envelope(m.ParamRefused(name, index, error), peer))

    def _send(self, name: str, index: int) -> None:
        value = m.ParamValue(name, self._parameters[name], SPECS[name].kind, len(TABLE), index)
        self._outbox.append(m.Envelope(value))
