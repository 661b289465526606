"""The whole chain in one process: a simulated vehicle, its log, and MAVSDK that flies it.

Shared by the benchmarks of its cost, of many missions in a row and of a long one.
"""

import asyncio
import math
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightdyn.random import RandomStreams
from mission.config.loading import builtin_config, load_config
from mission.config.models import RunConfig
from mission.flight.flyers.base import Attached, Task
from mission.flight.flyers.built_in import BuiltInBackend, BuiltInFlyer
from mission.flight.missions.round_mission import Demand, FlightPlan, mission_items
from mission.flight.track import FlightRecorder
from mission.log.values import Devices
from mission.log.writer import FlightLog
from mission.planner.flyable import Stop
from sitl.links import RawLink
from sitl.observer import VehicleEvent, VehicleObserver, VehicleSample
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

WIND = {"speed_mps": 5.0, "turbulence_severity": 4}
LEG_M = 80.0
SPEED_MPS = 20.0
NOBODY = Devices(np.zeros((0, 2)), ())


@dataclass(frozen=True)
class Cost:
    """What a stretch of flight took."""

    sim_s: float
    cpu_s: float  # of all threads of this process
    wall_s: float


class Meter:
    """Measures from its making on; `sim_ns` reads the vehicle's clock."""

    def __init__(self, sim_ns: Callable[[], int]) -> None:
        self._sim_ns = sim_ns
        self._start = sim_ns(), time.process_time(), time.perf_counter()

    def read(self) -> Cost:
        sim, cpu, wall = self._start
        now_cpu, now_wall = time.process_time(), time.perf_counter()
        return Cost((self._sim_ns() - sim) * 1e-9, now_cpu - cpu, now_wall - wall)


class Arrival:
    """A vehicle observer that sets `event` at the next hold."""

    def __init__(self) -> None:
        self.event = asyncio.Event()

    def sampled(self, sample: VehicleSample) -> None:
        """Nothing to see."""

    def happened(self, event: VehicleEvent) -> None:
        """Look for the hold."""
        if event.kind == "mode" and event.text.startswith("HOLD"):
            self.event.set()


def configuration(sensors: str = "realistic") -> RunConfig:
    """The quick-start mission's, in wind, with a battery that does not end a long flight."""
    aircraft = {"wind": WIND, "sensors": {"kind": sensors}, "battery": {"capacity_mah": 1e5}}
    return load_config(builtin_config("quickstart.toml"), {"vehicle.aircraft": aircraft})


def make_vehicle(config: RunConfig) -> Vehicle:
    """On the ground at home; always the same."""
    home = config.area.build().home
    return Vehicle(config.vehicle, home=home, streams=RandomStreams(config.seed))


def zigzag(config: RunConfig, length_m: float) -> FlightPlan:
    """Legs of 80 m at 20 m/s about home, as in a round, of `length_m` in all."""
    point = np.array(config.area.home_m, dtype=float)
    stops = [Stop(point, ())]
    for k in range(max(1, round(length_m / LEG_M))):
        course = 2.4 * k
        point = point + LEG_M * np.array([math.sin(course), math.cos(course)])
        stops.append(Stop(point, ()))
    return FlightPlan(tuple(stops), config.mission.altitude_m, SPEED_MPS, 5.0)


def order(vehicle: Vehicle, config: RunConfig, plan: FlightPlan) -> None:
    """Start the plan's mission without MAVSDK."""
    items = mission_items(plan, config.area.build())
    flight = vehicle.autopilot.flight
    flight.mission.replace(items)
    refused = flight.fly_mission()
    assert refused is None, refused


def airborne(config: RunConfig) -> Vehicle:
    """A vehicle that hovers above home."""
    vehicle = make_vehicle(config)
    flight = vehicle.autopilot.flight
    altitude = vehicle.aircraft.frame.origin.alt_msl_m + config.mission.altitude_m
    for start in (lambda: None, flight.arm, lambda: flight.take_off(altitude)):
        refused = start()
        assert refused is None, refused
        while vehicle.moving:
            vehicle.step()
    return vehicle


def flown_without_link(length_m: float, *, log: bool) -> Cost:
    """Aircraft and autopilot, observed by the recorder and, with `log`, the MCAP log."""
    config = configuration()
    with ExitStack() as stack:
        vehicle = airborne(config)
        for observer in _observers(stack, config, log=log):
            vehicle.add_observer(observer)
        order(vehicle, config, zigzag(config, length_m))
        meter = Meter(lambda: vehicle.t_ns)
        while vehicle.moving:
            vehicle.stride()
        return meter.read()


async def flown_unheard(length_m: float) -> Cost:
    """The same with the log, in the event loop, telemetry sent to nobody."""
    config = configuration()
    with ExitStack() as stack:
        vehicle = airborne(config)
        for observer in _observers(stack, config, log=True):
            vehicle.add_observer(observer)
        link = RawLink()
        link.attach(len)
        async with Simulation(vehicle, link):
            arrival = Arrival()
            vehicle.add_observer(arrival)
            order(vehicle, config, zigzag(config, length_m))
            meter = Meter(lambda: vehicle.t_ns)
            await arrival.event.wait()
            return meter.read()


@asynccontextmanager
async def hovering() -> AsyncIterator[BuiltInFlyer]:
    """The whole chain, in the hover above home."""
    config = configuration()
    with ExitStack() as stack:
        log = _observers(stack, config, log=True)[1:]
        demand = Demand(SPEED_MPS, config.mission.heights_m[1], math.inf, 5.0)
        task = Task(config, config.area.build(), RandomStreams(config.seed), demand)
        async with BuiltInBackend.of(task).open(Attached(log, Path(), print)) as flyer:
            await flyer.take_off()
            yield flyer


async def flown_by_mavsdk(length_m: float) -> Cost:
    """The whole chain, from the upload of the mission to MAVSDK's word that it is finished."""
    async with hovering() as flyer:
        meter = Meter(lambda: flyer.t_ns)
        plan = zigzag(configuration(), length_m)
        await flyer.upload(plan)
        await flyer.fly(plan)
        return meter.read()


def _observers(stack: ExitStack, config: RunConfig, *, log: bool) -> Sequence[VehicleObserver]:
    recorder = FlightRecorder()
    if not log:
        return (recorder,)
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    area = config.area.build()
    return recorder, stack.enter_context(FlightLog(folder / "a.mcap", area=area, devices=NOBODY))
