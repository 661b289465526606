"""A researcher's own code in the application: `fl.plugins`, with the application's errors."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

from fl.errors import DivergedError, LearningError, LearningInputError
from fl.plugins import PlugIn, PluginError
from mission.base.errors import AerofedError, InputError, TrainingError, UsersCodeError


class OwnCode(PlugIn):
    """A researcher's own code as a plug-in of the application; base class of such plug-ins."""

    error = UsersCodeError
    passed: ClassVar[tuple[type[Exception], ...]] = (AerofedError, LearningError)


@contextmanager
def errors_of_learning() -> Iterator[None]:
    """Context manager: convert errors of `fl` in the block to those of the application.

    Raises:
        UsersCodeError: a researcher's own code raised something, or answered what breaks a rule.
        InputError: a setting or a file cannot be used.
        TrainingError: training left the finite numbers.
    """
    try:
        yield
    except PluginError as error:
        raise UsersCodeError(str(error)) from error.__cause__
    except LearningInputError as error:
        raise InputError(str(error)) from None
    except DivergedError as error:
        raise TrainingError(f"learning diverged: {error}") from None
