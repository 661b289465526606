"""Vehicles that run in an event loop, and the worlds that let simulated time pass for them."""

import asyncio
import math
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import LimitsConfig
from flightdyn.random import RandomStreams
from flightdyn.state import Kinematics
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import AerofedError, InputError, LinkLostError
from mission.config.models import RunConfig
from mission.flight.flyers.base import Attached, Task, station_links
from mission.flight.flyers.firmware import FirmwareBackend
from mission.flight.missions.plan_check import CheckedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.missions.round_mission import Demand
from mission.flight.serve.flight_logs import FlightLogs
from mission.flight.serve.separation import Pair, pairs_of
from mission.flight.serve.together import Departure, fly_together, start_up
from mission.flight.serve.vehicle import FIRST, Served
from mission.scenario.limits import guidance_of
from sitl.autopilot.parameters import Parameters, parameters_of
from sitl.firmware.clock import FirmwareClock
from sitl.links import Link, RawLink, UdpLink
from sitl.observer import VehicleEvent, VehicleSample
from sitl.pace import Runs, Simulation

Order: TypeAlias = tuple[PlanFile, CheckedPath]  # a plan placed at home, and its path

LOOK_S = 0.1  # simulated time between looks at a condition
_GREETING_S = 10.0  # wall time in which a vehicle must have answered a new client


class State(NamedTuple):
    """Observable state of a vehicle; kinematics and charge are those of the simulated world."""

    truth: Kinematics
    mode: str
    armed: bool
    battery: float  # charge that is left, 0 to 1


class Host:
    """What one vehicle of a world has: a link for clients, a log and a track. Each has `state`, and
    `parameters`, by which its paths are planned."""

    def __init__(
        self, name: str, area: Area, guidance: LimitsConfig, logs: FlightLogs | None
    ) -> None:
        """Home is the area's; paths are planned with `guidance`."""
        self.name = name
        self.area, self.guidance, self.logs = area, guidance, logs
        self.port = UdpLink("udpin://127.0.0.1:0")
        self.track = Track()


class BuiltIn(Host):
    """A vehicle under the built-in autopilot."""

    def __init__(self, served: Served) -> None:
        super().__init__(served.name, served.area, served.guidance, served.logs)
        self.vehicle, self.stall_timeout_s = served.vehicle, served.link.stall_timeout_s
        self.raw = RawLink()
        self.links: list[Link] = [self.raw, self.port, *station_links(served.link, served.urls)]
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


class BuiltInWorld:
    """Vehicles of one world, each under the built-in autopilot."""

    def __init__(self, served: Sequence[Served], *, speed: float, runs: Runs) -> None:
        self.runs = runs
        self.hosts = [BuiltIn(each) for each in served]
        wired = {host.name: (host.vehicle, host.links) for host in self.hosts}
        self._simulation = Simulation(wired, speed=speed, runs=runs)

    @asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        """Context manager: the world runs inside; ordered time first runs until all started."""
        async with self._simulation:
            if self.runs == "ordered":
                await start_up(self._simulation, [host.vehicle for host in self.hosts])
            yield

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self._simulation.world.t_ns

    @property
    def pairs(self) -> list[Pair]:
        """The least distance so far of each pair of which one flew."""
        return pairs_of(self._simulation.world)

    async def run_for(self, seconds: float) -> None:
        """Let simulated time pass; messages sent before are processed first."""
        await self._simulation.run_to(self.t_ns + round(seconds * 1e9))

    async def fly(
        self, orders: Mapping[str, Order], after_s: Mapping[str, float]
    ) -> Mapping[str, AerofedError]:
        """Fly plans from the ground to the ground, by the vehicles' names; some begin later.
        Returns the errors, by name."""
        departures = {
            host.name: Departure(
                host.vehicle, host.raw, *orders[host.name],
                stall_timeout_s=host.stall_timeout_s, after_s=after_s.get(host.name, 0.0),
            )
            for host in self.hosts
            if host.name in orders
        }  # fmt: skip
        return await fly_together(self._simulation, departures)


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


_POLL_S = 0.001  # wall time
_ANYTHING = Demand(speed_mps=0.0, altitude_m=0.0, distance_m=0.0, acceptance_m=math.inf)


class FirmwareHost(Host):
    """PX4 or ArduCopter, host and world in one. Ordered time also runs, no faster than wall
    time, while a client is being answered: a firmware answers in its own time."""

    def __init__(self, config: RunConfig, *, logs: Path | None, speed: float, runs: Runs) -> None:
        """Prepare the firmware, at `speed` times real time; the rest is as for `aerofed.vehicle`.

        Raises:
            InputError: there is no such firmware, or a setting is refused.
        """
        if runs == "moving":
            raise InputError(
                "pace = 'moving': of a firmware time passes in 'steps', or at a number of times "
                "real time"
            )
        area, ordered = config.area.build(), runs == "ordered"
        recorder = None if logs is None else FlightLogs(logs, area=area)
        super().__init__(FIRST, area, guidance_of(config.vehicle), recorder)
        self.runs, self.hosts = runs, [self]
        link = config.link.model_copy(update={"speed": "max" if ordered else speed})
        config = config.model_copy(update={"link": link})
        self.parameters = parameters_of(config.vehicle)  # of the built-in one
        self._backend = FirmwareBackend.of(
            Task(config, area, RandomStreams(config.seed), _ANYTHING)
        )
        self._backend.check()
        self._folder = logs

    @asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        observers = (self.track, *(() if self.logs is None else (self.logs,)))
        said: list[str] = []  # what people are told of it is in its log, too
        with (
            TemporaryDirectory(prefix="aerofed-")
            if self._folder is None
            else nullcontext(mkdtemp(prefix="firmware-", dir=self._folder))
        ) as home:
            attached = Attached(observers, Path(home), said.append, (self.port,))
            async with self._backend.open(attached) as self._flyer:
                clock = self._flyer.vehicle.clock
                assert isinstance(clock, FirmwareClock)
                with clock.going():
                    await self._flyer.ready()
                clock.answers = self.runs == "ordered"
                if self.runs == "always":
                    clock.run()
                yield

    @property
    def state(self) -> State:
        now, flyer = self._flyer.vehicle.clock.truth.newest, self._flyer
        return State(now.kinematics, self.track.mode, flyer.pilot.armed, now.battery.remaining)

    @property
    def t_ns(self) -> int:
        return self._flyer.vehicle.clock.truth.newest.kinematics.t_ns

    @property
    def pairs(self) -> list[Pair]:
        return []

    async def run_for(self, seconds: float) -> None:
        vehicle = self._flyer.vehicle
        until_ns = vehicle.plant.t_ns + round(seconds * 1e9)
        vehicle.relay.take_orders()
        vehicle.clock.run(until_ns)
        try:
            while vehicle.plant.t_ns < until_ns:  # noqa: ASYNC110  in another thread
                await asyncio.sleep(_POLL_S)
        finally:
            vehicle.clock.rest()

    async def fly(
        self,
        orders: Mapping[str, Order],
        after_s: Mapping[str, float],  # noqa: ARG002  nobody is before it
    ) -> Mapping[str, AerofedError]:
        plan, path = orders[self.name]
        if self.logs is not None:
            self.logs.took(self._flyer.t_ns, mav.MAV_MISSION_TYPE_MISSION, plan.items)
        await self._flyer.carry_out(plan, path, begins=lambda: None)
        return {}
