"""Falls that end in a wreck at rest, and landings and hops that do not."""

import math

import numpy as np
import pytest
from flights import BREEZE, PERFECT, legs, make, path_along, run, take_off

from flightdyn.aircraft import Aircraft
from flightdyn.config import SensorsConfig, WindConfig
from flightdyn.faults import GnssOff, MotorLoss, WindBurst
from flightdyn.frames import normal_gravity, rotation_matrix

REALISTIC = SensorsConfig()


def cut_off(
    height_m: float, speed_mps: float, *, sensors: SensorsConfig, wind: WindConfig | None = None
) -> Aircraft:
    """An aircraft whose motors have been cut at that height and speed, northwards."""
    aircraft = make(sensors=sensors, wind=wind)
    take_off(aircraft, height_m)
    if speed_mps:
        aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (0.0,)), speed_mps))
        run(aircraft, speed_mps / 5 + 2)
        assert aircraft.truth.vel_ned_mps[0] == pytest.approx(speed_mps, abs=1)
    aircraft.disarm()
    return aircraft


def check_wreck(aircraft: Aircraft) -> None:
    """At rest on the ground, for good, and nothing is not a number."""
    assert aircraft.crashed
    assert not aircraft.armed
    assert aircraft.on_ground
    assert aircraft.why_not_ready == "crashed"
    before = aircraft.truth
    assert not before.vel_ned_mps.any()
    assert not before.omega_frd_radps.any()
    assert abs(before.pos_ned_m[2]) < 0.35
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -10.0]), 0.0)
    run(aircraft, 3.0)
    after = aircraft.truth
    assert not aircraft.armed
    assert np.array_equal(before.pos_ned_m, after.pos_ned_m)
    assert np.array_equal(before.q_frd_to_ned, after.q_frd_to_ned)
    assert max(aircraft.vehicle.rotor_speeds_radps()) == 0
    assert aircraft.battery.current_a == 0
    belief = aircraft.belief
    for values in (belief.pos_ned_m, belief.vel_ned_mps, belief.q_frd_to_ned):
        assert np.isfinite(values).all()


@pytest.mark.parametrize("speed_mps", [0.0, 10.0, 20.0])
@pytest.mark.parametrize("height_m", [3.0, 10.0, 30.0, 100.0])
def test_motors_cut_end_in_a_wreck(height_m: float, speed_mps: float) -> None:
    aircraft = cut_off(height_m, speed_mps, sensors=PERFECT)
    cut = aircraft.truth
    assert run(aircraft, 12.0, lambda: aircraft.crashed)
    fallen_s = (aircraft.t_ns - cut.t_ns) * 1e-9
    impact_mps = aircraft.impact_mps
    assert impact_mps is not None
    drop_m = cut.alt_rel_m
    # Faster than without air it cannot be, and the air takes nothing worth naming off 3 m.
    free_s = math.sqrt(2 * drop_m / 9.81)
    assert free_s - 0.05 < fallen_s < 1.7 * free_s
    speed = math.hypot(speed_mps, math.sqrt(2 * 9.81 * drop_m))
    assert 4 < impact_mps < 1.1 * speed + 2
    if drop_m < 5 and not speed_mps:
        assert impact_mps == pytest.approx(speed, rel=0.03)
    check_wreck(aircraft)


@pytest.mark.parametrize(("height_m", "speed_mps"), [(3.0, 20.0), (30.0, 0.0), (100.0, 20.0)])
def test_so_do_flights_on_the_estimate_in_wind(height_m: float, speed_mps: float) -> None:
    aircraft = cut_off(height_m, speed_mps, sensors=REALISTIC, wind=BREEZE)
    assert run(aircraft, 12.0, lambda: aircraft.crashed)
    check_wreck(aircraft)
    # The accelerometers felt the blow, so that the estimate stops where the aircraft did.
    assert np.linalg.norm(aircraft.belief.vel_ned_mps) < 1.0
    assert math.dist(aircraft.belief.pos_ned_m, aircraft.truth.pos_ned_m) < 5


@pytest.mark.parametrize("motor", range(4))
def test_a_lost_motor_ends_in_a_wreck(motor: int) -> None:
    aircraft = make(sensors=REALISTIC, seed=motor)
    take_off(aircraft, 30.0)
    aircraft.inject(MotorLoss(motor=motor))
    run(aircraft, 5.0)
    aircraft.inject(MotorLoss(motor=(motor + 2) % 4))
    assert run(aircraft, 30.0, lambda: aircraft.crashed)
    check_wreck(aircraft)


def test_a_small_drop_is_survived_and_flown_on_from() -> None:
    aircraft = make()
    take_off(aircraft, 0.6)  # sqrt(2 g h) = 3.4 m/s
    aircraft.disarm()
    run(aircraft, 3.0)
    assert not aircraft.crashed
    assert aircraft.truth.pos_ned_m == pytest.approx([0, 0, 0], abs=0.1)
    take_off(aircraft, 5.0)
    assert aircraft.truth.alt_rel_m == pytest.approx(5.0, abs=0.2)


def test_faults_end_one_by_one_and_leave_the_others_their_time() -> None:
    aircraft = make(sensors=REALISTIC)
    outage, burst = GnssOff(duration_s=4.0), WindBurst(east_mps=3.0)
    aircraft.inject(outage)
    aircraft.inject(burst)
    run(aircraft, 2.0)
    aircraft.faults.end(burst)
    assert aircraft.faults.active == (outage,)
    assert aircraft.vehicle.wind_ned() != (0, 3, 0)
    run(aircraft, 1.9)
    assert aircraft.faults.active == (outage,)
    run(aircraft, 0.3)  # four seconds since it began, not since the other one ended
    assert aircraft.faults.active == ()
    aircraft.faults.end(outage)
    assert aircraft.faults.active == ()


def test_the_accelerometers_feel_the_blow_and_then_rest() -> None:
    """All of the velocity is taken in one tick; what lies as it fell is pushed up by the ground."""
    aircraft = make(sensors=PERFECT)
    vehicle = aircraft.vehicle
    take_off(aircraft, 20.0)
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (40.0,)), 12.0))
    run(aircraft, 1.5)  # it leans, moves and climbs no more
    before, force = vehicle.kinematics(0), np.array(vehicle.specific_force())
    body = np.array(rotation_matrix(vehicle.attitude())).reshape(3, 3)
    assert np.abs(before.vel_ned_mps[:2]).min() > 2.0
    vehicle.wreck()
    blow = force - body.T @ before.vel_ned_mps / 0.004
    assert vehicle.specific_force() == pytest.approx(blow.tolist(), rel=1e-9)
    assert vehicle.imu.read() == pytest.approx([0.0, 0.0, 0.0, *blow.tolist()], rel=1e-9)
    assert vehicle.run()
    up = body.T @ [0.0, 0.0, -normal_gravity(47.0, 0.0)]
    for _ in range(3):
        assert vehicle.specific_force() == pytest.approx(up.tolist(), rel=1e-9)
        assert vehicle.imu.read() == pytest.approx([0.0, 0.0, 0.0, *up.tolist()], rel=1e-9)
        assert vehicle.run()
    after = vehicle.kinematics(0)
    assert after.pos_ned_m == pytest.approx(before.pos_ned_m, rel=1e-12)
    assert after.q_frd_to_ned == pytest.approx(before.q_frd_to_ned, rel=1e-12)
    assert not after.vel_ned_mps.any()
    assert not after.omega_frd_radps.any()
    assert (vehicle.electrical_power_w(), max(vehicle.rotor_thrusts_n())) == (0.0, 0.0)
