"""Sensor models: magnitudes, correlation, delay, independence of the flight."""

import math
from unittest.mock import Mock

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from flightdyn.clock import SimClock
from flightdyn.config import (
    AircraftConfig,
    BaroConfig,
    GnssConfig,
    ImuConfig,
    MagConfig,
    SensorsConfig,
)
from flightdyn.frames import quaternion_from_euler
from flightdyn.native.ticks import Gauges
from flightdyn.physics.sensors import Baro, Gnss, ImuErrors, Magnetometer, SensorSuite
from flightdyn.random import RandomStreams

ORIGIN = (0.0, 0.0, 0.0)


def imu_rows(config: ImuConfig, seconds: float, seed: int = 1) -> np.ndarray:
    errors = ImuErrors(config, RandomStreams(seed), dt_s=0.004)
    return np.concatenate([errors.draw() for _ in range(round(seconds))])


def test_white_noise_has_the_density_asked_for() -> None:
    config = ImuConfig(gyro_turn_on_radps=0, accel_turn_on_mps2=0, gyro_random_walk=0)
    config = config.model_copy(update={"accel_random_walk": 0.0})
    rows = imu_rows(config, 200.0)
    # Averaged over one second, white noise of density n has the standard deviation n.
    seconds = rows.reshape(200, 250, 6).mean(axis=1)
    assert seconds[:, :3].std() == pytest.approx(1.87e-4, rel=0.1)
    assert seconds[:, 3:].std() == pytest.approx(1.86e-3, rel=0.1)
    assert rows[:, :3].std() == pytest.approx(1.87e-4 * math.sqrt(250), rel=0.01)


@pytest.mark.slow
def test_bias_walks_with_the_square_root_of_time() -> None:
    config = ImuConfig(
        gyro_noise_density=0, accel_noise_density=0, gyro_turn_on_radps=0, accel_turn_on_mps2=0
    )
    ends = np.array([imu_rows(config, 25.0, seed)[-1] for seed in range(60)])
    assert ends[:, :3].std() == pytest.approx(3.88e-5 * 5, rel=0.12)
    assert ends[:, 3:].std() == pytest.approx(6e-3 * 5, rel=0.12)


def test_a_bias_walks_on_where_the_last_second_left_it() -> None:
    config = ImuConfig(
        gyro_noise_density=0, accel_noise_density=0, gyro_random_walk=1e-5, accel_random_walk=1e-3
    )
    errors = ImuErrors(config, RandomStreams(2), dt_s=0.004)
    before = errors.bias.copy()
    for _ in range(5):
        drawn = errors.draw()
        assert drawn.shape == (250, 6)
        steps = np.diff(np.vstack((before, drawn)), axis=0)
        assert steps.std(axis=0) == pytest.approx(
            math.sqrt(0.004) * np.array([1e-5] * 3 + [1e-3] * 3), rel=0.2
        )
        assert (abs(steps[0]) < 5 * steps.std(axis=0)).all()
        assert (steps[0] != steps[1]).all()
        before = errors.bias.copy()
        assert np.array_equal(before, drawn[-1])


def test_turn_on_bias_differs_from_flight_to_flight() -> None:
    biases = np.array(
        [ImuErrors(ImuConfig(), RandomStreams(s), dt_s=0.004).bias for s in range(300)]
    )
    assert biases[:, :3].std() == pytest.approx(0.0087, rel=0.1)
    assert biases[:, 3:].std() == pytest.approx(0.196, rel=0.1)


