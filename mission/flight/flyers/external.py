"""An external autopilot flies, known by its telemetry alone.

What is known of such a flight is what the autopilot itself believes: truth, belief and telemetry
are the same here, and time is the vehicle's own.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import LimitsConfig
from mission.base import polyline
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import AerofedError, FlightError, LinkLostError
from mission.base.interrupts import run_flight
from mission.config.link import LinkConfig
from mission.config.models import MissionConfig
from mission.flight.flyers.base import CHARGED, HOLD_TIMEOUT_S, Attached, Backend, Flyer, Say
from mission.flight.missions.plan_check import CheckedPath, wait_of
from mission.flight.missions.plan_file import PlanFile
from mission.flight.missions.round_mission import Demand, FlightPlan, mission_items, stop_items
from mission.flight.pilot.connection import located, until, until_ready
from mission.flight.pilot.feed import TelemetryFeed
from mission.flight.pilot.parameters import VehicleLimits, adjusted, read_limits
from mission.flight.pilot.pilot import Pilot
from mission.flight.track import FlightRecorder, FlownTrack, TrackPoint, passages, reported_in_turn
from mission.log.values import AUTOPILOT
from sitl.autopilot.codec.orders import MissionItem

LAST_SAMPLE_S = 2.0  # wall time
ASK_AGAIN_S = 10.0  # wall time; a vehicle that started anew has forgotten the streams
_FIRST_READING_S = 3.0  # the vehicle's time, of the battery
_SHORT_M = 20.0  # braking at the end may take it beyond the acceptance radius
_SLOW = 0.95  # of the planned speed: the rest is how a leg is flown
_LEAST_PACE, _MOST_PACE = 0.5, 3.0  # of flights against what was foreseen of them
_RUN_UP_MPS2 = 2.0  # a leg of v^2 over this is long enough to reach v, and
_AT_SPEED_S = 2.0  # so much longer for it to be kept
_SECOND_NS = 1_000_000_000
_LEAST_MPS = 0.1  # that plans are timed by


@dataclass
class ExternalFlyer(Flyer):
    """Flyer of an external autopilot; what was flown is known from telemetry only."""

    pilot: Pilot
    feed: TelemetryFeed
    recorder: FlightRecorder
    area: Area
    mission: MissionConfig
    guidance: LimitsConfig
    link: LinkConfig
    say: Say

    def __post_init__(self) -> None:
        self._doubted = False
        self._ordered_mps = self.mission.speed_mps  # plans may be timed by a lower speed
        self._foreseen_s = self._flown_s = 0.0  # of the rounds so far

    @property
    def t_ns(self) -> int:
        """The vehicle's time since the first position."""
        return self.here().t_ns

    @property
    def battery_remaining(self) -> float:
        return self.feed.battery_remaining

    def here(self) -> TrackPoint:
        here = self.feed.here
        if here is None:
            raise LinkLostError("the vehicle has not said yet where it is")
        return here

    async def ready(self) -> None:
        """Wait until the vehicle knows where it is and can be armed.

        Raises:
            FlightError: it is armed already, or not ready in time.
        """
        await until_ready(self.pilot, self.feed, timeout_s=self.link.ready_timeout_s)
        if self.pilot.armed:
            raise FlightError("the vehicle is armed already: land and disarm it first")

    async def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Upload a geofence to the vehicle, which keeps it after the flight."""
        await self.ready()
        await self.pilot.upload_fence(items)

    async def take_off(self) -> None:
        """Climb from the ground to the hover above where the vehicle stands.

        Raises:
            FlightError: see `ready`; or nobody charged an empty battery in time.
        """
        await self.ready()
        reserve = self.mission.battery_reserve
        if reserve > 0.0:
            await self._battery_told()
        if self.battery_remaining < reserve:
            self.say(f"{self._low(reserve)}: no take-off before it is charged")
            await self._change_battery(reserve)
        await self.pilot.take_off(self.altitude_m)

    async def upload(self, plan: FlightPlan) -> None:
        """Give the vehicle the stops; it hovers meanwhile."""
        if not (plan.stands or plan.waits):
            ordered = replace(plan, speed_mps=self._ordered_mps)
            await self.pilot.upload_items(mission_items(ordered, self.area))

    async def fly(self, plan: FlightPlan) -> FlownTrack:
        if plan.stands:
            here = self.here()
            return FlownTrack.standing(here, self.battery_remaining)
        if plan.waits:  # a mission that is over at once takes some autopilots long to tell
            end_ns = self.t_ns + round(1e9 * plan.stops[0].hold_s)
            flight = await self.record(lambda: self.wait(end_ns), goes_on=plan.goes_on)
            return replace(flight, passages=(flight.at(int(flight.t_ns[0])),))
        stops = self.area.to_ned(plan.points_m, plan.alt_rel_m)
        flight = await self.record(self.pilot.fly, goes_on=plan.goes_on)
        short_m = float(np.linalg.norm(stops[-1, :2] - flight.est_ned_m[-1, :2]))
        check_end(short_m, acceptance_m=plan.acceptance_m)
        hold_s = [stop.hold_s for stop in plan.stops]
        passed = self.find_passages(flight, stops, items=stop_items(plan), hold_s=hold_s)
        self._believe_speed(plan, flight)
        self._believe_pace(plan, flight)
        return replace(flight, passages=passed)

    async def wait(self, until_ns: int) -> None:
        """Hover up to an instant of the vehicle's time."""
        await self.pilot.until(lambda: self.here().t_ns >= until_ns, "hover")

    async def carry_out(
        self, plan: PlanFile, path: CheckedPath, *, begins: Callable[[], None]
    ) -> None:
        """Fly a plan file.

        Its return is ordered, not part of the mission: each family of autopilots has its own idea
        of when a mission with a return is over.
        """
        items = [item for item in plan.items if item.command != mav.MAV_CMD_NAV_RETURN_TO_LAUNCH]
        lands = items[-1].command == mav.MAV_CMD_NAV_LAND
        await self.ready()
        await self.pilot.upload_surroundings(plan)
        await self.pilot.upload_items(items)
        if any(item.command == mav.MAV_CMD_NAV_TAKEOFF for item in items):  # so it comes first
            await self.pilot.arm()
        else:  # not every autopilot leaves the ground for a waypoint
            await self.pilot.take_off(-float(path.places[0][1][2]))
        begins()
        flight = await self.record(lambda: self.pilot.carry_out(lands=lands))
        sequence = [seq for seq, _ in path.places]
        places = np.array([place for _, place in path.places])
        hold_s = [wait_of(plan.items[seq]) for seq in sequence]
        passed = self.find_passages(flight, places, items=sequence, hold_s=hold_s)
        check_end(float(np.linalg.norm((passed[-1].est_ned_m - places[-1])[:2])))
        if lands:
            await self.seen_down()
        else:
            await self.land()

    async def record(
        self, fly: Callable[[], Awaitable[None]], *, goes_on: bool = False
    ) -> FlownTrack:
        """Run `fly`, which carries out an uploaded mission, and return what was flown meanwhile."""
        self.feed.reached_ns.clear()
        self.recorder.start(self.here(), goes_on=goes_on)
        await fly()
        return self.recorder.finish(self.here(), self.battery_remaining)

    def find_passages(
        self,
        flight: FlownTrack,
        places_ned_m: Floats,
        *,
        items: Sequence[int],
        hold_s: Sequence[float],
    ) -> tuple[TrackPoint, ...]:
        """When a flight passed the places (S, 3) of the mission `items`; told to the observers."""
        passed = passages(
            flight,
            places_ned_m,
            reported_ns=reported_in_turn(self.feed.reached_ns, items),
            hovers=[wait_s > 0.0 for wait_s in hold_s],
        )
        for item, passage in zip(items, passed, strict=True):
            self.feed.passed(item, passage)
        return passed

    async def land(self) -> None:
        await self.go_home()
        await self.pilot.land()
        await self.seen_down()

    async def seen_down(self) -> None:
        """Wait for the sample that shows the motors off, so that track and log have it."""
        landed_ns = self.here().t_ns
        with suppress(TimeoutError):
            async with asyncio.timeout(LAST_SAMPLE_S):
                await until(lambda: self.here().t_ns > landed_ns)

    async def refresh(self, needed: float) -> bool:
        """See `Flyer`; people are told, because somebody has to charge or change the battery."""
        self._doubt_battery()
        if self.battery_remaining < needed:
            self.say(f"{self._low(needed)}: the vehicle returns, lands and waits for a charged one")
        return await super().refresh(needed)

    async def _battery_told(self) -> None:
        """Wait a few seconds for the first battery reading; a vehicle may fly without one."""
        end_s = self.pilot.clock() + _FIRST_READING_S
        await self.pilot.until(
            lambda: not math.isnan(self.battery_remaining) or self.pilot.clock() > end_s,
            "tell how full its battery is",
        )

    async def _change_battery(self, needed: float) -> None:
        """Wait for a charge halfway from `needed` to full, at most `CHARGED`: more than a battery
        recovers by resting."""
        enough = min((1.0 + needed) / 2.0, CHARGED)
        timeout_s = self.link.battery_timeout_s
        try:
            async with asyncio.timeout(timeout_s):
                while not self.battery_remaining >= enough:
                    await self.feed.ask()  # a new battery is a new start
                    with suppress(TimeoutError):
                        async with asyncio.timeout(ASK_AGAIN_S):
                            await until(lambda: self.battery_remaining >= enough)
        except TimeoutError:
            raise FlightError(
                f"the battery reads {100 * self.battery_remaining:.0f} % after "
                f"{timeout_s:g} s on the ground (link.battery_timeout_s); a flight needs "
                f"{100 * enough:.0f} %; the vehicle stands on the ground, motors off"
            ) from None

    def _low(self, needed: float) -> str:
        return (
            f"battery at {100 * self.battery_remaining:.0f} %, {100 * needed:.0f} % are needed "
            f"(mission.battery_reserve is {100 * self.mission.battery_reserve:.0f} %)"
        )

    def _doubt_battery(self) -> None:
        """Say once that readings of the charge are no use, so no reserve can be kept."""
        reserve = self.mission.battery_reserve
        if self.feed.battery.doubt and reserve > 0.0 and not self._doubted:
            self._doubted = True
            self.say(
                f"{self.feed.battery.doubt}: mission.battery_reserve = {reserve:g} cannot be kept"
            )

    def _believe_speed(self, plan: FlightPlan, flight: FlownTrack) -> None:
        """Time the next plans by the speed that the vehicle reached, if below the ordered one."""
        ordered_mps = self._ordered_mps
        enough_m = ordered_mps**2 / _RUN_UP_MPS2 + _AT_SPEED_S * ordered_mps
        reached_mps = _fastest(flight)
        if polyline.legs(plan.points_m).max(initial=0.0) < enough_m or reached_mps == 0.0:
            return
        if reached_mps < _SLOW * plan.speed_mps:
            self.say(
                f"the vehicle reached {reached_mps:.1f} m/s where {ordered_mps:g} were ordered "
                "(its lean limit, or wind): the next rounds are timed by that"
            )
        if reached_mps >= _SLOW * ordered_mps:
            believed_mps = ordered_mps
        else:
            believed_mps = max(round(reached_mps, 1), _LEAST_MPS)
        self.mission = self.mission.model_copy(update={"speed_mps": believed_mps})

    def _believe_pace(self, plan: FlightPlan, flight: FlownTrack) -> None:
        """Scale the times foreseen of the next rounds by how long those so far took."""
        if any(stop.hold_s > 0.0 for stop in plan.stops):
            return
        as_ours = replace(self.performance, pace=1.0)
        self._foreseen_s += plan.foreseen(as_ours).duration_s
        self._flown_s += flight.duration_s
        self.pace = min(max(self._flown_s / self._foreseen_s, _LEAST_PACE), _MOST_PACE)


