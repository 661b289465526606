"""Orders to one vehicle, each awaited until telemetry says that it was carried out."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractContextManager, nullcontext

from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.telemetry import FlightMode, LandedState

from mission.base.errors import FlightError, LinkLostError, UnansweredError
from mission.flight.missions.plan_file import PlanFile
from mission.flight.pilot.dialects import Dialect, as_dialect, from_raw, raw_items, same_mission
from mission.flight.pilot.mavsdk_calls import (
    ACCEPTED,
    CUSTOM_MODE,
    DO_SET_MODE,
    Answer,
    Messages,
    reason,
    settled,
)
from mission.flight.pilot.parameters import Parameters
from mission.flight.pilot.watch import Watch
from sitl.autopilot.codec.orders import MissionItem

logger = logging.getLogger(__name__)

POLL_S = 0.01  # wall time between looks at a condition that telemetry may have met
UPLOAD_ATTEMPTS = 3
# By the vehicle's clock. After it leaves mission mode its last MISSION_CURRENT may still be under
# way; PX4 refuses to start a mission that it has just taken until its next checks have seen it.
MODE_GRACE_S = 2.0
START_PAUSES_S = (0.1, 0.3, 0.6)
REASON_POLLS = 100  # a second
TAKE_OFF_TOLERANCE_M = 2.0


class Pilot:
    """Flies one vehicle over one MAVSDK system, while its `watch` runs; see `connect`."""

    def __init__(self, system: System, *, dialect: Dialect, stall_timeout_s: float) -> None:
        self.system = system
        self.dialect = dialect
        self.watch = Watch(system)
        self.messages = Messages(system)
        self.parameters = Parameters(system)
        self._action = ActionAsync(system)
        self._mission = MissionRawAsync(system)
        self._stall_timeout_s = stall_timeout_s
        # Seconds, by which it is judged what the vehicle does: its own, where they are told, so
        # that a simulated flight does not depend on how fast its time goes.
        self.clock: Callable[[], float] = asyncio.get_running_loop().time
        # Whether its vehicle stands still because pilots of others in its world are waited for.
        self.waits: Callable[[], bool] = lambda: False
        # Why its vehicle will not become ready to arm; empty where it may, or nobody knows.
        self.denied: Callable[[], str] = str
        self._held: list[RawItem] = []  # the mission that was uploaded last; none: not by us
        # Around each order: a vehicle whose time goes faster than ours waits for us here.
        self.giving: Callable[[], AbstractContextManager[None]] = nullcontext

    @property
    def mode(self) -> str:
        """The flight mode, by MAVSDK's name."""
        return str(self.watch.mode.name)

    @property
    def armed(self) -> bool:
        """Whether the motors are released."""
        return self.watch.armed

    @property
    def flying(self) -> bool:
        """Whether the vehicle is off the ground, by its own word."""
        return self.watch.landed in (LandedState.IN_AIR, LandedState.TAKING_OFF)

    @property
    def _landed(self) -> bool:
        return self.watch.landed == LandedState.ON_GROUND and not self.watch.armed

    async def ready(self) -> None:
        """Wait until the vehicle says that it can be armed.

        Raises:
            FlightError: it is known that it never will.
            LinkLostError: it falls silent, or never becomes ready.
        """
        while not self.watch.armable:
            if why := self.denied():
                raise FlightError(f"the vehicle cannot be armed: {why}")
            self._check_alive("become ready to arm")
            await asyncio.sleep(POLL_S)
            await self.watch.ask_armable()

    async def lists(self) -> list[tuple[MissionItem, ...]] | None:
        """Download mission, fence and rally points from the vehicle; None if one fails or is not
        whole, as while it answers another ground station of MAVSDK's, too."""
        raw = self._mission
        try:
            lists = [
                await settled(ask())
                for ask in (raw.download_mission, raw.download_geofence, raw.download_rallypoints)
            ]
        except MavsdkError as error:
            logger.info("nothing downloaded: %s", reason(error))
            return None
        if any(item.seq != seq for items in lists for seq, item in enumerate(items)):
            return None
        return [tuple(from_raw(item, self.dialect) for item in items) for items in lists]

    async def arm(self) -> None:
        """Arm the vehicle; where its dialect names one, in a mode that requires a position."""
        if self.dialect.arming_mode is not None:
            number, shown = self.dialect.arming_mode
            self.watch.order_given()
            with self.giving():
                answer = await self.messages.command(DO_SET_MODE, CUSTOM_MODE, number)
            if answer != ACCEPTED:
                raise await self._refused("take the mode to arm in")
            # Before it is seen MAVSDK may order a hold, in whose mode ArduCopter cannot be armed.
            await self.until(lambda: self.mode == shown, "take the mode to arm in")
        await self._order("arm", self._action.arm())
        await self.until(lambda: self.watch.armed, "arm")

    async def take_off(self, alt_rel_m: float) -> None:
        """Arm, climb, and wait for the hover at `alt_rel_m` above home."""
        await self._order("set the take-off altitude", self._action.set_takeoff_altitude(alt_rel_m))
        await self.arm()
        await self._order("take off", self._action.takeoff())
        what = f"climb to {alt_rel_m:g} m and hold there"
        # Telemetry of one instant arrives in several messages, so all of it must agree.
        await self.until(
            lambda: (
                not self.watch.armed
                or (
                    self.watch.landed == LandedState.IN_AIR
                    and self.mode in self.dialect.resting
                    and abs(self.watch.alt_rel_m - alt_rel_m) < TAKE_OFF_TOLERANCE_M
                )
            ),
            what,
        )
        if not self.watch.armed:  # a failsafe landed it; that it crashed may be under way
            await asyncio.sleep(MODE_GRACE_S)
            self._check_alive(what)
            raise FlightError(f"the vehicle did not {what}{_because(self.watch.last_warning)}")

    async def fly(self) -> None:
        """Start the mission that was uploaded, and wait for the end at its last stop.

        Raises:
            FlightError: the vehicle leaves it, or misses its end.
        """
        await self.carry_out()
        await self.until(
            lambda: self.mode in self.dialect.resting, "hold its position after the mission"
        )

    async def carry_out(self, *, lands: bool = False) -> None:
        """Start any mission that was uploaded, and wait until the vehicle has carried it out.

        One that `lands` is over when the motors are off, whatever the vehicle says of the mission.

        Raises:
            FlightError: the vehicle leaves it, or misses its end.
        """
        with self.giving():
            await self._start()
        loop = asyncio.get_running_loop()
        # That the mission before is finished may still be under way; once the vehicle has been in
        # mission mode, its word counts. One that is over at once may never be seen in that mode.
        entered, since = False, None
        while True:
            self._check_alive("finish the mission")
            if lands and self._landed:
                return
            if self.watch.mode == FlightMode.MISSION:
                entered, since = True, None
            elif since is None:
                since = self.clock(), loop.time()
            left = since is not None and self.clock() - since[0] > MODE_GRACE_S
            if (entered or left) and await self._mission_finished():
                return
            # An error ends the flight: it waits for what is under way on the link, too.
            if left and since is not None and loop.time() - since[1] > MODE_GRACE_S:
                mode, said = self.watch.left_mission or (self.watch.mode, "")
                because = _because(said or self.watch.why)
                raise FlightError(f"the vehicle left the mission for {mode.name}{because}")
            await asyncio.sleep(POLL_S)

    async def _start(self) -> None:
        for pause_s in START_PAUSES_S:
            self.watch.order_given()
            try:
                await settled(self._mission.start_mission())
            except MavsdkError as error:
                if "DENIED" not in reason(error):
                    raise await self._refused("start the mission", error) from None
                logger.info("mission start: %s", error)
                await self._pause(pause_s, "start the mission")
            else:
                return
        await self._order("start the mission", self._mission.start_mission())

    async def _pause(self, seconds: float, what: str) -> None:
        end_s = self.clock() + seconds
        await self.until(lambda: self.clock() >= end_s, what)

    async def _mission_finished(self) -> bool:
        # MAVSDK knows it; the asyncio wrapper asks in a thread, at forty times the cost, and has no
        # public way (4.1) to the plugin that it wraps.
        try:
            return bool(self._mission._plugin.is_mission_finished())
        except MavsdkError as error:
            raise await self._refused("report the mission", error) from None

    async def version(self) -> str:
        """The version that the vehicle says its software is; empty where it does not."""
        try:
            said = await settled(InfoAsync(self.system).get_version())
        except MavsdkError as error:
            logger.info("no version: %s", error)
            return ""
        number = f"{said.flight_sw_major}.{said.flight_sw_minor}.{said.flight_sw_patch}"
        return f"{number} {said.flight_sw_git_hash}" if self.dialect.tells_commit else number

    async def upload_fence(self, items: Sequence[MissionItem]) -> None:
        """Upload a geofence."""
        await self._order("take the geofence", self._mission.upload_geofence(raw_items(items)))

    async def upload_surroundings(self, plan: PlanFile) -> None:
        """Upload a plan file's fence and rally points, where it has any."""
        if plan.fence:
            await self.upload_fence(plan.fence)
        if plan.rally:
            await self._order(
                "take the rally points", self._mission.upload_rally_points(raw_items(plan.rally))
            )

    async def fly_plan(
        self,
        plan: PlanFile,
        *,
        returns: bool,
        begins: Callable[[], None] = lambda: None,
        starts: Callable[[], Awaitable[object]] | None = None,
    ) -> None:
        """Fly a plan file from the ground to the ground; one that does not return is brought home.

        `begins` is called when the vehicle is ready for it, `starts` awaited before it is armed.
        """
        await self.ready()
        await self.upload_surroundings(plan)
        begins()
        await self.upload_items(plan.items)
        if starts is not None:
            await starts()
        await self.arm()
        await self.carry_out()
        if returns:
            await self.landed()
        else:
            await self.land()

    async def landed(self) -> None:
        """Wait until the vehicle stands on the ground with its motors off."""
        await self.until(lambda: self._landed, "land and disarm")

    async def land(self) -> None:
        """Return to home, land, and wait until the motors are off."""
        await self._order("return and land", self._action.return_to_launch())
        await self.landed()

    async def hold(self) -> None:
        """Stop and hover where the vehicle is."""
        await self._order("hold", self._action.hold())

    async def until(self, met: Callable[[], bool], what: str) -> None:
        """Wait until `met()`; `what` the vehicle should do meanwhile goes into the error.

        Raises:
            LinkLostError, FlightError: it falls silent, or is lost.
        """
        while not met():
            self._check_alive(what)
            await asyncio.sleep(POLL_S)

    async def upload_items(self, items: Sequence[MissionItem]) -> None:
        """Upload any mission, numbered from 0, and make its first item the next.

        Raises:
            FlightError: the vehicle refuses it.
        """
        sent = as_dialect(raw_items(items), self.dialect)
        self.watch.order_given()
        refusal: MavsdkError | None = None
        for attempt in range(1, UPLOAD_ATTEMPTS + 1):
            try:
                with self.giving():
                    await settled(self._mission.upload_mission(sent))
                    back = await settled(self._mission.download_mission())
            except MavsdkError as error:
                logger.info("mission upload, attempt %d: %s", attempt, error)
                self._check_alive("take a mission")
                refusal = error
                continue
            if same_mission(sent, back, self.dialect):
                if self.dialect.rewinds or same_mission(sent, self._held or sent, self.dialect):
                    rewind = self._mission.set_current_mission_item(self.dialect.first_item)
                    await self._order("rewind the mission", rewind)
                self._held = sent
                return
            refusal = None
        if refusal is not None:
            raise await self._refused(f"take the mission of {len(sent)} items", refusal)
        raise FlightError(f"the vehicle holds another mission than the {len(sent)} items uploaded")

    async def _order(self, what: str, call: Awaitable[Answer]) -> Answer:
        """Give an order: a refusal is explained by the first warning after it."""
        self.watch.order_given()
        try:
            with self.giving():
                return await settled(call)
        except MavsdkError as error:
            raise await self._refused(what, error) from None

    async def _refused(self, what: str, error: MavsdkError | None = None) -> FlightError:
        """Return the error of a refusal, with the vehicle's own warning, awaited for a second."""
        for _ in range(REASON_POLLS):
            if self.watch.first_warning:
                break
            await asyncio.sleep(POLL_S)
        said = _because(self.watch.first_warning)
        why = "" if error is None else f": {reason(error)}"
        kind = UnansweredError if why.endswith("TIMEOUT") else FlightError
        return kind(f"the vehicle did not {what}{why}{said}")

    def _check_alive(self, what: str) -> None:
        watch = self.watch
        if watch.crash:
            raise FlightError(f"the aircraft is lost; it said: {watch.crash}")
        if self.waits():
            watch.expect()
        if watch.silence_s > self._stall_timeout_s:
            raise LinkLostError(
                f"no sign of the vehicle for {watch.silence_s:.0f} s while it should {what}"
                f"{_because(watch.why)}"
            )


def _because(said: str) -> str:
    return f" (it said: {said})" if said else ""
