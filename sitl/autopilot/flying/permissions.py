"""What others on board have to say about a flight: where it may lead, and whether it may begin."""

from collections.abc import Callable
from dataclasses import dataclass

from flightdyn.state import Vector


@dataclass(frozen=True)
class Permissions:
    """Asked before an order is carried out."""

    position_ok: Callable[[], bool]  # the aircraft knows where it is
    forbidden: Callable[[Vector], str]  # how places (3,) or (n, 3) in NED may not be; empty: may
    arming_denied: Callable[[], str]  # why the motors must not be released; empty: they may
