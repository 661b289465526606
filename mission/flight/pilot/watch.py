"""What telemetry said last, when it last said anything new, and whether the vehicle knows where it
is: only then may its position be believed, and only then may it be armed. An autopilot streams
positions long before, ArduPilot 0, 0 among them."""

import asyncio
import logging
import math
from collections.abc import Callable
from functools import partial

from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.telemetry import (
    FlightMode,
    Health,
    LandedState,
    Position,
    StatusText,
    StatusTextType,
)

from mission.flight.pilot.mavsdk_calls import Messages, follow, settled
from sitl.autopilot.codec.orders import Fields

logger = logging.getLogger(__name__)

_MOST_GRAVE = StatusTextType.EMERGENCY.value  # MAVSDK counts the other way round
# Wall time after which a warning is no reason any more for what happens, and what the warnings of
# checks before take-off begin with: in flight they are none at all.
_STALE_S = 5.0
_BEFORE_TAKEOFF = ("preflight", "prearm", "arm:")
_CRASH = "crash"  # a critical text that begins so, of this vehicle ("Crashed") and of ArduPilot
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


class Watch:
    """The newest telemetry of one vehicle, while `run` runs."""

    def __init__(self, system: System) -> None:
        self._telemetry = TelemetryAsync(system)
        self._changed_at = asyncio.get_running_loop().time()
        self._position: tuple[float, ...] = ()
        self.alt_rel_m = math.nan
        self.armable = False
        self.armed = False
        self.mode = FlightMode.UNKNOWN
        self.landed = LandedState.UNKNOWN
        # Hear every status text, with its MAV_SEVERITY.
        self.listeners: list[Callable[[int, str], None]] = []
        self.crash = ""  # what the vehicle said of it
        # Of the warnings since the last order: the first is why it was refused.
        self.first_warning = ""
        self.last_warning = ""
        self._warned_at = -math.inf  # wall time of the last
        # For which mode it left the mission since then, and why, as it said by that time: what it
        # does and says after that follows from it.
        self.left_mission: tuple[FlightMode, str] | None = None

    @property
    def silence_s(self) -> float:
        """Wall seconds since something changed."""
        return asyncio.get_running_loop().time() - self._changed_at

    def expect(self) -> None:
        """Expect no sign of life before now."""
        self._changed_at = asyncio.get_running_loop().time()

    @property
    def why(self) -> str:
        """The last warning, if it may be why an order is no longer carried out in flight."""
        late = self._changed_at - self._warned_at > _STALE_S  # nothing changes where it fell silent
        of_takeoff = self.last_warning.lower().startswith(_BEFORE_TAKEOFF)
        return "" if late or of_takeoff else self.last_warning

    def order_given(self) -> None:
        """Forget earlier warnings: only those from now on may be about the order being given."""
        self.first_warning = self.last_warning = ""
        self.left_mission = None

    async def run(self) -> None:
        """Follow telemetry until cancelled."""
        said = self._telemetry
        await follow(
            (said.subscribe_position(), self._take_position),
            (said.subscribe_health(), self._take_health),
            (said.subscribe_armed(), partial(self._take, "armed")),
            (said.subscribe_flight_mode(), self._take_mode),
            (said.subscribe_landed_state(), partial(self._take, "landed")),
            (said.subscribe_status_text(), self._take_text),
        )

    async def ask_armable(self) -> None:
        """Look whether the vehicle can be armed: MAVSDK tells it only once a second."""
        self._take_health(await settled(self._telemetry.health()))

    def _take(self, name: str, value: object) -> None:
        """Note a value; only one that differs from the last is a sign of life."""
        if value != getattr(self, name):
            self._changed_at = asyncio.get_running_loop().time()
        setattr(self, name, value)

    def _take_position(self, position: Position) -> None:
        seen = (position.latitude_deg, position.longitude_deg, position.relative_altitude_m)
        self.alt_rel_m = position.relative_altitude_m
        self._take("_position", seen)

    def _take_health(self, health: Health) -> None:
        self._take("armable", health.is_armable)

    def _take_mode(self, mode: FlightMode) -> None:
        if self.mode == FlightMode.MISSION != mode:
            self.left_mission = mode, self.why
        self._take("mode", mode)

    def _take_text(self, status: StatusText) -> None:
        logger.info("vehicle: %s", status.text)
        for listener in self.listeners:
            listener(_MOST_GRAVE - status.type.value, status.text)
        if status.type >= StatusTextType.WARNING:
            self._warned(status.text)
        grave = status.type >= StatusTextType.CRITICAL
        if grave and status.text.lower().startswith(_CRASH):
            self.crash = status.text

    def _warned(self, text: str) -> None:
        self.first_warning = self.first_warning or text
        self.last_warning, self._warned_at = text, asyncio.get_running_loop().time()


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
