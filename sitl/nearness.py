"""How near the aircraft of a world come to each other, by their true positions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.state import Vector

TOUCH_M = 2 * QUAD_X.hull_m  # between centres: hulls count as spheres
STEP_S = 0.02  # pieces of motion that count as straight: right to 1 mm at 10 m/s2
# Aircraft that cannot touch fly on alone for so long: in turn at each step they would cost twice as
# much, as each then finds the other's memory in the processor's cache.
_SPANS_S = np.array([STEP_S, 0.1, 0.2, 0.5, 1.0])
_REACH_M = 10.0 * _SPANS_S**2  # at 20 m/s2 towards each other
_AIRBORNE_M = 0.2  # above home; pairs of which neither flies are not followed


@dataclass(frozen=True, slots=True)
class Nearest:
    """The least distance of a pair, with the places of both, north, east and down of the first
    home, in metres; NaN where neither of them has flown."""

    pair: tuple[int, int]
    t_ns: int
    distance_m: float
    places_ned_m: tuple[Vector, Vector]

    @property
    def horizontal_m(self) -> float:
        """The level part of the distance."""
        here, there = self.places_ned_m
        return float(np.hypot(*(here - there)[:2]))

    @property
    def vertical_m(self) -> float:
        """The upright part of the distance."""
        here, there = self.places_ned_m
        return float(abs(here[2] - there[2]))


def straight_pieces(
    t_ns: NDArray[np.int64], places: NDArray[np.float64], speeds: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The motion (n, m, 3) through these instants (m,), places and velocities, in pieces of up to
    20 ms: on the cubics through them, right to 1 mm at 0.1 s and a snap of 1 km/s4."""
    span = np.diff(t_ns)
    parts = round(float(span.max()) * 1e-9 / STEP_S)
    if parts < 2:
        return t_ns, places
    u = (np.arange(1, parts + 1) / parts)[:, None]
    begin, end = places[:, :-1, None], places[:, 1:, None]
    seconds = span[:, None, None] * 1e-9
    leave, come = speeds[:, :-1, None] * seconds, speeds[:, 1:, None] * seconds
    inner = (
        begin + u * u * (3.0 - 2.0 * u) * (end - begin)
        + u * (1.0 - u) * ((1.0 - u) * leave - u * come)
    )  # fmt: skip
    finer = np.concatenate((places[:, :1], inner.reshape(len(places), -1, 3)), axis=1)
    instants = t_ns[:-1, None] + np.round(u[:, 0] * span[:, None]).astype(np.int64)
    return np.concatenate((t_ns[:1], instants.ravel())), finer


class Nearness:
    """Distances of all pairs of n aircraft; all at once take less than to sort them."""

    def __init__(self, near_m: Sequence[float]) -> None:
        """`near_m`: within what distance each wants to hear of another; 0: never."""
        count, wanted = len(near_m), np.array(near_m)
        self._one, self._two = np.triu_indices(count, 1)
        self._near_m = np.maximum(wanted[self._one], wanted[self._two])
        pairs = len(self._one)
        self._least = np.full(pairs, np.nan)
        self._when = np.zeros(pairs, dtype=np.int64)
        self._where = np.full((2, pairs, 3), np.nan)
        self._within = np.zeros(pairs, dtype=bool)

    def follow(
        self, t_ns: NDArray[np.int64], places: NDArray[np.float64], *, counts: NDArray[np.bool_]
    ) -> tuple[list[tuple[int, int]], list[Nearest]]:
        """Take the instants (m,) and the places (n, m, 3) there of those that count (n,).

        Returns the pairs that touched, and how each began that has come near.
        """
        axes = np.ascontiguousarray(np.moveaxis(places, 2, 0))  # sums over the first axis are fast
        one, two = axes[:, self._one], axes[:, self._two]
        apart, by = (one - two)[..., :-1], np.diff(one - two)
        speed2 = (by * by).sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = -(apart * by).sum(axis=0) / speed2
        share = np.clip(np.where(speed2 > 0.0, share, 0.0), 0.0, 1.0)
        distance = np.linalg.norm(apart + share * by, axis=0)
        flies = np.maximum(-one[2], -two[2])[:, 1:] > _AIRBORNE_M
        counted = flies & (counts[self._one] & counts[self._two])[:, None]
        distance[~counted] = np.inf
        at = distance.argmin(axis=1)
        rows = np.arange(len(at))
        least = distance[rows, at]
        span = np.diff(t_ns)

        def found(pair: int, k: int) -> Nearest:
            part = share[pair, k]
            here, there = (each[:, pair, k] + part * (each[:, pair, k + 1] - each[:, pair, k])
                           for each in (one, two))  # fmt: skip
            when = int(t_ns[k] + round(part * span[k]))
            pairs = int(self._one[pair]), int(self._two[pair])
            return Nearest(pairs, when, float(distance[pair, k]), (here, there))

        for pair in np.flatnonzero(least < np.where(np.isnan(self._least), np.inf, self._least)):
            new = found(int(pair), int(at[pair]))
            self._least[pair], self._when[pair] = new.distance_m, new.t_ns
            self._where[:, pair] = new.places_ned_m
        near = distance < self._near_m[:, None]
        begun = near.any(axis=1) & ~self._within
        self._within = near[:, -1] | (self._within & ~counted[:, -1])
        touched = np.flatnonzero(least < TOUCH_M)
        return (
            [(int(self._one[pair]), int(self._two[pair])) for pair in touched],
            [found(int(pair), int(near[pair].argmax())) for pair in np.flatnonzero(begun)],
        )

    def clear(self, places: NDArray[np.float64], speeds: NDArray[np.float64]) -> float:
        """For how long (s) nobody, at these places and velocities (n, 3), can touch another; 0: not
        even for a step."""
        apart = np.linalg.norm(places[self._one] - places[self._two], axis=1)[:, None]
        closing = np.linalg.norm(speeds[self._one] - speeds[self._two], axis=1)[:, None]
        clear = (apart - closing * _SPANS_S - _REACH_M > TOUCH_M).all(axis=0)
        return float(_SPANS_S[clear].max(initial=0.0))

    @property
    def least(self) -> list[Nearest]:
        """The least distance so far of each pair."""
        return [
            Nearest((int(i), int(j)), int(t), float(d), (here, there))
            for i, j, t, d, here, there in zip(
                self._one, self._two, self._when, self._least, *self._where, strict=True
            )
        ]
