"""What a run is made of before its first round: everything that can be refused, is refused here."""

from pathlib import Path

from mission.config.models import RunConfig
from mission.flight.flyers.choice import flyers_for
from mission.flight.flyers.open import Flyers
from mission.scenario.scenario import Scenario, build_scenario


def set_up(config: RunConfig, *, data_dir: Path | None) -> tuple[Scenario, Flyers]:
    """The scenario of a run, and who flies in it.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    scenario = build_scenario(config, data_dir=data_dir)
    return scenario, flyers_for(scenario)
