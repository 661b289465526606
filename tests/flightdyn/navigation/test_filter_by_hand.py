"""Matrices, residuals and airspeed of the filter, by numbers of their own and by differences."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flightdyn.config import BaroConfig, GnssConfig, ImuConfig, MagConfig, SensorsConfig
from flightdyn.frames import frozen, quaternion_from_euler, rotation_matrix
from flightdyn.inertial import Earth, NavState
from flightdyn.navigation.airspeed import DragAirspeed
from flightdyn.navigation.error_model import (
    Alignment,
    gnss_correlation,
    initial_covariance,
    level,
    measurement_matrix,
    measurement_noise,
    process_noise,
    transition,
)
from flightdyn.navigation.estimator import Estimator
from flightdyn.navigation.measurements import Biases, Measurements
from flightdyn.physics.air import pressure_pa, pressure_slope
from flightdyn.physics.sensors import BaroSample, MagSample
from flightdyn.state import GnssFix, Vector

CONFIG = SensorsConfig(
    imu=ImuConfig(
        gyro_noise_density=2e-3, gyro_random_walk=1e-3, gyro_turn_on_radps=0.1,
        accel_noise_density=0.03, accel_random_walk=0.05, accel_turn_on_mps2=0.3,
    ),
    gnss=GnssConfig(
        std_horizontal_m=0.5, std_vertical_m=1.5, correlation_s=10.0, white_m=0.2,
        std_vel_horizontal_mps=0.1, std_vel_vertical_mps=0.3,
    ),
    baro=BaroConfig(white_pa=6.0, drift_pa=24.0, drift_correlation_s=400.0),
    mag=MagConfig(
        field_north_gauss=0.2, field_east_gauss=0.1, field_down_gauss=0.4, white_gauss=0.01,
        hard_iron_gauss=0.02,
    ),
)  # fmt: skip
G, YAW = 9.8, 1.2
FIELD = np.array([0.2, 0.1, 0.4])
DECLINATION = math.atan2(0.1, 0.2)
S = 1_000_000_000


def aligned(force: Vector, field: Vector, seconds: float = 3.0) -> Alignment:
    fx, fy, fz = force.tolist()
    x, y, z = field.tolist()
    return Alignment((0, 0, 0), (fx, fy, fz), (x, y, z), 101_325.0, seconds)


def test_what_alignment_leaves_is_that_of_its_derivatives() -> None:
    true = Rotation.from_euler("Z", YAW)
    force, field = np.array([0.0, 0.0, -G]), true.inv().apply(FIELD)

    def error(accel: Vector, iron: Vector) -> Vector:
        found = level(aligned(force + accel, field + iron), declination_rad=DECLINATION)
        w, x, y, z = found
        rotvec: Vector = (true * Rotation.from_quat([x, y, z, w]).inv()).as_rotvec()
        return rotvec

    step, none = 1e-6, np.zeros(3)
    by_accel = np.array([error(step * unit, none) for unit in np.eye(3)]).T / step
    by_iron = np.array([error(none, step * unit) for unit in np.eye(3)]).T / step
    P = initial_covariance(
        CONFIG, aligned(force, field), attitude=quaternion_from_euler(0.0, 0.0, YAW),
        gravity_mps2=G,
    )  # fmt: skip
    accel, iron = np.diag([0.09 + 1e-8, 0.09 + 1e-8, 4e-4]), (0.0004 + 1e-10) * np.eye(3)
    expected = np.zeros((22, 22))
    expected[[0, 1], [0, 1]] = 0.25 + 0.04 + 1e-6
    expected[[0, 1, 15, 16], [15, 16, 0, 1]] = -0.25
    expected[[15, 16], [15, 16]] = 0.25 + 1e-9
    expected[2, 2] = expected[21, 21] = 1e-4
    expected[17, 17] = 2.25 + 1e-9
    expected[[3, 4, 5], [3, 4, 5]] = 1e-4
    expected[[9, 10, 11], [9, 10, 11]] = 4e-6 / 3.0 + 1e-6 * 3.0 + 1e-10
    expected[12:15, 12:15], expected[18:21, 18:21] = accel, iron
    expected[6:9, 12:15], expected[6:9, 18:21] = by_accel @ accel, by_iron @ iron
    expected[12:15, 6:9], expected[18:21, 6:9] = expected[6:9, 12:15].T, expected[6:9, 18:21].T
    # Three seconds of headings, five a second, of a field that is 0.05 gauss2 across.
    white = np.array([1e-6, 1e-6, 1e-4 / 0.05 / 15.0 + 1e-6])
    expected[6:9, 6:9] = by_accel @ accel @ by_accel.T + by_iron @ iron @ by_iron.T + np.diag(white)
    np.testing.assert_allclose(P, expected, rtol=1e-4, atol=1e-9)


def test_short_alignments_have_one_heading() -> None:
    short = aligned(np.array([0.0, 0.0, -G]), FIELD, 0.1)
    still = CONFIG.model_copy(
        update={"mag": CONFIG.mag.model_copy(update={"hard_iron_gauss": 0.0})}
    )
    P = initial_covariance(still, short, attitude=(1, 0, 0, 0), gravity_mps2=G)
    by_tilt = P[8, 12:15] @ np.linalg.inv(P[12:15, 12:15]) @ P[12:15, 8]
    assert P[8, 8] - by_tilt == pytest.approx(1e-4 / 0.05 + 1e-6, rel=1e-4)


def test_what_a_step_adds() -> None:
    Q = process_noise(CONFIG, step_s=0.2, pa_per_m=12.0)
    accel, gyro, expected = 0.0009 + 1e-7, 4e-6 + 1e-10, np.zeros((22, 22))
    keep = math.exp(-0.02)
    for i in range(3):
        expected[i, i] = accel * 0.008 / 3
        expected[i, 3 + i] = expected[3 + i, i] = accel * 0.04 / 2
        expected[3 + i, 3 + i] = accel * 0.2
        expected[6 + i, 6 + i] = gyro * 0.2
        expected[9 + i, 9 + i] = 1e-6 * 0.2
        expected[12 + i, 12 + i] = 0.0025 * 0.2
        expected[15 + i, 15 + i] = (2.25 if i == 2 else 0.25) * (1 - keep**2)
        expected[18 + i, 18 + i] = 1e-12 * 0.2
    expected[21, 21] = 2 * 2.0**2 / 400.0 * 0.2
    np.testing.assert_allclose(Q, expected, rtol=1e-9, atol=0.0)
    assert gnss_correlation(CONFIG, step_s=0.2) == pytest.approx(keep)
    F = np.eye(22)
    F[[0, 1, 2], [3, 4, 5]], F[[15, 16, 17], [15, 16, 17]] = 0.2, keep
    np.testing.assert_allclose(transition(CONFIG, step_s=0.2), F, rtol=1e-12)


def test_what_is_measured_and_how_well() -> None:
    H = np.zeros((8, 22))
    for i in range(3):
        H[i, i] = H[i, 15 + i] = H[3 + i, 3 + i] = 1.0
    H[6, 2], H[6, 21] = -1.0, 1.0
    H[7, 6:9] = -0.4 * 0.2 / 0.05, -0.4 * 0.1 / 0.05, 1.0
    np.testing.assert_allclose(measurement_matrix(CONFIG), H, rtol=1e-12)
    variances = [0.04, 0.04, 0.04, 0.01, 0.01, 0.09, 0.25, 0.0001 / 0.05]
    R = np.diag(np.array(variances) + 1e-6)
    np.testing.assert_allclose(measurement_noise(CONFIG, pa_per_m=12.0), R, rtol=1e-12)


# --- residuals ------------------------------------------------------------------------------------


def waiting() -> Measurements:
    """Aligned at 200 m; increments of 20 ms."""
    align = Alignment((0, 0, 0), (0, 0, -G), (0.2, 0.1, 0.4), pressure_pa(200.0), 4.0)
    return Measurements(CONFIG, align, pa_per_m=12.0, increment_ns=S // 50)


STATE = NavState(
    10 * S, (300.0, -400.0, -50.0), (3.0, -2.0, 1.0), quaternion_from_euler(0.3, -0.2, YAW)
)
BIASES = Biases(gnss=(0.5, -0.25, 0.125), mag=(0.01, -0.02, 0.03), baro=0.75)


def fix_at(t_ns: int) -> GnssFix:
    where, velocity = frozen([310.0, -405.0, -47.0]), frozen([3.5, -1.0, 0.75])
    return GnssFix(t_ns, where, velocity, 1.0, 1.0, 0.1, 12)


def test_the_newest_fix_that_is_due_is_taken() -> None:
    measured = waiting()
    fixes = [fix_at(n * S) for n in (1, 2, 3)]
    measured.fixes.extend(fixes)
    assert measured.take_fix(S - 1) is None
    assert measured.take_fix(2 * S) is fixes[1]
    assert measured.take_fix(2 * S) is None
    assert list(measured.fixes) == fixes[2:]


def test_a_fix_is_compared_with_the_state_and_its_bias() -> None:
    """A twentieth of a second old, in which the aircraft has moved on."""
    measured = waiting()
    kinds = measured.compare(fix_at(STATE.t_ns - S // 20), STATE, BIASES)
    assert [tuple(kind) for kind in kinds] == [
        ("gnss position", 0, slice(0, 3), 21.1), ("gnss velocity", 1, slice(3, 6), 21.1),
    ]  # fmt: skip
    expected = [
        310.0 + 0.15 - 300.0 - 0.5, -405.0 - 0.1 + 400.0 + 0.25, -47.0 + 0.05 + 50.0 - 0.125,
        0.5, 1.0, -0.25,
    ]  # fmt: skip
    assert measured.residual[:6].tolist() == pytest.approx(expected)


def test_pressures_are_compared_each_with_its_own_height() -> None:
    """Now, an increment ago, and between two of them; less what the earth curves in 500 m."""
    measured = waiting()
    measured.downs[:] = [-47.0, -48.0, -49.0, -50.0]
    for back_ns, height_m in ((S // 25, 252.0), (S // 50, 250.5), (S // 90, 251.0)):
        measured.baro.append(BaroSample(STATE.t_ns - back_ns, pressure_pa(height_m)))
    late = BaroSample(STATE.t_ns + 1, pressure_pa(900.0))
    measured.baro.append(late)
    (kind,) = measured.compare(None, STATE, BIASES)
    assert tuple(kind) == ("baro", 2, slice(6, 7), 15.1)
    curve = 500.0**2 / 2 / 6.371e6
    mean = ((252.0 - 200.0 - 48.0) + (250.5 - 200.0 - 49.0) + (251.0 - 200.0 - 50.0)) / 3
    assert measured.residual[6] == pytest.approx(mean - curve - 0.75, abs=1e-6)
    assert measured.R[6, 6] == pytest.approx((0.25 + 1e-6) / 3)
    assert list(measured.baro) == [late]
    assert measured.downs == []
    measured.downs[:] = [-47.0, -48.0]
    measured.baro.appendleft(BaroSample(STATE.t_ns - S // 25, pressure_pa(251.0)))
    measured.compare(None, STATE, BIASES)  # from before all that is known
    assert measured.residual[6] == pytest.approx(1.0 - curve - 0.75, abs=1e-6)
    assert measured.R[6, 6] == pytest.approx(0.25 + 1e-6)
    assert measured.compare(None, STATE, BIASES) == []


def test_a_heading_is_compared_at_its_own_instant() -> None:
    measured, body = waiting(), Rotation.from_euler("ZYX", (YAW, -0.2, 0.3))
    turned = Rotation.from_rotvec([0.0, 0.0, 0.1])  # truly it heads by a tenth more to the right
    seen = (turned * body).inv().apply(FIELD) + BIASES.mag
    x, y, z = seen.tolist()
    for t_ns in (STATE.t_ns - 1, STATE.t_ns + 1):
        measured.mag.append(MagSample(t_ns, (9.0, 9.0, 9.0)))
        assert measured.compare(None, STATE, BIASES) == []
        measured.mag.clear()
    measured.mag.extend([MagSample(STATE.t_ns - 5, (9, 9, 9)), MagSample(STATE.t_ns, (x, y, z))])
    (kind,) = measured.compare(None, STATE, BIASES)
    assert tuple(kind) == ("heading", 3, slice(7, 8), 15.1)
    assert measured.residual[7] == pytest.approx(0.1)
    # How an offset of each axis changes it, by differences.
    for axis in range(3):
        more = np.array(seen)
        more[axis] += 1e-6
        north, east, _ = body.apply(more - BIASES.mag)
        changed = DECLINATION - math.atan2(east, north) - 0.1
        if axis == 0:
            whole = measured.H[7, 18:21].copy()
        # Of the field as it is at home, not as it is seen: alike to a tenth.
        assert whole[axis] == pytest.approx(changed / 1e-6, abs=0.6)
    exact = waiting()
    x, y, z = body.inv().apply(FIELD).tolist()
    exact.mag.append(MagSample(STATE.t_ns, (x, y, z)))
    exact.compare(None, STATE, Biases())
    assert exact.residual[7] == pytest.approx(0.0, abs=1e-12)
    for axis in range(3):
        north, east, _ = body.apply(np.array([x, y, z]) + 1e-6 * np.eye(3)[axis])
        changed = DECLINATION - math.atan2(east, north)
        assert exact.H[7, 18 + axis] == pytest.approx(changed / 1e-6, abs=1e-4)


# --- airspeed -------------------------------------------------------------------------------------


@pytest.mark.parametrize("lean", [(0.0, 0.0, 0.0), (0.25, -0.2, YAW)])
def test_drag_tells_the_airspeed_and_velocity_the_wind(lean: tuple[float, float, float]) -> None:
    drag, density = (0.3, 0.01, 0.0004), 0.9
    air = DragAirspeed(drag, pressure_pa=0.9 * 101_325.0)
    roll, pitch, yaw = lean
    body = Rotation.from_euler("ZYX", (yaw, pitch, roll))
    through = np.array([6.0, -3.0, 1.5])
    speed = np.linalg.norm(through)
    k = drag[0] + drag[1] * speed + drag[2] * speed**2
    felt = -density * k * body.inv().apply(through)
    felt[2] = -9.0  # along the thrust: nobody's drag
    n, e, d = body.apply(felt).tolist()
    r = rotation_matrix(quaternion_from_euler(roll, pitch, yaw))
    for _ in range(2):
        air.take((n, e, d), r, down_mps=1.5, bias=(0.0, 0.0, 0.0))
    assert air.over_ground_ne_mps == pytest.approx((6.0, -3.0), abs=0.05)
    seen = np.array(air.over_ground_ne_mps)
    air.learn_wind((8.0, -8.0, 1.5), bias=(0.05, -0.1, 0.2), dt_s=0.5)
    assert air.wind_ne_mps == pytest.approx(0.1 * (np.array([8.0, -8.0]) - seen))
    wind = np.array(air.wind_ne_mps)
    assert air.over_ground_ne_mps == pytest.approx(seen + wind)
    air.learn_wind((8.0, -8.0, 1.5), bias=(0.05, -0.1, 0.2), dt_s=0.5)
    assert air.wind_ne_mps == pytest.approx(wind + 0.1 * (np.array([8.0, -8.0]) - seen - wind))
    # A bias that is estimated without GNSS is put back, the one with it taken off.
    n, e, d = body.apply(np.add(felt, (0.05 - 0.3, -0.1 - 0.4, 0.0))).tolist()
    air.take((n, e, d), r, down_mps=1.5, bias=(0.3, 0.4, 0.5))
    assert np.array(air.over_ground_ne_mps) - air.wind_ne_mps == pytest.approx(seen, abs=1e-9)


def test_nobody_is_taken_for_faster_than_forty_metres_a_second() -> None:
    """Drag of k = 0.1 + 0.1 v at 40 m/s: what pushes by 41 m/s2 moves at 10 m/s through it."""
    air = DragAirspeed((0.1, 0.1, 0.0), pressure_pa=101_325.0)
    air.take((-41.0, 0.0, 0.0), rotation_matrix((1, 0, 0, 0)), down_mps=500.0, bias=(0, 0, 0))
    assert air.over_ground_ne_mps == pytest.approx((10.0, 0.0))


def test_a_lean_of_more_than_that_counts_as_one_of_73_degrees() -> None:
    """Across, it moves as it sinks: by at most 1 / 0.3 of that."""
    r = rotation_matrix(quaternion_from_euler(math.radians(80.0), 0.0, 0.0))
    air = DragAirspeed((1.0, 0.0, 0.0), pressure_pa=101_325.0)
    air.take((0.0, 0.0, 0.0), r, down_mps=3.0, bias=(0.0, 0.0, 0.0))
    north, east = air.over_ground_ne_mps
    assert (north, abs(east)) == pytest.approx((0.0, math.sin(math.radians(80.0)) * 10.0))


def test_the_earth_turns() -> None:
    earth = Earth.at(30.0, 0.0)
    assert earth.rate_north_radps == pytest.approx(7.292115e-5 * math.sqrt(0.75), rel=1e-9)
    assert earth.rate_down_radps == pytest.approx(-7.292115e-5 / 2, rel=1e-9)


# --- from increments to a correction --------------------------------------------------------------

EARTH = Earth.at(47.0, 0.0)
STEP_NS = S // 50


def at_rest(rates: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Estimator:
    """With solutions that are 120 ms old, five increments to a step of 0.1 s."""
    align = Alignment((0, 0, 0), (0, 0, -EARTH.gravity_mps2), (0.2, 0.1, 0.4), 101_325.0, 4.0)
    estimator = Estimator(
        CONFIG, align=align, fix=fixed(0), t_ns=0, earth=EARTH, step_s=0.1, increments=5
    )
    for at_ns in range(STEP_NS, S // 2, STEP_NS):
        estimator.increments.add(
            [*rates, 0.0, 0.0, -EARTH.gravity_mps2], dt_s=0.02, carried=estimator.to_now
        )
        estimator.update(at_ns, None)
        if at_ns == 320_000_000:
            break
    return estimator


def fixed(t_ns: int) -> GnssFix:
    return GnssFix(t_ns, frozen([0.0] * 3), frozen([0.0] * 3), 1.0, 1.0, 0.1, 12)


def test_the_first_two_steps_are_those_of_the_equations() -> None:
    """Without measurements the covariance of 0.2 s is F P F^T + Q, with the columns of F that turn
    attitude and biases into motion by the gravity that is felt."""
    estimator, dt, g = at_rest(), 0.2, EARTH.gravity_mps2
    align = Alignment((0, 0, 0), (0, 0, -g), (0.2, 0.1, 0.4), 101_325.0, 4.0)
    P = initial_covariance(CONFIG, align, attitude=(1, 0, 0, 0), gravity_mps2=g)
    F = transition(CONFIG, step_s=dt)
    felt = np.array([[0.0, g, 0.0], [-g, 0.0, 0.0], [0.0, 0.0, 0.0]])  # cross product with force
    F[3:6, 6:9], F[0:3, 6:9] = -felt * dt, -felt * dt**2 / 2
    F[6:9, 9:12] = -np.eye(3) * dt
    F[3:6, 12:15], F[0:3, 12:15] = -np.eye(3) * dt, -np.eye(3) * dt**2 / 2
    F[3:6, 9:12], F[0:3, 9:12] = felt * dt**2 / 2, felt * dt**3 / 6
    P = F @ P @ F.T + process_noise(CONFIG, step_s=dt, pa_per_m=pressure_slope(101_325.0))
    np.testing.assert_allclose(estimator.std(slice(0, 22)), np.sqrt(np.diag(P)), rtol=1e-3)


def test_a_filter_is_due_with_each_step_of_a_solution_and_else_each_200_ms() -> None:
    """120 ms later than its horizon."""
    estimator = at_rest()
    assert estimator.horizon.t_ns == 200_000_000
    assert estimator.due_ns == 520_000_000
    estimator.update(340_000_000, fixed(280_000_000))
    assert (estimator.horizon.t_ns, estimator.due_ns) == (200_000_000, 420_000_000)


def test_the_state_of_now_is_carried_once() -> None:
    """Turning on its place; corrections without measurements carry nothing again."""
    turning = at_rest((0.0, 0.0, 0.5))
    w, *_, z = turning.now.q
    assert 2.0 * math.atan2(z, w) == pytest.approx(0.5 * 0.32, abs=1e-4)
