"""A real firmware flies the simulated aircraft.

It is flown like any external autopilot, with two differences: the truth is known, and time is
ours. Time stands still while a round is planned and devices train, and goes on while the firmware
takes orders, whose answers take it some of its own time.
"""

import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import Self

from flightdyn.plant import Plant
from mission.base.errors import FlightError, InputError, LinkLostError
from mission.config.models import RunConfig
from mission.flight.flyers.base import Attached, Backend, Flyer, Task, station_links
from mission.flight.flyers.external import ExternalFlyer, limits_of
from mission.flight.missions.plan_check import CheckedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.pilot.connection import NoVehicleError, located
from mission.flight.pilot.feed import Known, Takers
from mission.flight.pilot.pilot import Pilot
from mission.flight.track import FlightRecorder, FlownTrack
from native.errors import FirmwareError, FirmwareSilentError
from sitl.autopilot.codec.orders import MissionItem
from sitl.firmware.vehicle import FirmwareVehicle, check_firmware, plant_for
from sitl.links import RawLink
from sitl.observer import VehicleEvent, VehicleSample

NAMES = {"px4": "PX4", "ardupilot": "ArduPilot"}
FOLDER = "firmware"  # of a run, where the firmware lives
_HEARD = frozenset({0, 31, 33, 46, 83, 85, 147, 162, 242})  # what the feed takes from the relay
_TOLD_NS = 100_000_000  # after an instant, in which a position is told: two of its intervals
_AIRBORNE_M = 0.5
_SAME_PARAMETER = 1e-4  # relative: parameters travel as 32-bit floats


@dataclass(frozen=True)
class Milestones:
    """`VehicleObserver` that tells the plant of the events after which its faults may begin."""

    plant: Plant

    def sampled(self, sample: VehicleSample) -> None:
        if sample.armed:
            self.plant.happened("arming")
        if sample.truth.alt_rel_m > _AIRBORNE_M:
            self.plant.happened("take-off")

    def happened(self, event: VehicleEvent) -> None:
        if event.seq is not None:
            self.plant.happened(event.seq)


@dataclass(kw_only=True)
class FirmwareFlyer(ExternalFlyer):
    """Flyer of a firmware on the simulated aircraft: truth from physics, belief from telemetry."""

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

    async def fly(self, plan: FlightPlan) -> FlownTrack:
        with self.vehicle.clock.going():
            return await super().fly(plan)

    async def wait(self, until_ns: int) -> None:
        with self.vehicle.clock.going(until_ns + _TOLD_NS):
            await super().wait(until_ns)

    async def carry_out(
        self, plan: PlanFile, path: CheckedPath, *, begins: Callable[[], None]
    ) -> None:
        with self.vehicle.clock.going():
            await super().carry_out(plan, path, begins=begins)

    async def land(self) -> None:
        with self.vehicle.clock.going():
            await super().land()

    @property
    def battery_remaining(self) -> float:
        return self.vehicle.clock.truth.newest.battery.remaining

    async def refresh(self, needed: float) -> bool:
        """See `Flyer`; the battery is changed at once, as for the simulated vehicle."""
        return await Flyer.refresh(self, needed)

    async def _change_battery(self, needed: float) -> None:  # noqa: ARG002
        self.vehicle.clock.exchange_battery()


@dataclass(frozen=True)
class FirmwareBackend(Backend):
    """Backend of a real firmware on the simulated aircraft; opened once in a run."""

    plant: Plant  # on the ground at home

    @classmethod
    def of(cls, task: Task) -> Self:
        """Create the backend with the configured aircraft.

        Raises:
            InputError: one of its settings is refused.
        """
        area, streams = task.area, task.streams
        plant = plant_for(
            task.config.vehicle, home=area.home, streams=streams, obstacles=area.obstacles
        )
        return cls(task, plant)

    @property
    def position_source(self) -> str:
        name = NAMES[self.task.config.vehicle.autopilot]
        return f"simulated aircraft flown by {name}: truth from its physics, belief from {name}"

    @property
    def no_resume(self) -> str:
        name = NAMES[self.task.config.vehicle.autopilot]
        return f"flights of {name} do not repeat to the last bit"

    def check(self) -> None:
        """Refuse a binary that cannot be started or is another's, and ports that are taken."""
        try:
            check_firmware(self.task.config.vehicle)
        except FirmwareSilentError as error:
            raise InputError(str(error)) from None
        super().check()

    @asynccontextmanager
    async def open(self, attached: Attached) -> AsyncIterator[FirmwareFlyer]:
        """Start the firmware in a folder of its own below the run's, and connect a pilot to it.

        Ground stations of `link.gcs` see the vehicle too. The firmware ends with the block.

        Raises:
            LinkLostError: a port cannot be had; the firmware cannot be started, dies or falls
                silent.
            FlightError: it cannot be flown: not ready in time, another program, a parameter of the
                configuration that it does not know.
        """
        config, recorder, raw_link = self.task.config, FlightRecorder(), RawLink()
        takers: Takers = {}
        vehicle = FirmwareVehicle(
            config.vehicle,
            self.plant,
            attached.folder / FOLDER,
            [raw_link, *attached.links, *station_links(config.link)],
            mission_speed_mps=config.mission.speed_mps,
            speed=math.inf if config.link.speed == "max" else config.link.speed,
            hear=lambda name, fields: takers[name](fields) if name in takers else None,
            heard=_HEARD,
        )
        name, when = NAMES[config.vehicle.autopilot], " at its start"
        try:
            async with vehicle:
                vehicle.clock.run()
                async with located(
                    config.link,
                    area=self.task.area,
                    observers=(recorder, Milestones(self.plant), *attached.observers),
                    say=attached.say,
                    raw_link=raw_link,
                    known=Known(
                        vehicle.clock.truth.at,
                        self.plant.fault_news,
                        takers,
                        vehicle.clock.truth.motors,
                        config.vehicle.control_rate_hz,
                    ),
                ) as (pilot, feed):
                    pilot.giving = partial(vehicle.clock.going, speed=1.0)
                    await _check_program(pilot, config)
                    limits = await limits_of(
                        pilot, feed, self.task.demand, adjusted=False, say=attached.say
                    )
                    speed_mps = min(config.mission.speed_mps, limits.speed_mps)
                    flyer = FirmwareFlyer(
                        pilot,
                        feed,
                        recorder,
                        self.task.area,
                        config.mission.model_copy(update={"speed_mps": speed_mps}),
                        limits.guidance,
                        config.link,
                        attached.say,
                        vehicle=vehicle,
                    )
                    flyer.wind = config.vehicle.aircraft.wind
                    vehicle.clock.rest()
                    when = ""
                    yield flyer
        except NoVehicleError:
            waited = f"it has not answered in {config.link.connect_timeout_s:g} s"
            said = vehicle.with_last_words(f"{waited} (link.connect_timeout_s)")
            raise LinkLostError(f"{name}{when}: {said}") from None
        except FirmwareError as error:
            raise error.in_words(f"{name}{when}: {error}") from None


async def _check_program(pilot: Pilot, config: RunConfig) -> None:
    """Raise FlightError unless this is the configured firmware and it took its parameters."""
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
