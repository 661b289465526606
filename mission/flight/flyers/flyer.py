"""A vehicle with its pilot, and the simulated one: orders in area coordinates in, flights out."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flightdyn.errors import FlightDynamicsError
from mission.base.area import Area
from mission.base.errors import AerofedError, FlightError, LinkLostError
from mission.config.models import MissionConfig, RunConfig
from mission.flight.flight_plan import FlightPlan, Stop
from mission.flight.ground_stations import station_links
from mission.flight.pilot.connection import connect
from mission.flight.pilot.orders import Pilot
from mission.flight.track import Flight, FlightRecorder, Passage
from sitl.errors import LinkError
from sitl.links import Link, RawLink, UdpLink
from sitl.observer import VehicleObserver
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

Floats = NDArray[np.float64]

Tap: TypeAlias = Callable[[Link], Link]

SIMULATED_POSITIONS = "simulated vehicle: truth from its physics, belief from its estimator"
HOLD_TIMEOUT_S = 3.0  # wall time for the last order of an interrupted flight


class Flyer(Protocol):
    """Flies stretches one after another and hands out what was recorded of each."""

    area: Area
    mission: MissionConfig

    @property
    def t_ns(self) -> int:
        """The vehicle's time."""
        ...

    def here(self) -> Passage:
        """Truth and belief at this instant."""
        ...

    async def take_off(self) -> None:
        """From the ground to the hover above home."""
        ...

    async def upload(self, plan: FlightPlan) -> None:
        """Give the vehicle the stops; a plan that neither moves nor hovers is none of its business.

        Where time cannot stand still the vehicle hovers meanwhile.
        """
        ...

    async def fly(self, plan: FlightPlan) -> Flight:
        """Fly what was uploaded; a plan that neither moves nor hovers is over at once."""
        ...

    async def land(self) -> None:
        """Back to home and down."""
        ...

    async def refresh(self, reserve: float) -> bool:
        """Have a full battery where less than `reserve` (0..1) is left; whether it was changed."""
        ...

    def flight_plan(
        self, stops: Sequence[Stop], *, acceptance_m: float | None = None
    ) -> FlightPlan:
        """The stops at the mission's altitude, speed and, if no other, acceptance radius."""
        mission = self.mission
        radius = mission.acceptance_radius_m if acceptance_m is None else acceptance_m
        return FlightPlan(tuple(stops), mission.altitude_m, mission.speed_mps, radius)

    async def go_to(self, xy_m: Floats) -> None:
        """To a point in area coordinates, outside any round."""
        start = self.area.from_ned(self.here().est_ned_m)
        if float(np.linalg.norm(xy_m - start)) > self.mission.acceptance_radius_m:
            plan = self.flight_plan((Stop(start, ()), Stop(xy_m, ())))
            await self.upload(plan)
            await self.fly(plan)


@dataclass
class SimulatedFlyer(Flyer):
    """Flies the simulated vehicle, whose truth is known."""

    pilot: Pilot
    vehicle: Vehicle
    recorder: FlightRecorder
    area: Area
    mission: MissionConfig

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self.vehicle.t_ns

    def here(self) -> Passage:
        """Truth and belief at this instant."""
        aircraft = self.vehicle.aircraft
        return Passage(self.vehicle.t_ns, aircraft.truth.pos_ned_m, aircraft.belief.pos_ned_m)

    async def take_off(self) -> None:
        """From the ground to the hover above home."""
        await self.pilot.ready()
        await self.pilot.take_off(self.mission.altitude_m)

    async def upload(self, plan: FlightPlan) -> None:
        """Give the vehicle the stops; simulated time stands still meanwhile."""
        if not plan.stands:
            await self.pilot.upload(plan, plan.positions(self.area))

    async def fly(self, plan: FlightPlan) -> Flight:
        """Fly what was uploaded; a plan that neither moves nor hovers is over at once."""
        if plan.stands:
            here = self.here()
            return Flight.standing(here, {0: here}, self.vehicle.aircraft.battery.remaining)
        self.recorder.start(self.here())
        await self.pilot.fly()
        return self.recorder.finish(self.here(), self.vehicle.aircraft.battery.remaining)

    async def land(self) -> None:
        """Back to home and down."""
        await self.pilot.land()

    async def refresh(self, reserve: float) -> bool:
        """Return, land, change the battery, take off and come back to where it was."""
        aircraft = self.vehicle.aircraft
        if aircraft.battery.remaining >= reserve:
            return False
        back = self.area.from_ned(self.here().est_ned_m)
        await self.land()
        aircraft.exchange_battery()
        await self.take_off()
        await self.go_to(back)
        return True


@asynccontextmanager
async def open_simulated(
    config: RunConfig,
    vehicle: Vehicle,
    *,
    area: Area,
    observers: Sequence[VehicleObserver],
    tap: Tap | None = None,
) -> AsyncIterator[SimulatedFlyer]:
    """Start the simulated vehicle, fresh on the ground at home, and connect a pilot to it.

    Ground stations of `link.gcs` see the vehicle too. With a `tap` the pilot's link is passed
    through it. An interrupted flight is ended by an order to hold.

    Raises:
        LinkLostError: the link cannot be opened or the vehicle does not answer.
    """
    recorder = FlightRecorder()
    for observer in (recorder, *observers):
        vehicle.add_observer(observer)
    speed = math.inf if config.link.speed == "max" else config.link.speed
    raw_link = RawLink() if config.link.kind == "in_process" else None
    port = config.link.udp_port
    try:
        link: Link = raw_link or UdpLink(f"udpout://127.0.0.1:{port}")
        if tap is not None:
            link = tap(link)
        async with (
            Simulation(vehicle, link, *station_links(config.link), speed=speed),
            connect(
                "raw://" if raw_link else f"udpin://127.0.0.1:{port}",
                raw_link=raw_link,
                stall_timeout_s=config.link.stall_timeout_s,
            ) as pilot,
        ):
            flyer = SimulatedFlyer(pilot, vehicle, recorder, area, config.mission)
            try:
                yield flyer
            except asyncio.CancelledError:
                if vehicle.moving:
                    with suppress(AerofedError, TimeoutError):
                        async with asyncio.timeout(HOLD_TIMEOUT_S):
                            await pilot.hold()
                raise
    except LinkError as error:
        raise LinkLostError(str(error)) from None
    except FlightDynamicsError as error:
        raise FlightError(f"the simulated aircraft failed: {error}") from error
