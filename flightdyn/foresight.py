"""Lower bounds on time and energy of flights by their length, whatever their corners."""

import math

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.physics.power import least_power_w, power_w
from flightdyn.state import Vector

# From the reference's end until the aircraft stands there: 0.04 to 0.28 s in 56 calm flights, at
# most of many stops 0.02 to 0.04 s, in wind and turbulence too.
SETTLING_S, STOPPING_S = 0.3, 0.05
_SPEEDS = 2000


def least_duration(length_m: float, *, speed_mps: float, limits: LimitsConfig) -> float:
    """Return a lower bound in seconds on the flight time of a path, whatever its corners.

    A corner is cut at the speed with which it is reached, so that along the path nobody is faster
    than on a straight one.
    """
    speed, accel = min(speed_mps, limits.speed_mps), limits.acceleration_mps2
    if length_m <= 0.0:
        return 0.0
    if length_m >= speed * speed / accel:
        moving_s = length_m / speed + speed / accel
    else:
        moving_s = 2.0 * math.sqrt(length_m / accel)
    return moving_s + limits.smoothing_s + SETTLING_S


def longest_within(duration_s: float, *, speed_mps: float, limits: LimitsConfig) -> float:
    """Return a bound (m) on the path length flown in a time: the inverse of `least_duration`."""
    speed, accel = min(speed_mps, limits.speed_mps), limits.acceleration_mps2
    moving_s = max(0.0, duration_s - limits.smoothing_s - SETTLING_S)
    if moving_s >= 2.0 * speed / accel:
        return speed * (moving_s - speed / accel)
    return accel * moving_s * moving_s / 4.0


def least_energy(
    lengths_m: Vector,
    *,
    legs: float = math.inf,
    speed_mps: float,
    limits: LimitsConfig,
    cut_m: float,
    density: float = 1.0,
    wind_mps: float = 0.0,
) -> Vector:
    """Return lower bounds (n,) in joules on the energy of level paths of `lengths_m`, from 0 up in
    fine steps, with at most `legs` straight legs, and with or without hovers between them.

    Every metre takes at least what it takes at the cheapest speed that can be had there: from
    rest, and to rest, u^2 <= 2 a s. Hovering takes more than flying slowly: power is taken for the
    least of a speed and all above. The wind blows from behind. Below the ordered speed a path
    accelerates by a throughout, but near changes of acceleration, where the trajectory is averaged:
    where there may be any number of these, accelerating costs nothing.
    """
    speed, accel = min(speed_mps, limits.speed_mps), limits.acceleration_mps2
    window_s = limits.smoothing_s

    def level_w(speeds: Vector) -> Vector:
        return least_power_w(np.maximum(0.0, np.abs(speeds) - wind_mps), density=density)

    # From each of these speeds to the next it is no less than what power at the lower one and
    # metres at the higher one make.
    speeds = np.linspace(0.0, speed, _SPEEDS + 1)
    entered, counted = speeds[:-1], speeds[1:]
    # A corner entered at speed u is cut by a parabola with s = sin(phi / 2), u^2 s^2 <= 2 a cut.
    # Its metres count as if flown at u; power, convex, is at least that of its mean speed.
    s = np.clip(math.sqrt(2.0 * accel * cut_m) / np.maximum(entered, 1e-9), 1e-9, 1.0 - 1e-9)
    mean = entered / 2.0 * (1.0 + (1.0 - s * s) / s * np.arctanh(s))
    # Averaged, a velocity is shorter: in a window its variance is (a window_s)^2 / 12 at most.
    apart = accel * window_s / math.sqrt(12.0)
    bent_w = (level_w(speeds + apart) + level_w(speeds - apart)) / 2.0 - level_w(speeds)
    watts, cruise_w = (level_w(at) - bent_w.max() for at in (mean, speeds[-1:]))
    halves = lengths_m / 2.0  # the other half is the same in a mirror
    reached = np.sqrt(2.0 * accel * halves[1:])  # at the far end of each piece: the cheaper
    cheapest = np.minimum(np.searchsorted(speeds, reached), _SPEEDS) - 1
    settling_j = float(power_w(np.array([wind_mps]), density=density)[0]) * SETTLING_S

    def with_more(added_w: float) -> tuple[Vector, float]:
        """Return joules if accelerating adds so many watts, and the least J/m."""
        per_m = (watts + added_w) / counted
        per_m[-1] = min(per_m[-1], cruise_w[0] / speed)
        per_m = np.minimum.accumulate(per_m)
        joules = 2.0 * np.cumsum(per_m[cheapest] * np.diff(halves)) + settling_j
        return np.concatenate(([0.0], joules)), float(per_m[-1])

    free_j, _ = with_more(0.0)
    if math.isinf(legs):
        return free_j
    hovering = power_w(np.zeros(2), accel_mps2=np.array([0.0, accel]), density=density)
    joules, per_m = with_more(float(np.diff(hovering)[0]))
    # Accelerating by b < a takes (b / a)^2 of that at least. A jump d of acceleration takes
    # |d|^2 window_s / 6 off the integral of its square; a leg has 4 a^2 of them, so has a corner.
    spared_j = legs * window_s * 4.0 / 3.0 * (per_m * counted - watts).max()
    return np.asarray(np.maximum(free_j, joules - spared_j))
