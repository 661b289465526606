"""What Python calls: compiled once per installation, then loaded from numba's cache."""

import hashlib
import math
from collections.abc import Callable
from pathlib import Path

from numba import njit

from mission.planner.kernels.compiled import Indices, Matrix
from mission.planner.kernels.exploration import Lists, explore
from mission.planner.kernels.instance import Problem
from mission.planner.kernels.search import search

Plan = Callable[[Problem, Lists, int, float, int, int, Matrix, Indices], tuple[float, float, int]]


def _entry(digest: str) -> Plan:
    """The cache looks at the source file and the closure of a function, not at what it calls.
    With the digest of all sources in the closure a change anywhere compiles anew."""

    @njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
    def plan(
        problem: Problem,
        lists: Lists,
        tries: int,
        gap: float,
        max_nodes: int,
        pool: int,
        way: Matrix,
        assigned: Indices,
    ) -> tuple[float, float, int]:
        """Explore, then search if there are nodes to search; (value, upper bound, nodes)."""
        _ = digest
        value = explore(problem.devices, problem.limits, lists, tries, way, assigned)
        if max_nodes == 0 or value <= 0.0:
            return value, math.inf, 0
        return search(problem, gap, max_nodes, pool, way, assigned, value)

    result: Plan = plan
    return result


def _digest() -> str:
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()


plan = _entry(_digest())
