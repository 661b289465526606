"""What can go wrong in a run, and the exit code it ends with."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Self

LIMITS_NOT_MET = 6
DIFFERENT = 7
INTERRUPTED = 130

# Options and keys by which several aircraft are asked for.
_SEVERAL = re.compile(
    r"(?:(?:vehicle|mission|link|area)\.)?(?:(?:n|num|number_of)_)?"
    r"(?:count|instances?|vehicles|drones?|uavs?|aircrafts?|fleet|swarm)"
)

# In words, for the command line and the documentation.
EXIT_CODES: Mapping[int, str] = {
    0: "done",
    1: "a bug",
    2: "wrong input: settings, data, files, folders",
    3: "no feasible plan",
    4: "failed on the way: flight not finished, or training diverged",
    5: "link lost, download failed, or port in use",
    LIMITS_NOT_MET: "limits not met",
    DIFFERENT: "logs differ, or a log has gaps",
    INTERRUPTED: "interrupted by Ctrl-C, SIGTERM or SIGHUP; a run goes on by aerofed run --resume",
}


def several(name: str) -> str:
    """Say, where an unknown option or key asks for several aircraft, what there is; else empty."""
    asks = _SEVERAL.fullmatch(name.lstrip("-").replace("-", "_"))
    words = "one aircraft flies a run; aerofed sitl --count N and aerofed.vehicles(N) serve several"
    return f"; {words}" if asks else ""


class AerofedError(Exception):
    """Root of the application's errors; the message is one clear line for the user."""

    exit_code = 1

    def in_words(self, text: str) -> Self:
        """The same error with another message, to be raised `from` its `__cause__`.

        It keeps the traceback.
        """
        other = self.__new__(type(self), text)
        vars(other).update(vars(self))
        return other.with_traceback(self.__traceback__)


class UsersCodeError(AerofedError):
    """A researcher's own code raised something, which is the `__cause__`, or broke a rule."""

    exit_code = 2


class CallbackError(UsersCodeError):
    """A callback failed; the run can be resumed once it is fixed, as callbacks alter no run."""


class InputError(AerofedError):
    """The user's input is wrong: configuration, data, files, folders."""

    exit_code = 2


class PlanError(AerofedError):
    """No feasible plan."""

    exit_code = 3


class FlightError(AerofedError):
    """The vehicle refused an order or did not finish it."""

    exit_code = 4


class LimitsNotMetError(AerofedError):
    """A flight does not meet its limits; `verdicts` has one for each limit, met or not."""

    exit_code = LIMITS_NOT_MET

    def __init__(self, message: str, verdicts: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.verdicts = tuple(verdicts)


class TrainingError(AerofedError):
    """Training failed, for example diverged; a retry does not help, another setting may."""

    exit_code = 4


class LinkLostError(AerofedError):
    """The link could not be opened, or the vehicle fell silent."""

    exit_code = 5
