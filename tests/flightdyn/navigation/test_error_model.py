"""The filter's matrices against samples of the errors that they describe."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flightdyn.config import SensorsConfig
from flightdyn.frames import quaternion_from_euler, rotation_matrix
from flightdyn.native.library import Innovations, Transition
from flightdyn.navigation.error_model import (
    ATT,
    BA,
    BARO,
    BG,
    BGNSS,
    BMAG,
    HEADING,
    POS,
    STATES,
    VEL,
    Alignment,
    initial_covariance,
    level,
    measurement_matrix,
    measurement_noise,
    process_noise,
    transition,
)

CONFIG = SensorsConfig()
G = 9.80665
YAW = math.radians(70.0)
FIELD = np.array([0.214, 0.013, 0.430])
DECLINATION = math.atan2(FIELD[1], FIELD[0])


def test_alignment_errors_are_those_of_the_initial_covariance() -> None:
    """Level and point 4000 aircraft with biased sensors; compare sample and model covariance."""
    rng = np.random.default_rng(1)
    true = Rotation.from_euler("Z", YAW)
    down, field = np.array([0.0, 0.0, -G]), true.inv().apply(FIELD)
    rows = []
    for _ in range(4000):
        accel = rng.normal(0, CONFIG.imu.accel_turn_on_mps2, 3) * [1, 1, 0.1]
        iron = rng.normal(0, CONFIG.mag.hard_iron_gauss, 3)
        align = Alignment((0, 0, 0), tuple(down + accel), tuple(field + iron), 101_325.0, 4.0)
        w, x, y, z = level(align, declination_rad=DECLINATION)
        error = (true * Rotation.from_quat([x, y, z, w]).inv()).as_rotvec()
        rows.append([*error, *accel, *iron])
    sample = np.cov(np.array(rows).T)
    q = true.as_quat()
    P = initial_covariance(
        CONFIG,
        Alignment((0, 0, 0), tuple(down), tuple(field), 101_325.0, 4.0),
        attitude=(q[3], q[0], q[1], q[2]),
        gravity_mps2=G,
    )
    order = [*range(6, 9), *range(12, 15), *range(18, 21)]
    model = P[np.ix_(order, order)]
    assert np.all(np.linalg.eigvalsh(P) > -1e-12)
    size = np.sqrt(np.outer(np.diag(model), np.diag(model)))
    # As correlations, the z accelerometer apart: the model keeps a little room for its lean.
    both = [0, 1, 2, 3, 4, 6, 7]
    difference = ((sample - model) / size)[np.ix_(both, both)]
    assert np.max(np.abs(difference)) < 0.08


def test_first_fix_and_receiver_error_are_one() -> None:
    align = Alignment((0, 0, 0), (0, 0, -G), tuple(FIELD), 101_325.0, 4.0)
    P = initial_covariance(CONFIG, align, attitude=(1, 0, 0, 0), gravity_mps2=G)
    # p + b is known to the white noise of one fix.
    for axis in range(2):
        total = P[axis, axis] + P[15 + axis, 15 + axis] + 2 * P[axis, 15 + axis]
        assert total == pytest.approx(CONFIG.gnss.white_m**2, rel=0.01)


def test_correlated_states_keep_their_variance() -> None:
    """The receiver's error is stationary: F P F' + Q = P."""
    F = transition(CONFIG, step_s=0.1)[BGNSS, BGNSS]
    Q = process_noise(CONFIG, step_s=0.1, pa_per_m=12.0)[BGNSS, BGNSS]
    P = np.diag([0.7**2, 0.7**2, 1.97**2])
    assert pytest.approx(P) == F @ P @ F.T + Q


def test_process_noise_is_that_of_many_short_steps() -> None:
    """White acceleration noise through 100 steps of a millisecond gives the blocks of one."""
    Q1 = process_noise(CONFIG, step_s=0.001, pa_per_m=12.0)
    F1 = transition(CONFIG, step_s=0.001)
    P = np.zeros_like(Q1)
    for _ in range(100):
        P = F1 @ P @ F1.T + Q1
    Q = process_noise(CONFIG, step_s=0.1, pa_per_m=12.0)
    for rows, columns in ((POS, POS), (POS, VEL), (VEL, VEL), (ATT, ATT), (BG, BG), (BA, BA)):
        assert P[rows, columns] == pytest.approx(Q[rows, columns], rel=0.02, abs=1e-18)


def test_heading_residual_is_the_derivative_of_the_measured_heading() -> None:
    H = measurement_matrix(CONFIG)
    for axis in range(3):
        turn = np.zeros(3)
        turn[axis] = 1e-6
        # The true attitude is the believed one, turned: the belief sees the field turned back.
        seen = Rotation.from_rotvec(turn).inv().apply(FIELD)
        residual = DECLINATION - math.atan2(seen[1], seen[0])
        assert H[HEADING, ATT][axis] == pytest.approx(residual / 1e-6, abs=1e-4)
    assert not np.any(H[HEADING, BMAG])  # depends on the attitude: filled in at use


def test_measurement_noise_is_in_metres_and_radians() -> None:
    R = np.diag(measurement_noise(CONFIG, pa_per_m=12.0))
    assert R[0] == pytest.approx(0.05**2, rel=1e-2)
    assert R[3:6] == pytest.approx([0.09**2, 0.09**2, 0.18**2], rel=1e-2)
    assert R[BARO] == pytest.approx((1 / 12) ** 2, rel=1e-2)
    assert R[HEADING] == pytest.approx((0.004 / math.hypot(0.214, 0.013)) ** 2, rel=1e-2)


def test_innovations_and_transition_against_numpy() -> None:
    """What C does of the filter's matrices, by their general forms."""
    rng = np.random.default_rng(1)
    H, R = measurement_matrix(CONFIG), measurement_noise(CONFIG, pa_per_m=12.0)
    innovations = Innovations(H, R)
    for _ in range(20):
        root = rng.normal(size=(STATES, STATES))
        P = root @ root.T
        innovations.residual[:] = y = rng.normal(size=8)
        stds, squares = innovations.measure(P)
        S = H @ P @ H.T + R
        assert stds == pytest.approx(np.sqrt(S.diagonal()), rel=1e-12)
        parts = (slice(0, 3), slice(3, 6), slice(6, 7), slice(7, 8))
        expected = [float(y[p] @ np.linalg.solve(S[p, p], y[p])) for p in parts]
        assert squares == pytest.approx(expected, rel=1e-8)
    q, gained, dt = quaternion_from_euler(0.3, -0.2, 2.0), (0.4, -0.7, 1.1), 0.2
    F = transition(CONFIG, step_s=dt)
    plain = F.copy()
    Transition(F).write(q, gained, dt)
    R3 = np.array(rotation_matrix(q)).reshape(3, 3)
    cross = -np.cross(np.eye(3), gained).T
    plain[VEL, ATT], plain[POS, ATT] = -cross, -cross * dt / 2
    plain[ATT, BG] = plain[VEL, BA] = -R3 * dt
    plain[POS, BA] = -R3 * dt**2 / 2
    plain[VEL, BG] = cross @ R3 * dt / 2
    np.testing.assert_allclose(F, plain, atol=1e-15)
