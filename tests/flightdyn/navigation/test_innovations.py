"""What the estimator tells about its measurements."""

import numpy as np
import pytest
from flights import PERFECT, make, run

from flightdyn.config import SensorsConfig, WindConfig
from flightdyn.faults import GnssJump
from flightdyn.navigation.inertial_navigation import InertialNavigation


def test_every_sensor_is_told_of_once_in_order_of_time() -> None:
    aircraft = make(seed=3, sensors=SensorsConfig())
    run(aircraft, 2.0)
    first = aircraft.innovations_after(0)
    assert {item.kind for item in first} == {"gnss position", "gnss velocity", "baro", "heading"}
    instants = [item.t_ns for item in first]
    assert instants == sorted(instants)
    assert 0 < instants[0] < instants[-1] <= 2_000_000_000
    assert aircraft.innovations_after(instants[-1]) == ()
    run(aircraft, 1.0)
    later = aircraft.innovations_after(instants[-1])
    assert min(item.t_ns for item in later) > instants[-1]
    assert aircraft.innovations_after(0) == first + later


def test_size_against_expectation() -> None:
    aircraft = make(seed=4, sensors=SensorsConfig())
    run(aircraft, 3.0)
    told = aircraft.innovations_after(0)
    assert [item.kind for item in told].count("gnss position") == 15  # five a second
    assert len(told) > 3 * 15
    for item in told:
        assert len(item.values) == len(item.stds)
        assert item.accepted
        assert 0.0 <= item.ratio < 1.0
        if len(item.values) == 1:
            assert item.nis == pytest.approx((item.values[0] / item.stds[0]) ** 2, rel=1e-9)
        # Whatever the correlation, no axis may be farther out than all together.
        worst = np.max(np.abs(np.divide(item.values, item.stds)))
        assert worst**2 <= item.nis * (1 + 1e-9)


def test_a_jump_of_the_receiver_is_shown_as_refused() -> None:
    aircraft = make(seed=5, sensors=SensorsConfig())
    run(aircraft, 2.0)
    aircraft.inject(GnssJump(north_m=40.0))
    seen_ns = aircraft.innovations_after(0)[-1].t_ns
    run(aircraft, 1.0)
    refused = [item for item in aircraft.innovations_after(seen_ns) if not item.accepted]
    assert {item.kind for item in refused} == {"gnss position"}
    for item in refused:
        assert item.ratio > 1.0
        assert item.values[0] == pytest.approx(40.0, abs=3.0)


def test_rates_and_forces_are_told_without_their_biases() -> None:
    aircraft = make(seed=3, sensors=SensorsConfig())
    navigation = aircraft.navigation
    assert isinstance(navigation, InertialNavigation)
    for _ in range(7):  # between guidance steps as well as at them
        run(aircraft, 0.004)
        biases, imu = navigation.estimator.biases, navigation.sensors.imu
        rates = np.subtract(imu.rates, biases.gyro)
        assert aircraft.belief.omega_frd_radps.tolist() == pytest.approx(rates.tolist(), rel=1e-12)
        readings = navigation.readings()
        assert readings.rates_radps == pytest.approx(rates.tolist(), rel=1e-12)
        if samples := navigation._loop.taken:
            force = np.subtract(samples[-3:], biases.accel)
            assert readings.specific_force_mps2 == pytest.approx(force.tolist(), rel=1e-12)
        assert readings.pressure_pa == navigation.sensors.pressure.pressure_pa  # type: ignore[union-attr]  # aligned by it


def test_without_an_estimator_there_is_none() -> None:
    aircraft = make(sensors=PERFECT)
    run(aircraft, 1.0)
    assert aircraft.innovations_after(0) == ()


def test_steady_wind_at_the_aircraft() -> None:
    aircraft = make(wind=WindConfig(speed_mps=6.0, from_deg=270.0))
    run(aircraft, 0.5)
    np.testing.assert_allclose(aircraft.wind_ned_mps, (0.0, 6.0, 0.0), atol=1e-6)
