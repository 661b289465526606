"""Answers said again on a link that loses, until the other side goes on.

Whoever waits for an answer asks again after a while, and gives up after a few times. Saying the
answer again meanwhile leaves only the loss of the questions to their count; and a question whose
answer ends the exchange is asked again by few.
"""

from dataclasses import dataclass

from sitl.autopilot.values import messages as m

ECHOES = 3
ECHO_S = 0.1  # below every ground station's time-out


@dataclass(slots=True)
class _Echo:
    body: m.Outgoing
    due: float
    left: int = ECHOES


class Echoes:
    """At most one answer per ground station, its newest."""

    def __init__(self, outbox: m.Outbox) -> None:
        self._outbox = outbox
        self._of: dict[m.Peer, _Echo] = {}

    def repeat(self, peer: m.Peer, body: m.Outgoing, now: float) -> None:
        """`body` has just been sent to `peer`: say it again until it is `heard`."""
        self._of[peer] = _Echo(body, now + ECHO_S)

    def heard(self, peer: m.Peer) -> None:
        """The peer has said something since: whatever it waits for now, it is not this."""
        self._of.pop(peer, None)

    def poll(self, now: float) -> None:
        """Send what is due."""
        for peer, echo in list(self._of.items()):
            if now < echo.due:
                continue
            self._outbox.append(m.Envelope(echo.body, peer))
            echo.due, echo.left = now + ECHO_S, echo.left - 1
            if echo.left == 0:
                del self._of[peer]

    def due(self) -> float | None:
        """When `poll` has something to do; None for never."""
        return min((echo.due for echo in self._of.values()), default=None)
