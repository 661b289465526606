"""Airspeed and wind, estimated from the drag that the accelerometers feel.

Across the thrust axis nothing but the air pushes a multirotor, so its specific force there is its
drag: k(v) times the velocity through the air, with k of the airframe (M. Bangura et al., "Nonlinear
dynamic modeling for high performance control of a quadrotor", 2012; PX4's EKF2 fuses the same).
"""

import math

from flightdyn.frames import Matrix9, Triple

_SEA_LEVEL_PA = 101_325.0
_SMOOTHING_S = 5.0  # of the wind


class DragAirspeed:
    """Estimator of airspeed by specific force and attitude, and of wind by airspeed and GNSS."""

    def __init__(self, drag: Triple, *, pressure_pa: float) -> None:
        """`drag`: k = d0 + d1 v + d2 v^2 in 1/s at sea level, v in m/s."""
        self._drag = drag
        self._density = pressure_pa / _SEA_LEVEL_PA
        self._air = (0.0, 0.0)
        self._bias: Triple = (0.0, 0.0, 0.0)
        self.wind_ne_mps = (0.0, 0.0)

    @property
    def over_ground_ne_mps(self) -> tuple[float, float]:
        """Velocity over ground by drag: the estimated wind plus the airspeed."""
        return self.wind_ne_mps[0] + self._air[0], self.wind_ne_mps[1] + self._air[1]

    def take(self, force_ned_mps2: Triple, r: Matrix9, *, down_mps: float, bias: Triple) -> None:
        """Update the airspeed by a step's mean specific force (m/s2, NED) at attitude `r` (to NED).

        `bias` (FRD) has been taken off the force. The one last estimated with GNSS is used instead:
        one estimated without would be taken for wind here and come back as bias.
        """
        n, e, d = force_ned_mps2
        fx = r[0] * n + r[3] * e + r[6] * d + bias[0] - self._bias[0]
        fy = r[1] * n + r[4] * e + r[7] * d + bias[1] - self._bias[1]
        d0, d1, d2 = self._drag
        k = d0
        upright = max(0.3, r[8])
        for _ in range(4):  # a contraction: k grows by a twentieth of itself a metre a second
            x, y = -fx / (k * self._density), -fy / (k * self._density)
            z = (down_mps - r[6] * x - r[7] * y) / upright
            v = min(40.0, math.sqrt(x * x + y * y + z * z))
            k = d0 + d1 * v + d2 * v * v
        self._air = (r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z)

    def learn_wind(self, vel_ned_mps: Triple, *, bias: Triple, dt_s: float) -> None:
        """Update the wind, smoothed, by velocity over ground less airspeed, and note the bias."""
        self._bias = bias
        share = dt_s / _SMOOTHING_S
        (wn, we), (an, ae) = self.wind_ne_mps, self._air
        wn += share * (vel_ned_mps[0] - an - wn)
        we += share * (vel_ned_mps[1] - ae - we)
        self.wind_ne_mps = (wn, we)
