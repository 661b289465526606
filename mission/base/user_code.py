"""A researcher's own code in the application: `fl.plugins`, with the application's errors."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fl.errors import LearningError
from fl.plugins import FAILURES, PluginError, make, told
from mission.base.errors import AerofedError, InputError, UsersCodeError


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
    except FAILURES as error:
        raise UsersCodeError(f"{key} = {path!r}: {told(path, doing, error)}") from error


@contextmanager
def plugins_of_learning() -> Iterator[None]:
    """Have what goes wrong in plug-ins of `fl` while the block runs end the run in one line.

    Raises:
        UsersCodeError: their code raised something.
        InputError: what it answered cannot be used.
    """
    try:
        yield
    except PluginError as error:
        if error.__cause__ is not None:
            raise UsersCodeError(str(error)) from error.__cause__
        raise InputError(str(error)) from None


def make_from(path: str, *arguments: object, key: str, members: tuple[str, ...]) -> Any:
    """What the factory at `path` makes of the arguments; it must have these members.

    Raises:
        InputError: it cannot be imported or called, or makes something else; `key` is the setting
            that holds the path.
    """
    try:
        return make(path, *arguments, key=key, members=members)
    except PluginError as error:
        raise InputError(str(error)) from error.__cause__
