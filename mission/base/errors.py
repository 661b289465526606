"""What can go wrong in a run, and the exit code it ends with."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from native.errors import AerofedError as AerofedError
from native.errors import FlightError as FlightError
from native.errors import InputError as InputError
from native.errors import LinkLostError as LinkLostError
from native.errors import NoFlightError as NoFlightError
from native.errors import TrainingError as TrainingError
from native.errors import UnansweredError as UnansweredError
from native.errors import UsersCodeError as UsersCodeError

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
    words = (
        "several aircraft of a run are the key vehicles: --set vehicles=3, or a table [[vehicles]] "
        "for each; aerofed sitl --count N and aerofed.vehicles(N) serve several; "
        "aerofed world --px4 --px4 serves two to firmwares"
    )
    return f"; {words}" if asks else ""


class CallbackError(UsersCodeError):
    """A callback failed; the run can be resumed once it is fixed, as callbacks alter no run."""


class PlanError(AerofedError):
    """No feasible plan."""

    exit_code = 3


class LimitsNotMetError(AerofedError):
    """A flight does not meet its limits; `verdicts` has one for each limit, met or not."""

    exit_code = LIMITS_NOT_MET

    def __init__(self, message: str, verdicts: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.verdicts = tuple(verdicts)


class PlanInputError(InputError):
    """A planning problem that makes no sense as it was given: shapes, NaN, negative values."""


class SolverError(PlanError):
    """A convex solver gave no usable answer; another start or method may succeed."""

    def __init__(self, solver: str, status: str) -> None:
        super().__init__(f"{solver} ended with status {status!r} and no usable solution")
        self.solver = solver
        self.status = status


class InfeasiblePlanError(PlanError):
    """A plan that breaks a constraint of its problem; the message names which, and by how much."""
