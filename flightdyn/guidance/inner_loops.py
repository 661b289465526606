"""The outer loop's end of the inner loops that run in the FCS.

The FCS takes the rotation from the believed to the wanted attitude, in body axes. The guidance
gives it at its own rate; between its steps the rotation is carried on with the believed body
rates, so that the attitude loop closes at every tick (`feed` in `flightdyn/native/inner.h`).
"""

from flightdyn.native.ticks import Inner
from flightdyn.physics.multirotor import Multirotor


class InnerLoops(Inner):
    """Writes errors and rates into the FCS."""

    def __init__(self, vehicle: Multirotor, *, dt_s: float) -> None:
        super().__init__(
            vehicle.set_rates,
            vehicle.set_errors,
            vehicle.set_feeds,
            vehicle.set_collective,
            dt_s=dt_s,
        )
