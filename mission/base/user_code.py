"""A researcher's own code by import path: `package.module:callable`."""

import importlib
import importlib.util
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fl.errors import USERS_MISTAKES, LearningError, first_line, kind_of
from mission.base.errors import AerofedError, InputError, UsersCodeError

IMPORT_PATH = r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*"


def is_import_path(text: str) -> bool:
    """Whether the text has the form of one."""
    return re.fullmatch(IMPORT_PATH, text) is not None


@contextmanager
def users_code(path: str, *, key: str, doing: str) -> Iterator[None]:
    """Run a researcher's code in the block: what it raises is theirs, and is said to be.

    Raises:
        UsersCodeError: one line with the place in their file; `key` is the setting that names it.
    """
    try:
        yield
    except (AerofedError, LearningError):
        raise
    except Exception as error:
        raise UsersCodeError(
            f"{key} = {path!r}: {doing}: {first_line(error)} ({_place(path, error)})"
        ) from error


def _place(path: str, error: BaseException) -> str:
    """File and line in the module at `path` that led to an error; where it was raised, if none."""
    module = sys.modules.get(path.partition(":")[0])
    file = getattr(module, "__file__", None)
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if file is not None and frame.filename == file]
    frame = (own or frames)[-1]
    return f"{frame.filename}, line {frame.lineno}"


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
            f"{key} = {path!r}: gives {kind_of(made)} without {', '.join(missing)}; "
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
        raise InputError(f"{key} = {path!r}: is {kind_of(found)}, not callable")
    made: Callable[..., Any] = found
    return made
