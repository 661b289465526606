"""Aerofed from Python and from notebooks: everything that code of your own imports.

    import aerofed

    run = aerofed.run("quickstart", {"mission.rounds": 3}, out="out")
    run.rounds                                   # a pandas DataFrame
    aerofed.load("out").figure("map")            # a picture, shown in a notebook

Names that are not here may change without notice. A wrong value raises an `AerofedError` whose
message is what the command line prints.
"""

from aerofed import _packages  # noqa: F401  before any of ours is imported
from fl.config import LearningConfig
from fl.data.arrays import Samples
from fl.data.partition import Partition, PartitionTask
from fl.federation.algorithms import Algorithm, StaleStart, Update
from fl.federation.rounds import RoundLearning
from fl.radio.channel import Channel
from fl.radio.learned import Belief, Heard
from fl.radio.place import LinkTerms, Radio
from fl.training.local import DeviceData, LocalResult, LocalSettings, Trainer, TrainingDevice
from mission.api.comparing import compare
from mission.api.configuring import channel, config
from mission.api.planning import first_problem, plan
from mission.api.runs import Figure, Run, load, resume, run
from mission.api.sweeps import Sweep, load_sweep, sweep
from mission.api.vehicles import fly, vehicle, vehicles
from mission.base.airspace import Airspace
from mission.base.area import Area
from mission.base.errors import (
    AerofedError,
    InputError,
    LimitsNotMetError,
    PlanError,
    UsersCodeError,
)
from mission.config.models import MissionConfig, RunConfig
from mission.log.records import RoundRecord, UplinkRecord
from mission.planner.evaluate import finish, fit_budget
from mission.planner.limits import RoundLimits
from mission.planner.performance import Foreseen, Performance
from mission.planner.plan import PlannedPath, Planner, RoundPlan
from mission.planner.problem import RoundProblem, Start
from mission.run.callbacks import Callback, CallbackContext, RoundReport
from mission.scenario.strategies import (
    ImportanceStrategy,
    RoundInfo,
    Sortie,
    Strategy,
    StrategyContext,
)

__all__ = [
    "AerofedError",
    "Airspace",
    "Algorithm",
    "Area",
    "Belief",
    "Callback",
    "CallbackContext",
    "Channel",
    "DeviceData",
    "Figure",
    "Foreseen",
    "Heard",
    "ImportanceStrategy",
    "InputError",
    "LearningConfig",
    "LimitsNotMetError",
    "LinkTerms",
    "LocalResult",
    "LocalSettings",
    "MissionConfig",
    "Partition",
    "PartitionTask",
    "Performance",
    "PlanError",
    "PlannedPath",
    "Planner",
    "Radio",
    "RoundInfo",
    "RoundLearning",
    "RoundLimits",
    "RoundPlan",
    "RoundProblem",
    "RoundRecord",
    "RoundReport",
    "Run",
    "RunConfig",
    "Samples",
    "Sortie",
    "StaleStart",
    "Start",
    "Strategy",
    "StrategyContext",
    "Sweep",
    "Trainer",
    "TrainingDevice",
    "Update",
    "UplinkRecord",
    "UsersCodeError",
    "channel",
    "compare",
    "config",
    "finish",
    "first_problem",
    "fit_budget",
    "fly",
    "load",
    "load_sweep",
    "plan",
    "resume",
    "run",
    "sweep",
    "vehicle",
    "vehicles",
]