def test_gnss_position_error_is_correlated_and_its_velocity_error_white() -> None:
    config = GnssConfig()
    gnss = Gnss(config, RandomStreams(3))
    position, velocity = [], []
    for k in range(40_000):
        t_ns = k * 200_000_000
        gnss.measure(t_ns, ORIGIN, ORIGIN)
        fix = gnss.deliver(t_ns + 120_000_000)
        assert fix is not None
        position.append(fix.pos_ned_m)
        velocity.append(fix.vel_ned_mps)
    p, v = np.array(position), np.array(velocity)
    assert p.std(axis=0) == pytest.approx([0.7, 0.7, 1.97], rel=0.1)
    # Autocorrelation after 12 s: 1/e; after one solution: nearly one.
    lag = 60
    for axis in range(3):
        c = np.mean(p[lag:, axis] * p[:-lag, axis]) / p[:, axis].var()
        assert c == pytest.approx(math.exp(-1), abs=0.08)
    assert v.std(axis=0) == pytest.approx([0.09, 0.09, 0.18], rel=0.03)
    assert abs(np.mean(v[1:] * v[:-1])) < 0.001


def test_gnss_solutions_arrive_after_their_delay_and_in_order() -> None:
    gnss = Gnss(GnssConfig(delay_s=0.3, interval_s=0.2), RandomStreams(1))
    arrived = []
    for tick in range(500):
        t_ns = tick * 4_000_000
        if tick % 50 == 0:
            gnss.measure(t_ns, (float(tick), 0.0, 0.0), ORIGIN)
        fix = gnss.deliver(t_ns)
        if fix is not None:
            arrived.append((fix.t_ns, t_ns - fix.t_ns))
    assert [epoch for epoch, _ in arrived] == [k * 200_000_000 for k in range(len(arrived))]
    assert {age for _, age in arrived} == {300_000_000}


