"""What goes wrong in a simulated vehicle, as errors of the application."""

from collections.abc import Iterator
from contextlib import contextmanager

from flightdyn.errors import FlightDynamicsError, FlightInputError
from mission.base.errors import FlightError, InputError, LinkLostError
from sitl.errors import LinkError, SitlInputError


@contextmanager
def of_settings() -> Iterator[None]:
    """Context manager around the making of a vehicle: refused settings raise InputError."""
    try:
        yield
    except (SitlInputError, FlightInputError) as error:
        raise InputError(str(error)) from None


@contextmanager
def of_a_vehicle() -> Iterator[None]:
    """Context manager around a vehicle's flight: translates errors of its links and physics.

    Raises:
        LinkLostError: a link cannot be opened or used.
        FlightError: the aircraft has left the range of its physics.
    """
    try:
        yield
    except LinkError as error:
        raise LinkLostError(str(error)) from None
    except FlightDynamicsError as error:
        raise FlightError(f"the simulated aircraft failed: {error}") from error
