"""What a run is made of before its first round: everything that can be refused, is refused here."""

from dataclasses import dataclass
from pathlib import Path

from mission.config.models import RunConfig
from mission.flight.flyers.open import Flyers, flyers_for
from mission.scenario.scenario import Ground, build_ground


@dataclass(frozen=True)
class World(Ground):
    """The ground of one run, and who flies over it."""

    flyers: Flyers


def build_world(config: RunConfig, *, data_dir: Path | None) -> World:
    """Set up the ground and the vehicle.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    ground = build_ground(config, data_dir=data_dir)
    return World(**vars(ground), flyers=flyers_for(ground))
