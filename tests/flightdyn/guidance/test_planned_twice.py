"""Trajectories in C against the same rules in numpy, over paths of all kinds."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from flightdyn.config import LimitsConfig
from flightdyn.guidance.path import FlightPath, plan_path, profile_of
from flightdyn.state import Vector

LIMITS = LimitsConfig(
    acceleration_mps2=4.0, vertical_acceleration_mps2=2.0, speed_mps=15.0, climb_mps=3.0,
    descent_mps=2.0, corner_cut=0.8, smoothing_s=0.3,
)  # fmt: skip


def strays(cut: float, sine: float, radius: float) -> bool:
    """Whether the parabola about a corner at the origin, of unit acceleration, is more than a fifth
    of the radius off the leg along x where it comes into the circle of that radius."""
    v, cosine = math.sqrt(2 * cut) / sine, math.sqrt(max(0.0, 1 - sine**2))
    middle_s, most = v * sine, 0.2 * radius
    if v * middle_s <= radius or cosine * middle_s**2 / 2 <= most:
        return False
    t = math.sqrt(2 * most / cosine)
    return math.hypot(-v * middle_s + v * t - sine * t**2 / 2, most) > radius


class Planned:
    """Vertices and pieces of a path, begun at a velocity."""

    def __init__(self, path: FlightPath, velocity: Vector, *, braking: bool) -> None:
        self.pieces: list[list[float]] = []  # as C has them
        self._t, self._p, self._area = 0.0, path.points_ned_m[0].copy(), np.zeros(3)
        self._path = path
        self._begin(self._p)
        if braking or not self.legs or not self._set_speeds(velocity):
            speed = float(np.linalg.norm(velocity))
            if speed > 0.05:
                self._draw(velocity, -4.0 / speed * velocity, speed / 4.0)
            self._begin(self._p)
            if self.legs:
                self._set_speeds(np.zeros(3))
        self._fly()

    def _begin(self, start: Vector) -> None:
        path = self._path
        self.at = [{"p": start.copy(), "radius": path.acceptance_m[0], "passed": 1}]
        for i, (point, radius) in enumerate(
            zip(path.points_ned_m[1:], path.acceptance_m[1:], strict=True)
        ):
            last = self.at[-1]
            way = point - last["p"]
            length = float(np.linalg.norm(way))
            if length < 1e-3:  # the same point
                last["passed"], last["radius"] = i + 2, min(last["radius"], radius)
                continue
            top, accel, steep = min(path.speeds_mps[i], 15.0), 4.0, abs(way[2]) / length
            if steep > 1e-6:
                top = min(top, (3.0 if way[2] < 0 else 2.0) / steep)
                accel = min(accel, 2.0 / steep)
            self.at.append({
                "p": point, "radius": radius, "passed": i + 2, "u": way / length, "length": length,
                "top": top, "accel": accel,
            })  # fmt: skip
        self.legs: list[dict[str, Any]] = self.at[1:]

    def _set_speeds(self, velocity: Vector) -> bool:
        """Set them; return whether the velocity fits."""
        at, first = self.at, self.legs[0]
        along = float(velocity @ first["u"])
        across = float(np.linalg.norm(velocity - along * first["u"]))
        at[0] |= {"v": min(max(0.0, along), first["top"]), "sine": 0.0, "bend": first["accel"]}
        at[-1] |= {"v": 0.0, "sine": 0.0, "bend": first["accel"]}
        for here, after in zip(self.legs, self.legs[1:], strict=False):
            accel, v = min(here["accel"], after["accel"]), min(here["top"], after["top"])
            sine = float(np.linalg.norm(here["u"] - after["u"])) / 2
            if sine > 1e-9:
                cut = 0.8 * here["radius"]
                while cut > 1e-6 and strays(cut, sine, here["radius"]):
                    cut *= 0.95
                # The blend misses the corner by v^2 s^2 / 2a, and takes half of each leg at most.
                v = min(v, math.sqrt(2 * accel * cut) / sine)
                v = min(v, math.sqrt(accel * min(here["length"], after["length"]) / (2 * sine)))
            here |= {"v": v, "sine": sine, "bend": accel}
        again = True
        while again:
            again = False
            ends = list(zip(at, at[1:], at[1:], strict=False))
            for begin, leg, end in (*ends, *((b, leg, a) for a, leg, b in reversed(ends))):
                # v1^2 = v0^2 + 2 a (length - v0^2 s0 / b0 - v1^2 s1 / b1), if that is less.
                room = leg["length"] - begin["v"] ** 2 * begin["sine"] / begin["bend"]
                square = begin["v"] ** 2 + 2 * leg["accel"] * room
                square /= 1 + 2 * leg["accel"] * end["sine"] / end["bend"]
                if (v := math.sqrt(max(0.0, square))) < end["v"] - 1e-12:
                    end["v"], again = v, True
        for vertex in at:
            vertex["half"] = vertex["v"] * vertex["sine"] / vertex["bend"]
        return across <= 4.0 and abs(along - at[0]["v"]) <= 1.0

    def _draw(self, v: Vector, a: Vector, s: float) -> None:
        if s > 0.0:
            self.pieces.append([self._t, *self._p, *v, *a, *self._area])
            self._t += s
            self._area = self._area + self._p * s + v * s**2 / 2 + a * s**3 / 6
            self._p = self._p + v * s + a * s**2 / 2

    def _fly(self) -> None:
        self.at[0]["t"] = self._t
        for begin, end, after in zip(self.at, self.legs, [*self.legs[1:], None], strict=False):
            v0, v1, a, u = begin["v"], end["v"], end["accel"], end["u"]
            length = max(0.0, end["length"] - v0 * begin["half"] - v1 * end["half"])
            top = max(v0, v1, min(end["top"], math.sqrt((v0**2 + v1**2) / 2 + a * length)))
            ramps = (top**2 - v0**2) / (2 * a), (top**2 - v1**2) / (2 * a)
            self._draw(u * v0, u * a, (top - v0) / a)
            self._draw(u * top, 0 * u, max(0.0, length - sum(ramps)) / top if top > 0 else 0.0)
            self._draw(u * top, -u * a, (top - v1) / a)
            end["t"], end["normal"] = self._t, np.zeros(3)
            if after is None:
                break
            out = after["u"]
            both = u + out
            if np.linalg.norm(both) > 0.2:
                end["normal"] = both / np.linalg.norm(both)
            half = end["half"]
            self._draw(u * v1, (out - u) * (v1 / (2 * half) if half > 0 else 0.0), 2 * half)
            end["t"] = self._t - half
        self.end_s = self._t
        self._draw(np.zeros(3), np.zeros(3), 1.0)


def some_path(rng: np.random.Generator) -> FlightPath:
    """Level, climbing and upright legs of all lengths; points that coincide, and ways back."""
    count = int(rng.integers(2, 8))
    points = [rng.normal(0, 10, 3)]
    for _ in range(count - 1):
        match int(rng.integers(6)):
            case 0:
                points.append(points[-1] + rng.normal(0, 1e-4, 3))
            case 1:
                points.append(points[-1] + [0.0, 0.0, float(rng.normal(0, 20))])
            case 2 if len(points) > 1:
                points.append(points[-2].copy())
            case 3:
                points.append(points[-1] + rng.normal(0, 40, 3))
            case _:
                points.append(points[-1] + [*rng.normal(0, float(rng.choice([3, 80])), 2), 0.0])
    radii = rng.choice([0.0, 0.5, 5.0, 40.0], count)
    return FlightPath(np.array(points), rng.uniform(0.5, 20.0, count - 1), radii)


def some_velocity(rng: np.random.Generator, path: FlightPath) -> Vector:
    way = path.points_ned_m[1] - path.points_ned_m[0]
    along: Vector = way / max(1e-9, float(np.linalg.norm(way))) * rng.uniform(-1.0, 14.0)
    kind = int(rng.integers(4))
    aside = rng.normal(0, (0.5, 4.0)[kind % 2], 3)
    return np.zeros(3) if kind == 3 else rng.normal(0, 0.02, 3) if kind == 2 else along + aside


def test_trajectories_are_those_of_the_rules_in_numpy() -> None:
    rng, kept = np.random.default_rng(7), 0
    for _ in range(200):
        path, braking = some_path(rng), bool(rng.random() < 0.15)
        velocity = some_velocity(rng, path)
        x, y, z = velocity.tolist()
        pieces, corners, end_s = profile_of(path, LIMITS).trajectory((x, y, z), braking=braking)
        planned = Planned(path, velocity, braking=braking)
        assert end_s == pytest.approx(planned.end_s, abs=1e-7)
        expected = np.array(planned.pieces)
        longer = [np.append(np.diff(each[:, 0]) > 1e-6, True) for each in (pieces, expected)]
        found, expected = pieces[longer[0]], expected[longer[1]]
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-5)
        assert [corner.passed for corner in corners] == [each["passed"] for each in planned.at]
        for corner, each in zip(corners, planned.at, strict=True):
            assert corner.t == pytest.approx(each["t"], abs=1e-7)
            np.testing.assert_allclose(corner.p[:], each["p"], atol=1e-9)
            if planned.legs:
                numbers = [corner.v, corner.sine, corner.bend, corner.half]
                assert numbers == pytest.approx([each[n] for n in ("v", "sine", "bend", "half")])
                np.testing.assert_allclose(corner.normal[:], each.get("normal", 0.0), atol=1e-9)
        kept += pieces[0, 4:7].tolist() == pytest.approx(velocity.tolist()) and len(corners) > 1
    assert 15 < kept < 150


def drawn(pieces: Vector, t: float) -> tuple[Vector, Vector]:
    """Position and velocity before averaging; before the first piece at its speed."""
    piece = pieces[max(0, int(np.searchsorted(pieces[:, 0], t, side="right")) - 1)]
    s, p, v, a = t - piece[0], piece[1:4], piece[4:7], piece[7:10] * (t >= pieces[0, 0])
    return p + v * s + a * s**2 / 2, v + a * s


def test_a_reference_is_the_mean_of_what_was_drawn() -> None:
    """Over the 0.3 s about it; of quadratics, whose mean Simpson's rule has exactly."""
    rng, half = np.random.default_rng(11), 0.15
    for _ in range(40):
        path = some_path(rng)
        velocity = some_velocity(rng, path)
        x, y, z = velocity.tolist()
        pieces, _, end_s = profile_of(path, LIMITS).trajectory((x, y, z), braking=False)
        trajectory, _ = plan_path(path, LIMITS, start_vel=(x, y, z))
        assert trajectory.end_s == pytest.approx(end_s + half)
        assert trajectory.start_s == (0.0 if pieces[0, 4:7].any() else -half)
        for t in (*rng.uniform(-0.3, end_s + 0.8, 12), -half, 0.0, end_s, *pieces[:3, 0]):
            cuts = [t - half, *(c for c in pieces[:, 0] if t - half < c < t + half), t + half]
            area = np.zeros(3)
            for a, b in pairwise(cuts):
                inside = np.nextafter(b, a), np.nextafter(a, b)
                ends = drawn(pieces, inside[1])[0] + drawn(pieces, inside[0])[0]
                area += (b - a) / 6 * (ends + 4 * drawn(pieces, (a + b) / 2)[0])
            (p0, v0), (p1, v1) = (drawn(pieces, t + side * half) for side in (-1.0, 1.0))
            found = trajectory.at(float(t))
            np.testing.assert_allclose(found.p, area / (2 * half), atol=1e-6)
            np.testing.assert_allclose(found.v, (p1 - p0) / (2 * half), atol=1e-6)
            np.testing.assert_allclose(found.a, (v1 - v0) / (2 * half), atol=1e-6)
