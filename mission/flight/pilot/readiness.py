"""Whether a vehicle knows where it is: only then may its position be believed, and only then may
it be armed. An autopilot streams positions long before, ArduPilot 0, 0 among them.
"""

from mission.flight.pilot.raw_messages import Messages, follow
from sitl.autopilot.codec.orders import Fields

FIX_3D = 3  # GPS_FIX_TYPE

# ESTIMATOR_STATUS_FLAGS of common.xml; EKF_STATUS_FLAGS of ardupilotmega.xml has the same bits.
_NEEDED = {
    1: "attitude",
    2: "horizontal velocity",
    4: "vertical velocity",
    16: "horizontal position",
    32: "height",
}
# "Position assumed constant" (128) is not among them: PX4 says it of any vehicle at rest.
_FORBIDDEN = {1024: "not started, or misled by GPS"}


class Readiness:
    """GNSS fix, estimator status and home position that a vehicle has reported."""

    def __init__(self, estimator: str) -> None:
        self._estimator = estimator
        # Whether it agreed to stream its estimator's status; None: not asked yet.
        self.estimator_promised: bool | None = None
        self.forget()

    def forget(self) -> None:
        """Forget all reports: the vehicle has started anew."""
        self._fix_type: int | None = None
        self._flags: int | None = None
        self._home = False

    @property
    def missing(self) -> str:
        """What keeps its position from being believed, for people; empty where nothing does."""
        wanted = []
        if self._fix_type is None:
            wanted.append("no word of its GPS")
        elif self._fix_type < FIX_3D:
            wanted.append("no 3D GPS fix")
        if self._flags is not None or self.estimator_promised is not False:
            wanted += [words] if (words := _estimator_lacks(self._flags)) else []
        if not self._home:
            wanted.append("no home position")
        return ", ".join(wanted)

    @property
    def estimator(self) -> str:
        """What its estimator says, for people; empty before it says anything."""
        return "" if self._flags is None else _estimator_lacks(self._flags) or "estimator: complete"

    async def watch(self, messages: Messages) -> None:
        """Follow what the vehicle says until cancelled."""
        await follow(
            (messages.of("GPS_RAW_INT"), self._take_fix),
            (messages.of(self._estimator), self._take_flags),
            (messages.of("HOME_POSITION"), self._take_home),
        )

    def _take_fix(self, fields: Fields) -> None:
        self._fix_type = fields["fix_type"]

    def _take_flags(self, fields: Fields) -> None:
        self._flags = fields["flags"]

    def _take_home(self, fields: Fields) -> None:
        self._home = (fields["latitude"], fields["longitude"]) != (0, 0)


def _estimator_lacks(flags: int | None) -> str:
    if flags is None:
        return "no word of its estimator"
    lacks = [words for bit, words in _NEEDED.items() if not flags & bit]
    wrong = [words for bit, words in _FORBIDDEN.items() if flags & bit]
    without = [f"without {' and '.join(lacks)}"] if lacks else []
    return f"estimator {', '.join([*without, *wrong])}" if lacks or wrong else ""
