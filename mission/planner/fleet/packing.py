"""Paths of several aircraft as columns: a linear programme over them, and the best that fit.

Some devices of a packed path may be dropped: whole paths overlap too much to fit. Both are solved
by HiGHS, as SciPy has it, without a clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.base.arrays import Floats, Ints

NODES = 50  # of the packing's search, at most


@dataclass(frozen=True)
class Column:
    """A path of one of the aircraft that are alike."""

    group: int  # the first of them
    way: Floats  # (N, 2), from its start at the origin
    brought: Floats  # (K,) what the devices that it serves bring, 0: not served

    def after(self, prices: Floats) -> float:
        """Return what is left once prices (K,) are paid for those that are worth it."""
        return float(np.maximum(0.0, self.brought - prices).sum())


class Master:
    """The linear programme over columns: an aircraft flies one path, a device is served once."""

    def __init__(self, counts: Ints, delta: Floats) -> None:
        self._groups, self._delta = len(counts), delta
        self._most = np.concatenate((counts, np.ones(len(delta))))
        self._worth: list[float] = []
        self._takes: list[Floats] = []

    def add(self, row: int, brought: Floats) -> None:
        """Add a path of an aircraft of that group."""
        one = np.zeros(len(self._most))
        one[row], one[self._groups :] = 1.0, brought > 0.0
        self._worth.append(float(brought.sum()))
        self._takes.append(one)

    def solve(self) -> tuple[Floats, Floats]:
        """Return prices (K,) of devices, and what a path of each group has to bring."""
        from scipy.optimize import linprog  # not every plan needs it, and it takes long to import

        takes = np.column_stack(self._takes)
        found = linprog(-np.array(self._worth), A_ub=takes, b_ub=self._most, method="highs-ds")
        duals = np.maximum(0.0, -found.ineqlin.marginals)
        return np.minimum(duals[self._groups :], self._delta), duals[: self._groups]


def packed(columns: Sequence[Column], rows: Sequence[int], counts: Ints) -> list[int]:
    """Return which paths, so many of each row's group at most, are worth most if each device is
    served by one of them only."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    if not columns:
        return []
    # A variable for each path, then one for each device that a path serves: at most the path's.
    path, device = np.nonzero(np.stack([column.brought for column in columns]))
    paths, served, groups = len(columns), len(path), len(counts)
    which = paths + np.arange(served)
    beyond = groups + len(columns[0].brought)
    entries = [
        (np.array(rows), np.arange(paths), 1.0),
        (groups + device, which, 1.0),
        (beyond + np.arange(served), which, 1.0),
        (beyond + np.arange(served), path, -1.0),
    ]
    at, of = (np.concatenate([entry[i] for entry in entries]) for i in (0, 1))
    values = np.concatenate([np.full(len(entry[0]), entry[2]) for entry in entries])
    table = coo_array((values, (at, of)), shape=(beyond + served, paths + served))
    most = np.concatenate((counts, np.ones(beyond - groups), np.zeros(served)))
    worth = np.stack([column.brought for column in columns])[path, device]
    found = milp(
        np.concatenate((np.zeros(paths), -worth)),
        integrality=np.concatenate((np.ones(paths), np.zeros(served))),
        bounds=Bounds(0.0, 1.0),
        constraints=LinearConstraint(table.tocsr(), -np.inf, most),
        options={"node_limit": NODES},
    )
    return [] if found.x is None else np.flatnonzero(found.x[:paths] > 0.5).tolist()
