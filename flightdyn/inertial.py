"""State and Earth model of inertial navigation, which the C code of `flightdyn.native` integrates.

That code sums the IMU's samples and carries states forward by the sums.
"""

import math
from typing import NamedTuple

from flightdyn.frames import Quaternion, Triple, normal_gravity
from flightdyn.native.library import Strapdown

_EARTH_RADPS = 7.292115e-5
EARTH_RADIUS_M = 6.371e6

ImuSample = tuple[float, float, float, float, float, float]  # rates rad/s, specific force m/s2


class NavState(NamedTuple):
    """Position (m) and velocity (m/s) in NED, attitude body to NED, at `t_ns`."""

    t_ns: int
    p: Triple
    v: Triple
    q: Quaternion

    @classmethod
    def of(cls, t_ns: int, carried: Strapdown) -> "NavState":
        """Navigation state at `t_ns`, from what strapdown integration has carried it to."""
        pn, pe, pd, vn, ve, vd, w, x, y, z = carried.numbers
        return cls(t_ns, (pn, pe, pd), (vn, ve, vd), (w, x, y, z))


class Earth(NamedTuple):
    """Gravity, and the Earth's rotation where the aircraft flies, NED.

    The rotation turns paths over ground (Coriolis: 2 mm/s2 at 20 m/s). Gyroscopes are taken to
    turn with the Earth: its 15 deg an hour drown in their bias.
    """

    gravity_mps2: float
    rate_north_radps: float
    rate_down_radps: float

    @classmethod
    def at(cls, lat_deg: float, alt_m: float) -> "Earth":
        """Gravity and rotation of the Earth at a place, as navigation uses them."""
        lat = math.radians(lat_deg)
        return cls(
            normal_gravity(lat_deg, alt_m),
            _EARTH_RADPS * math.cos(lat),
            -_EARTH_RADPS * math.sin(lat),
        )
