"""The asyncio mission controller: the one home of mavsdk.

A pilot knows the vehicle only by MAVLink. It gives an order, waits until telemetry says that it
was carried out, and gives up when the vehicle falls silent. Wall time is read by its watchdog
alone, which may end a flight but never alters one.
"""

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Any

from mavsdk.asyncio import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.autopilot import Autopilot
from mavsdk.component_type import ComponentType
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.telemetry import FlightMode, LandedState

from flightdyn.state import GeodeticPoint
from mission.dialects import ARDUPILOT, PX4, Dialect
from mission.errors import FlightError, LinkLostError
from mission.flightplan import FlightPlan
from sitl.links import RawLink

logger = logging.getLogger(__name__)

POLL_S = 0.01  # wall time between looks at a condition that telemetry may have met
CONNECT_TIMEOUT_S = 10.0
SETTLE_TIMEOUT_S = 10.0  # MAVSDK's own time-outs are shorter
UPLOAD_ATTEMPTS = 3
# After the vehicle leaves mission mode its last MISSION_CURRENT may still be under way.
MODE_GRACE_S = 2.0
_CRASH = "crash"  # a critical text that begins so, of this vehicle ("Crashed") and of ArduPilot
REASON_POLLS = 100  # a second
TAKE_OFF_TOLERANCE_M = 2.0

FRAME_GLOBAL_RELATIVE_ALT_INT = 6
NAV_WAYPOINT = 16
DO_CHANGE_SPEED = 178
GROUND_SPEED = 1.0
UNCHANGED = -1.0


