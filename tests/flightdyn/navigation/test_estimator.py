"""The filter: exact where its sensors are, honest about its errors where they are not."""

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
import pytest
from flights import BREEZE, legs, make, path_along, run, take_off
from scipy.special import gammaincinv

from flightdyn.aircraft import Aircraft
from flightdyn.config import (
    BaroConfig,
    GnssConfig,
    ImuConfig,
    MagConfig,
    SensorsConfig,
    WindConfig,
)
from flightdyn.faults import GnssJump, GnssOff, ImuBias
from flightdyn.frames import Quaternion, Triple, frozen, quaternion_multiply, rotation_matrix
from flightdyn.inertial import Earth, NavState
from flightdyn.native.library import Increments, Strapdown
from flightdyn.navigation.error_model import Alignment
from flightdyn.navigation.estimator import Estimator
from flightdyn.navigation.inertial_navigation import InertialNavigation
from flightdyn.physics.air import pressure_pa
from flightdyn.physics.sensors import BaroSample, MagSample
from flightdyn.state import GnssFix, Vector

EXACT = SensorsConfig(
    imu=ImuConfig(
        gyro_noise_density=0,
        gyro_random_walk=0,
        gyro_turn_on_radps=0,
        accel_noise_density=0,
        accel_random_walk=0,
        accel_turn_on_mps2=0,
    ),
    gnss=GnssConfig(
        std_horizontal_m=0,
        std_vertical_m=0,
        white_m=0,
        std_vel_horizontal_mps=0,
        std_vel_vertical_mps=0,
    ),
    baro=BaroConfig(white_pa=0, drift_pa=0),
    mag=MagConfig(white_gauss=0, hard_iron_gauss=0),
)
EARTH = Earth.at(47.0, 0.0)
FIELD = (0.214, 0.013, 0.430)
ZERO = (0.0, 0.0, 0.0)


def rotation_error(true: Quaternion, believed: Quaternion) -> Vector:
    """Rotation vector (NED) from the believed to the true attitude."""
    w, x, y, z = believed
    dw, dx, dy, dz = quaternion_multiply(true, (w, -x, -y, -z))
    return 2 * math.copysign(1.0, dw) * np.array([dx, dy, dz])


# --- A world made of the filter's own equations: nothing but the filter can err in it.


class Twin:
    """Increments of an arbitrary flight, the state that they lead to, and exact sensors."""

    def __init__(self, config: SensorsConfig, *, estimator_accel_bias: Triple = ZERO) -> None:
        self._rng = np.random.default_rng(4)
        self.state = NavState(0, ZERO, ZERO, (1.0, 0.0, 0.0, 0.0))
        self.history = {0: self.state}
        force = (
            estimator_accel_bias[0],
            estimator_accel_bias[1],
            -EARTH.gravity_mps2 + estimator_accel_bias[2],
        )
        self.accel_bias = estimator_accel_bias
        align = Alignment(ZERO, force, FIELD, pressure_pa(0.0), 4.0)
        self._carried = Strapdown(EARTH, most=1)
        self._carried.place(*self.state[1:])
        self.estimator = Estimator(
            config, align=align, fix=self.fix(0), t_ns=0, earth=EARTH, step_s=0.1, increments=5
        )

    def fix(self, t_ns: int) -> GnssFix:
        s = self.history[t_ns]
        return GnssFix(t_ns, frozen(s.p), frozen(s.v), 1.0, 1.0, 0.1, 12)

    def step(self) -> None:
        t_ns = self.state.t_ns + 20_000_000
        t = t_ns * 1e-9
        rates = [0.9 * math.sin(t), 0.7 * math.cos(1.3 * t), 0.4]
        r = np.array(rotation_matrix(self.state.q)).reshape(3, 3)
        push = np.array([3 * math.sin(0.5 * t), 2 * math.cos(0.8 * t), -EARTH.gravity_mps2])
        force = r.T @ push
        true = Increments(1)
        true.add([*rates, *force.tolist()], dt_s=0.02)
        self._carried.carry(true, 0, 1)
        self.state = NavState.of(t_ns, self._carried)
        self.history[t_ns] = self.state
        felt = [*rates, *(force + self.accel_bias).tolist()]
        if t_ns % 200_000_000 == 0:
            north, east, down = self.state.p
            height = (north**2 + east**2) / (2 * 6.371e6) - down
            self.estimator.measurements.baro.append(BaroSample(t_ns, pressure_pa(height)))
            r = np.array(rotation_matrix(self.state.q)).reshape(3, 3)
            x, y, z = (r.T @ np.array(FIELD)).tolist()
            self.estimator.measurements.mag.append(MagSample(t_ns, (x, y, z)))
        epoch = t_ns - 120_000_000
        due = epoch > 0 and epoch % 200_000_000 == 0
        self.estimator.increments.add(felt, dt_s=0.02, carried=self.estimator.to_now)
        self.estimator.update(t_ns, self.fix(epoch) if due else None)


