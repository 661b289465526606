"""What a run is made of before its first round: everything that can be refused, is refused here."""

from dataclasses import dataclass
from pathlib import Path

from mission.config import RunConfig
from mission.ground import Ground, build_ground
from mission.simulated import simulated_vehicle
from sitl.vehicle import Vehicle


@dataclass(frozen=True)
class World(Ground):
    """The ground of one run, and who flies over it."""

    vehicle: Vehicle  # on the ground at home; a run flies it once


def build_world(config: RunConfig, *, data_dir: Path | None) -> World:
    """Set up the ground and the vehicle.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    ground = build_ground(config, data_dir=data_dir)
    vehicle = simulated_vehicle(config.vehicle, home=ground.area.home, streams=ground.streams)
    return World(**vars(ground), vehicle=vehicle)
