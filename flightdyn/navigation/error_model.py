"""Matrices of the error-state filter: what is estimated and how uncertain everything is.

Error state (22): position, velocity, attitude (rotation vector in NED), gyroscope bias,
accelerometer bias, correlated error of the GNSS position, offset of the magnetometer, drift of the
barometer. The last seven are there because those errors are not white: a filter that took them for
white would believe far too much in its position and heading. Equations: J. Farrell, Aided
Navigation (2008), chapter 11; J. Sola, Quaternion kinematics for the error-state Kalman filter
(2017), 7. Tiny constants keep the matrices regular where a sensor is exact.
"""

import math
from dataclasses import dataclass

import numpy as np

from flightdyn.config import MagConfig, SensorsConfig
from flightdyn.frames import (
    Matrix9,
    Quaternion,
    Triple,
    quaternion_from_euler,
    rotation_matrix,
    wrap_pi,
)
from flightdyn.state import Vector

STATES = 22
POS, VEL, ATT, BG, BA, BGNSS, BMAG = (slice(i, i + 3) for i in range(0, 21, 3))
BBARO = 21
BARO, HEADING = 6, 7  # rows of the measurement, after GNSS position and velocity


@dataclass(frozen=True, slots=True)
class Alignment:
    """Mean readings over a time at rest, from which the filter starts (FRD; rad/s, m/s2)."""

    rates: Triple
    specific_force: Triple
    field_frd_gauss: Triple
    pressure_pa: float
    duration_s: float


def level(align: Alignment, *, declination_rad: float) -> Quaternion:
    """Attitude at rest: roll and pitch from gravity, heading from the horizontal field."""
    fx, fy, fz = align.specific_force
    roll = math.atan2(-fy, -fz)
    pitch = math.atan2(fx, math.hypot(fy, fz))
    r = rotation_matrix(quaternion_from_euler(roll, pitch, 0.0))
    x, y, z = align.field_frd_gauss
    north = r[0] * x + r[1] * y + r[2] * z
    east = r[3] * x + r[4] * y + r[5] * z
    return quaternion_from_euler(roll, pitch, wrap_pi(declination_rad - math.atan2(east, north)))


def magnetometer_row(mag: MagConfig, r: Matrix9) -> Vector:
    """Derivative (3,) of the heading residual (rad) by a magnetometer offset (gauss, FRD)."""
    n, e = mag.field_north_gauss, mag.field_east_gauss
    k = 1 / (n * n + e * e)
    return np.array([(e * r[i] - n * r[3 + i]) * k for i in range(3)])


def _heading_variance(mag: MagConfig) -> float:
    """Variance (rad2) of the white error of one heading measurement."""
    return mag.white_gauss**2 / (mag.field_north_gauss**2 + mag.field_east_gauss**2)


def initial_covariance(
    config: SensorsConfig, align: Alignment, *, attitude: Quaternion, gravity_mps2: float
) -> Vector:
    """Error covariance (22, 22) after the alignment, cross-covariances included."""
    imu, gnss, mag = config.imu, config.gnss, config.mag
    P = np.zeros((STATES, STATES))
    horizontal = gnss.std_horizontal_m**2
    for i in range(2):
        # The first fix is the position: its error is the receiver's with the sign turned.
        P[i, i] = horizontal + gnss.white_m**2 + 1e-6
        P[i, 15 + i] = P[15 + i, i] = -horizontal
        P[15 + i, 15 + i] = horizontal + 1e-9
    P[2, 2] = 1e-4  # height is counted from here
    P[17, 17] = gnss.std_vertical_m**2 + 1e-9
    P[VEL, VEL] = np.eye(3) * 1e-4
    rest_s = align.duration_s
    gyro = imu.gyro_noise_density**2 / rest_s + imu.gyro_random_walk**2 * rest_s
    P[BG, BG] = np.eye(3) * (gyro + 1e-10)
    P[BBARO, BBARO] = 1e-4

    # Levelling takes an accelerometer bias b for a tilt of b / g: the two errors are one. The
    # heading was taken with that tilt, which leaks into it through the dip of the field.
    r = rotation_matrix(attitude)
    R = np.array(r).reshape(3, 3)
    tilt = np.array(((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 0.0))) / gravity_mps2 @ R
    dip = measurement_matrix(config)[HEADING, ATT]
    tilt[2] = -(dip[0] * tilt[0] + dip[1] * tilt[1])
    accel = imu.accel_turn_on_mps2**2 + 1e-8
    spread = np.diag([accel, accel, 4e-4])
    P[BA, BA] = spread
    P[ATT, BA] = tilt @ spread
    P[BA, ATT] = P[ATT, BA].T
    # So does the magnetometer's offset.
    offset = np.zeros((3, 3))
    offset[2] = -magnetometer_row(mag, r)
    iron = np.eye(3) * (mag.hard_iron_gauss**2 + 1e-10)
    P[BMAG, BMAG] = iron
    P[ATT, BMAG] = offset @ iron
    P[BMAG, ATT] = P[ATT, BMAG].T
    heading = _heading_variance(mag) / max(1.0, rest_s / mag.interval_s)
    white = np.diag([1e-6, 1e-6, heading + 1e-6])
    P[ATT, ATT] = tilt @ spread @ tilt.T + offset @ iron @ offset.T + white
    return P


