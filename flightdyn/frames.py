"""WGS84 and local frames, and attitude as quaternions (w, x, y, z) that turn FRD into NED.

Positions near home are given in the plane that touches the ellipsoid at home (NED). Euler angles
are yaw, pitch, roll about z, y, x. Source: J. Farrell, Aided Navigation (2008), 2.3 and appendix D.
"""

import math

import numpy as np

from flightdyn.state import GeodeticPoint, Vector
from native.errors import InputError

WGS84_A_M = 6_378_137.0
WGS84_F = 1 / 298.257223563
_E2 = WGS84_F * (2 - WGS84_F)
_B_M = WGS84_A_M * (1 - WGS84_F)
_EP2 = _E2 / (1 - _E2)

Quaternion = tuple[float, float, float, float]
Triple = tuple[float, float, float]
Matrix9 = tuple[float, float, float, float, float, float, float, float, float]


def frozen(values: tuple[float, ...] | list[float] | Vector) -> Vector:
    """A read-only float array of `values`."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def geodetic_to_ecef(lat_deg: float, lon_deg: float, alt_m: float) -> Triple:
    """Earth-centred, Earth-fixed position (m) of a geodetic point."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    normal = WGS84_A_M / math.sqrt(1 - _E2 * math.sin(lat) ** 2)
    ring = (normal + alt_m) * math.cos(lat)
    return (
        ring * math.cos(lon),
        ring * math.sin(lon),
        (normal * (1 - _E2) + alt_m) * math.sin(lat),
    )


def ecef_to_geodetic(x: float, y: float, z: float) -> Triple:
    """Latitude and longitude (deg) and altitude (m); Bowring's method, iterated to 1e-15 rad."""
    ring = math.hypot(x, y)
    beta = math.atan2(z, (1 - WGS84_F) * ring)
    lat, before = 0.0, math.inf
    for _ in range(4):
        lat = math.atan2(
            z + _EP2 * _B_M * math.sin(beta) ** 3, ring - _E2 * WGS84_A_M * math.cos(beta) ** 3
        )
        if lat == before:
            break
        before = lat
        beta = math.atan2((1 - WGS84_F) * math.sin(lat), math.cos(lat))
    sin_lat, cos_lat = math.sin(lat), math.cos(lat)
    # Exact at the pole and on the equator alike, unlike a division by cos(lat).
    alt = ring * cos_lat + z * sin_lat - WGS84_A_M * math.sqrt(1 - _E2 * sin_lat**2)
    return math.degrees(lat), math.degrees(math.atan2(y, x)), alt


class LocalFrame:
    """North, east, down in the plane that touches the ellipsoid at `origin`."""

    def __init__(self, origin: GeodeticPoint) -> None:
        if not (abs(origin.lat_deg) <= 90 and abs(origin.lon_deg) <= 180):
            raise InputError(
                f"home at latitude {origin.lat_deg}, longitude {origin.lon_deg}: "
                "latitude is -90..90, longitude -180..180 deg"
            )
        self.origin = origin
        self._ecef = geodetic_to_ecef(origin.lat_deg, origin.lon_deg, origin.alt_msl_m)
        lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
        sin_lat, cos_lat = math.sin(lat), math.cos(lat)
        sin_lon, cos_lon = math.sin(lon), math.cos(lon)
        self._north = (-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
        self._east = (-sin_lon, cos_lon, 0.0)
        self._down = (-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat)
        self._rows = tuple(zip(self._ecef, self._north, self._east, self._down, strict=True))

    def to_ned(self, lat_deg: float, lon_deg: float, alt_msl_m: float) -> Vector:
        """Position (3,) in m of a geodetic point."""
        ecef = geodetic_to_ecef(lat_deg, lon_deg, alt_msl_m)
        dx, dy, dz = (ecef[i] - self._ecef[i] for i in range(3))
        axes = (self._north, self._east, self._down)
        return frozen([a[0] * dx + a[1] * dy + a[2] * dz for a in axes])

    def to_geodetic(self, pos_ned_m: Vector) -> GeodeticPoint:
        """The geodetic point of a position (3,) in m."""
        n, e, d = map(float, pos_ned_m)
        x, y, z = (o + n * a + e * b + d * c for o, a, b, c in self._rows)
        return GeodeticPoint(*ecef_to_geodetic(x, y, z))

    def in_frame(self, pos_ned_m: Vector, other: "LocalFrame") -> Vector:
        """Positions (n, 3) of this plane in that of another origin."""
        mine, theirs = (np.array([f._north, f._east, f._down]) for f in (self, other))
        moved: Vector = (pos_ned_m @ mine + np.subtract(self._ecef, other._ecef)) @ theirs.T
        return moved

    def drop_m(self, north_m: Vector, east_m: Vector) -> Vector:
        """How far below this plane (n,) the ellipsoid lies, in m: d^2 / 2R, with its radii of
        curvature at the origin towards north and east; to 1 mm within 10 km, to 1 m within 100."""
        flat = 1 - _E2 * math.sin(math.radians(self.origin.lat_deg)) ** 2
        normal = WGS84_A_M / math.sqrt(flat)
        meridian = normal * (1 - _E2) / flat
        return (north_m**2 / meridian + east_m**2 / normal) / 2


def normal_gravity(lat_deg: float, alt_m: float) -> float:
    """Gravity in m/s2, felt by a body at rest: Somigliana's formula and its height correction."""
    s2 = math.sin(math.radians(lat_deg)) ** 2
    surface = 9.7803253359 * (1 + 0.00193185265241 * s2) / math.sqrt(1 - _E2 * s2)
    m = 0.00344978650684  # rotation rate squared * a^2 * b / GM
    return surface * (
        1
        - 2 / WGS84_A_M * (1 + WGS84_F + m - 2 * WGS84_F * s2) * alt_m
        + 3 * (alt_m / WGS84_A_M) ** 2
    )


def wrap_pi(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % math.tau - math.pi


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Attitude of the given angles (rad)."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_quaternion(q: Quaternion) -> Triple:
    """Roll, pitch and yaw (rad) of an attitude."""
    w, x, y, z = q
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def yaw_of(q: Quaternion | Vector) -> float:
    """Heading (rad, clockwise from north) of an attitude."""
    w, x, y, z = (float(v) for v in q)
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def quaternion_multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product: first `b`, then `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def rotation_quaternion(x: float, y: float, z: float) -> Quaternion:
    """The quaternion of a rotation vector (rad)."""
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-6:  # series: the next term is below 1e-16
        half = 0.5 - angle2 / 48
        return (1 - angle2 / 8 + angle2 * angle2 / 384, half * x, half * y, half * z)
    angle = math.sqrt(angle2)
    half = math.sin(angle / 2) / angle
    return (math.cos(angle / 2), half * x, half * y, half * z)


def rotation_matrix(q: Quaternion) -> Matrix9:
    """The matrix (row by row) that turns body vectors into NED."""
    w, x, y, z = q
    return (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )
