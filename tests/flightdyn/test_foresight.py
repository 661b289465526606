"""What is foreseen of a path is what the aircraft flies: time, energy, and bounds on both."""

import math

import numpy as np
import pytest
from flights import HOME, legs, make, path_along, run, take_off

from flightdyn.config import LimitsConfig, WindConfig
from flightdyn.foresight import SETTLING_S, least_duration, least_energy, longest_within
from flightdyn.guidance.path import FlightPath, passing_times, plan_path
from flightdyn.physics.air import steady_wind_ned
from flightdyn.physics.power import density_ratio, least_power_w, power_w
from mission.planner.performance import Foreseen, Performance

LIMITS = LimitsConfig()
HEIGHT_M = 40.0


def random_path(seed: int, *, speed_mps: float = 20.0, acceptance_m: float = 5.0) -> FlightPath:
    """Up to nine legs of 3 to 250 m, level."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 10))
    steps = rng.uniform(3, 250, count)[:, None] * unit(rng.uniform(0, 2 * np.pi, count))
    points = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    level = np.column_stack((points, np.full(count + 1, -HEIGHT_M)))
    return path_along(level, speed_mps=speed_mps, acceptance_m=acceptance_m)


def foresee(path: FlightPath, *, density: float = 1.0, wind_mps=(0.0, 0.0, 0.0)) -> Foreseen:
    """What planning foresees of a level path at one speed."""
    speed_mps, acceptance_m = float(path.speeds_mps[0]), float(path.acceptance_m[0])
    flying = Performance(speed_mps, acceptance_m, LIMITS, density, tuple(wind_mps[:2]))
    stops_m = path.points_ned_m[:, :2]
    return flying.foresee(stops_m, [0.0] * len(stops_m), acceptance_m)


def unit(angles):
    return np.column_stack((np.cos(angles), np.sin(angles)))


def length(path: FlightPath) -> float:
    return float(np.linalg.norm(np.diff(path.points_ned_m, axis=0), axis=1).sum())


@pytest.mark.parametrize("seed", range(8))
def test_when_points_are_passed_is_known_without_making_a_trajectory(seed: int) -> None:
    path = random_path(seed)
    twice = np.repeat(path.points_ned_m, 1 + seed % 2, axis=0)  # some of them coincide
    path = path_along(twice, speed_mps=20.0, acceptance_m=5.0)
    trajectory, corners = plan_path(path, LIMITS)
    closest_s = [corner.t - trajectory.start_s for corner in corners[1:-1]]
    closest_s.append(trajectory.end_s - trajectory.start_s)
    passed_s, counts = passing_times(path, LIMITS), [corner.passed for corner in corners]
    assert [passed_s[count - 1] for count in counts[1:]] == pytest.approx(closest_s, abs=1e-9)
    assert foresee(path).arrived_s.tolist() == passed_s


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_flown_as_foreseen(seed: int) -> None:
    aircraft, path = make(), random_path(seed)
    take_off(aircraft, HEIGHT_M)
    foreseen = foresee(path, density=density_ratio(HOME.alt_msl_m + HEIGHT_M))
    start_ns = aircraft.t_ns
    passed_s: dict[int, float] = {}
    mah, energy_j = aircraft.battery.consumed_mah, 0.0
    aircraft.follow(path)

    def arrived() -> bool:
        nonlocal mah, energy_j
        battery = aircraft.battery
        energy_j += (battery.consumed_mah - mah) * 3.6 * battery.voltage_v
        mah = battery.consumed_mah
        passed_s.setdefault(aircraft.progress.passed, (aircraft.t_ns - start_ns) / 1e9)
        return aircraft.progress.finished

    assert run(aircraft, 300, arrived)
    flown_s = (aircraft.t_ns - start_ns) / 1e9
    assert foreseen.duration_s == pytest.approx(flown_s, abs=0.4)
    assert foreseen.energy_j == pytest.approx(energy_j, rel=0.02)
    for index in range(1, len(path.points_ned_m) - 1):
        assert foreseen.arrived_s[index] == pytest.approx(passed_s[index + 1], abs=0.3)


@pytest.mark.parametrize("seed", range(60))
def test_nobody_is_faster_than_straight_nor_cheaper(seed: int) -> None:
    speed, acceptance = (8.0, 14.0, 20.0, 22.0)[seed % 4], (1.0, 5.0, 40.0)[seed % 3]
    path = random_path(seed, speed_mps=speed, acceptance_m=acceptance)
    wind = 6.0 * unit(np.array([seed]))[0] * (seed % 5 == 0)
    foreseen, metres = foresee(path, wind_mps=(*wind.tolist(), 0.0)), length(path)
    assert least_duration(metres, speed_mps=speed, limits=LIMITS) <= foreseen.duration_s + 1e-9
    lengths = np.linspace(0.0, metres, 500)
    cut_m = LIMITS.corner_cut * acceptance
    wind_mps = float(np.hypot(*wind))
    for straights in (len(path.points_ned_m) - 1, np.inf):
        joules = least_energy(
            lengths, legs=straights, speed_mps=speed, limits=LIMITS, cut_m=cut_m, wind_mps=wind_mps
        )
        assert joules[-1] <= foreseen.energy_j
        assert (np.diff(joules) > 0.0).all()


def test_accelerating_counts_by_straights() -> None:
    """Zigzags from 3 to 150 m a leg, by any angle: none is cheaper, some are nearly as cheap."""
    rng, nearest = np.random.default_rng(3), np.inf
    for _ in range(200):
        straights, angle = int(rng.integers(1, 20)), rng.uniform(0.0, np.pi)
        course = np.cumsum(angle * rng.choice([-1.0, 1.0], straights))
        steps = np.exp(rng.uniform(1.1, 5.0)) * np.stack([np.cos(course), np.sin(course)], axis=1)
        points = np.vstack([np.zeros(3), np.pad(np.cumsum(steps, axis=0), ((0, 0), (0, 1)))])
        path = FlightPath(points, np.full(straights, 20.0), np.full(straights + 1, 5.0))
        lengths = np.linspace(0.0, length(path), 2000)
        least_j = least_energy(
            lengths, legs=straights, speed_mps=20.0, limits=LIMITS, cut_m=LIMITS.corner_cut * 5.0
        )[-1]
        nearest = min(nearest, foresee(path).energy_j / least_j)
    assert 1.0 <= nearest < 1.1


def test_wind_costs_energy_as_it_is_flown_in() -> None:
    path = random_path(2)
    wind = WindConfig(speed_mps=6.0, from_deg=250.0)
    aircraft = make(wind=wind)
    take_off(aircraft, HEIGHT_M)
    mah, energy_j = aircraft.battery.consumed_mah, 0.0
    aircraft.follow(path)

    def arrived() -> bool:
        nonlocal mah, energy_j
        battery = aircraft.battery
        energy_j += (battery.consumed_mah - mah) * 3.6 * battery.voltage_v
        mah = battery.consumed_mah
        return aircraft.progress.finished

    assert run(aircraft, 300, arrived)
    density = density_ratio(HOME.alt_msl_m + HEIGHT_M)
    blown = foresee(path, density=density, wind_mps=steady_wind_ned(wind))
    still = foresee(path, density=density)
    assert blown.energy_j == pytest.approx(energy_j, rel=0.03)
    assert still.energy_j < 0.97 * energy_j


@pytest.mark.parametrize("metres", [2.0, 30.0, 79.0, 81.0, 500.0])
def test_a_straight_path_takes_the_least(metres: float) -> None:
    straight = path_along(legs(np.zeros(3), (0.0,), metres))
    least_s = least_duration(metres, speed_mps=20.0, limits=LIMITS)
    assert foresee(straight).duration_s == pytest.approx(least_s, abs=1e-6)
    assert longest_within(least_s, speed_mps=20.0, limits=LIMITS) == pytest.approx(metres)


def test_no_path_is_flown_in_less_than_it_takes_to_begin_and_end() -> None:
    assert longest_within(0.5, speed_mps=20.0, limits=LIMITS) == 0.0
    assert least_duration(0.0, speed_mps=20.0, limits=LIMITS) == 0.0


@pytest.mark.parametrize("seed", [3, 5])
def test_joules_are_those_of_the_reference(seed: int) -> None:
    path, wind = random_path(seed), np.array([3.0, -1.0, 0.0])
    trajectory, _ = plan_path(path, LIMITS)
    times = np.linspace(trajectory.start_s, trajectory.end_s, 5000)
    references = [trajectory.at(t) for t in times.tolist()]
    speed = np.linalg.norm([r.v - wind for r in references], axis=1)
    accel = np.linalg.norm([r.a for r in references], axis=1)
    watts = power_w(speed, accel_mps2=accel, density=0.9)
    settled_j = SETTLING_S * power_w(np.linalg.norm([wind], axis=1), density=0.9)[0]
    foreseen = foresee(path, density=0.9, wind_mps=(3.0, -1.0, 0.0))
    assert foreseen.energy_j == pytest.approx(np.trapezoid(watts, times) + settled_j, rel=1e-4)


@pytest.mark.parametrize(
    ("length_m", "speed_mps", "seconds"),
    [
        # 5 m/s2: 16 m to 20 m/s and back, 0.4 s of smoothing and 0.3 s until it stands.
        (80.0, 20.0, 8.7), (180.0, 20.0, 13.7), (20.0, 20.0, 4.7), (20.0, 10.0, 4.7),
        (70.0, 10.0, 9.7), (500.0, 40.0, 25.7),
    ],
)  # fmt: skip
def test_the_least_time_of_a_length_by_hand(
    length_m: float, speed_mps: float, seconds: float
) -> None:
    limits = LimitsConfig(speed_mps=25.0)
    keys = {"speed_mps": speed_mps, "limits": limits}
    assert least_duration(length_m, **keys) == pytest.approx(seconds)  # type: ignore[arg-type]  # by name
    assert longest_within(seconds, **keys) == pytest.approx(length_m)  # type: ignore[arg-type]  # by name
    assert longest_within(seconds - 0.01, **keys) < length_m  # type: ignore[arg-type]  # by name


@pytest.mark.parametrize("legs_count", [np.inf, 3.0])
@pytest.mark.parametrize(("wind_mps", "density"), [(0.0, 1.0), (4.0, 0.9)])
def test_the_least_energy_of_a_length_is_that_of_its_description(
    legs_count: float, wind_mps: float, density: float
) -> None:
    """Speed by speed, without the shortcuts: what a metre takes at the cheapest of what is had."""
    speed, accel, window_s, cut_m = 18.0, 5.0, 0.4, 2.0
    lengths = np.linspace(0.0, 90.0, 46)
    found = least_energy(
        lengths, legs=legs_count, speed_mps=speed, limits=LIMITS, cut_m=cut_m, density=density,
        wind_mps=wind_mps,
    )  # fmt: skip
    speeds = np.linspace(0.0, speed, 2001)

    def level_w(at: np.ndarray) -> np.ndarray:
        slow = np.maximum(0.0, np.abs(at) - wind_mps)
        return least_power_w(slow, density=density)

    apart = accel * window_s / math.sqrt(12.0)
    averaged = ((level_w(speeds + apart) + level_w(speeds - apart)) / 2 - level_w(speeds)).max()
    entered = np.maximum(speeds[:-1], 1e-9)
    # The mean speed of a parabola that is entered at u: of sqrt(1 - s^2 + (s x)^2), x from 0 to 1.
    sine = np.clip(np.sqrt(2 * accel * cut_m) / entered, 1e-9, 1 - 1e-9)
    x = np.linspace(0.0, 1.0, 20_001)
    root = np.sqrt(1.0 - sine[::100, None] ** 2 + (sine[::100, None] * x) ** 2)
    few = entered[::100] * np.trapezoid(root, x, axis=1)
    mean = entered / 2 * (1 + (1 - sine**2) / sine * np.arctanh(sine))
    np.testing.assert_allclose(few, mean[::100], rtol=1e-6, atol=1e-9)
    watts, cruise_w = level_w(mean) - averaged, level_w(speeds[-1:])[0] - averaged
    hover, pushed = power_w(np.zeros(2), accel_mps2=np.array([0.0, accel]), density=density)
    settling_j = power_w(np.array([wind_mps]), density=density)[0] * 0.3

    def joules(added_w: float) -> tuple[list[float], float]:
        per_m = [(w + added_w) / u for w, u in zip(watts, speeds[1:], strict=True)]
        per_m[-1] = min(per_m[-1], cruise_w / speed)
        total, totals = settling_j, [0.0]
        for before, after in zip(lengths[:-1] / 2, lengths[1:] / 2, strict=True):
            had = min(int(np.searchsorted(speeds, math.sqrt(2 * accel * after))), 2000)
            total += 2 * min(per_m[:had]) * (after - before)
            totals.append(total)
        return totals, min(per_m)

    free, _ = joules(0.0)
    if math.isinf(legs_count):
        assert found.tolist() == pytest.approx(free, rel=1e-9)
        return
    paid, cheapest = joules(pushed - hover)
    # Each leg has jumps of 4 a^2, each as many of a sixth of a window.
    spared = legs_count * 4 * window_s / 6 * 2 * (cheapest * speeds[1:] - watts).max()
    expected = [max(a, b - spared) for a, b in zip(free, paid, strict=True)]
    assert found.tolist() == pytest.approx(expected, rel=1e-9)
