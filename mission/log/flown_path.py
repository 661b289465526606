"""The flown path so far, as a message now and then."""

from flightdyn.state import Kinematics
from mission.base.area import Area
from mission.log import messages
from mission.log.rates import Every
from mission.log.values import NS_PER_S

_POINT_NS = NS_PER_S  # spacing of the points
# It is written whole, so that it is there wherever somebody looks; a long one more rarely, or the
# log would grow with the square of the flight.
_EVERY = 5  # points
_SHARE = 20  # or the twentieth part of it


class FlownPath:
    """The true track of a round, a point a second."""

    def __init__(self) -> None:
        self._point = Every(_POINT_NS)
        self.forget()

    def forget(self) -> None:
        """Begin another path."""
        self._points, self._count = bytearray(), 0
        self._due = 1  # points at which it is written next

    def extend(self, t_ns: int, area: Area, truth: Kinematics) -> bool:
        """Take a position; whether the path is to be written now."""
        if not self._point.now(t_ns):
            return False
        self._points += messages.path_points([messages.area_xyz(area, truth.pos_ned_m)])
        self._count = count = self._count + 1
        if count < self._due:
            return False
        self._due = count + max(_EVERY, count // _SHARE)
        return True

    def message(self, t_ns: int) -> bytes | None:
        """The path as it is; None without a point."""
        return messages.path(messages.timestamp(t_ns), self._points) if self._count else None
