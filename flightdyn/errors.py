"""Errors of the flight dynamics."""

from native.errors import FlightError, InputError


class FaultError(InputError):
    """A fault that this aircraft cannot be given."""


class ModelDivergedError(FlightError):
    """The physics left the finite numbers: a fault of the model, not of its user."""
