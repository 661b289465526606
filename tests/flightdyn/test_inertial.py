"""Strapdown integration against closed forms and against the physics."""

import math

import numpy as np
import pytest
from flights import PERFECT, legs, make, path_along, take_off
from scipy.spatial.transform import Rotation

from flightdyn.config import SensorsConfig
from flightdyn.frames import normal_gravity, rotation_matrix
from flightdyn.inertial import Earth, ImuSample, NavState
from flightdyn.native.library import Increments, Strapdown

DT = 0.004
FLAT = Earth(9.8, 0.0, 0.0)


def carry(state: NavState, samples: list[ImuSample], earth: Earth = FLAT) -> NavState:
    carried = Strapdown(earth, most=1)
    carried.place(state.p, state.v, state.q)
    increments = Increments(1)
    for i in range(0, len(samples), 5):
        increments.add([number for sample in samples[i : i + 5] for number in sample], dt_s=DT)
        carried.carry(increments, 0, 1)
        increments.drop(1)
    return NavState.of(round(len(samples) * DT * 1e9), carried)


def test_constant_rate_turns_by_rate_times_time() -> None:
    rates = np.array([0.7, -1.1, 2.3])
    state = NavState(0, (0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0))
    end = carry(state, [(*rates.tolist(), 0.0, 0.0, 0.0)] * 500)
    w, x, y, z = end.q
    expected = Rotation.from_rotvec(rates * 2.0)
    assert (Rotation.from_quat([x, y, z, w]) * expected.inv()).magnitude() < 1e-10
    assert end.v == pytest.approx((0, 0, 9.8 * 2.0), abs=1e-9)
    assert end.p == pytest.approx((0, 0, 9.8 * 2.0), abs=1e-9)  # g t^2 / 2


def test_coning_motion_does_not_drift() -> None:
    """A cone of half angle 5 deg at 4 Hz: the axis comes back after every turn."""
    half, rate = math.radians(5), math.tau * 4
    # Body rates of classical coning with the drift rate compensated: R(t) known in closed form.
    times = (np.arange(5000) + 0.5) * DT
    samples: list[ImuSample] = [
        (
            -math.sin(half) * rate * math.sin(rate * t),
            math.sin(half) * rate * math.cos(rate * t),
            rate * (1 - math.cos(half)) * -1.0,
            0.0,
            0.0,
            0.0,
        )
        for t in times
    ]

    def closed(t: float) -> Rotation:
        return Rotation.from_rotvec(half * np.array([math.cos(rate * t), math.sin(rate * t), 0.0]))

    start = closed(0.0).as_quat()
    state = NavState(0, (0.0,) * 3, (0.0,) * 3, (start[3], start[0], start[1], start[2]))
    w, x, y, z = carry(state, samples).q
    error = Rotation.from_quat([x, y, z, w]) * closed(20.0).inv()
    # Without the coning term it would be 0.078 rad.
    assert error.magnitude() < 0.005


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.3, 2.0, 6.0])
def test_large_and_small_rotations_are_exact(angle: float) -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3
    carried = Strapdown(FLAT, most=1)
    carried.place((0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0))
    increments = Increments(1)
    increments.add([*(axis * angle / DT).tolist(), 0.0, 0.0, 0.0], dt_s=DT)
    carried.carry(increments, 0, 1)
    expected = [math.cos(angle / 2), *(math.sin(angle / 2) * axis)]
    assert NavState.of(0, carried).q == pytest.approx(expected, abs=1e-14)


def test_increments_that_are_not_there_are_refused() -> None:
    increments, carried = Increments(2), Strapdown(FLAT, most=1)
    with pytest.raises(ValueError, match="5 numbers of samples"):
        increments.add([0.0] * 5, dt_s=DT)
    for _ in range(2):
        increments.add([0.0] * 6, dt_s=DT)
    with pytest.raises(ValueError, match="2 of 2 increments"):
        increments.add([0.0] * 6, dt_s=DT)
    with pytest.raises(ValueError, match="increments 2 to 3 of 2"):
        carried.carry(increments, 2, 1)
    with pytest.raises(ValueError, match="2 increments at once, 1 at most"):
        carried.carry(increments, 0, 2)


