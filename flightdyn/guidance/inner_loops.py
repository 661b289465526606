"""The outer loop's end of the inner loops that run in the FCS.

The FCS takes the rotation from the believed to the wanted attitude, in body axes. The guidance
gives it at its own rate; between its steps the rotation is carried on with the believed body
rates, so that the attitude loop closes at every tick (`feed` in `flightdyn/native/ticks.h`).
"""

from flightdyn.frames import Triple
from flightdyn.native.ticks import Inner
from flightdyn.physics.multirotor import Multirotor


class InnerLoops:
    """Writes errors and rates into the FCS."""

    def __init__(self, vehicle: Multirotor, *, dt_s: float) -> None:
        self.memory = Inner(tuple(vehicle.set_rates), tuple(vehicle.set_errors), dt=dt_s)
        self._set_errors, self._set_feeds = vehicle.set_errors, vehicle.set_feeds
        self._set_collective = vehicle.set_collective

    def command(self, error: Triple, feed: Triple, collective: float) -> None:
        """Attitude error (rad), rate fed forward (rad/s), thrust per rotor (1 = full)."""
        self.memory.error[:] = error
        self.memory.feed[:] = feed
        for put, value in zip(self._set_feeds, feed, strict=True):
            put(value)
        for put, value in zip(self._set_errors, error, strict=True):
            put(value)
        self._set_collective(collective)

    def correct(self, gyro_bias: Triple) -> None:
        """What to take off the rates from now on (rad/s)."""
        self.memory.bias[:] = gyro_bias
