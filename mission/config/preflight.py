"""What a configuration names outside itself, checked before anything heavy is imported for it.

Here nothing is loaded or run: parameters, files, labels and the user's own code are looked up, so
that a slip is answered at once. The homes of each check it again, and more, when they use it.
"""

from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fl.config import BUILT_IN_NETWORKS
from fl.data.load import load
from fl.data.partition import check_owners
from fl.errors import LearningInputError, SettingError
from fl.training.device import check_device
from mission.base.errors import InputError
from mission.base.user_code import check_found, is_import_path
from sitl.autopilot.parameters import SPECS, Parameters, known_names
from sitl.autopilot.protocol.parameter_file import load_parameters
from sitl.errors import SitlInputError

if TYPE_CHECKING:
    from fl.config import CommunityConfig
    from mission.config.models import RunConfig
    from sitl.config import VehicleConfig

_BUNDLED = ("digits", "colour-shapes")  # these need no files
# Of every task but npz, whose file must be read.
_CLASSES = 10


class Fault(NamedTuple):
    """A key whose value cannot be used."""

    key: str
    value: Any
    reason: str


def faults(config: "RunConfig") -> Iterator[Fault]:
    """Everything of a valid configuration that cannot be used on this machine."""
    yield from _parameters(config.vehicle)
    for index, community in enumerate(config.communities):
        yield from _community(community, f"communities.{index}")
    try:
        check_device(config.learning.device)
    except SettingError as error:
        yield Fault(error.key, error.value, error.allowed)
    if is_import_path(config.mission.strategy):
        yield from _code("mission.strategy", config.mission.strategy)
    if config.planner.factory is not None:
        yield from _code("planner.factory", config.planner.factory)


def load_data(config: "RunConfig", data_dir: Path | None) -> None:
    """Read the data sets that are files; the run finds them read.

    Raises:
        InputError: one is missing or damaged.
    """
    for community in config.communities:
        if community.task not in _BUNDLED:
            try:
                load(community.task, data_dir=data_dir, data_file=community.data_file)
            except LearningInputError as error:
                raise InputError(str(error)) from None


def _parameters(vehicle: "VehicleConfig") -> Iterator[Fault]:
    path, parameters = vehicle.parameter_file, Parameters()
    if path is not None:
        key = "vehicle.parameter_file"
        if not path.is_file():
            # A ground station may save into it, but a slip of the name must not pass for that.
            hint = "; to have parameters saved there, make an empty file"
            yield Fault(key, str(path), f"no such file{hint}")
        else:
            try:
                parameters.apply(load_parameters(path), str(path))
            except SitlInputError as error:
                yield Fault(key, str(path), str(error))
    for name, value in vehicle.parameters.items():
        spec = SPECS.get(name)
        if spec is None:
            close = get_close_matches(name, SPECS, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            reason = f"no such parameter{hint} (known: {known_names()})"
            yield Fault(f"vehicle.parameters.{name}", value, reason)
        elif parameters.check(name, value) is not None:
            unit = f", in {spec.unit}" if spec.unit else ""
            reason = f"must be a number from {spec.low:g} to {spec.high:g}{unit}"
            yield Fault(f"vehicle.parameters.{name}", value, reason)


def _community(community: "CommunityConfig", key: str) -> Iterator[Fault]:
    if community.partition == "labels" and community.task != "npz":
        try:
            check_owners(
                community.devices,
                _CLASSES,
                per_device=community.labels_per_device,
                coverage=community.coverage,
            )
        except SettingError as error:
            yield Fault(f"{key}.{error.key}", error.value, error.allowed)
    if is_import_path(community.network):
        yield from _code(f"{key}.network", community.network)
    elif community.network not in BUILT_IN_NETWORKS:
        choices = ", ".join(map(repr, BUILT_IN_NETWORKS))
        reason = f"must be one of {choices}, or your own as 'package.module:callable'"
        yield Fault(f"{key}.network", community.network, reason)


def _code(key: str, path: str) -> Iterator[Fault]:
    try:
        check_found(path)
    except InputError as error:
        yield Fault(key, path, str(error))