def test_noiseless_twin_is_exact() -> None:
    """Delays, horizon, replay and every sign: exact sensors leave nothing to correct."""
    twin = Twin(EXACT)
    for _ in range(3000):
        twin.step()
        assert twin.estimator.now.p == pytest.approx(twin.state.p, abs=1e-9)
    assert twin.estimator.now.v == pytest.approx(twin.state.v, abs=1e-10)
    assert np.linalg.norm(rotation_error(twin.state.q, twin.estimator.now.q)) < 1e-10
    assert {i.kind for i in twin.estimator.innovations} == {
        "gnss position",
        "gnss velocity",
        "baro",
        "heading",
    }
    assert max(i.nis for i in twin.estimator.innovations) < 1e-12


def test_an_accelerometer_bias_is_found_exactly() -> None:
    """Levelled with a bias, the filter starts tilted; the flight tells tilt and bias apart."""
    imu = ImuConfig(
        gyro_noise_density=0,
        gyro_random_walk=0,
        gyro_turn_on_radps=0,
        accel_noise_density=0,
        accel_random_walk=0,
        accel_turn_on_mps2=0.3,
    )
    bias = (0.25, -0.15, 0.1)
    twin = Twin(EXACT.model_copy(update={"imu": imu}), estimator_accel_bias=bias)
    assert np.linalg.norm(rotation_error(twin.state.q, twin.estimator.now.q)) > 0.02
    for _ in range(6000):
        twin.step()
    assert twin.estimator.biases.accel == pytest.approx(bias, abs=2e-3)
    assert np.linalg.norm(rotation_error(twin.state.q, twin.estimator.now.q)) < 3e-4
    assert twin.estimator.now.v == pytest.approx(twin.state.v, abs=2e-3)


def test_exact_sensors_in_the_real_physics_are_nearly_exact() -> None:
    aircraft = make(sensors=EXACT, wind=BREEZE)
    take_off(aircraft, 30.0)
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (0, 90, 135), 120.0)))
    for _ in range(5000):
        aircraft.step()
        assert aircraft.navigation.state().p == pytest.approx(
            aircraft.vehicle.position_ned(), abs=0.02
        )
    assert aircraft.belief.vel_ned_mps == pytest.approx(aircraft.truth.vel_ned_mps, abs=0.02)


# --- Monte Carlo: many short flights of the whole aircraft with default sensors.


@dataclass
class Errors:
    """Errors and covariances at the horizon, one row a GNSS epoch."""

    e: Vector  # (K, 9): position, velocity, attitude
    P: Vector  # (K, 9, 9)
    now: Vector  # (K, 6): position and velocity error of the state of now
    gnss: Vector  # (K, 3): injected error
    nis: dict[str, list[float]] = field(default_factory=dict)


