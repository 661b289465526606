"""Geodesy and attitude against pymap3d, SciPy and published values."""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flightdyn.frames import (
    LocalFrame,
    euler_from_quaternion,
    normal_gravity,
    quaternion_from_euler,
    quaternion_multiply,
    rotation_matrix,
    rotation_quaternion,
    wrap_pi,
    yaw_of,
)
from flightdyn.state import GeodeticPoint
from native.errors import InputError

lat = st.floats(-89, 89)
lon = st.floats(-180, 180)
offset = st.floats(-20_000, 20_000)
angle = st.floats(-3.1, 3.1)


def scipy(q: tuple[float, float, float, float]) -> Rotation:
    return Rotation.from_quat([q[1], q[2], q[3], q[0]])


@given(lat, lon, st.floats(-100, 4000), offset, offset, st.floats(-3000, 3000))
def test_local_frame_is_that_of_pymap3d(
    lat0: float, lon0: float, alt0: float, n: float, e: float, d: float
) -> None:
    frame = LocalFrame(GeodeticPoint(lat0, lon0, alt0))
    point = frame.to_geodetic(np.array([n, e, d]))
    expected = pymap3d.ned2geodetic(n, e, d, lat0, lon0, alt0)
    assert point.lat_deg == pytest.approx(expected[0], abs=1e-11)
    assert wrap_pi(math.radians(point.lon_deg - expected[1])) == pytest.approx(0, abs=1e-11)
    assert point.alt_msl_m == pytest.approx(expected[2], abs=1e-6)
    back = frame.to_ned(point.lat_deg, point.lon_deg, point.alt_msl_m)
    assert back == pytest.approx([n, e, d], abs=1e-6)


def test_home_off_the_earth_is_refused() -> None:
    with pytest.raises(InputError, match="latitude 91"):
        LocalFrame(GeodeticPoint(91.0, 0.0, 0.0))


@pytest.mark.parametrize(("latitude", "gravity"), [(0.0, 9.7803253359), (90.0, 9.8321849379)])
def test_gravity_is_that_of_wgs84(latitude: float, gravity: float) -> None:
    # NIMA TR8350.2, table 3.4.
    assert normal_gravity(latitude, 0.0) == pytest.approx(gravity, abs=1e-8)
    # Free-air gradient at mid-latitudes: -3.086e-6 per second squared.
    slope = (normal_gravity(latitude, 100.0) - normal_gravity(latitude, 0.0)) / 100
    assert slope == pytest.approx(-3.086e-6, rel=2e-3)


def test_gravity_falls_with_height_as_wgs84_says() -> None:
    """TR8350.2, 4-3, from its angular velocity (rad/s) and the earth's GM (m3/s2)."""
    a, f, spin, gm = 6_378_137.0, 1 / 298.257223563, 7.292115e-5, 3.986004418e14
    m = spin**2 * a**2 * (a * (1 - f)) / gm
    for latitude in (0.0, 45.0, 90.0):
        ground, s2 = normal_gravity(latitude, 0.0), math.sin(math.radians(latitude)) ** 2
        for h in (-400.0, 2000.0, 9000.0):
            share = 1 - 2 / a * (1 + f + m - 2 * f * s2) * h + 3 * (h / a) ** 2
            assert normal_gravity(latitude, h) == pytest.approx(ground * share, rel=1e-11)


def test_the_ellipsoid_drops_below_the_plane() -> None:
    frame = LocalFrame(GeodeticPoint(52.0, 13.0, 0.0))
    north, east = np.array([0.0, 8000.0, 0.0, -6000.0]), np.array([0.0, 0.0, 8000.0, 5000.0])
    drops = frame.drop_m(north, east)
    for n, e, drop in zip(north, east, drops, strict=True):
        height = frame.to_geodetic(np.array([n, e, drop])).alt_msl_m
        assert height == pytest.approx(0.0, abs=1e-3)
    assert drops[1] == pytest.approx(8000.0**2 / 2 / 6.3755e6, rel=1e-4)


def test_places_of_one_plane_in_another() -> None:
    one, other = (LocalFrame(GeodeticPoint(52.0, lon_deg, 40.0)) for lon_deg in (13.0, 13.05))
    places = np.array([[0.0, 0.0, 0.0], [300.0, -200.0, -50.0], [-4000.0, 100.0, 10.0]])
    for there, place in zip(one.in_frame(places, other), places, strict=True):
        point = one.to_geodetic(place)
        expected = other.to_ned(point.lat_deg, point.lon_deg, point.alt_msl_m)
        assert there == pytest.approx(expected, abs=1e-6)


def test_home_at_the_ends_of_the_earth() -> None:
    for latitude, longitude in ((90.0, 180.0), (-90.0, -180.0)):
        frame = LocalFrame(GeodeticPoint(latitude, longitude, 0.0))
        assert frame.to_geodetic(np.zeros(3)).lat_deg == pytest.approx(latitude)
    for latitude, longitude in ((90.001, 0.0), (0.0, 180.001), (0.0, -180.001), (math.nan, 0.0)):
        with pytest.raises(InputError, match=r"latitude is -90\.\.90, longitude -180\.\.180 deg"):
            LocalFrame(GeodeticPoint(latitude, longitude, 0.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_nose_straight_up_is_a_right_angle_whatever_the_rounding(sign: float) -> None:
    half = math.sqrt(0.5) + 1e-9
    assert euler_from_quaternion((half, 0.0, sign * half, 0.0))[1] == sign * math.pi / 2


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(3.0, 3.0), (4.0, 4.0 - math.tau), (-4.0, math.tau - 4.0), (15.0, 15.0 - 2 * math.tau)],
)
def test_angles_are_wrapped(angle: float, wrapped: float) -> None:
    assert wrap_pi(angle) == pytest.approx(wrapped)
    assert wrap_pi(math.pi) == -math.pi


@given(angle, st.floats(-1.5, 1.5), angle)
def test_euler_angles_are_those_of_scipy(roll: float, pitch: float, yaw: float) -> None:
    q = quaternion_from_euler(roll, pitch, yaw)
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    assert np.array(rotation_matrix(q)).reshape(3, 3) == pytest.approx(
        expected.as_matrix(), abs=1e-12
    )
    assert euler_from_quaternion(q) == pytest.approx((roll, pitch, yaw), abs=1e-6)
    assert yaw_of(q) == pytest.approx(yaw, abs=1e-6)


@pytest.mark.slow
@given(st.tuples(angle, angle, angle), st.tuples(angle, angle, angle))
def test_products_and_rotation_vectors_are_those_of_scipy(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> None:
    product = quaternion_multiply(rotation_quaternion(*a), rotation_quaternion(*b))
    expected = Rotation.from_rotvec(a) * Rotation.from_rotvec(b)
    assert (scipy(product) * expected.inv()).magnitude() == pytest.approx(0, abs=1e-12)


@given(st.floats(1e-8, 2e-3))
def test_small_rotations_keep_their_precision(size: float) -> None:
    w, x, _, _ = rotation_quaternion(size, 0.0, 0.0)
    assert x == pytest.approx(math.sin(size / 2), rel=1e-14)
    assert w == pytest.approx(math.cos(size / 2), rel=1e-15)
