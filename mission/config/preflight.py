"""What a configuration names outside itself, checked before anything heavy is imported for it.

Here nothing is loaded or run: parameters, files, labels and the user's own code are looked up, so
that a slip is answered at once. The homes of each check it again, and more, when they use it.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fl import preflight as learning
from fl.data.load import load, needs_files
from fl.errors import LearningInputError, SettingError
from fl.training.device import check_device
from mission.base.errors import InputError
from mission.base.user_code import check_found, is_import_path
from sitl import preflight as vehicle

if TYPE_CHECKING:
    from mission.config.models import RunConfig


class Problem(NamedTuple):
    """A key whose value cannot be used."""

    key: str
    value: Any
    reason: str


def problems(config: "RunConfig") -> Iterator[Problem]:
    """Everything of a valid configuration that cannot be used on this machine."""
    for key, value, reason in vehicle.problems_of(config.vehicle):
        yield Problem(f"vehicle.{key}", value, reason)
    for index, community in enumerate(config.communities):
        at = f"communities.{index}"
        for error in learning.problems_of(community, is_users=is_import_path):
            yield Problem(f"{at}.{error.key}", error.value, error.allowed)
        yield from _code(f"{at}.network", community.network)
    try:
        check_device(config.learning.device)
    except SettingError as error:
        yield Problem(error.key, error.value, error.allowed)
    yield from _code("mission.strategy", config.mission.strategy)
    if config.planner.factory is not None:
        yield from _code("planner.factory", config.planner.factory)


def load_data(config: "RunConfig", data_dir: Path | None) -> None:
    """Read the data sets that are files; the run finds them read.

    Raises:
        InputError: one is missing or damaged.
    """
    for community in config.communities:
        if needs_files(community.task):
            try:
                load(community.task, data_dir=data_dir, data_file=community.data_file)
            except LearningInputError as error:
                raise InputError(str(error)) from None


def _code(key: str, path: str) -> Iterator[Problem]:
    """The researcher's own code where a value names any."""
    if is_import_path(path):
        try:
            check_found(path)
        except InputError as error:
            yield Problem(key, path, str(error))
