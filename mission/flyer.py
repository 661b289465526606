"""A simulated vehicle with its pilot: orders in area coordinates in, flights out."""

import asyncio
import math
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdyn.errors import FlightDynamicsError
from mission import pilot as piloting
from mission.area import Area
from mission.config import RunConfig
from mission.errors import AerofedError, FlightError, LinkLostError
from mission.flightplan import FlightPlan, Stop
from mission.track import Flight, FlightRecorder, Passage
from sitl.errors import LinkError
from sitl.links import RawLink, UdpLink
from sitl.observer import VehicleObserver
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

Floats = NDArray[np.float64]

HOLD_TIMEOUT_S = 3.0  # wall time for the last order of an interrupted flight


@dataclass
class Flyer:
    """Flies stretches one after another and hands out what was recorded of each."""

    pilot: piloting.Pilot
    vehicle: Vehicle
    simulation: Simulation
    recorder: FlightRecorder
    area: Area
    altitude_m: float
    speed_mps: float
    acceptance_m: float

    def here(self) -> Passage:
        """Truth and belief at this instant."""
        aircraft = self.vehicle.aircraft
        return Passage(self.vehicle.t_ns, aircraft.truth.pos_ned_m, aircraft.belief.pos_ned_m)

    async def take_off(self) -> None:
        """From the ground to the hover above home."""
        await self.pilot.ready()
        await self.pilot.take_off(self.altitude_m)

    def flight_plan(self, stops: Sequence[Stop]) -> FlightPlan:
        """The stops at this flyer's altitude, speed and acceptance radius."""
        return FlightPlan(tuple(stops), self.altitude_m, self.speed_mps, self.acceptance_m)

    async def go_to(self, xy_m: Floats) -> None:
        """To a point in area coordinates, outside any round."""
        start = self.area.from_ned(self.here().est_ned_m)
        if float(np.linalg.norm(xy_m - start)) > self.acceptance_m:
            await self.fly(self.flight_plan((Stop(start, ()), Stop(xy_m, ()))))

    async def fly(self, plan: FlightPlan) -> Flight:
        """Fly the stops; a plan that neither moves nor hovers is over at once."""
        if len(plan.stops) == 1 and plan.stops[0].hold_s == 0.0:
            here = self.here()
            reached = {0: here}
            return Flight.standing(here, reached, self.vehicle.aircraft.battery.remaining)
        self.recorder.start(self.here())
        await self.pilot.fly(plan, plan.positions(self.area))
        return self.recorder.finish(self.here(), self.vehicle.aircraft.battery.remaining)

    async def land(self) -> None:
        """Back to home and down."""
        await self.pilot.land()


@asynccontextmanager
async def open_flyer(
    config: RunConfig, vehicle: Vehicle, *, area: Area, observers: Sequence[VehicleObserver]
) -> AsyncIterator[Flyer]:
    """Start the simulated vehicle, fresh on the ground at home, and connect a pilot to it.

    An interrupted flight is ended by an order to hold.

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
        link = raw_link or UdpLink(f"udpout://127.0.0.1:{port}")
        async with (
            Simulation(vehicle, link, speed=speed) as simulation,
            piloting.connect(
                "raw://" if raw_link else f"udpin://127.0.0.1:{port}",
                raw_link=raw_link,
                stall_timeout_s=config.link.stall_timeout_s,
            ) as pilot,
        ):
            mission = config.mission
            flyer = Flyer(
                pilot, vehicle, simulation, recorder, area,
                mission.altitude_m, mission.speed_mps, mission.acceptance_radius_m,
            )  # fmt: skip
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
