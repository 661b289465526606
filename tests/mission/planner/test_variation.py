"""A change at random, against its description: one at a time, with the random numbers it draws."""

from collections.abc import Callable, Iterator

import numpy as np

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.native.rounds import CandidatePlan
from mission.planner.problem import RoundProblem

STEPS = 9
WHOLE = 2**64 - 1


def numbers(seed: int) -> Iterator[float]:
    """Marsaglia's xorshift (2003) with his shifts 13, 7, 17, in [0, 1)."""
    state = 0x9E3779B97F4A7C15 ^ seed
    while True:
        state ^= state << 13 & WHOLE
        state ^= state >> 7
        state ^= state << 17 & WHOLE
        yield (state >> 11) / 2**53


def changed(
    way: np.ndarray, device_m: np.ndarray, under: Callable[[int], int], draw: Iterator[float]
):
    """The way after a change, and which kind it was."""
    n, m, kind = 1 + under(STEPS - 1), 1 + under(STEPS - 1), under(7)
    x, y = next(draw), next(draw)
    way, old = way.copy(), way[n].copy()
    if kind in (0, 6):
        put = old + (np.array([x, y]) - 0.5) * 256.0 / 2 ** under(8)
        same = (way == old).all(axis=1) if kind == 6 else np.arange(STEPS) == n
        same[0] = False
        way[same] = put
    elif kind == 1:
        way[n] = device_m + x * y * (old - device_m)
    elif kind == 2:
        first, last = sorted((n, m))
        way[first : last + 1] = way[first : last + 1][::-1].copy()
    else:
        put = old if kind == 3 else way[m - 1].copy()
        if kind == 4:
            put = device_m + x * y * (put - device_m)
        way = np.insert(np.delete(way, n, axis=0), m, put, axis=0)
    return way, kind


def test_every_kind_of_change_is_what_is_said_of_it() -> None:
    rng = np.random.default_rng(1)
    devices_m = rng.uniform(350.0, 450.0, (5, 2))
    problem = RoundProblem(
        devices_m, np.array([1.0, 0.0, 0.5, 2.0, 0.3]), np.full(2, 400.0), STEPS, 2, 1e5,
        CHANNEL_PRESETS["suburban"],
    )  # fmt: skip
    worth = np.array([0, 2, 3, 4])
    seen, moved = set(), 0
    for seed in range(200):
        way = np.vstack((problem.start_m, rng.uniform(300.0, 500.0, (STEPS - 1, 2))))
        way[[3, 7]] = way[5]  # three at one place
        plan = CandidatePlan(
            way, np.arange(STEPS), np.zeros((STEPS, 5), bool), 1e-300  # whatever comes is better
        )  # fmt: skip
        found = problem.as_judged.varied(
            plan, 1e5, changes=1, tolerance=0.0, seed=seed, limited=False
        )
        draw = numbers(seed)

        def under(limit: int, draw: Iterator[float] = draw) -> int:
            return int(next(draw) * limit)

        next(draw)  # what the change may lose
        expected, kind = changed(way, devices_m[worth[under(4)]], under, draw)
        np.testing.assert_allclose(found.route[found.at], expected, rtol=0.0, atol=1e-9)
        seen.add(kind)
        moved += kind == 6 and (expected != way).any(axis=1).sum() == 3
    assert seen == set(range(7))
    assert moved > 0
