"""What a run takes along to a machine that sees no folder of the sweep's: data sets and code."""

import importlib.util
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from fl.data.dataset import Dataset
from fl.data.load import Source, load, needs_files
from fl.plugins import is_import_path
from mission.base.errors import InputError
from mission.config.models import RunConfig

_OURS = frozenset(["mission", "fl", "sitl", "flightdyn", "native"])  # installed on every machine
_LARGE_BYTES = 10 * 2**20  # of a file that lies beside the modules
_MOST_BYTES = 200 * 2**20


def data_sets(configs: Sequence[RunConfig], data_dir: Path | None) -> dict[Source, Dataset]:
    """The data sets of these runs that are read from files, or made by code of the user's.

    Raises:
        LearningInputError: one is missing or damaged.
    """
    wanted = {
        (community.task, data_dir, community.data_file)
        for config in configs
        for community in config.communities
        if needs_files(community.task)
    }
    found = {}
    for task, folder, name in wanted:
        dataset = load(task, data_dir=folder, data_file=name)
        _ = dataset.train  # read, if it was not
        found[task, folder, name] = dataset
    return found


def own_code(configs: Sequence[RunConfig], here: Path) -> tuple[Path, ...]:
    """Files of the working directory that these runs' plug-ins need.

    Without plug-ins in it, nothing. Else the files that lie directly in it, unless they are large,
    and all of every package that a plug-in is in, or that was imported from it.

    Raises:
        InputError: it is too much.
    """
    named = {
        text.partition(":")[0].partition(".")[0]
        for config in configs
        for text in _texts(config.model_dump(mode="json"))
        if is_import_path(text)
    }
    if not any(_is_here(name, here) for name in named - _OURS):
        return ()
    imported = {name.partition(".")[0] for name in list(sys.modules)}
    packages = [here / name for name in sorted((named | imported) - _OURS) if _is_here(name, here)]
    inside = [path for package in packages if package.is_dir() for path in package.rglob("*")]
    files = [
        path
        for path in (*here.iterdir(), *inside)
        if not any(_is_hidden(part) for part in path.relative_to(here).parts)
        and path.is_file()  # a link may lead nowhere
        and (path.parent != here or path.stat().st_size <= _LARGE_BYTES)
    ]
    total = sum(path.stat().st_size for path in files)
    if total > _MOST_BYTES:
        largest = max(files, key=lambda path: path.stat().st_size)
        raise InputError(
            f"{here}: the code that goes along to the cluster's machines, and what lies beside it, "
            f"has {total / 2**20:.0f} MB, {_MOST_BYTES // 2**20} MB at most; the largest file is "
            f"{largest.relative_to(here)}: keep data elsewhere"
        )
    return tuple(files)


def put_together(files: Sequence[Path], here: Path, there: Path) -> None:
    """Copy the files, with the folders that they are in, into the folder `there`."""
    for path in files:
        copy = there / path.relative_to(here)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)


def _is_here(name: str, here: Path) -> bool:
    """Whether the top of a module's name is found in that folder."""
    if name.startswith("_") or not ((here / name).is_dir() or (here / f"{name}.py").is_file()):
        return False
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    if spec is None:
        return False
    folders = list(spec.submodule_search_locations or ())  # of a package, without __init__.py too
    return any(Path(place).is_relative_to(here) for place in (spec.origin, *folders) if place)


def _is_hidden(name: str) -> bool:
    return name.startswith(".") or name == "__pycache__"


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, list):
        for item in value:
            yield from _texts(item)
