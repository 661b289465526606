"""Our own autopilot on the simulated aircraft flies, and its truth is known."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from typing import Self

from flightdyn.config import LimitsConfig
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import AerofedError, FlightError, InputError
from mission.config.models import MissionConfig
from mission.flight.flyers.base import HOLD_TIMEOUT_S, Attached, Backend, Flyer, Task, station_links
from mission.flight.missions.geofence import fence_of
from mission.flight.missions.plan_check import CheckedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.missions.round_mission import FlightPlan, mission_items, stop_items
from mission.flight.pilot.connection import connect
from mission.flight.pilot.pilot import Pilot
from mission.flight.track import FlightRecorder, FlownTrack, TrackPoint
from mission.log.values import Zone
from mission.scenario.limits import guidance_of
from sitl.autopilot.codec.orders import MissionItem
from sitl.config import VehicleConfig
from sitl.links import Link, RawLink, UdpLink
from sitl.pace import Simulation
from sitl.vehicle import Vehicle


def simulated_vehicle(config: VehicleConfig, *, area: Area, streams: RandomStreams) -> Vehicle:
    """Create a vehicle on the ground at home; a failsafe that goes by wall time is refused.

    Raises:
        InputError: the vehicle's settings are refused.
    """
    vehicle = Vehicle(config, home=area.home, streams=streams, obstacles=area.obstacles)
    if (action := vehicle.autopilot.parameters["NAV_DLL_ACT"]) != 0:
        raise InputError(
            f"vehicle.parameters.NAV_DLL_ACT = {action:g}: this failsafe goes by wall time, so a "
            "flight would depend on the machine; here it must be 0 (aerofed sitl takes any)"
        )
    return vehicle


def _arrival(flight: FlownTrack, reported: TrackPoint | None, hold_s: float) -> TrackPoint | None:
    """Return the arrival at a stop: the reported passage, less its hover; None: not reported."""
    if reported is None or hold_s == 0.0:
        return reported
    return flight.at(reported.t_ns - round(1e9 * hold_s))


@dataclass
class BuiltInFlyer(Flyer):
    """Flies the simulated vehicle, whose truth is known."""

    pilot: Pilot
    vehicle: Vehicle
    recorder: FlightRecorder
    area: Area
    mission: MissionConfig
    guidance: LimitsConfig

    @property
    def t_ns(self) -> int:
        return self.vehicle.t_ns

    def here(self) -> TrackPoint:
        aircraft = self.vehicle.aircraft
        return TrackPoint(self.vehicle.t_ns, aircraft.truth.pos_ned_m, aircraft.belief.pos_ned_m)

    async def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Give the vehicle a fence; simulated time stands still meanwhile."""
        await self.pilot.ready()
        await self.pilot.upload_fence(items)

    async def take_off(self) -> None:
        await self.pilot.ready()
        await self.pilot.take_off(self.altitude_m)

    async def upload(self, plan: FlightPlan) -> None:
        """Give the vehicle the stops; simulated time stands still meanwhile."""
        if not plan.stands:
            await self.pilot.upload_items(mission_items(plan, self.area))

    async def fly(self, plan: FlightPlan) -> FlownTrack:
        if plan.stands:
            return FlownTrack.standing(self.here(), self.battery_remaining)
        self.begin(plan)
        await self.order(plan)
        return self.end(plan)

    def begin(self, plan: FlightPlan) -> None:
        """Record the flight of a plan from now on."""
        self._begun = self.here()
        self.recorder.start(self._begun, goes_on=plan.goes_on)

    async def order(self, plan: FlightPlan) -> None:
        """Fly what was uploaded."""
        if not plan.stands:
            await self.pilot.fly()

    @property
    def lost(self) -> BaseException | None:
        """What has gone wrong with it; None: nothing."""
        crashed = self.vehicle.aircraft.crashed
        return FlightError("the aircraft is lost: it crashed as it waited") if crashed else None

    def end(self, plan: FlightPlan) -> FlownTrack:
        """Return the flight of a plan, which ends now; of one that stands it is a wait."""
        items = [] if plan.stands else stop_items(plan)
        flight = self.recorder.finish(self.here(), self.battery_remaining, items=items)
        if plan.stands:
            return replace(flight, passages=(self._begun,))
        passed = zip(plan.stops, flight.passages, strict=True)
        arrivals = tuple(_arrival(flight, over, stop.hold_s) for stop, over in passed)
        return replace(flight, passages=arrivals)

    async def carry_out(
        self, plan: PlanFile, path: CheckedPath, *, begins: Callable[[], None]
    ) -> None:
        """Fly a plan file; simulated time stands still while the vehicle is given it."""
        await self.pilot.fly_plan(plan, returns=path.returns, begins=begins)

    async def land(self) -> None:
        await self.go_home()
        await self.pilot.land()

    @property
    def battery_remaining(self) -> float:
        return self.vehicle.aircraft.battery.remaining

    async def _change_battery(self, needed: float) -> None:  # noqa: ARG002
        self.vehicle.exchange_battery()


