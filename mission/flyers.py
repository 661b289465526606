"""The flyer that a configuration asks for."""

from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager

from mission.config import LinkConfig
from mission.external import open_external
from mission.flyer import Flyer, open_simulated
from mission.world import World
from sitl.observer import VehicleObserver


def open_flyer(
    world: World, observers: Sequence[VehicleObserver]
) -> AbstractAsyncContextManager[Flyer]:
    """The simulated vehicle, or an external autopilot."""
    config = world.config
    if config.link.kind == "external":
        return open_external(
            config.link, mission=config.mission, area=world.area, observers=observers
        )
    return open_simulated(config, world.vehicle, area=world.area, observers=observers)


def position_source(link: LinkConfig) -> str:
    """Where a run's positions come from, for people."""
    if link.kind == "external":
        return f"telemetry of {link.url}: truth and belief are what the autopilot says"
    return "simulated vehicle: truth from its physics, belief from its estimator"
