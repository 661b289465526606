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
