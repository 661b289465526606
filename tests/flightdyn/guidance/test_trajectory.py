"""The reference along a path: limits, corners and closed forms."""

import ctypes
import math

import numpy as np
import pytest
from flights import corner_distance, cross_track, legs, path_along
from hypothesis import given, settings
from hypothesis import strategies as st

from flightdyn.clock import SimClock
from flightdyn.config import LimitsConfig
from flightdyn.guidance.path import FlightPath, Trajectory, brake_and_go, plan_path
from flightdyn.native.ticks import FLIGHT
from flightdyn.state import Vector
from native.errors import InputError

LIMITS = LimitsConfig()
START = np.array([0.0, 0.0, -60.0])


def sample(trajectory: Trajectory, dt: float = 0.01) -> tuple[Vector, Vector, Vector]:
    times = np.arange(trajectory.start_s, trajectory.end_s + 0.5, dt)
    refs = [trajectory.at(float(t)) for t in times]
    return (
        np.array([r.p for r in refs]),
        np.array([r.v for r in refs]),
        np.array([r.a for r in refs]),
    )


def test_straight_takes_length_over_speed_plus_speed_over_acceleration() -> None:
    trajectory, _ = plan_path(path_along(legs(START, (0.0,))), LIMITS)
    expected = 400 / 20 + 20 / LIMITS.acceleration_mps2 + LIMITS.smoothing_s
    assert trajectory.end_s - trajectory.start_s == pytest.approx(expected, abs=1e-9)


def test_short_leg_never_reaches_its_speed() -> None:
    trajectory, _ = plan_path(path_along(legs(START, (0.0,), 10.0)), LIMITS)
    _, v, _ = sample(trajectory)
    assert trajectory.end_s - trajectory.start_s == pytest.approx(
        2 * math.sqrt(10 / LIMITS.acceleration_mps2) + LIMITS.smoothing_s, abs=1e-9
    )
    assert np.max(v) < math.sqrt(LIMITS.acceleration_mps2 * 10)


@pytest.mark.parametrize("turn", [20.0, 45.0, 90.0, 135.0, 170.0])
def test_corner_is_cut_as_the_parabola_says(turn: float) -> None:
    points = legs(START, (0.0, turn), 200.0)
    trajectory, corners = plan_path(path_along(points), LIMITS)
    p, _, _ = sample(trajectory, 0.001)
    miss = float(np.min(corner_distance(points, p)))
    at = trajectory.at(corners[1].t)
    # Before the averaging, where the leg is left: a hair of the window lies on either side.
    sharp, _ = plan_path(path_along(points), LIMITS.model_copy(update={"smoothing_s": 0.0}))
    speed = math.dist((0, 0, 0), sharp.at(corners[1].t - corners[1].half).v)
    sine = math.sin(math.radians(turn) / 2)
    a = LIMITS.acceleration_mps2
    # v^2 s^2 / 2a, and a T^2 / 24 of the averaging window on top.
    expected = speed**2 * sine**2 / (2 * a) + a * LIMITS.smoothing_s**2 / 24
    assert miss == pytest.approx(expected, abs=2e-3)
    assert math.dist(at.p[:2], points[1, :2]) == pytest.approx(miss, abs=1e-3)
    assert miss <= 5.0
    outside = corner_distance(points, p) > 5.0
    assert np.max(cross_track(points, p)[outside]) <= 1.05


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(-300, 300), st.floats(-300, 300), st.floats(-90, -30), st.floats(2, 25)
        ),
        min_size=1,
        max_size=8,
    ),
    st.lists(st.booleans(), min_size=8, max_size=8),
    st.floats(0, 10),
)
def test_any_path_keeps_the_limits_and_ends_where_it_should(
    rows: list[tuple[float, float, float, float]], repeats: list[bool], radius: float
) -> None:
    points, speeds = [tuple(START)], []
    for row, repeat in zip(rows, repeats, strict=False):
        points.append(row[:3])
        speeds.append(row[3])
        if repeat:  # coincident points
            points.append(row[:3])
            speeds.append(row[3])
    path = FlightPath(np.array(points), np.array(speeds), np.full(len(points), radius))
    trajectory, corners = plan_path(path, LIMITS)
    p, v, a = sample(trajectory, 0.04)
    assert p[0] == pytest.approx(START, abs=1e-6)
    assert p[-1] == pytest.approx(points[-1], abs=1e-6)
    assert np.max(np.linalg.norm(a, axis=1)) <= LIMITS.acceleration_mps2 * 1.001
    assert np.max(np.linalg.norm(v, axis=1)) <= 25.001
    assert np.max(-v[:, 2]) <= LIMITS.climb_mps * 1.001
    assert np.max(v[:, 2]) <= LIMITS.descent_mps * 1.001
    # Velocity and acceleration are the derivatives of position and velocity.
    assert np.diff(p, axis=0) == pytest.approx((v[1:] + v[:-1]) * 0.02, abs=0.002)
    assert np.diff(v, axis=0) == pytest.approx((a[1:] + a[:-1]) * 0.02, abs=0.03)
    assert corners[-1].passed == len(points)
    times = [corner.t for corner in corners]
    assert times == sorted(times)
    for corner in corners[1:-1]:
        nearest = trajectory.at(corner.t).p
        assert math.dist(nearest, corner.p) <= LIMITS.corner_cut * radius + 0.05


