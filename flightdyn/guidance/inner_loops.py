"""The outer loop's end of the inner loops that run in the FCS.

The FCS takes the rotation from the believed to the wanted attitude, in body axes. The guidance
gives it at its own rate; between its steps the rotation is carried on with the believed body
rates, so that the attitude loop closes at every tick.
"""

from flightdyn.frames import Triple
from flightdyn.physics.multirotor import Multirotor


class InnerLoops:
    """Writes errors and rates into the FCS."""

    __slots__ = (
        "_bias",
        "_dt",
        "_ep",
        "_eq",
        "_er",
        "_fp",
        "_fq",
        "_fr",
        "_set_collective",
        "_set_ep",
        "_set_eq",
        "_set_er",
        "_set_fp",
        "_set_fq",
        "_set_fr",
        "_set_p",
        "_set_q",
        "_set_r",
    )

    def __init__(self, vehicle: Multirotor, *, dt_s: float) -> None:
        self._dt = dt_s
        self._bias = (0.0, 0.0, 0.0)
        self._ep = self._eq = self._er = 0.0
        self._fp = self._fq = self._fr = 0.0
        self._set_ep, self._set_eq, self._set_er = vehicle.set_errors
        self._set_p, self._set_q, self._set_r = vehicle.set_rates
        self._set_fp, self._set_fq, self._set_fr = vehicle.set_feeds
        self._set_collective = vehicle.set_collective

    def command(self, error: Triple, feed: Triple, collective: float) -> None:
        """Attitude error (rad), rate fed forward (rad/s), thrust per rotor (1 = full)."""
        self._ep, self._eq, self._er = error
        self._fp, self._fq, self._fr = feed
        self._set_fp(feed[0])
        self._set_fq(feed[1])
        self._set_fr(feed[2])
        self._set_ep(error[0])
        self._set_eq(error[1])
        self._set_er(error[2])
        self._set_collective(collective)

    def correct(self, gyro_bias: Triple) -> None:
        """What to take off the rates from now on (rad/s)."""
        self._bias = gyro_bias

    def feed(self, p: float, q: float, r: float) -> None:
        """Measured body rates (rad/s) of this tick."""
        bp, bq, br = self._bias
        p, q, r = p - bp, q - bq, r - br
        self._set_p(p)
        self._set_q(q)
        self._set_r(r)
        dt = self._dt
        self._ep = ep = self._ep - (p - self._fp) * dt
        self._eq = eq = self._eq - (q - self._fq) * dt
        self._er = er = self._er - (r - self._fr) * dt
        self._set_ep(ep)
        self._set_eq(eq)
        self._set_er(er)
