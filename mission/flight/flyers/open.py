"""Who flies a run: the kinds of flyers, how each is made ready and opened, and the choice."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightdyn.plant import Plant
from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.flight.failures import of_settings
from mission.flight.fence_zones import airspace_zones, fence_of
from mission.flight.flyers.contact import await_vehicle
from mission.flight.flyers.external import open_external, telemetry_of
from mission.flight.flyers.firmware import FOLDER, NAMES, open_firmware
from mission.flight.flyers.flyer import Flyer
from mission.flight.flyers.ports import check_link
from mission.flight.flyers.simulated import (
    SIMULATED_POSITIONS,
    Tap,
    open_simulated,
    simulated_vehicle,
)
from mission.flight.flyers.unflown import PLANNED_POSITIONS, open_unflown
from mission.flight.pilot.limits import Demand
from mission.log.values import Zone
from mission.scenario.scenario import Scenario, build_scenario
from sitl.firmware.choice import check_firmware
from sitl.firmware.errors import FirmwareSilentError
from sitl.firmware.vehicle import plant_for
from sitl.observer import VehicleObserver
from sitl.vehicle import Vehicle

Say = Callable[[str], None]


@dataclass(frozen=True)
class Attached:
    """What else has to do with a flight."""

    observers: Sequence[VehicleObserver]
    folder: Path  # of the run
    say: Say  # hears what people should know of another autopilot than ours
    tap: Tap | None = None  # on the link between pilot and built-in autopilot


@dataclass(frozen=True)
class Flyers(ABC):
    """Opens the flyer of one run."""

    scenario: Scenario

    @property
    @abstractmethod
    def position_source(self) -> str:
        """Where the run's positions come from, for people."""

    @property
    def no_resume(self) -> str:
        """Why the run cannot be resumed, for people; empty where it can."""
        return ""

    def check(self) -> None:
        """Refuse what cannot work, before anything is written.

        Raises:
            LinkLostError: a port is taken.
            InputError: the firmware's binary is not there.
        """
        check_link(self.scenario.config.link)

    def await_vehicle(self, *, say: Say) -> None:  # noqa: B027  most wait for nothing
        """Wait for a vehicle that must be there already; `say` hears what is waited for.

        Raises:
            LinkLostError, FlightError, InputError: it is not, or not where the devices are.
        """

    def fence(self) -> tuple[Zone, ...]:
        """What the vehicle keeps to, as far as it is known here: what the configuration draws."""
        return airspace_zones(self.scenario.area)

    @abstractmethod
    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        """The flyer, for the length of a block."""


@dataclass(frozen=True)
class BuiltInFlyers(Flyers):
    """Our own autopilot on the simulated aircraft. A run flies it once."""

    vehicle: Vehicle  # on the ground at home
    position_source = SIMULATED_POSITIONS

    def fence(self) -> tuple[Zone, ...]:
        """With what the vehicle's parameters make: a circle about home."""
        parameters = self.vehicle.autopilot.parameters
        return (*super().fence(), *fence_of((), parameters, self.scenario.area))

    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        return open_simulated(
            self.scenario.config,
            self.vehicle,
            area=self.scenario.area,
            observers=attached.observers,
            tap=attached.tap,
        )


@dataclass(frozen=True)
class FirmwareFlyers(Flyers):
    """A real firmware on the simulated aircraft. A run flies it once."""

    plant: Plant  # on the ground at home

    @property
    def position_source(self) -> str:
        name = NAMES[self.scenario.config.vehicle.autopilot]
        return f"simulated aircraft flown by {name}: truth from its physics, belief from {name}"

    @property
    def no_resume(self) -> str:
        name = NAMES[self.scenario.config.vehicle.autopilot]
        return f"flights of {name} do not repeat to the last bit"

    def check(self) -> None:
        """Refuse a binary that cannot be started or is another's, and ports that are taken."""
        try:
            check_firmware(self.scenario.config.vehicle)
        except FirmwareSilentError as error:
            raise InputError(str(error)) from None
        super().check()

    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        """Start the firmware, in a folder of its own below the run's."""
        return open_firmware(
            self.scenario.config,
            self.plant,
            attached.folder / FOLDER,
            area=self.scenario.area,
            demand=_demand(self.scenario),
            observers=attached.observers,
            say=attached.say,
        )


@dataclass(frozen=True)
class ExternalFlyers(Flyers):
    """An autopilot somewhere else, to which nobody but MAVSDK is linked."""

    no_resume = "flights of an external autopilot do not repeat"

    @property
    def position_source(self) -> str:
        return telemetry_of(self.scenario.config.link)

    def await_vehicle(self, *, say: Say) -> None:
        await_vehicle(self.scenario.config.link, area=self.scenario.area, say=say)

    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        scenario = self.scenario
        return open_external(
            scenario.config.link,
            mission=scenario.config.mission,
            area=scenario.area,
            demand=_demand(scenario),
            observers=attached.observers,
            say=attached.say,
        )


@dataclass(frozen=True)
class NoFlyers(Flyers):
    """Nobody flies: a plan, if there is one, is met exactly."""

    position_source = PLANNED_POSITIONS

    def check(self) -> None:
        """Refuse nothing: no link is needed."""

    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        scenario = self.scenario
        return open_unflown(
            scenario.config.mission, area=scenario.area, observers=attached.observers
        )


def flyers_for(scenario: Scenario) -> Flyers:
    """Who flies in a scenario, as its configuration says.

    Raises:
        InputError: a setting of the vehicle is refused.
    """
    config = scenario.config
    if scenario.strategy is None or config.mission.flight == "none":
        return NoFlyers(scenario)
    if config.link.kind == "external":
        return ExternalFlyers(scenario)
    home, streams = scenario.area.home, scenario.streams
    if config.vehicle.autopilot == "built-in":
        return BuiltInFlyers(
            scenario, simulated_vehicle(config.vehicle, home=home, streams=streams)
        )
    with of_settings():
        plant = plant_for(config.vehicle, home=home, streams=streams)
    return FirmwareFlyers(scenario, plant)


def set_up(config: RunConfig, *, data_dir: Path | None) -> tuple[Scenario, Flyers]:
    """The scenario of a run, and who flies in it.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    scenario = build_scenario(config, data_dir=data_dir)
    return scenario, flyers_for(scenario)


def _demand(scenario: Scenario) -> Demand:
    """What the rounds may ask of the vehicle: no path leads farther than to the devices."""
    mission = scenario.config.mission
    away_m = np.linalg.norm(scenario.devices_m - np.array(scenario.area.home_m), axis=1)
    return Demand(
        speed_mps=mission.speed_mps,
        altitude_m=mission.heights_m[1],
        distance_m=float(away_m.max(initial=0.0)),
        acceptance_m=mission.acceptance_radius_m,
    )
