"""What can go wrong in a run, and the exit code it ends with."""


class AerofedError(Exception):
    """Root of the application's errors; the message is one clear line for the user."""

    exit_code = 1


class InputError(AerofedError):
    """The user's input is wrong: configuration, data, files, folders."""

    exit_code = 2


class PlanError(AerofedError):
    """No feasible plan."""

    exit_code = 3


class FlightError(AerofedError):
    """The vehicle refused an order or did not finish it."""

    exit_code = 4


class TrainingError(AerofedError):
    """Training went wrong on the way: no retry helps, another setting may."""

    exit_code = 4


class LinkLostError(AerofedError):
    """The link could not be opened, or the vehicle fell silent."""

    exit_code = 5


INTERRUPTED = 130