def test_a_solution_without_noise_is_the_truth_and_says_how_sure_it_is() -> None:
    exact = dict.fromkeys(("std_horizontal_m", "std_vertical_m", "white_m"), 0.0)
    exact |= dict.fromkeys(("std_vel_horizontal_mps", "std_vel_vertical_mps"), 0.0)
    gnss = Gnss(GnssConfig(**exact, delay_s=0.1, satellites=9), RandomStreams(1))
    assert gnss.due_ns == math.inf
    gnss.jump_ned_m = (10.0, -20.0, 30.0)
    gnss.measure(5_000, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    gnss.on = False
    gnss.measure(6_000, ORIGIN, ORIGIN)
    assert gnss.due_ns == 100_005_000
    assert gnss.deliver(100_004_999) is None
    fix = gnss.deliver(100_005_000)
    assert fix is not None
    assert (fix.t_ns, fix.satellites) == (5_000, 9)
    assert fix.pos_ned_m.tolist() == [11.0, -18.0, 33.0]
    assert fix.vel_ned_mps.tolist() == [4.0, 5.0, 6.0]
    assert gnss.error_ned_m == (10.0, -20.0, 30.0)
    assert (gnss.due_ns, gnss.deliver(10**12)) == (math.inf, None)
    noisy = Gnss(
        GnssConfig(std_horizontal_m=0.6, std_vertical_m=1.5, white_m=0.8,
                   std_vel_horizontal_mps=0.2), RandomStreams(1),
    )  # fmt: skip
    noisy.measure(0, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    fix = noisy.deliver(10**9)
    assert fix is not None
    for told, true, off in (
        (fix.pos_ned_m, (1.0, 2.0, 3.0), noisy.error_ned_m),
        (fix.vel_ned_mps, (4.0, 5.0, 6.0), noisy.velocity_error_ned_mps),
    ):
        assert 0.0 not in off
        assert told.tolist() == pytest.approx(np.add(true, off).tolist())
    stds = fix.std_horizontal_m, fix.std_vertical_m, fix.std_velocity_mps
    assert stds == pytest.approx((1.0, 1.7, 0.2))


def test_white_errors_of_a_receiver_are_of_each_axis_alone() -> None:
    config = GnssConfig(
        std_horizontal_m=0, std_vertical_m=0, white_m=0.5, std_vel_horizontal_mps=0.1,
        std_vel_vertical_mps=0.3,
    )  # fmt: skip
    gnss, rows = Gnss(config, RandomStreams(2)), []
    for k in range(3000):
        gnss.measure(k, ORIGIN, ORIGIN)
        rows.append([*gnss.error_ned_m, *gnss.velocity_error_ned_mps])
    errors = np.array(rows)
    assert errors.std(axis=0) == pytest.approx([0.5, 0.5, 0.5, 0.1, 0.1, 0.3], rel=0.05)
    assert abs(errors.mean(axis=0) / errors.std(axis=0)).max() < 0.08
    assert abs(np.corrcoef(errors.T)[np.triu_indices(6, 1)]).max() < 0.08
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 0.08


@pytest.mark.parametrize("baro", [True, False])
def test_each_sensor_is_read_at_its_own_ticks(baro: bool) -> None:
    """At 250 Hz: receiver every 100, barometer every 30, magnetometer every 75 ticks."""
    config = SensorsConfig(
        gnss=GnssConfig(interval_s=0.4, delay_s=0.0), baro=BaroConfig(interval_s=0.12),
        mag=MagConfig(interval_s=0.3),
    )  # fmt: skip
    clock, vehicle = SimClock(250), Mock()
    vehicle.position_ned.return_value = vehicle.velocity_ned.return_value = (1.0, 2.0, 3.0)
    vehicle.attitude.return_value, vehicle.pressure_pa.return_value = (1.0, 0.0, 0.0, 0.0), 9e4
    vehicle.imu = Gauges([(lambda: 0.0, 0.0, 1.0)] * 6)
    suite = SensorSuite(config, vehicle, clock, RandomStreams(1))
    assert (suite.due, suite.field, suite.pressure) == (0, None, None)
    every = (100, 75, 30) if baro else (100, 75)
    for tick in range(700):
        clock.tick = tick
        pressure, field = suite.slow(baro=baro)
        assert (field is not None) == (tick % 75 == 0)
        assert (pressure is not None) == (baro and tick % 30 == 0)
        assert (suite.fix() is not None) == (tick % 100 == 0)
        assert suite.due == min((tick // n + 1) * n for n in every)
        for sample in (pressure, field):
            assert sample is None or sample.t_ns == tick * 4_000_000
    assert suite.field is not None
    assert suite.field.t_ns == 675 * 4_000_000
    felt = suite.feel_pressure(7, 8e4)
    assert suite.pressure is felt
    assert (felt.t_ns, felt.pressure_pa) == (7, pytest.approx(8e4, abs=10.0))


def test_an_outage_does_not_change_later_noise() -> None:
    plain, broken = (Gnss(GnssConfig(), RandomStreams(5)) for _ in range(2))
    for k in range(100):
        broken.on = not 20 <= k < 60
        plain.measure(k, ORIGIN, ORIGIN)
        broken.measure(k, ORIGIN, ORIGIN)
    assert np.array_equal(plain.error_ned_m, broken.error_ned_m)


def test_barometer_noise_is_one_pascal_and_drifts() -> None:
    baro = Baro(BaroConfig(drift_pa=0), RandomStreams(1))
    samples = np.array([baro.measure(k, 1e5).pressure_pa for k in range(5000)])
    assert samples.std() == pytest.approx(1.0, rel=0.05)
    drifts = [Baro(BaroConfig(white_pa=0), RandomStreams(s)).measure(0, 0.0) for s in range(300)]
    assert np.std([d.pressure_pa for d in drifts]) == pytest.approx(1.2, rel=0.12)


def test_magnetometer_turns_the_field_into_the_body() -> None:
    config = MagConfig(white_gauss=0, hard_iron_gauss=0)
    sample = Magnetometer(config, RandomStreams(1)).measure(7, quaternion_from_euler(0.2, -0.3, 2))
    field = np.array([config.field_north_gauss, config.field_east_gauss, config.field_down_gauss])
    expected = Rotation.from_euler("ZYX", [2, -0.3, 0.2]).inv().apply(field)
    assert sample.field_frd_gauss == pytest.approx(tuple(expected), abs=1e-12)
    assert sample.t_ns == 7


def test_the_magnetometer_keeps_an_offset_and_adds_white_noise() -> None:
    """Of three axes each, about a field along the first of 0.2 gauss."""
    level, field = (1.0, 0.0, 0.0, 0.0), np.array([0.2, 0.0, 0.0])
    fields = {"field_north_gauss": 0.2, "field_east_gauss": 0.0, "field_down_gauss": 0.0}
    kept = MagConfig(white_gauss=0, hard_iron_gauss=0.01, **fields)
    magnetometers = [Magnetometer(kept, RandomStreams(seed)) for seed in range(300)]
    first, second = (
        np.array([each.measure(t_ns, level).field_frd_gauss for each in magnetometers]) - field
        for t_ns in (0, 9)
    )
    assert (first == second).all()
    assert first.std(axis=0) == pytest.approx([0.01] * 3, rel=0.15)
    assert abs(np.corrcoef(first.T)[np.triu_indices(3, 1)]).max() < 0.2
    noisy = Magnetometer(MagConfig(white_gauss=0.02, hard_iron_gauss=0, **fields), RandomStreams(1))
    white = np.array([noisy.measure(k, level).field_frd_gauss for k in range(2000)]) - field
    assert white.std(axis=0) == pytest.approx([0.02] * 3, rel=0.06)
    assert abs(np.corrcoef(white.T)[np.triu_indices(3, 1)]).max() < 0.1
    assert abs(np.corrcoef(white[1:, 0], white[:-1, 0])[0, 1]) < 0.1


def test_the_field_at_home_is_central_europes() -> None:
    """Of WMM2025 at 47.4 degrees north, 8.5 degrees east, rounded: 48 400 nT, which
    dips by 63 degrees and points 3.4 degrees east of true north."""
    field = MagConfig()
    north, east, down = field.field_north_gauss, field.field_east_gauss, field.field_down_gauss
    assert math.hypot(north, east, down) == pytest.approx(0.484, abs=0.01)
    assert math.degrees(math.atan2(down, math.hypot(north, east))) == pytest.approx(63.3, abs=1.0)
    assert math.degrees(math.atan2(east, north)) == pytest.approx(3.4, abs=0.5)


def test_sensors_draw_from_streams_of_their_own() -> None:
    """Noise of one sensor is the same whether or not another one is asked."""
    alone = imu_rows(ImuConfig(), 1.0, 9)
    streams = RandomStreams(9)
    Gnss(GnssConfig(), streams).measure(0, ORIGIN, ORIGIN)
    assert np.array_equal(alone, ImuErrors(ImuConfig(), streams, dt_s=0.004).draw())


@pytest.mark.parametrize(
    ("data", "path"),
    [
        ({"sensors": {"gnss": {"delay_s": -1}}}, ("sensors", "gnss", "delay_s")),
        ({"wind": {"speed": 3}}, ("wind", "speed")),
        ({"sensors": {"kind": "magic"}}, ("sensors", "kind")),
        ({"faults": [{"kind": "motor_loss", "motor": 7}]}, ("faults", 0, "motor_loss", "motor")),
    ],
)
def test_configuration_names_what_is_wrong(data: dict[str, object], path: tuple[str, ...]) -> None:
    with pytest.raises(ValidationError) as error:
        AircraftConfig.model_validate(data)
    assert error.value.errors()[0]["loc"] == path


def test_configuration_survives_a_round_trip() -> None:
    config = AircraftConfig.model_validate(
        {"sensors": SensorsConfig(kind="perfect"), "faults": [{"kind": "gnss_off", "at_s": 3}]}
    )
    assert AircraftConfig.model_validate_json(config.model_dump_json()) == config


def test_an_upright_field_tells_no_heading() -> None:
    with pytest.raises(ValidationError, match="tells no heading"):
        MagConfig(field_north_gauss=0.0, field_east_gauss=0.0)
