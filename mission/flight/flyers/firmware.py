"""A real firmware as the brain of the simulated aircraft: orders in area coordinates in, flights
out.

It is flown like any external autopilot, with two differences: the truth is known, and time is
ours. Time stands still while a round is planned and devices train, and goes on while the firmware
takes orders, whose answers take it some of its own time.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from flightdyn.plant import Plant
from mission.base.area import Area
from mission.base.errors import FlightError, LinkLostError
from mission.config.models import RunConfig
from mission.flight.failures import of_a_vehicle
from mission.flight.flight_plan import FlightPlan
from mission.flight.flyers.contact import Say, located
from mission.flight.flyers.external import ExternalFlyer, limits_of
from mission.flight.flyers.flyer import Flyer
from mission.flight.ground_stations import station_links
from mission.flight.pilot.feed import Known
from mission.flight.pilot.limits import Demand
from mission.flight.pilot.pilot import Pilot
from mission.flight.track import Flight, FlightRecorder
from sitl.autopilot.codec.message import Fields
from sitl.autopilot.values.messages import MissionItem
from sitl.firmware.errors import FirmwareError, FirmwareSilentError
from sitl.firmware.vehicle import FirmwareVehicle
from sitl.links import RawLink
from sitl.observer import VehicleObserver

NAMES = {"px4": "PX4", "ardupilot": "ArduPilot"}
FOLDER = "firmware"  # of a run, where the firmware lives
_HEARD = frozenset({31, 33, 46, 147})  # what the feed takes from the relay
_SAME_PARAMETER = 1e-4  # relative: parameters travel as 32-bit floats


class FirmwareFlyer(ExternalFlyer):
    """Flies stretches one after another; truth from the physics, belief from telemetry."""

    vehicle: FirmwareVehicle

    @property
    def t_ns(self) -> int:
        return self.vehicle.plant.t_ns

    async def set_fence(self, items: Sequence[MissionItem]) -> None:
        with self.vehicle.clock.going():
            await super().set_fence(items)

    async def take_off(self) -> None:
        with self.vehicle.clock.going():
            await super().take_off()

    async def upload(self, plan: FlightPlan) -> None:
        """Give the firmware the stops; it needs some of its time for that, and hovers."""
        with self.vehicle.clock.going():
            await super().upload(plan)

    async def fly(self, plan: FlightPlan) -> Flight:
        with self.vehicle.clock.going():
            return await super().fly(plan)

    async def land(self) -> None:
        with self.vehicle.clock.going():
            await super().land()

    @property
    def battery_remaining(self) -> float:
        return self.vehicle.clock.now.battery.remaining

    async def refresh(self, needed: float) -> bool:
        """As the simulated vehicle does: its charge is known, and nobody has to be waited for."""
        return await Flyer.refresh(self, needed)

    async def _change_battery(self, needed: float) -> None:  # noqa: ARG002
        self.vehicle.clock.exchange_battery()


@dataclass
class RelayedMessages:
    """The messages that the relay hears, whoever asks for them."""

    _asked: dict[str, list[asyncio.Queue[Fields]]] = field(default_factory=dict)

    def hear(self, name: str, fields: Fields) -> None:
        """Hand a message on."""
        for queue in self._asked.get(name, ()):
            queue.put_nowait(fields)

    async def of(self, name: str) -> AsyncIterator[Fields]:
        """The fields of every message of that name from now on."""
        queue: asyncio.Queue[Fields] = asyncio.Queue()
        self._asked.setdefault(name, []).append(queue)
        while True:
            yield await queue.get()


@asynccontextmanager
async def open_firmware(
    config: RunConfig,
    plant: Plant,
    folder: Path,
    *,
    area: Area,
    demand: Demand,
    observers: Sequence[VehicleObserver],
    say: Say,
) -> AsyncIterator[FirmwareFlyer]:
    """Start the configured firmware in a new folder `folder` and connect a pilot to it.

    Ground stations of `link.gcs` see the vehicle too. The firmware ends with the block.

    Raises:
        LinkLostError: a port cannot be had; the firmware cannot be started, dies or falls silent.
        FlightError: it cannot be flown: not ready in time, another program, a parameter of the
            configuration that it does not know.
    """
    recorder, messages, raw_link = FlightRecorder(), RelayedMessages(), RawLink()
    vehicle = FirmwareVehicle(
        config.vehicle,
        plant,
        folder,
        [raw_link, *station_links(config.link)],
        mission_speed_mps=config.mission.speed_mps,
        speed=math.inf if config.link.speed == "max" else config.link.speed,
        hear=messages.hear,
        heard=_HEARD,
    )
    name, when = NAMES[config.vehicle.autopilot], " at its start"
    try:
        with of_a_vehicle():
            async with vehicle:
                vehicle.clock.run()
                known = Known(messages, vehicle.clock.at, boot_ms=0)
                async with located(
                    config.link,
                    area=area,
                    observers=(recorder, *observers),
                    say=say,
                    raw_link=raw_link,
                    known=known,
                ) as (pilot, feed):
                    await _check_program(pilot, config)
                    limits = await limits_of(pilot, feed, demand, adjusted=False, say=say)
                    speed_mps = min(config.mission.speed_mps, limits.speed_mps)
                    flyer = FirmwareFlyer(
                        pilot,
                        feed,
                        recorder,
                        area=area,
                        mission=config.mission.model_copy(update={"speed_mps": speed_mps}),
                        guidance=limits.guidance,
                        link=config.link,
                        say=say,
                    )
                    flyer.vehicle = vehicle
                    flyer.wind = config.vehicle.aircraft.wind
                    vehicle.clock.rest()
                    when = ""
                    yield flyer
    except FirmwareError as error:
        kind = LinkLostError if isinstance(error, FirmwareSilentError) else FlightError
        raise kind(f"{name}{when}: {error}") from None


async def _check_program(pilot: Pilot, config: RunConfig) -> None:
    """Whether it is the firmware that the configuration asks for, and has taken its parameters."""
    name = NAMES[config.vehicle.autopilot]
    if pilot.dialect.name != name:
        raise FlightError(
            f"vehicle.firmware.path = {config.vehicle.firmware.path}: this is "
            f"{pilot.dialect.name}, vehicle.autopilot asks for {name}"
        )
    for parameter, wanted in config.vehicle.firmware.parameters.items():
        has = await pilot.parameters.get(parameter)
        if has is None or not math.isclose(has, wanted, rel_tol=_SAME_PARAMETER, abs_tol=1e-9):
            said = "it knows no such parameter" if has is None else f"it has {has:g}"
            raise FlightError(
                f"vehicle.firmware.parameters.{parameter} = {wanted:g}: the firmware did not take "
                f"it: {said}"
            )