@dataclass(frozen=True)
class BuiltInBackend(Backend):
    """Backend of our own autopilot on the simulated aircraft; opened once in a run."""

    vehicle: Vehicle  # on the ground at home
    position_source = "simulated vehicle: truth from its physics, belief from its estimator"

    @classmethod
    def of(cls, task: Task) -> Self:
        """Create the backend with the configured vehicle.

        Raises:
            InputError: one of its settings is refused.
        """
        vehicle = simulated_vehicle(task.config.vehicle, area=task.area, streams=task.streams)
        return cls(task, vehicle)

    def fence(self) -> tuple[Zone, ...]:
        """Return the configured zones, and the circle about home that parameters set, if any."""
        parameters = self.vehicle.autopilot.parameters
        return (*super().fence(), *fence_of((), parameters, self.task.area))

    def observed(self, attached: Attached) -> FlightRecorder:
        """Attach a recorder and the log, which hear of its start-up if it is not running yet."""
        recorder = FlightRecorder()
        for observer in (recorder, *attached.observers):
            self.vehicle.add_observer(observer)
        return recorder

    def flyer(self, pilot: Pilot, recorder: FlightRecorder) -> BuiltInFlyer:
        """The flyer of the vehicle, by a pilot that is connected to it."""
        config = self.task.config
        guidance = guidance_of(config.vehicle)
        flyer = BuiltInFlyer(
            pilot, self.vehicle, recorder, self.task.area, config.mission, guidance
        )
        pilot.denied = lambda: self.vehicle.denied
        flyer.wind = config.vehicle.aircraft.wind
        return flyer

    @asynccontextmanager
    async def open(self, attached: Attached) -> AsyncIterator[BuiltInFlyer]:
        """Connect a pilot to the vehicle; ground stations of `link.gcs` see it too.

        An interrupted flight is ended by an order to hold.

        Raises:
            LinkLostError: the link cannot be opened or the vehicle does not answer.
        """
        config, vehicle, recorder = self.task.config, self.vehicle, self.observed(attached)
        speed = math.inf if config.link.speed == "max" else config.link.speed
        raw_link = RawLink() if config.link.kind == "in_process" else None
        port = config.link.udp_port
        link: Link = raw_link or UdpLink(f"udpout://127.0.0.1:{port}")
        async with (
            Simulation(vehicle, link, *station_links(config.link), speed=speed),
            connect(
                raw_link or f"udpin://127.0.0.1:{port}", stall_timeout_s=config.link.stall_timeout_s
            ) as pilot,
        ):
            flyer = self.flyer(pilot, recorder)
            async with held_at_interruption(flyer):
                yield flyer


@asynccontextmanager
async def held_at_interruption(*flyers: BuiltInFlyer) -> AsyncIterator[None]:
    """Context manager: where the block is cancelled, order those that move to hold."""
    try:
        yield
    except asyncio.CancelledError:
        for flyer in flyers:
            if flyer.vehicle.moving:
                with suppress(AerofedError, TimeoutError):
                    async with asyncio.timeout(HOLD_TIMEOUT_S):
                        await flyer.pilot.hold()
        raise
