"""Paths of several aircraft as columns: the prices that they ask for, and the best that fit.

Some devices of a packed path may be dropped: whole paths overlap too much to fit. Packed by HiGHS,
as SciPy has it, without a clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.base.arrays import Floats, Ints

NODES = 50  # of the packing's search, at most
MOST_NEWTON, MOST_HALVINGS = 100, 30
FARTHEST, NEAR = 30.0, 1e-3  # of a step, and what is left to gain in the end, over `soft`
ROUNDED = 9  # digits of the importance
_FLAT = 1e-9  # least curvature


@dataclass(frozen=True)
class Column:
    """A path of one of the aircraft that are alike."""

    group: int  # the first of them
    way: Floats  # (N, 2), from its start at the origin
    brought: Floats  # (K,) what the devices that it serves bring, 0: not served

    def after(self, prices: Floats) -> float:
        """Return what is left once prices (K,) are paid for those that are worth it."""
        return float(np.maximum(0.0, self.brought - prices).sum())


class Market:
    """The prices at which a round is worth least, as far as the paths found so far say:

        sum_k prices_k + sum_a max over paths c of a of sum_k max(0, brought_ck - prices_k)

    is least, each maximum made smooth over a share of the value (`soft`): without that, few paths
    leave much open, and prices would be in some corner of it.
    """

    def __init__(self, counts: Ints, delta: Floats) -> None:
        """Begin without paths and prices, for groups of so many (G,) aircraft that are alike."""
        self._counts, self._delta = counts, delta
        self._rows: list[int] = []
        self._brought: list[Floats] = []
        self._prices = np.zeros(len(delta))

    def add(self, row: int, brought: Floats) -> None:
        """Add a path of an aircraft of that group."""
        self._rows.append(row)
        self._brought.append(brought)

    def most_after(self, prices: Floats) -> Floats:
        """(G,) what is left of the best path of each group once prices (K,) are paid."""
        most = np.zeros(len(self._counts))
        np.maximum.at(most, self._rows, np.maximum(0.0, np.stack(self._brought) - prices).sum(1))
        return most

    def prices(self, soft: float) -> Floats:
        """Return prices (K,), by Newton steps from the last ones."""
        brought, rows = np.stack(self._brought), np.array(self._rows)
        whose = (rows == np.arange(len(self._counts))[:, None]).astype(np.float64)

        def look(prices: Floats) -> tuple[float, Floats, Floats]:
            """The smooth worth, its gradient (K,) and Hessian; who is taken below 0 is so twice."""
            over, below = (brought - prices) / soft, -prices / soft
            takes, twice = np.where(brought > 0.0, _step(over), 0.0), 2.0 * _step(below)
            after = np.where(brought > 0.0, np.logaddexp(0.0, over), 0.0).sum(axis=1)
            top = np.array([after[mine].max(initial=0.0) for mine in whose > 0.0])
            weight = np.exp(after - top[rows])
            sums = whose @ weight + np.exp(-top)  # or it stays
            worth = top + np.log(sums)
            weight *= (self._counts / sums)[rows]
            mean = (whose * weight) @ takes
            bend = (takes * weight[:, None]).T @ takes - mean.T @ (mean / self._counts[:, None])
            bend += np.diag(weight @ (takes * (1.0 - takes)) + twice * (1.0 - 0.5 * twice))
            return (
                prices.sum() + soft * (self._counts @ worth + 2.0 * np.logaddexp(0.0, below).sum()),
                1.0 - mean.sum(axis=0) - twice,
                bend / soft,
            )

        prices, (worth, slope, bend) = self._prices, look(self._prices)
        for _ in range(MOST_NEWTON):
            step = -np.linalg.solve(bend + _FLAT / soft * np.eye(len(prices)), slope)
            step *= min(1.0, FARTHEST * soft / np.abs(step).max(initial=1e-300))
            gain = -float(slope @ step)
            if gain < NEAR * soft:
                break
            for _ in range(MOST_HALVINGS):
                tried = look(prices + step)
                if tried[0] <= worth - 1e-4 * gain:
                    break
                step, gain = 0.5 * step, 0.5 * gain
            prices, (worth, slope, bend) = prices + step, tried
        self._prices = prices
        # Rounded, so that processors that round otherwise go on alike.
        shares = np.clip(prices / self._delta, 0.0, 1.0).round(ROUNDED)
        return np.asarray(shares * self._delta)


def _step(x: Floats) -> Floats:
    """The derivative of log(1 + exp(x))."""
    return 0.5 + 0.5 * np.tanh(0.5 * x)


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
