"""What a configuration names outside itself, checked before anything heavy is imported for it.

Here nothing is loaded or run: parameters, files, labels and the user's own code are looked up, so
that a slip is answered at once. The homes of each check it again, and more, when they use it.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from fl.config import ALGORITHMS, BELIEFS, BUILT_IN_NETWORKS, PARTITIONS, RADIOS, TASKS
from fl.data.load import CLASSES, load, needs_files
from fl.data.partition import check_owners
from fl.errors import DataMissingError
from fl.plugin_code import digest_of, is_plugin
from fl.plugins import needs_torch, problem_of
from mission.base.errors import InputError
from mission.base.explain import WrongKey
from mission.base.user_files import read_text
from mission.config import STRATEGIES
from native.errors import SettingError
from sitl.autopilot.parameters import problems_of

if TYPE_CHECKING:
    from mission.config.models import RunConfig


def problems(config: "RunConfig") -> Iterator[WrongKey]:
    """Everything of a valid configuration that cannot be used on this machine."""
    for key, value, reason in problems_of(config.vehicle):
        yield f"vehicle.{key}", value, reason
    if (path := config.link.signing_key) is not None:
        try:
            signing_key(path)
        except InputError as wrong:
            yield "link.signing_key", str(path), str(wrong)
    for index, community in enumerate(config.communities):
        at = f"communities.{index}"
        if community.partition == "labels" and community.task in TASKS[:-1]:
            each, coverage = community.labels_per_device, community.coverage
            try:
                check_owners(community.devices, CLASSES, per_device=each, coverage=coverage)
            except SettingError as error:
                yield f"{at}.{error.key}", error.value, error.allowed
        if community.network not in BUILT_IN_NETWORKS and (missing := needs_torch()):
            yield f"{at}.network", community.network, missing
    for key, name in own_code(config):
        if (why := problem_of(name)) is not None:
            yield key, name, why


def own_code(config: "RunConfig", *, told: bool = True) -> Iterator[tuple[str, str]]:
    """Yield the keys that name code of the researcher's own, each with the name.

    `told`: also callbacks, which are only told of rounds and alter no result.
    """
    callbacks = enumerate(config.callbacks or ()) if told else ()
    places: list[tuple[str, str | None, tuple[str, ...]]] = [
        ("mission.strategy", config.mission.strategy, STRATEGIES),
        ("learning.algorithm", config.learning.algorithm, ALGORITHMS),
        ("learning.trainer", config.learning.trainer, ()),
        ("radio.truth", config.radio.truth, RADIOS),
        ("radio.belief", config.radio.belief, BELIEFS),
        ("planner.factory", config.planner.factory, ()),
        *((f"callbacks.{index}", name, ()) for index, name in callbacks),
    ]
    for index, community in enumerate(config.communities):
        at = f"communities.{index}"
        places += [
            (f"{at}.network", community.network, BUILT_IN_NETWORKS),
            (f"{at}.task", community.task, TASKS),
            (f"{at}.partition", community.partition, PARTITIONS),
        ]
    for key, named, built_in in places:
        if named is not None and named not in built_in and is_plugin(named):
            yield key, named


def code_digests(*configs: "RunConfig", told: bool = True) -> dict[str, str | None]:
    """SHA-256 of each plug-in's code, by its name (None: unknown); `told` as in `own_code`."""
    names = {name for config in configs for _, name in own_code(config, told=told)}
    return {name: digest_of(name) for name in sorted(names)}


def signing_key(path: Path) -> bytes:
    """Derive the MAVLink signing key from the pass phrase in a file.

    Raises:
        InputError: the file cannot be read, or the phrase is too short.
    """
    from sitl.autopilot.codec.wire import key_of  # 15 ms, where a key is configured

    return key_of(read_text(path).strip())


def load_data(config: "RunConfig", data_dir: Path | None) -> None:
    """Load the data sets that are files into the cache of this process, for the run to use.

    Raises:
        InputError: one is damaged, or some are missing; a line for each.
    """
    missing: dict[str, None] = {}  # the first community that needs a data set tells it
    for index, community in enumerate(config.communities):
        task, file = community.task, community.data_file
        try:
            if needs_files(task):
                load(task, data_dir=data_dir, data_file=file, community=index)
        except DataMissingError as error:
            missing[str(error)] = None
    if missing:
        raise InputError("\n".join(missing))
