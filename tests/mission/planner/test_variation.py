"""A change at random, against its description: one at a time, with the random numbers it draws."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from one_aircraft import round_problem

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.limits import RoundLimits
from mission.planner.native.rounds import CandidatePlan
from mission.planner.performance import Performance

STEPS, SPEED_MPS = 9, 20.0
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
    way: np.ndarray, device_m: np.ndarray, under: Callable[[int], int], draw: Iterator[float],
    ready_s: float | None = None,
):  # fmt: skip
    """The way after a change, and which kind it was; with the device's readiness there are nine."""
    n, m = 1 + under(STEPS - 1), 1 + under(STEPS - 1)
    kind = under(7 if ready_s is None else 9)
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
        if kind > 6:  # aside, half as far as is flown there and back until the device is ready
            assert ready_s is not None
            legs_m = np.hypot(*np.diff(way[: m + 1], axis=0).T)
            quarter_s = max(0.0, ready_s - legs_m.sum() / SPEED_MPS) * (1.0 + next(draw) ** 2) / 4.0
            ramp_s = SPEED_MPS / 5.0
            if quarter_s > ramp_s:
                far_m = SPEED_MPS * (2.0 * quarter_s - ramp_s)
            else:
                far_m = 5.0 * quarter_s**2
            aside = np.array([x - 0.5, y - 0.5])
            put = put + far_m * aside / np.hypot(*aside)
        way = np.insert(np.delete(way, n, axis=0), m, put, axis=0)
    return way, kind


@pytest.mark.parametrize("ready", [False, True])
def test_every_kind_of_change_is_what_is_said_of_it(ready: bool) -> None:
    ready_s = np.array([0.0, 0.0, 30.0, 60.0, 90.0]) if ready else None
    paper = RoundLimits(Performance(SPEED_MPS, 5.0, None), 1e6) if ready else None
    rng = np.random.default_rng(1)
    devices_m = rng.uniform(350.0, 450.0, (5, 2))
    problem = round_problem(
        devices_m, np.array([1.0, 0.0, 0.5, 2.0, 0.3]), np.full(2, 400.0), STEPS, 2, 1e5,
        CHANNEL_PRESETS["suburban"], limits=paper, ready_in_s=ready_s,
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
        k = worth[under(4)]
        of_k = None if ready_s is None else float(ready_s[k])
        expected, kind = changed(way, devices_m[k], under, draw, of_k)
        np.testing.assert_allclose(found.route[found.at], expected, rtol=0.0, atol=1e-9)
        seen.add(kind)
        moved += kind == 6 and (expected != way).any(axis=1).sum() == 3
    assert seen == set(range(9 if ready else 7))
    assert moved > 0
