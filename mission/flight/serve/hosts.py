"""Hosts: vehicles that run in an event loop, each with its way to let simulated time pass."""

from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import LimitsConfig
from flightdyn.state import Kinematics
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import AerofedError, LinkLostError
from mission.flight.flyers.base import station_links
from mission.flight.missions.plan_check import CheckedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.pilot.connection import connect
from mission.flight.serve.flight_logs import FlightLogs
from mission.flight.serve.together import Sortie, fly_together, start_up
from mission.flight.serve.vehicle import Served
from sitl.autopilot.parameters import Parameters
from sitl.links import Link, RawLink, UdpLink
from sitl.observer import VehicleEvent, VehicleSample
from sitl.pace import Runs, Simulation
from sitl.vehicle import Vehicle

LOOK_S = 0.1  # simulated time between looks at a condition
_GREETING_S = 10.0  # wall time in which a vehicle must have answered a new client


class State(NamedTuple):
    """Observable state of a vehicle; kinematics and charge are those of the simulated world."""

    truth: Kinematics
    mode: str
    armed: bool
    battery: float  # charge that is left, 0 to 1


class Host:
    """What hosts share: a link for clients, a log and a track. Each has `state`, `parameters` (by
    which paths are planned), `run_for` and `fly`."""

    def __init__(
        self, name: str, area: Area, guidance: LimitsConfig, logs: FlightLogs | None, runs: Runs
    ) -> None:
        """Home is the area's; paths are planned with `guidance`."""
        self.name = name
        self.area, self.guidance, self.logs, self.runs = area, guidance, logs, runs
        self.port = UdpLink("udpin://127.0.0.1:0")
        self.track = Track()


class BuiltIn(Host):
    """Host of the built-in autopilot of one vehicle of a world."""

    def __init__(self, served: Served, world: "BuiltInWorld", *, runs: Runs) -> None:
        super().__init__(served.name, served.area, served.guidance, served.logs, runs)
        self.vehicle, self._world = served.vehicle, world
        self._raw = RawLink()
        self.links: list[Link] = [self._raw, self.port, *station_links(served.link, served.urls)]
        self.vehicle.add_observer(self.track)

    @property
    def state(self) -> State:
        """The vehicle's present state."""
        aircraft, mode = self.vehicle.aircraft, self.vehicle.autopilot.mode.name
        return State(aircraft.truth, mode, aircraft.armed, aircraft.battery.remaining)

    @property
    def parameters(self) -> Parameters:
        """The autopilot's parameters."""
        return self.vehicle.autopilot.parameters

    async def run_for(self, seconds: float) -> None:
        """Let simulated time of the world pass; messages sent before are processed first."""
        await self._world.run_for(seconds)

    async def fly(self, plan: PlanFile, path: CheckedPath) -> None:
        """Carry out a plan that lies around home, from the ground to the ground."""
        errors = await self._world.fly({self.name: (plan, path)})
        if errors:
            raise errors[self.name]

    def sortie(self, plan: PlanFile, path: CheckedPath, *, after_s: float = 0.0) -> Sortie:
        """The flight of such a plan, to be flown with others."""

        async def fly(starts: Callable[[], Awaitable[object]]) -> None:
            async with connect(self._raw) as pilot:
                pilot.waits = partial(self._world.waits, self.vehicle)
                await pilot.fly_plan(plan, returns=path.returns, starts=starts)

        return Sortie(self.name, self.vehicle, fly, after_s)


class BuiltInWorld:
    """Vehicles of one world, each under the built-in autopilot."""

    def __init__(self, served: Sequence[Served], *, speed: float, runs: Runs) -> None:
        self.runs = runs
        self.hosts = [BuiltIn(each, self, runs=runs) for each in served]
        wired = {host.name: (host.vehicle, host.links) for host in self.hosts}
        self._simulation = Simulation(wired, speed=speed, runs=runs)
        self.world = self._simulation.world

    @asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        """Context manager: the world runs inside; ordered time first runs until all started."""
        async with self._simulation:
            if self.runs == "ordered":
                await start_up(self._simulation, [host.vehicle for host in self.hosts])
            yield

    def waits(self, vehicle: Vehicle) -> bool:
        """Whether a vehicle on its way stands still because the pilot of another is waited for."""
        return self._simulation.waits(vehicle)

    async def run_for(self, seconds: float) -> None:
        """Let simulated time pass; messages sent before are processed first."""
        await self._simulation.run_to(self.world.t_ns + round(seconds * 1e9))

    async def fly(
        self,
        orders: Mapping[str, tuple[PlanFile, CheckedPath]],
        after_s: Mapping[str, float] = MappingProxyType({}),
    ) -> Mapping[str, AerofedError]:
        """Fly plans, by the vehicles' names; some begin later. Returns the errors, by name."""
        sorties = [
            host.sortie(*orders[host.name], after_s=after_s.get(host.name, 0.0))
            for host in self.hosts
            if host.name in orders
        ]
        return await fly_together(self._simulation, sorties)


class Track:
    """Observer that keeps each sample's time (s) and true east, north, up (m), and the mode."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, float, float, float]] = []
        self.mode = ""

    def sampled(self, sample: VehicleSample) -> None:
        x, y, height = enu(sample.truth.pos_ned_m).tolist()
        self.rows.append((sample.t_ns * 1e-9, x, y, height))
        self.mode = sample.mode

    def happened(self, event: VehicleEvent) -> None:
        pass


def enu(ned: Floats) -> Floats:
    """(3,) north, east, down -> east, north, up."""
    north, east, down = ned
    return np.array([east, north, -down])


def pymavlink_client(url: str) -> Any:
    """Open a pymavlink connection, and wait for the vehicle's heartbeat.

    Raises:
        LinkLostError: none came in time.
    """
    from pymavlink import mavutil  # 17 ms, for a client of pymavlink alone

    client: Any = mavutil.mavlink_connection(  # type: ignore[no-untyped-call]  # pymavlink has no types
        url.replace("://", ":")
    )
    client.mav.heartbeat_send(mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, 0)
    if client.wait_heartbeat(timeout=_GREETING_S) is None:
        client.close()
        raise LinkLostError(f"no vehicle answered on {url} in {_GREETING_S:g} s")
    return client
