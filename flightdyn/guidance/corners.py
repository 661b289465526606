"""How fast corners can be taken, and what that leaves for the legs between them.

A corner is cut by a parabola: constant acceleration a along the bisector. A blend at speed v
through the course change phi takes the time T = 2 v s / a with s = sin(phi / 2), begins
v T / 2 = v^2 s / a before the corner and misses it by v T s / 4 = v^2 s^2 / (2 a), which bounds v
by the cut allowed.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

from flightdyn.config import LimitsConfig
from flightdyn.frames import Triple

_SPILL = 0.2  # of the acceptance radius: how far off the legs a blend may be outside of it


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight between two vertices."""

    u: Triple  # unit vector
    length: float  # m
    speed: float  # m/s
    accel: float  # m/s2, along it and in the blends at its ends


def make_leg(start: Triple, end: Triple, *, speed: float, limits: LimitsConfig) -> Leg:
    """The leg between two different points, at the speed ordered or what the limits allow."""
    d = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    length = math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    u = (d[0] / length, d[1] / length, d[2] / length)
    accel = limits.acceleration_mps2
    speed = min(speed, limits.speed_mps)
    steep = abs(u[2])
    if steep > 1e-6:
        vertical = limits.climb_mps if u[2] < 0 else limits.descent_mps
        speed = min(speed, vertical / steep)
        accel = min(accel, limits.vertical_acceleration_mps2 / steep)
    return Leg(u, length, speed, accel)


def _strays(cut: float, sine: float, *, radius: float) -> bool:
    """Whether a blend that misses its corner by `cut` is further than `_SPILL` off the leg where it
    enters the circle of `radius` about the corner.

    With a = 1: v^2 = 2 cut / s^2; along the leg the blend is v^2 s - (v t - s t^2 / 2) before the
    corner, and off it by cos(phi / 2) t^2 / 2. It comes nearer up to its middle, at t = v s.
    """
    v = math.sqrt(2 * cut) / sine
    before = v * v * sine
    cosine = math.sqrt(max(1 - sine * sine, 0.0))
    off = _SPILL * radius
    if before <= radius or cosine * (v * sine) ** 2 / 2 <= off:
        return False
    t = math.sqrt(2 * off / cosine)
    return math.hypot(before - v * t + sine * t * t / 2, off) > radius


@lru_cache(maxsize=1000)
def _allowed_cut(sine: float, radius: float, *, share: float) -> float:
    """The largest cut, at most `share` of the acceptance radius, that strays from the legs by at
    most `_SPILL` of it outside."""
    cut = share * radius
    while cut > 1e-6 and _strays(cut, sine, radius=radius):
        cut *= 0.95
    return cut


def corner_speeds(
    legs: list[Leg], radii: list[float], *, share: float, v_start: float
) -> tuple[list[float], list[float], list[float]]:
    """Speed at each vertex, sin(phi / 2) there, and the acceleration of its blend.

    `radii`: acceptance radius of each vertex, of which `share` may be cut; `v_start`: speed at the
    first vertex, if the rest allows it. The last speed is zero.
    """
    n = len(legs)
    sines, accels = [0.0] * (n + 1), [legs[0].accel] * (n + 1)
    speeds = [min(v_start, legs[0].speed)] + [0.0] * n
    for i in range(1, n):
        a, b = legs[i - 1], legs[i]
        s = math.dist(a.u, b.u) / 2  # |u1 - u0| = 2 sin(phi / 2)
        accel = min(a.accel, b.accel)
        v = min(a.speed, b.speed)
        if s > 1e-9:
            v = min(
                v,
                math.sqrt(2 * accel * _allowed_cut(s, radii[i], share=share)) / s,
                math.sqrt(accel * min(a.length, b.length) / (2 * s)),
            )
        speeds[i], sines[i], accels[i] = v, s, accel
    # What acceleration allows between corners: v1^2 <= v0^2 + 2 a (length - both half blends).
    # Lowering a speed may shorten its blend, so that one sweep there and back need not do.
    for _ in range(2 * n):
        before = list(speeds)
        for i, leg in enumerate(legs):
            _lower(speeds, sines, accels, leg, i, i + 1)
        for i in range(n - 1, -1, -1):
            _lower(speeds, sines, accels, legs[i], i + 1, i)
        if speeds == before:
            break
    return speeds, sines, accels


def _lower(
    speeds: list[float], sines: list[float], accels: list[float], leg: Leg, here: int, there: int
) -> None:
    """Lower the speed at vertex `there` to what can be had from `here` on the leg between."""
    v2 = speeds[here] ** 2
    room = leg.length - v2 * sines[here] / accels[here]
    best = (v2 + 2 * leg.accel * room) / (1 + 2 * sines[there] * leg.accel / accels[there])
    speeds[there] = min(speeds[there], math.sqrt(max(best, 0.0)))