def gnss_correlation(config: SensorsConfig, *, step_s: float) -> float:
    """Correlation of the receiver's position error across a step (first-order Gauss-Markov)."""
    return math.exp(-step_s / config.gnss.correlation_s)


def process_noise(config: SensorsConfig, *, step_s: float, pa_per_m: float) -> Vector:
    """Process noise covariance Q (22, 22) of a filter step."""
    imu, gnss, baro, dt = config.imu, config.gnss, config.baro, step_s
    accel = imu.accel_noise_density**2 + 1e-7
    gyro = imu.gyro_noise_density**2 + 1e-10
    Q = np.zeros((STATES, STATES))
    one = np.eye(3)
    Q[POS, POS] = one * accel * dt**3 / 3
    Q[POS, VEL] = Q[VEL, POS] = one * accel * dt**2 / 2
    Q[VEL, VEL] = one * accel * dt
    Q[ATT, ATT] = one * gyro * dt
    Q[BG, BG] = one * imu.gyro_random_walk**2 * dt
    Q[BA, BA] = one * imu.accel_random_walk**2 * dt
    Q[BMAG, BMAG] = one * 1e-12 * dt
    keep = gnss_correlation(config, step_s=dt)
    std = np.array([gnss.std_horizontal_m] * 2 + [gnss.std_vertical_m])
    Q[BGNSS, BGNSS] = np.diag(std**2 * (1 - keep**2))
    # Drift since the ground pressure was taken: at first a random walk.
    drift = baro.drift_pa / pa_per_m
    Q[BBARO, BBARO] = 2 * drift**2 / baro.drift_correlation_s * dt
    return Q


def transition(config: SensorsConfig, *, step_s: float) -> Vector:
    """Transition matrix F (22, 22) over a step, without the blocks that depend on the flight."""
    F = np.eye(STATES)
    F[POS, VEL] = np.eye(3) * step_s
    F[BGNSS, BGNSS] *= gnss_correlation(config, step_s=step_s)
    return F


def measurement_matrix(config: SensorsConfig) -> Vector:
    """Measurement matrix H (8, 22) of GNSS position and velocity, height and heading.

    The heading's part for the magnetometer's offset depends on the attitude: `magnetometer_row`.
    """
    H = np.zeros((8, STATES))
    H[0:3, POS] = H[0:3, BGNSS] = H[3:6, VEL] = np.eye(3)
    H[BARO, 2] = -1.0
    H[BARO, BBARO] = 1.0
    # Heading of the horizontal field: (field x across) / size, with `across` horizontal and to
    # the right of the field. Tilt errors leak into it through the dip.
    mag = config.mag
    n, e, d = mag.field_north_gauss, mag.field_east_gauss, mag.field_down_gauss
    H[HEADING, ATT] = np.array((-d * n, -d * e, n * n + e * e)) / (n * n + e * e)
    return H


def measurement_noise(config: SensorsConfig, *, pa_per_m: float) -> Vector:
    """Measurement noise covariance R (8, 8), for one sample of each sensor."""
    gnss = config.gnss
    variances = [
        *[gnss.white_m**2] * 3,
        *[gnss.std_vel_horizontal_mps**2] * 2,
        gnss.std_vel_vertical_mps**2,
        (config.baro.white_pa / pa_per_m) ** 2,
        _heading_variance(config.mag),
    ]
    return np.diag(np.array(variances) + 1e-6)