def test_sums_and_states_are_those_of_numpy() -> None:
    """Two sums of five samples, with biases and an Earth that turns fast; sculling and coning terms
    as Savage has them."""
    rng, earth, dt = np.random.default_rng(3), Earth(9.7, 0.02, -0.03), 0.01
    for _ in range(20):
        samples = rng.normal(0, (2, 2, 2, 8, 8, 8), (2, 5, 6))
        gyro, accel = rng.normal(0, 0.1, 3), rng.normal(0, 0.5, 3)
        p, v = rng.normal(0, 20, (2, 3))
        body = Rotation.from_rotvec(rng.normal(0, 2, 3))
        x, y, z, w = body.as_quat().tolist()
        carried, increments = Strapdown(earth, most=2), Increments(2)
        carried.place(tuple(p), tuple(v), (w, x, y, z))
        carried.correct(tuple(gyro), tuple(accel))
        for each in samples:
            increments.add(each.ravel().tolist(), dt_s=dt)
        carried.carry(increments, 0, 2)
        gained, downs = np.zeros(3), []
        for each in samples:
            angle, velocity = np.zeros(3), np.zeros(3)
            for rate, force in zip(each[:, :3], each[:, 3:], strict=True):
                velocity += (force + np.cross(angle, force)) * dt
                angle += rate * dt + np.cross(angle, rate * dt) / 2
            velocity -= accel * 5 * dt
            moved = body.apply(velocity)
            gained += moved
            turning = np.array([earth.rate_north_radps, 0.0, earth.rate_down_radps])
            after = v + moved - 2 * np.cross(turning, v) * 5 * dt
            after[2] += earth.gravity_mps2 * 5 * dt
            p, v = p + (v + after) / 2 * 5 * dt, after
            body *= Rotation.from_rotvec(angle - gyro * 5 * dt)
            downs.append(p[2])
        x, y, z, w = (math.copysign(1.0, body.as_quat()[3]) * body.as_quat()).tolist()
        found = NavState.of(0, carried)
        sign = math.copysign(1.0, found.q[0])
        assert found.p == pytest.approx(p.tolist(), abs=1e-10)
        assert found.v == pytest.approx(v.tolist(), abs=1e-10)
        assert [sign * part for part in found.q] == pytest.approx([w, x, y, z], abs=1e-10)
        assert carried.gained == pytest.approx(gained.tolist(), abs=1e-10)
        assert carried.downs(2) == pytest.approx(downs, abs=1e-10)
        assert carried.force == pytest.approx((velocity / (5 * dt)).tolist(), abs=1e-10)


def test_coriolis_turns_right_on_the_northern_half() -> None:
    """Flying north at 47 deg, left free: 2 Omega sin(lat) v to the right."""
    earth = Earth.at(47.0, 0.0)
    hover = (0.0, 0.0, 0.0, 0.0, 0.0, -normal_gravity(47.0, 0.0))
    state = NavState(0, (0.0,) * 3, (20.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    end = carry(state, [hover] * 2500, earth)
    expected = 2 * 7.292115e-5 * math.sin(math.radians(47.0)) * 20.0 * 10.0
    assert end.v[1] == pytest.approx(expected, rel=1e-3)


def test_exact_sensors_carry_the_state_through_a_flight() -> None:
    """A minute of corners at 20 m/s on inertial sensors alone: the physics' own trajectory."""
    aircraft = make(sensors=PERFECT)
    take_off(aircraft, 30.0)
    vehicle = aircraft.vehicle
    t0 = NavState(0, vehicle.position_ned(), vehicle.velocity_ned(), vehicle.attitude())
    samples: list[ImuSample] = []
    rates = vehicle.rates()
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (0, 90, 90, 45, 135), 150.0)))
    for _ in range(15_000):
        aircraft.step()
        samples.append((*rates, *vehicle.specific_force()))  # force and rates of one instant
        rates = vehicle.rates()
    end = carry(t0, samples, Earth.at(47.0, 0.0))
    assert end.v == pytest.approx(vehicle.velocity_ned(), abs=0.03)
    assert end.p == pytest.approx(vehicle.position_ned(), abs=1.0)
    a, b = (np.array(rotation_matrix(q)).reshape(3, 3) for q in (end.q, vehicle.attitude()))
    assert np.linalg.norm(a @ b.T - np.eye(3)) < 1e-4


def test_sub_tick_positions_continue_the_track() -> None:
    """Belief between guidance steps lies on the curve through its neighbours."""
    aircraft = make(sensors=SensorsConfig())
    take_off(aircraft, 20.0)
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (0, 60), 60.0)))
    last = aircraft.navigation.state().p
    worst = 0.0
    for _ in range(2000):
        aircraft.step()
        here = aircraft.navigation.state().p
        moved = math.dist(here, last)
        speed = math.dist((0, 0, 0), tuple(aircraft.belief.vel_ned_mps))
        worst = max(worst, abs(moved - speed * DT))
        last = here
    assert worst < 0.25  # a correction of the filter, never a jump
