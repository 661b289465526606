"""Whether a corner may be passed before the next guidance step: C against the same in Python."""

import math

import numpy as np
import pytest
from gains import DT_S, GAINS

from flightdyn.native.library import ATTITUDE, NEAR, Guide, Strapdown
from flightdyn.native.ticks import Inner


@pytest.fixture
def guide() -> Guide:
    told: list[float] = []
    axes = [told.append] * 3
    guide = Guide(GAINS, Inner(axes, axes, axes, told.append, dt_s=DT_S))
    guide.memory.effectiveness, guide.memory.mode = 1.0, ATTITUDE
    return guide


def near(guide: Guide, carried: Strapdown) -> bool:
    guide.step(carried)
    return bool(guide.memory.noted & NEAR)


def test_near_is_what_python_makes_of_it(guide: Guide) -> None:
    rng = np.random.default_rng(3)
    carried, memory, found = Strapdown((9.81, 0.0, 0.0), most=1), guide.memory, []
    for _ in range(3000):
        p, c, v, n = rng.normal(0, [[2], [1], [8], [1]], (4, 3)).tolist()
        n = (np.array(n) / math.hypot(*n)).tolist()
        carried.place(tuple(p), tuple(v), (1.0, 0.0, 0.0, 0.0))
        memory.soon, memory.corner[:], memory.normal[:] = float(rng.normal(0, 0.03)), c, n
        (x, y, z), (cx, cy, cz), (nx, ny, nz), (vx, vy, vz) = p, c, n, v
        beyond = (x - cx) * nx + (y - cy) * ny + (z - cz) * nz
        soon = memory.t >= memory.soon - DT_S
        due = beyond + 2 * DT_S * (abs(vx) + abs(vy) + abs(vz)) + 0.2 > 0
        assert near(guide, carried) == (soon and due)
        found.append((soon, due))
    assert len(set(found)) == 4


def test_a_reversal_is_near_once_it_is_time_wherever_the_aircraft_is(guide: Guide) -> None:
    carried, memory = Strapdown((9.81, 0.0, 0.0), most=1), guide.memory
    carried.place((500.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    memory.soon = math.inf
    assert not near(guide, carried)
    memory.soon = 0.0
    assert near(guide, carried)