class Pilot:
    """Flies one vehicle over one MAVSDK system. Build it with `connect`."""

    def __init__(self, system: Any, *, dialect: Dialect = PX4, stall_timeout_s: float) -> None:
        self.system = system
        self.dialect = dialect
        self._action = ActionAsync(system)
        self._mission = MissionRawAsync(system)
        self._telemetry = TelemetryAsync(system)
        self._stall_timeout_s = stall_timeout_s
        self._last_change = asyncio.get_running_loop().time()
        self._position: tuple[float, ...] = ()
        self._alt_rel_m = math.nan
        self._armable = False
        self._armed = False
        self._mode = FlightMode.UNKNOWN
        self._landed = LandedState.UNKNOWN
        self._last_warning = ""
        self._crash = ""  # what the vehicle said of it

    @property
    def mode(self) -> str:
        """The flight mode, by MAVSDK's name."""
        return str(self._mode.name)

    @property
    def armed(self) -> bool:
        """Whether the motors are released."""
        return self._armed

    # --- orders -------------------------------------------------------------------------------

    async def ready(self) -> None:
        """Wait until the vehicle says that it can be armed.

        Raises:
            LinkLostError: it falls silent, or never becomes ready.
        """
        await self._until(lambda: self._armable, "become ready to arm")

    async def take_off(self, alt_rel_m: float) -> None:
        """Arm, climb, and wait for the hover at `alt_rel_m` above home."""
        await self._order("set the take-off altitude", self._action.set_takeoff_altitude(alt_rel_m))
        await self.arm()
        await self._order("take off", self._action.takeoff())
        # Telemetry of one instant arrives in several messages, so all of it must agree.
        await self._until(
            lambda: (
                self._landed == LandedState.IN_AIR
                and self.mode in self.dialect.resting
                and abs(self._alt_rel_m - alt_rel_m) < TAKE_OFF_TOLERANCE_M
            ),
            f"climb to {alt_rel_m:g} m and hold there",
        )

    async def fly(self, plan: FlightPlan, positions: Sequence[GeodeticPoint]) -> None:
        """Upload the stops at `positions`, start, and wait for the end at the last one.

        Raises:
            FlightError: the vehicle refuses the mission, leaves it, or misses its end.
        """
        await self.fly_items(mission_items(plan, positions, self.dialect))
        await self._until(
            lambda: self.mode in self.dialect.resting, "hold its position after the mission"
        )

    async def arm(self) -> None:
        """Release the motors."""
        await self._order("arm", self._action.arm())
        await self._until(lambda: self._armed, "arm")

    async def fly_items(self, items: list[MissionItem]) -> None:
        """Upload any mission, start it, and wait until the vehicle has carried it out.

        Raises:
            FlightError: the vehicle refuses the mission, leaves it, or misses its end.
        """
        await self._upload(items)
        await self._order("start the mission", self._mission.start_mission())
        loop = asyncio.get_running_loop()
        left_at: float | None = None
        while not await self._order("report the mission", self._mission.is_mission_finished()):
            self._check_alive("finish the mission")
            if self._mode == FlightMode.MISSION:
                left_at = None
            elif left_at is None:
                left_at = loop.time()
            elif loop.time() - left_at > MODE_GRACE_S:
                raise FlightError(
                    f"the vehicle left the mission for {self._mode.name}{self._because()}"
                )
            await asyncio.sleep(POLL_S)

    async def upload_fence(self, items: list[MissionItem]) -> None:
        """Upload a geofence."""
        await self._order("take the geofence", self._mission.upload_geofence(items))

    async def landed(self) -> None:
        """Wait until the vehicle stands on the ground with its motors off."""
        await self._until(
            lambda: self._landed == LandedState.ON_GROUND and not self._armed,
            "land and disarm",
        )

    async def land(self) -> None:
        """Return to home, land, and wait until the motors are off."""
        await self._order("return and land", self._action.return_to_launch())
        await self.landed()

    async def hold(self) -> None:
        """Stop and hover where the vehicle is."""
        await self._order("hold", self._action.hold())

    # --- how ----------------------------------------------------------------------------------

    async def _upload(self, items: list[MissionItem]) -> None:
        for attempt in range(1, UPLOAD_ATTEMPTS + 1):
            try:
                await _settled(self._mission.upload_mission(items))
                back = await _settled(self._mission.download_mission())
            except MavsdkError as error:
                logger.info("mission upload, attempt %d: %s", attempt, error)
                self._check_alive("take a mission")
                failure = (
                    f"the vehicle did not take the mission of {len(items)} items: {reason(error)}"
                )
                continue
            first = int(self.dialect.home_first)
            if self._essence(back[first:]) == self._essence(items[first:]):
                await self._order(
                    "rewind the mission", self._mission.set_current_mission_item(first)
                )
                return
            failure = f"the vehicle holds another mission than the {len(items)} items uploaded"
        raise FlightError(failure)

    def _essence(self, items: list[MissionItem]) -> list[tuple[int, ...]]:
        """What must come back unchanged; parameters travel as 32-bit floats, heights in cm."""
        return [
            (
                item.seq, item.command, item.x, item.y, round(item.z * 100),
                round(item.param2 * 1000) if self.dialect.keeps_radius else 0,
            )
            for item in items
        ]  # fmt: skip

    async def _order(self, what: str, call: Awaitable[Any]) -> Any:
        try:
            return await _settled(call)
        except MavsdkError as error:
            # The vehicle's own words may come a little after its refusal.
            for _ in range(REASON_POLLS):
                if self._last_warning:
                    break
                await asyncio.sleep(POLL_S)
            raise FlightError(
                f"the vehicle did not {what}: {reason(error)}{self._because()}"
            ) from None

    async def _until(self, met: Callable[[], bool], what: str) -> None:
        while not met():
            self._check_alive(what)
            await asyncio.sleep(POLL_S)

    def _check_alive(self, what: str) -> None:
        if self._crash:
            raise FlightError(f"the aircraft is lost; it said: {self._crash}")
        silence = asyncio.get_running_loop().time() - self._last_change
        if silence > self._stall_timeout_s:
            raise LinkLostError(
                f"no sign of the vehicle for {silence:.0f} s while it should {what}"
                f"{self._because()}"
            )

    def _because(self) -> str:
        return f" (it said: {self._last_warning})" if self._last_warning else ""

    # --- telemetry ----------------------------------------------------------------------------

    def _changed(self) -> None:
        self._last_change = asyncio.get_running_loop().time()

    async def watch(self) -> None:
        """Follow telemetry until cancelled. `connect` runs it beside the pilot."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._watch_position())
            group.create_task(self._watch_armable())
            group.create_task(self._watch_armed())
            group.create_task(self._watch_mode())
            group.create_task(self._watch_landed())
            group.create_task(self._watch_text())

    async def _watch_position(self) -> None:
        async for position in self._telemetry.subscribe_position():
            seen = (position.latitude_deg, position.longitude_deg, position.relative_altitude_m)
            self._alt_rel_m = position.relative_altitude_m
            if seen != self._position:
                self._position = seen
                self._changed()

    async def _watch_armable(self) -> None:
        async for health in self._telemetry.subscribe_health():
            if health.is_armable != self._armable:
                self._changed()
            self._armable = health.is_armable

    async def _watch_armed(self) -> None:
        async for armed in self._telemetry.subscribe_armed():
            self._armed = armed
            self._changed()

    async def _watch_mode(self) -> None:
        async for mode in self._telemetry.subscribe_flight_mode():
            if mode != self._mode:
                self._changed()
            self._mode = mode

    async def _watch_landed(self) -> None:
        async for landed in self._telemetry.subscribe_landed_state():
            if landed != self._landed:
                self._changed()
            self._landed = landed

    async def _watch_text(self) -> None:
        async for status in self._telemetry.subscribe_status_text():
            logger.info("vehicle: %s", status.text)
            if status.type >= 3:  # StatusTextType.WARNING and worse
                self._last_warning = status.text
            if status.type >= 5 and status.text.lower().startswith(_CRASH):  # CRITICAL and worse
                self._crash = status.text


async def _settled(call: Awaitable[Any]) -> Any:
    """The result of a MAVSDK call. An interruption is raised when the call has ended.

    The call runs in a thread, and MAVSDK must not be taken down under it: both would wait for
    ever.
    """
    running = asyncio.ensure_future(call)
    try:
        return await asyncio.shield(running)
    except asyncio.CancelledError:
        await asyncio.wait((running,), timeout=SETTLE_TIMEOUT_S)
        if running.done() and not running.cancelled():
            running.exception()  # seen, so that nobody reports it as forgotten
        raise


@asynccontextmanager
async def connect(
    url: str, *, raw_link: RawLink | None = None, stall_timeout_s: float = 30.0
) -> AsyncIterator[Pilot]:
    """Open a MAVSDK connection and yield a pilot for the first autopilot on it.

    With `raw_link`, `url` must be `raw://` and MAVSDK exchanges bytes with a vehicle in this
    process.

    Raises:
        LinkLostError: the connection cannot be opened, or no autopilot answers on it.
    """
    log_subscribe(log_mavsdk)
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        try:
            await mavsdk.add_any_connection(url)
        except MavsdkError as error:
            raise LinkLostError(f"cannot open {url}: {error}") from None
        if raw_link is not None:
            # The asyncio wrapper of mavsdk 4.1 does not pass these two on.
            core = mavsdk._mavsdk
            core.subscribe_raw_bytes_to_be_sent(raw_link.feed)
            raw_link.attach(core.pass_received_raw_bytes)
        try:
            system = await mavsdk.first_autopilot(timeout_s=CONNECT_TIMEOUT_S)
            if system is None:
                raise LinkLostError(f"no vehicle answered on {url} in {CONNECT_TIMEOUT_S:g} s")
            kind = await system.autopilot_type()
            dialect = ARDUPILOT if kind == Autopilot.ARDUPILOT else PX4
            pilot = Pilot(system, dialect=dialect, stall_timeout_s=stall_timeout_s)
            watch = asyncio.create_task(pilot.watch())
            try:
                yield pilot
            finally:
                watch.cancel()
                with suppress(asyncio.CancelledError):
                    await watch
        finally:
            if raw_link is not None:
                raw_link.detach()


def mission_items(
    plan: FlightPlan, positions: Sequence[GeodeticPoint], dialect: Dialect = PX4
) -> list[MissionItem]:
    """The stops as MAVLink items: the first stop, the speed of all legs, the other stops.

    The first stop is where the vehicle already is; the speed stands after it because autopilots
    apply DO_CHANGE_SPEED to the leg after the item before it. See `stop_sequence`.
    """
    waypoints = [
        _item(
            NAV_WAYPOINT,
            stop.hold_s,
            plan.acceptance_m,
            0.0,
            math.nan,
            x=round(position.lat_deg * 1e7),
            y=round(position.lon_deg * 1e7),
            z=plan.alt_rel_m,
        )
        for stop, position in zip(plan.stops, positions, strict=True)
    ]
    speed = _item(DO_CHANGE_SPEED, GROUND_SPEED, plan.speed_mps, UNCHANGED, 0.0)
    items = [waypoints[0], speed, *waypoints[1:]]
    if dialect.home_first:
        # The autopilot puts its own home there.
        home = positions[0]
        items.insert(
            0,
            _item(
                NAV_WAYPOINT, 0.0, 0.0, 0.0, 0.0,
                x=round(home.lat_deg * 1e7), y=round(home.lon_deg * 1e7), z=0.0,
            ),
        )  # fmt: skip
    for seq, item in enumerate(items):
        item.seq = seq
        item.current = int(seq == int(dialect.home_first))
        if dialect.finite and math.isnan(item.param4):
            item.param4 = 0.0
    return items


def stop_sequence(plan: FlightPlan, dialect: Dialect = PX4) -> list[int]:
    """The MAVLink sequence number of every stop in `mission_items`."""
    first = int(dialect.home_first)
    return [first, *range(first + 2, first + len(plan.stops) + 1)]


def _item(command: int, *params: float, x: int = 0, y: int = 0, z: float = 0.0) -> MissionItem:
    return MissionItem(
        seq=0,
        frame=FRAME_GLOBAL_RELATIVE_ALT_INT,
        command=command,
        current=0,
        autocontinue=1,
        param1=params[0],
        param2=params[1],
        param3=params[2],
        param4=params[3],
        x=x,
        y=y,
        z=z,
        mission_type=0,
    )


def reason(error: MavsdkError) -> str:
    """MAVSDK's result alone, without the arguments of the call."""
    return str(error).partition(";")[0]


def log_mavsdk(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Take MAVSDK's own messages into ours; for `log_subscribe`."""
    # MAVSDK's complaints are for whoever debugs; what matters of them becomes our own errors.
    worth = logging.INFO if level in (LogLevel.WARN, LogLevel.ERROR) else logging.DEBUG
    logger.log(worth, "mavsdk: %s", message)
    return True