def observe(seed: int, seconds: float) -> Errors:
    aircraft = make(seed=seed, sensors=SensorsConfig(), wind=WindConfig(speed_mps=4.0))
    navigation = aircraft.navigation
    assert isinstance(navigation, InertialNavigation)
    estimator = navigation.estimator
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -25.0]), 0.0)
    run(aircraft, 12.0)
    turns = tuple(np.random.default_rng(seed).uniform(-140, 140, 60))
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, turns, 80.0)))
    past: dict[int, tuple[Triple, Triple, Quaternion]] = {}
    rows: list[tuple[Vector, Vector, Vector, Vector]] = []
    nis: dict[str, list[float]] = defaultdict(list)
    estimator.innovations.clear()
    vehicle = aircraft.vehicle
    for tick in range(round(seconds * 250)):
        aircraft.step()
        if tick % 5 != 4:
            continue
        past[aircraft.t_ns] = vehicle.position_ned(), vehicle.velocity_ned(), vehicle.attitude()
        h = estimator.horizon
        if aircraft.t_ns % 200_000_000 != 120_000_000 or h.t_ns not in past:
            continue
        p, v, q = past[h.t_ns]
        e = [*np.subtract(p, h.p), *np.subtract(v, h.v), *rotation_error(q, h.q)]
        belief, truth = estimator.now, past[aircraft.t_ns]
        now = [*np.subtract(truth[0], belief.p), *np.subtract(truth[1], belief.v)]
        covariance = estimator._kf.P[:9, :9].copy()
        wander = np.array(navigation.sensors.receiver.error_ned_m)
        rows.append((np.array(e), covariance, np.array(now), wander))
        for innovation in estimator.innovations:
            assert innovation.accepted or innovation.nis < 40
            nis[innovation.kind].append(innovation.nis / len(innovation.values))
        estimator.innovations.clear()
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Errors(columns[0], columns[1], columns[2], columns[3], nis=nis)


def chi_square(dof: int) -> Vector:
    """The middle 95 % of the distribution with so many degrees of freedom: from, to."""
    return np.asarray(2.0 * gammaincinv(dof / 2.0, [0.025, 0.975]))


@pytest.fixture(scope="module")
def flights() -> list[Errors]:
    return [observe(seed, 26.0) for seed in range(20)]


@pytest.mark.slow
def test_the_filter_knows_how_wrong_it_is(flights: list[Errors]) -> None:
    """Mean NEES over the seeds, at instants far apart, in its two-sided 95 % band."""
    for part, dof in ((slice(0, 9), 9), (slice(3, 6), 3), (slice(6, 9), 3)):
        nees = np.array(
            [
                [
                    e[part] @ np.linalg.solve(P[part, part], e[part])
                    for e, P in zip(f.e, f.P, strict=True)
                ]
                for f in flights
            ]
        )
        runs = len(flights)
        low, high = chi_square(dof * runs) / runs
        inside = [low <= mean <= high for mean in nees.mean(axis=0)[::10]]
        # One instant in twenty lies outside by chance.
        assert np.mean(inside) >= 0.80, (part, nees.mean(axis=0)[::10].round(1), low, high)
        assert nees.mean() == pytest.approx(dof, rel=0.25)


@pytest.mark.slow
def test_innovations_are_as_large_as_expected(flights: list[Errors]) -> None:
    """Normalised innovations of one kind are nearly independent: their mean is one."""
    for kind, dof in (("gnss position", 3), ("gnss velocity", 3), ("baro", 1), ("heading", 1)):
        values = np.concatenate([f.nis[kind] for f in flights])
        low, high = chi_square(dof * len(values)) / (dof * len(values))
        # Early in a flight linearisation at a degree of tilt shows: a little room beside the band.
        assert low - 0.03 <= values.mean() <= high + 0.03, kind


@pytest.mark.slow
def test_default_sensors_give_the_accuracy_promised(flights: list[Errors]) -> None:
    now = np.concatenate([f.now for f in flights])
    gnss = np.concatenate([f.gnss for f in flights])
    rms = np.sqrt(np.mean(now**2, axis=0))
    assert np.max(rms[3:]) <= 0.05  # each axis
    assert rms[2] <= 0.15
    injected = np.sqrt(np.mean(gnss[:, :2] ** 2))
    assert np.sqrt(np.mean(now[:, :2] ** 2)) <= 1.2 * injected


# --- Failures of sensors in flight.


def cruise(seed: int = 2) -> Aircraft:
    aircraft = make(seed=seed, sensors=SensorsConfig(), wind=BREEZE)
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -25.0]), 0.0)
    run(aircraft, 12.0)
    turns = tuple(np.random.default_rng(seed).uniform(-140, 140, 60))
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, turns, 80.0)))
    run(aircraft, 15.0)
    return aircraft


