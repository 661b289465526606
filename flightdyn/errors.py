"""Errors of the flight dynamics."""


class FlightDynamicsError(Exception):
    """Base class of the errors of `flightdyn`."""


class FlightInputError(FlightDynamicsError):
    """An input from outside is not usable; the message names it, its value and what is allowed."""


class PathError(FlightInputError):
    """A flight path whose arrays do not fit together or hold impossible numbers."""


class FaultError(FlightInputError):
    """A fault that this aircraft cannot be given."""


class AirframeError(FlightDynamicsError):
    """The airframe's files are missing or lack a property that the code drives."""


class ModelDivergedError(FlightDynamicsError):
    """The physics left the finite numbers: a fault of the model, not of its user."""
