"""Who flies a run: chosen once, when the run is set up."""

from flightdyn.errors import FlightInputError
from mission.base.errors import InputError
from mission.flight.flyers.open import (
    BuiltInFlyers,
    ExternalFlyers,
    FirmwareFlyers,
    Flyers,
    NoFlyers,
)
from mission.flight.flyers.simulated import simulated_vehicle
from mission.scenario.scenario import Scenario
from sitl.errors import SitlInputError
from sitl.firmware.vehicle import plant_for


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
    try:
        return FirmwareFlyers(scenario, plant_for(config.vehicle, home=home, streams=streams))
    except (SitlInputError, FlightInputError) as error:
        raise InputError(str(error)) from None