def test_start_at_speed_keeps_the_speed_along_the_first_leg() -> None:
    path = path_along(legs(START, (0.0,)))
    trajectory, _ = plan_path(path, LIMITS, start_vel=(12.0, 3.0, 0.0))
    assert trajectory.at(0.0).v == pytest.approx((12.5, 0, 0), abs=0.6)
    still, _ = plan_path(path, LIMITS)
    assert trajectory.end_s < still.end_s - 0.5


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("beside_mps", "keeps"), [(3.9, True), (-4.1, False)])
def test_what_leads_beside_the_first_leg_by_four_metres_a_second_is_braked_off(
    axis: int, beside_mps: float, keeps: bool
) -> None:
    """Whatever the way of the leg: along each axis in turn, and a little along the other two."""
    along, beside = np.roll([0.8, 0.6, 0.0], axis), np.roll([0.6, -0.8, 0.0], axis)
    path = path_along(np.array([START, START + 300.0 * along]))
    velocity = (2.5 * along + beside_mps * beside).tolist()
    trajectory, _ = plan_path(path, LIMITS, start_vel=velocity)
    still, _ = plan_path(path, LIMITS)
    assert (trajectory.end_s < still.end_s) is keeps


def test_braking_stops_in_the_closed_form_distance() -> None:
    trajectory = brake_and_go(
        (0.0, 0.0, -50.0), (20.0, 0.0, 0.0), goal=(0.0, 0.0, -50.0), limits=LIMITS
    )
    p, v, _ = sample(trajectory)
    assert np.max(p[:, 0]) == pytest.approx(20**2 / (2 * LIMITS.acceleration_mps2), abs=0.1)
    assert p[-1] == pytest.approx([0, 0, -50], abs=1e-9)
    assert np.max(np.abs(v[-1])) == 0


@pytest.mark.parametrize(
    ("points", "speeds", "radii", "says"),
    [
        (np.zeros((1, 3)), np.zeros(0), np.zeros(1), "M >= 2"),
        (np.zeros((2, 2)), np.ones(1), np.ones(2), r"\(2, 2\)"),
        (np.zeros((2, 3)), np.ones(2), np.ones(2), r"speeds_mps has shape \(2,\)"),
        (np.zeros((2, 3)), np.zeros(1), np.ones(2), "speeds_mps = 0"),
        (np.zeros((2, 3)), np.ones(1), np.array([1.0, -1.0]), "acceptance_m = -1"),
        (np.full((2, 3), np.nan), np.ones(1), np.ones(2), "not finite"),
    ],
)
def test_bad_paths_are_refused(points: Vector, speeds: Vector, radii: Vector, says: str) -> None:
    with pytest.raises(InputError, match=says):
        FlightPath(points, speeds, radii)


def test_paths_are_read_only() -> None:
    path = path_along(legs(START, (0.0,)))
    with pytest.raises(ValueError, match="read-only"):
        path.points_ned_m[0, 0] = 1.0


def test_clock_counts_whole_ticks() -> None:
    clock = SimClock(250)
    for _ in range(1_000_000):
        clock.tick += 1
    assert clock.t_ns == 4_000_000_000_000
    assert clock.ticks(0.02, what="interval") == 5
    with pytest.raises(InputError, match=r"interval = 0.003 s is not a whole number"):
        clock.ticks(0.003, what="interval")
    with pytest.raises(InputError, match="interval = 0 s is not"):
        clock.ticks(0.0, what="interval")
    for rate_hz in (300_007, 0, -250):
        with pytest.raises(InputError, match=f"rate {rate_hz} Hz"):
            SimClock(rate_hz)
    assert (clock.ticks(0.004, what="interval"), SimClock(1000).dt_s) == (1, 0.001)


def test_the_acceleration_alone_is_led() -> None:
    """The guidance asks for it some time ahead: it is that of the later instant, where pieces meet
    as well."""
    trajectory, _ = plan_path(path_along(legs(START, (0.0, 70.0), 60.0)), LIMITS)
    out, lead = (ctypes.c_double * 9)(), 0.12
    changes = 0
    for t in np.arange(trajectory.start_s, trajectory.end_s, 0.01).tolist():
        FLIGHT.reference(trajectory.pieces.at, t, lead, ctypes.addressof(out))
        now, ahead = trajectory.at(t), trajectory.at(t + lead)
        assert out[:] == pytest.approx([*now.p, *now.v, *ahead.a], rel=1e-9, abs=1e-9)
        changes += now.a != ahead.a
    assert changes > 100
