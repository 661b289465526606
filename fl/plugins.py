"""A researcher's own code: found by name, held to its interface, and named where it fails.

A name is an import path, `package.module:callable`, found in the working directory too, or that of
an entry point which an installed package declares in the group `aerofed.plugins`.
"""

import importlib
import importlib.metadata
import importlib.util
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fl.errors import LearningError, LearningInputError, did_you_mean, first_line, kind_of

IMPORT_PATH = r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*"
GROUP = "aerofed.plugins"
# What code of others may raise; sys.exit() in it ends no run either.
FAILURES = (Exception, SystemExit)


@dataclass(eq=False)
class PluginError(LearningInputError):
    """A plug-in that cannot be used, or that failed: `__cause__` is what its code raised."""

    key: str  # the setting that names it
    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.key} = {self.name!r}: {self.reason}"

    def in_community(self, index: int) -> "PluginError":
        """The same error, with the community whose setting it is, from 0."""
        return replace(self, key=self.key.replace("communities.", f"communities.{index}.", 1))


def is_import_path(text: str) -> bool:
    """Whether the text has the form of one."""
    return re.fullmatch(IMPORT_PATH, text) is not None


def is_plugin(name: str) -> bool:
    """Whether it is an import path, or an entry point that is installed."""
    return is_import_path(name) or name in _entry_points()


def checked_name(name: str, built_in: tuple[str, ...]) -> str:
    """The name, where it is built in or a plug-in's.

    Raises:
        ValueError: it is neither; says what there is.
    """
    if name in built_in or is_plugin(name):
        return name
    names = (*built_in, *_entry_points())
    raise ValueError(
        f"must be one of {', '.join(map(repr, names))} or the import path of your own, "
        f"'package.module:callable'{did_you_mean(name, names)}"
    )


def problem_of(name: str) -> str | None:
    """Why a plug-in is not found; its module is not imported, only the packages around it are."""
    _look_here()
    module, _, _ = _path(name).partition(":")
    try:
        found = importlib.util.find_spec(module)
    except FAILURES as error:
        return _not_imported(error)
    return None if found else _not_imported(ModuleNotFoundError(f"No module named {module!r}"))


def needs_torch() -> str | None:
    """How to have torch, an extra that only code of users' own needs; None where it is there."""
    if importlib.util.find_spec("torch"):
        return None
    return "needs torch, which is an extra and not installed: pip install 'aerofed[torch]'"


def _not_imported(error: BaseException) -> str:
    if getattr(error, "name", None) == "torch" and (reason := needs_torch()):
        return reason
    missing = isinstance(error, ModuleNotFoundError)
    where = "; looked for in the working directory, in PYTHONPATH and among what is installed"
    return f"cannot be imported: {first_line(error)}{where if missing else ''}"


def find(name: str, *, key: str) -> Callable[..., Any]:
    """The callable of that name.

    Raises:
        PluginError: it cannot be imported, or cannot be called; `key` is the setting.
    """
    _look_here()
    module, _, attribute = _path(name).partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except FAILURES as error:
        raise PluginError(key, name, _not_imported(error)) from error
    if not callable(found):
        raise PluginError(key, name, f"is {kind_of(found)}, not callable")
    made: Callable[..., Any] = found
    return made


def make(name: str, *arguments: object, key: str, members: tuple[str, ...]) -> Any:
    """What the factory of that name makes of the arguments; it must have these members.

    Raises:
        PluginError: it cannot be imported or called, or makes something else.
    """
    factory = find(name, key=key)
    try:
        made = factory(*arguments)
    except FAILURES as error:
        raise PluginError(key, name, f"calling it fails: {first_line(error)}") from error
    missing = [member for member in members if not hasattr(made, member)]
    if missing:
        raise PluginError(
            key,
            name,
            f"gives {kind_of(made)} without {', '.join(missing)}; needed: {', '.join(members)}",
        )
    return made


@contextmanager
def guarded(name: str, *, key: str, doing: str) -> Iterator[None]:
    """Run a plug-in's code in the block: what it raises is its own, and is said to be.

    Raises:
        PluginError: one line with the place in its file.
    """
    try:
        yield
    except LearningError:
        raise
    except FAILURES as error:
        raise PluginError(key, name, told(name, doing, error)) from error


def told(name: str, doing: str, error: BaseException) -> str:
    """What a plug-in was asked, what it raised, and where in its module (or anywhere else)."""
    module = sys.modules.get(_path(name).partition(":")[0])
    file = getattr(module, "__file__", None)
    frames = [
        (frame.f_code.co_filename, line, str(frame.f_globals.get("__name__")).partition(".")[0])
        for frame, line in traceback.walk_tb(error.__traceback__)
    ]
    own = [frame for frame in frames if frame[0] == file]
    # The first is the one who asked: where nothing but its package failed, no place helps.
    others = [frame for frame in frames if frame[2] != frames[0][2]]
    found = (own or others)[-1:]
    where = "".join(f" ({name}, line {line})" for name, line, _ in found)
    return f"{doing}: {first_line(error)}{where}"


def _look_here() -> None:
    """Have modules found in the working directory too, after all others."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)


def _path(name: str) -> str:
    return name if is_import_path(name) else _entry_points().get(name, name)


def _entry_points() -> dict[str, str]:
    """Import paths by the name of the entry point."""
    return {item.name: item.value for item in importlib.metadata.entry_points(group=GROUP)}