def check_end(short_m: float, *, acceptance_m: float = 0.0) -> None:
    """Refuse a flight that is over far from its last place.

    Raises:
        FlightError: says how far.
    """
    if short_m > acceptance_m + _SHORT_M:
        raise FlightError(
            f"the vehicle says that the mission is over, {short_m:.0f} m short of its end"
        )


def _fastest(flight: FlownTrack) -> float:
    """Return the greatest mean ground speed (m/s) over a second; 0 for a shorter flight."""
    t_ns = flight.t_ns
    begin_ns = t_ns[t_ns <= t_ns[-1] - _SECOND_NS]
    moved_m = [
        np.interp(begin_ns + _SECOND_NS, t_ns, along) - along[: len(begin_ns)]
        for along in flight.est_ned_m.T[:2]
    ]
    return float(np.hypot(*moved_m).max(initial=0.0))


@dataclass(frozen=True)
class ExternalBackend(Backend):
    """Backend of an autopilot elsewhere, with a MAVSDK connection as the only link to it."""

    no_resume = "flights of an external autopilot do not repeat"

    @property
    def position_source(self) -> str:
        url = self.task.config.link.url
        return f"telemetry of {url}: truth and belief are what the autopilot says"

    def await_vehicle(self, *, say: Say) -> VehicleLimits:
        """Connect as for a flight, check that the vehicle is near the area, and read its limits."""
        link = self.task.config.link

        async def look() -> VehicleLimits:
            async with located(link, area=self.task.area, observers=(), say=say) as (pilot, _):
                return await read_limits(pilot.parameters, pilot.dialect.limits)

        say(f"waiting for a vehicle on {link.url} (Ctrl-C ends)")
        return run_flight(look())

    @asynccontextmanager
    async def open(self, attached: Attached) -> AsyncIterator[ExternalFlyer]:
        """Connect to the autopilot at `link.url`, and tell people what it cannot do of the demand.

        A flight that ends otherwise than by landing is left holding its position. Parameters that
        were set for the flight are set back, however it ends.

        Raises:
            LinkLostError: no autopilot there in time, or one that does not say where it is.
            FlightError: it does not come to know where it is.
            InputError: it is too far from the area.
        """
        task, say, recorder = self.task, attached.say, FlightRecorder()
        link, mission, demand = task.config.link, task.config.mission, task.demand
        observers = (recorder, *attached.observers)
        async with located(link, area=task.area, observers=observers, say=say) as (pilot, feed):
            limits = await limits_of(pilot, feed, demand, adjusted=link.set_parameters, say=say)
            changes = limits.adjustments(demand) if link.set_parameters else {}
            for name, (before, during) in changes.items():
                feed.note(f"parameter {name}: {before:g} -> {during:g} for the flight")
            speed_mps = mission.speed_mps
            if not link.set_parameters:
                speed_mps = min(speed_mps, limits.speed_mps)
            flown = mission.model_copy(update={"speed_mps": speed_mps})
            async with adjusted(pilot.parameters, changes, say=say), left_holding(pilot):
                yield ExternalFlyer(
                    pilot, feed, recorder, task.area, flown, limits.guidance, link, say
                )


async def limits_of(
    pilot: Pilot, feed: TelemetryFeed, demand: Demand, *, adjusted: bool, say: Say
) -> VehicleLimits:
    """The limits that a vehicle's parameters set, logged; `say` hears which the demand exceeds."""
    limits = await read_limits(pilot.parameters, pilot.dialect.limits)
    feed.note(f"{AUTOPILOT}{pilot.dialect.name} {await pilot.version()}".rstrip())
    for line in limits.lines():
        feed.note(f"parameter {line}")
    shortfalls = limits.shortfalls(demand, adjusted=adjusted)
    if shortfalls:
        say(f"the vehicle will not fly as asked: {'; '.join(shortfalls)}")
    return limits


@asynccontextmanager
async def left_holding(pilot: Pilot) -> AsyncIterator[None]:
    """Context manager: order a hold if the block raises while the vehicle is armed and linked."""
    try:
        yield
    except BaseException as error:  # a bug, too, leaves it in the air
        if pilot.armed and not isinstance(error, LinkLostError):
            with suppress(AerofedError, TimeoutError):
                async with asyncio.timeout(HOLD_TIMEOUT_S):
                    await pilot.hold()
        raise
