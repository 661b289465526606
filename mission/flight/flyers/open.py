"""Who flies a run: the choice among the kinds of flyers.

Each is imported where it is chosen: who flies nothing waits for no aircraft, whose filter alone
takes most of a second.
"""

from pathlib import Path

from mission.config.models import RunConfig
from mission.flight.flyers.flyers import Flyers
from mission.scenario.scenario import Scenario, build_scenario


def flyers_for(scenario: Scenario) -> Flyers:
    """Who flies in a scenario, as its configuration says.

    Raises:
        InputError: a setting of the vehicle is refused.
    """
    config = scenario.config
    if scenario.strategy is None or config.mission.flight == "none":
        from mission.flight.flyers.unflown import NoFlyers

        return NoFlyers(scenario)
    if config.link.kind == "external":
        from mission.flight.flyers.external import ExternalFlyers

        return ExternalFlyers(scenario)
    if config.vehicle.autopilot == "built-in":
        from mission.flight.flyers.simulated import BuiltInFlyers

        return BuiltInFlyers.of(scenario)
    from mission.flight.flyers.firmware import FirmwareFlyers

    return FirmwareFlyers.of(scenario)


def set_up(config: RunConfig, *, data_dir: Path | None) -> tuple[Scenario, Flyers]:
    """The scenario of a run, and who flies in it.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    scenario = build_scenario(config, data_dir=data_dir)
    return scenario, flyers_for(scenario)
