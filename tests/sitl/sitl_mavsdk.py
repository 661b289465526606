"""A simulated vehicle and a MAVSDK client that talks to it."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np
from mavsdk.asyncio import Configuration, Mavsdk, System
from mavsdk.component_type import ComponentType
from mavsdk.plugins.mission import MissionItem, MissionPlan
from patience import HANG_S

from flightdyn.frames import LocalFrame
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from sitl.config import VehicleConfig
from sitl.links import RawLink, UdpLink
from sitl.observer import VehicleEvent, VehicleSample
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

HOME = GeodeticPoint(47.4, 8.5, 488.0)


@dataclass
class Recorder:
    """Keeps everything that an observer hears."""

    samples: list[VehicleSample] = field(default_factory=list)
    events: list[VehicleEvent] = field(default_factory=list)

    def sampled(self, sample: VehicleSample) -> None:
        self.samples.append(sample)

    def happened(self, event: VehicleEvent) -> None:
        self.events.append(event)

    def of_kind(self, kind: str) -> list[VehicleEvent]:
        return [event for event in self.events if event.kind == kind]

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.of_kind(kind)]

    def track(self) -> bytes:
        """Everything that was flown, as bytes."""
        return b"".join(
            np.int64(s.t_ns).tobytes()
            + s.truth.pos_ned_m.tobytes()
            + s.belief.pos_ned_m.tobytes()
            + s.truth.q_frd_to_ned.tobytes()
            for s in self.samples
        )


def make_vehicle(
    recorder: Recorder | None = None, *, seed: int = 1, config: VehicleConfig | None = None
) -> Vehicle:
    """The real aircraft."""
    observers = () if recorder is None else (recorder,)
    return Vehicle(
        config or VehicleConfig(), home=HOME, streams=RandomStreams(seed), observers=observers
    )


@asynccontextmanager
async def over_raw(vehicle: Vehicle) -> AsyncIterator[System]:
    """The vehicle flown by MAVSDK within this process."""
    link = RawLink()
    async with Simulation(vehicle, link), client() as mavsdk:
        await mavsdk.add_any_connection("raw://")
        core = mavsdk._mavsdk
        core.subscribe_raw_bytes_to_be_sent(link.feed)
        link.attach(core.pass_received_raw_bytes)
        system = await mavsdk.first_autopilot(timeout_s=HANG_S)
        assert system is not None
        yield system
        link.detach()


@asynccontextmanager
async def over_udp(vehicle: Vehicle) -> AsyncIterator[System]:
    """The vehicle flown by MAVSDK over a UDP port that the system chose."""
    link = UdpLink("udpin://127.0.0.1:0")
    async with Simulation(vehicle, link), client() as mavsdk:
        await mavsdk.add_any_connection(f"udpout://127.0.0.1:{link.port}")
        system = await mavsdk.first_autopilot(timeout_s=HANG_S)
        assert system is not None
        yield system


def client() -> Mavsdk:
    return Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))


async def until(condition: Callable[[], bool]) -> None:
    """Wait in wall time."""
    limit = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < limit, "waited in vain"
        await asyncio.sleep(0.005)


async def until_true(ask: Callable[[], Awaitable[bool]]) -> None:
    """Wait for the answer yes."""
    limit = time.monotonic() + HANG_S
    while not await ask():
        assert time.monotonic() < limit, "waited in vain"
        await asyncio.sleep(0.005)


def mission_plan(
    points: Sequence[tuple[float, float, float]], *, speed_mps: float, fly_through: bool = True
) -> MissionPlan:
    """A plan through (north, east, height) about HOME."""
    frame = LocalFrame(HOME)
    items = []
    for north, east, height in points:
        place = frame.to_geodetic(np.array([north, east, -height]))
        items.append(
            MissionItem(
                latitude_deg=place.lat_deg,
                longitude_deg=place.lon_deg,
                relative_altitude_m=place.alt_msl_m - HOME.alt_msl_m,
                speed_m_s=speed_mps,
                is_fly_through=fly_through,
                acceptance_radius_m=5.0,
            )
        )
    return MissionPlan(items)
