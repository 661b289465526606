"""What a configuration names outside itself, checked before anything heavy is imported for it.

Here nothing is loaded or run: parameters, files, labels and the user's own code are looked up, so
that a slip is answered at once. The homes of each check it again, and more, when they use it.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fl.config import ALGORITHMS, BUILT_IN_NETWORKS, PARTITIONS, TASKS, CommunityConfig
from fl.data.load import CLASSES, load, needs_files
from fl.data.partition import check_owners
from fl.errors import DataMissingError, SettingError
from fl.plugins import is_plugin, needs_torch, problem_of
from fl.radio.uplink import GATES
from mission.base.errors import InputError
from mission.base.user_code import errors_of_learning
from mission.config import STRATEGIES
from sitl.autopilot.parameters import problems_of

if TYPE_CHECKING:
    from mission.config.models import RunConfig


class Problem(NamedTuple):
    """A key whose value cannot be used."""

    key: str
    value: object
    reason: str


def problems(config: "RunConfig") -> Iterator[Problem]:
    """Everything of a valid configuration that cannot be used on this machine."""
    for key, value, reason in problems_of(config.vehicle):
        yield Problem(f"vehicle.{key}", value, reason)
    for index, community in enumerate(config.communities):
        at = f"communities.{index}"
        if (error := _owners(community)) is not None:
            yield Problem(f"{at}.{error.key}", error.value, error.allowed)
        if community.network not in BUILT_IN_NETWORKS and (missing := needs_torch()):
            yield Problem(f"{at}.network", community.network, missing)
        yield from _code(f"{at}.network", community.network, BUILT_IN_NETWORKS)
        yield from _code(f"{at}.task", community.task, TASKS)
        yield from _code(f"{at}.partition", community.partition, PARTITIONS)
    yield from _code("mission.strategy", config.mission.strategy, STRATEGIES)
    yield from _code("learning.algorithm", config.learning.algorithm, ALGORITHMS)
    if config.learning.trainer is not None:
        yield from _code("learning.trainer", config.learning.trainer)
    yield from _code("channel.gate", config.channel.gate, GATES)
    if config.planner.factory is not None:
        yield from _code("planner.factory", config.planner.factory)
    for index, name in enumerate(config.callbacks or ()):
        yield from _code(f"callbacks.{index}", name)


def _owners(community: CommunityConfig) -> SettingError | None:
    """Why labels cannot be dealt out to a community's devices, where its classes are known."""
    if community.partition == "labels" and community.task in TASKS[:-1]:
        each, coverage = community.labels_per_device, community.coverage
        try:
            check_owners(community.devices, CLASSES, per_device=each, coverage=coverage)
        except SettingError as error:
            return error
    return None


def load_data(config: "RunConfig", data_dir: Path | None) -> None:
    """Read the data sets that are files; the run finds them read.

    Raises:
        InputError: one is missing or damaged.
    """
    with errors_of_learning():
        for index, community in enumerate(config.communities):
            task, file = community.task, community.data_file
            try:
                if needs_files(task):
                    load(task, data_dir=data_dir, data_file=file, community=index)
            except DataMissingError as error:
                raise InputError(f"{error}{_others(config, index, data_dir)}") from None


def _others(config: "RunConfig", index: int, data_dir: Path | None) -> str:
    """Which data sets are missing beside a community's where no folder was given."""
    if data_dir is not None:
        return ""
    first, *later = (
        (community.task, community.data_file) for community in config.communities[index:]
    )
    others = [
        f"{task} ({file or f'aerofed data fetch FOLDER --task {task}'})"
        for task, file in dict.fromkeys(later)
        if task in TASKS and needs_files(task) and (task, file) != first
        if file is None or not Path(file).is_absolute()
    ]
    return f"; --data-dir FOLDER must also hold {' and '.join(others)}" if others else ""


def _code(key: str, name: str, built_in: tuple[str, ...] = ()) -> Iterator[Problem]:
    """The researcher's own code where a value names any."""
    if name not in built_in and is_plugin(name):
        reason = problem_of(name)
        if reason is not None:
            yield Problem(key, name, reason)
