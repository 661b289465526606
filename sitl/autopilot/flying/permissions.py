"""What others on board have to say about a flight: where it may lead, and whether it may begin."""

from collections.abc import Callable
from dataclasses import dataclass, field

from flightdyn.state import Vector
from sitl.autopilot.modes import Need


@dataclass(frozen=True)
class Permissions:
    """Asked before an order is carried out."""

    position_ok: Callable[[], bool]  # the aircraft knows where it is
    forbidden: Callable[[Vector], str]  # how places (3,) or (n, 3) in NED may not be; empty: may
    arming_denied: Callable[[], str]  # why the motors must not be released; empty: they may
    # What modes need of those who fly in them; each comes with its pilot.
    needs: dict[Need, Callable[[], bool]] = field(default_factory=dict)
