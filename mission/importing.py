"""A researcher's own code by import path: `package.module:callable`."""

import importlib
import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fl.errors import USERS_MISTAKES, first_line
from mission.errors import InputError

IMPORT_PATH = r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*"


def is_import_path(text: str) -> bool:
    """Whether the text has the form of one."""
    return re.fullmatch(IMPORT_PATH, text) is not None


def make_from(path: str, *arguments: object, key: str, members: tuple[str, ...]) -> Any:
    """What the factory at `path` makes of the arguments; it must have these members.

    Raises:
        InputError: it cannot be imported or called, or makes something else; `key` is the setting
            that holds the path.
    """
    factory = _imported(path, key=key)
    try:
        made = factory(*arguments)
    except USERS_MISTAKES as error:
        raise InputError(f"{key} = {path!r}: calling it fails: {first_line(error)}") from error
    missing = [member for member in members if not hasattr(made, member)]
    if missing:
        raise InputError(
            f"{key} = {path!r}: gives a {type(made).__name__} without {', '.join(missing)}; "
            f"needed: {', '.join(members)}"
        )
    return made


def check_found(path: str) -> None:
    """Whether there is such a module; it is not imported, only the packages around it are.

    Raises:
        InputError: there is none, or a package around it cannot be imported.
    """
    _look_here()
    module_name, _, _ = path.partition(":")
    try:
        found = importlib.util.find_spec(module_name)
    except USERS_MISTAKES as error:
        raise InputError(f"cannot be imported: {first_line(error)}") from error
    if found is None:
        raise InputError(f"cannot be imported: No module named {module_name!r}")


def _look_here() -> None:
    """Have modules found in the working directory too, after all others."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)


def _imported(path: str, *, key: str) -> Callable[..., Any]:
    _look_here()
    module_name, _, name = path.partition(":")
    try:
        found = getattr(importlib.import_module(module_name), name)
    except USERS_MISTAKES as error:
        raise InputError(f"{key} = {path!r}: cannot be imported: {first_line(error)}") from error
    if not callable(found):
        raise InputError(f"{key} = {path!r}: is a {type(found).__name__}, not callable")
    made: Callable[..., Any] = found
    return made
