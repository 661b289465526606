"""Hosts: vehicles that run in an event loop, each with its way to let simulated time pass."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import LimitsConfig
from flightdyn.state import Kinematics
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import LinkLostError
from mission.flight.ground_stations import station_links
from mission.flight.missions.plan_check import PlannedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.pilot.connection import connect
from mission.flight.serve.flight_logs import FlightLogs
from mission.flight.serve.vehicle import Served
from sitl.autopilot.parameters import Parameters
from sitl.links import Link, RawLink, UdpLink
from sitl.observer import VehicleEvent, VehicleSample
from sitl.pace import Runs, Simulation

LOOK_S = 0.1  # simulated time between looks at a condition
_GREETING_S = 10.0  # wall time in which a vehicle must have answered a new client


class State(NamedTuple):
    """Observable state of a vehicle; kinematics and charge are those of the simulated world."""

    truth: Kinematics
    mode: str
    armed: bool
    battery: float  # charge that is left, 0 to 1


class Host:
    """What hosts share: a link for clients, a log and a track. Each has `alive`, `state`,
    `parameters` (by which paths are planned), `run_for` and `fly`."""

    def __init__(
        self, area: Area, guidance: LimitsConfig, logs: FlightLogs | None, runs: Runs
    ) -> None:
        """Home is the area's; paths are planned with `guidance`."""
        self.area, self.guidance, self.logs, self.runs = area, guidance, logs, runs
        self.port = UdpLink("udpin://127.0.0.1:0")
        self.track = Track()


class BuiltIn(Host):
    """Host of the built-in autopilot."""

    def __init__(self, served: Served, *, speed: float, runs: Runs) -> None:
        super().__init__(served.area, served.guidance, served.logs, runs)
        self._vehicle, self._raw = served.vehicle, RawLink()
        links: list[Link] = [self._raw, self.port, *station_links(served.link, served.urls)]
        self._simulation = Simulation(served.vehicle, *links, speed=speed, runs=runs)
        served.vehicle.add_observer(self.track)

    @asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        """Context manager: the vehicle runs inside; ordered time first runs until it is started."""
        async with self._simulation:
            while self.runs == "ordered" and self._vehicle.moving:
                await self.run_for(LOOK_S)  # it starts up
            yield

    @property
    def state(self) -> State:
        """The vehicle's present state."""
        aircraft, mode = self._vehicle.aircraft, self._vehicle.autopilot.mode.name
        return State(aircraft.truth, mode, aircraft.armed, aircraft.battery.remaining)

    @property
    def parameters(self) -> Parameters:
        """The autopilot's parameters."""
        return self._vehicle.autopilot.parameters

    async def run_for(self, seconds: float) -> None:
        """Let simulated time pass; messages sent before are processed first."""
        await self._simulation.run_to(self._vehicle.t_ns + round(seconds * 1e9))

    async def fly(self, plan: PlanFile, path: PlannedPath) -> None:
        """Carry out a plan that lies around home, from the ground to the ground."""
        self._simulation.runs = "moving"
        try:
            async with connect(self._raw) as pilot:
                await pilot.fly_plan(plan, returns=path.returns)
        finally:
            self._simulation.runs = self.runs


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
