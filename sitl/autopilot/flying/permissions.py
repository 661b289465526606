"""What others on board have to say about a flight: where it may lead, and whether it may begin."""

from typing import Protocol

from flightdyn.state import Vector


class Permissions(Protocol):
    """Asked before an order is carried out."""

    def position_ok(self) -> bool:
        """Whether the aircraft knows where it is."""

    def forbidden(self, places_ned_m: Vector, *, home_ned_m: Vector) -> str:
        """How places, (3,) or (n, 3), may not be; empty if they may."""

    def arming_denied(self) -> str:
        """Why the motors must not be released; empty if they may."""