def worst_error(aircraft: Aircraft, seconds: float) -> tuple[float, float]:
    """Largest horizontal and velocity error over some time."""
    position = velocity = 0.0
    for _ in range(round(seconds * 10)):
        run(aircraft, 0.1)
        belief, truth = aircraft.belief, aircraft.truth
        position = max(position, math.dist(belief.pos_ned_m[:2], truth.pos_ned_m[:2]))
        velocity = max(velocity, math.dist(belief.vel_ned_mps, truth.vel_ned_mps))
    return position, velocity


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_ten_seconds_without_gnss_are_bridged(seed: int) -> None:
    aircraft = cruise(seed)
    aircraft.inject(GnssOff(duration_s=10.0))
    run(aircraft, 2.0)
    assert aircraft.why_not_ready == "no GNSS"
    position, velocity = worst_error(aircraft, 8.0)
    assert position < 4.0
    assert velocity < 0.6
    run(aircraft, 5.0)
    assert aircraft.ready
    position, velocity = worst_error(aircraft, 10.0)
    assert position < 2.0
    assert velocity < 0.25


def test_gnss_is_lost_a_second_and_a_half_after_what_was_believed_last() -> None:
    aircraft = make(sensors=SensorsConfig())
    run(aircraft, 0.5)
    aircraft.inject(GnssOff(duration_s=10.0))
    assert isinstance(aircraft.navigation, InertialNavigation)
    fused_ns = aircraft.navigation.estimator.fused_ns
    assert run(aircraft, 3.0, until=lambda: aircraft.why_not_ready == "no GNSS")
    assert aircraft.t_ns - fused_ns["gnss position"] == 1_500_000_000


def test_a_jump_of_fifty_metres_is_not_believed() -> None:
    aircraft = cruise()
    aircraft.inject(GnssJump(north_m=30.0, east_m=-40.0, duration_s=10.0))
    position, velocity = worst_error(aircraft, 10.0)
    assert position < 2.5
    assert velocity < 0.25
    assert aircraft.why_not_ready == "no GNSS"
    run(aircraft, 2.0)
    assert aircraft.ready
    assert worst_error(aircraft, 5.0)[0] < 2.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [ImuBias(gyro_radps=(0.01, -0.01, 0.01)), ImuBias(accel_mps2=(0.5, -0.3, 0.3))],
    ids=["gyroscope", "accelerometer"],
)
def test_an_imu_that_changes_its_bias_is_found_out(fault: ImuBias) -> None:
    aircraft = cruise()
    navigation = aircraft.navigation
    assert isinstance(navigation, InertialNavigation)
    before = navigation.estimator.biases
    aircraft.inject(fault)
    position, velocity = worst_error(aircraft, 12.0)
    assert position < 4.0
    assert velocity < 1.5
    position, velocity = worst_error(aircraft, 20.0)
    assert position < 2.5
    assert velocity < 0.3
    after = navigation.estimator.biases
    assert np.subtract(after.gyro, before.gyro) == pytest.approx(fault.gyro_radps, abs=3e-3)
    assert np.subtract(after.accel, before.accel) == pytest.approx(fault.accel_mps2, abs=0.15)


@pytest.mark.slow
def test_height_stays_right_far_from_home() -> None:
    """At 3 km the ground has fallen 0.7 m below the plane that touches it at home."""
    aircraft = make(seed=2, sensors=SensorsConfig(), wind=BREEZE)
    take_off(aircraft, 40.0)
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (20.0,), 3000.0)))
    assert run(aircraft, 200.0, lambda: aircraft.progress.finished)
    errors = []
    for _ in range(100):
        run(aircraft, 0.2)
        errors.append(aircraft.belief.pos_ned_m[2] - aircraft.truth.pos_ned_m[2])
    assert abs(np.mean(errors)) < 0.25
    point = aircraft.frame.to_geodetic(aircraft.truth.pos_ned_m)
    assert point.alt_msl_m == pytest.approx(488.0 + 40.0 + 3000.0**2 / 2 / 6.371e6, abs=0.4)
