"""What the autopilot tells: to ground stations as messages, to observers as events."""

import logging
from collections.abc import Callable
from types import TracebackType

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Outbox
from sitl.observer import EventKind

_STATE = {mav.MAVLINK_MSG_ID_HEARTBEAT, mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE}
_TEXT_BYTES = 50  # of one STATUSTEXT

logger = logging.getLogger(__name__)

EventSink = Callable[[EventKind, str, int | None, int], None]


class Reporter:
    """Sends reports at once; `nudged` holds the telemetry messages to send out of turn.

    `items_reached` go out before those.
    """

    def __init__(self, outbox: Outbox, sink: EventSink) -> None:
        self._outbox = outbox
        self._to = sink
        self._outside: Exception | None = None  # what an observer raised
        self._told: set[tuple[str, str]] = set()
        self._last_text = 0  # number of the last text that took more than one message
        self.nudged: set[int] = set()
        self.items_reached = Outbox()

    def contain(self, what: str, otherwise: Callable[[], object] | None = None) -> "_Contained":
        """Return a context manager for the handling of a message, an order or a periodic check.

        An internal error ends the block, is reported, and `otherwise` is called; the vehicle
        goes on. Errors of observers (a full disk) pass through.
        """
        return _Contained(self, what, otherwise)

    def internal_error(self, what: str, error: Exception) -> None:
        """Report an unexpected error, once for each kind and place; raise an observer's again."""
        if error is self._outside:
            raise error
        kind = type(error).__name__
        if (what, kind) not in self._told:
            self._told.add((what, kind))
            logger.error("internal error in %s", what, exc_info=error)
            self.say(f"Internal error in {what}: {kind}", mav.MAV_SEVERITY_ERROR)

    def _sink(self, kind: EventKind, text: str, seq: int | None, severity: int) -> None:
        try:
            self._to(kind, text, seq, severity)
        except Exception as error:
            self._outside = error
            raise

    def say(
        self, text: str, severity: int = mav.MAV_SEVERITY_WARNING, *, kind: EventKind = "status"
    ) -> None:
        """Send a status text to ground stations, in as many messages as it takes (one that is not
        full ends it), and tell it to observers.
        """
        data, number = text.encode("ascii", "replace"), 0
        if len(data) > _TEXT_BYTES:
            number = self._last_text = self._last_text % 65535 + 1
        ends = range(0, len(data) + (number > 0), _TEXT_BYTES) or (0,)
        for chunk, at in enumerate(ends):
            part = data[at : at + _TEXT_BYTES]
            self._outbox.append(mav.MAVLink_statustext_message(severity, part, number, chunk))
        self._sink(kind, text, None, severity)

    def mode(self, name: str, why: str) -> None:
        """Tell that the flight mode has changed."""
        self.nudged |= {
            mav.MAVLINK_MSG_ID_HEARTBEAT,
            mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
            mav.MAVLINK_MSG_ID_MISSION_CURRENT,
        }
        self._sink("mode", f"{name} ({why})", None, mav.MAV_SEVERITY_INFO)

    def armed(self, armed: bool) -> None:
        """Tell that the motors were armed or disarmed."""
        self.nudged |= _STATE
        self._sink("armed", "armed" if armed else "disarmed", None, mav.MAV_SEVERITY_INFO)

    def nudge(self, kind: int) -> None:
        """Have a telemetry message sent at once: what it says has changed."""
        self.nudged.add(kind)

    def reached(self, seq: int, *, place: bool) -> None:
        """Tell that a mission item was reached (`place`) or carried out."""
        self.items_reached.append(mav.MAVLink_mission_item_reached_message(seq))
        self.nudged.add(mav.MAVLINK_MSG_ID_MISSION_CURRENT)
        if place:
            self._sink("reached", f"item {seq}", seq, mav.MAV_SEVERITY_INFO)

    def failsafe(self, text: str) -> None:
        """Report a failsafe that was triggered, as critical."""
        self.say(text, mav.MAV_SEVERITY_CRITICAL, kind="failsafe")


class _Contained:
    """A context manager; one made of a generator would cost more than what it guards."""

    __slots__ = ("_otherwise", "_reporter", "_what")

    def __init__(
        self, reporter: Reporter, what: str, otherwise: Callable[[], object] | None
    ) -> None:
        self._reporter = reporter
        self._what = what
        self._otherwise = otherwise

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> bool:
        if not isinstance(error, Exception):
            return False
        self._reporter.internal_error(self._what, error)
        if self._otherwise is not None:
            self._otherwise()
        return True
