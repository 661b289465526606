"""Who flies a run: the choice among the backends.

Those with an aircraft are imported where they are chosen: of ours, filter and physics take 740 ms,
of an external one MAVSDK takes 40 ms.
"""

from pathlib import Path

import numpy as np

from mission.config.models import RunConfig
from mission.flight.flyers.base import Backend, Task
from mission.flight.flyers.unflown import UnflownBackend, UnflownFleetBackend
from mission.flight.missions.round_mission import Demand
from mission.scenario.limits import Aircraft
from mission.scenario.scenario import Scenario, build_scenario


def backend_for(task: Task) -> Backend:
    """Return the backend that the configuration asks for: external, built-in or firmware.

    Raises:
        InputError: a setting of the vehicle is refused.
    """
    config = task.config
    if config.link.kind == "external":
        from mission.flight.flyers.external import ExternalBackend

        return ExternalBackend(task)
    if config.vehicle.autopilot == "built-in":
        from mission.flight.flyers.built_in import BuiltInBackend

        return BuiltInBackend.of(task)
    from mission.flight.flyers.firmware import FirmwareBackend

    return FirmwareBackend.of(task)


def set_up(config: RunConfig, *, data_dir: Path | None) -> tuple[Scenario, Backend]:
    """The scenario of a run, and who flies in it.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    scenario = build_scenario(config, data_dir=data_dir)
    tasks = [
        Task(one.config, one.area, scenario.streams.of_vehicle(number), _demand(scenario, one))
        for number, one in enumerate(scenario.fleet)
    ]
    unflown = scenario.strategy is None or config.mission.flight == "none"
    if unflown:
        each = tuple(UnflownBackend(task) for task in tasks)
        return scenario, UnflownFleetBackend(tasks[0], each, scenario.aircraft)
    if len(tasks) == 1:
        return scenario, backend_for(tasks[0])
    from mission.flight.flyers.together import WorldBackend

    backends = tuple(backend_for(task) for task in tasks)
    return scenario, WorldBackend(tasks[0], backends, scenario.aircraft)


def _demand(scenario: Scenario, one: Aircraft) -> Demand:
    """What the rounds may ask of the vehicle: no path leads farther than to the devices."""
    mission = one.config.mission
    away_m = np.linalg.norm(scenario.devices_m - np.array(one.area.home_m), axis=1)
    return Demand(
        speed_mps=mission.speed_mps,
        altitude_m=mission.heights_m[1],
        distance_m=float(away_m.max(initial=0.0)),
        acceptance_m=mission.acceptance_radius_m,
    )
