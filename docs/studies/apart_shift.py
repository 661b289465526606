"""How far weights move who is heard, by a screen of planned rounds: its tables and picture."""

import numpy as np
import pandas as pd
from study import ahead, holm, markdown, mean_of, parts, two_sided

FACTORS = ("steps", "per_step", "channel", "planner", "path_budget_m", "boost", "ratio")
BASE = (2, 3, "suburban", "certified", 800.0, 1.5, 3.0)
L_TOTAL_M, MOST_ROUNDS = (10e3, 20e3, 40e3), 400
# What goes forward: docs/data/PLAN.md, stage 1.
LEAST_SHIFT, MOST_BEFORE, MOST_STEPS, MOST_CELLS = 10.0, 85.0, 4, 12

LAYOUTS = ("mixed", "halves", "corners", "rim", "clusters")
TITLES = {
    "steps": "N",
    "per_step": "K_bar",
    "channel": "channel",
    "planner": "planner",
    "path_budget_m": "L_max, m",
    "boost": "lambda",
    "ratio": "importance ratio",
}


def shifts(rows: pd.DataFrame) -> pd.DataFrame:
    """A row a setting, ratio above 1 and seed: in percent, and metres; `_1` is with ratio 1."""
    rows = rows.rename(
        columns={"participation_cifar10": "cifar10", "participation_mnist": "mnist"}
    ).assign(cifar10=lambda r: 100.0 * r.cifar10, mnist=lambda r: 100.0 * r.mnist)
    by = ["layout", *FACTORS[:-1], "seed"]
    level = rows[rows.ratio == 1.0].drop(columns="ratio")
    found = rows[rows.ratio != 1.0].merge(level, on=by, suffixes=("", "_1"), validate="m:1")
    return found.assign(shift=found.cifar10 - found.cifar10_1)


def base_but(found: pd.DataFrame, *free: str) -> pd.DataFrame:
    """The rows that differ from the base in the factors `free` at most."""
    keep = np.ones(len(found), dtype=bool)
    for factor, value in zip(FACTORS, BASE, strict=True):
        keep &= (factor in free) | (found[factor] == value).to_numpy()
    return found[keep]


def forward(found: pd.DataFrame) -> pd.DataFrame:
    """The cells of the full grid that a sweep goes on with, by the rule of the plan, best first."""
    full = base_but(found, "steps", "per_step")
    cells = full.groupby(["layout", "steps", "per_step"], as_index=False, sort=False).mean(
        numeric_only=True
    )
    passed = cells[
        (cells["shift"] >= LEAST_SHIFT)
        & (cells.cifar10_1 <= MOST_BEFORE)
        & (cells.steps <= MOST_STEPS)
    ].sort_values("shift", ascending=False, kind="stable")
    firsts = passed.drop_duplicates("layout")
    rest = passed.drop(firsts.index).head(max(0, MOST_CELLS - len(firsts)))
    return passed.loc[passed.index.isin([*firsts.index, *rest.index])]


_HEAD = """\
# Where weights can move anything

Made from screen.csv by `python docs/studies/apart.py --out docs/data/apart-screen`. Planned before:
[PLAN](../PLAN.md), stage 1; what it says: [The paper's experiment, reproduced][page].

Shift: CIFAR-10's participation with its devices three times as important as MNIST's, less that with
all alike, in points; mean of {draws} draws (lowest to highest).

[page]: ../../reproduction.md#where-weights-can-move-anything
"""
_METRES = """\
N = 2, K_bar = 3: metres of a round, and rounds that L_total pays for (400 at most), ratio 1 → 3.
"""


def tables(rows: pd.DataFrame) -> str:
    """README.md of a screen."""
    found = shifts(rows)
    texts = {
        "Hypotheses": _hypotheses(found),
        "Layout, N and K_bar": "Below the shift: CIFAR-10's participation, in percent. Bold: goes "
        f"forward.\n\n{_full(found)}",
        "The other factors, one at a time": _alone(found),
        "Metres and rounds": f"{_METRES}\n{_rounds(found)}",
        "What goes forward": _forward(found),
    }
    head = _HEAD.format(draws=found.seed.nunique())
    return head + parts(texts)


def _hypotheses(found: pd.DataFrame) -> str:
    by_seed = {
        layout: base_but(found)[lambda r, layout=layout: r.layout == layout].set_index("seed")
        for layout in ("corners", "mixed")
    }
    tested = {
        "H1: shift in corners less mixed, points": by_seed["corners"]["shift"]
        - by_seed["mixed"]["shift"],
        "H2: corners, round with ratio 1 less ratio 3, m": by_seed["corners"].path_m_1
        - by_seed["corners"].path_m,
    }
    values = [of.to_numpy(dtype=np.float64) for of in tested.values()]
    corrected = holm([two_sided(of) for of in values])
    rows = [
        [what, mean_of(of, sign="+"), f"{p:.1g}", ahead(of)]
        for what, of, p in zip(tested, values, corrected, strict=True)
    ]
    return markdown(["", "mean ± 95 % interval", "p (Holm)", "draws above 0"], rows)


def _full(found: pd.DataFrame) -> str:
    full = base_but(found, "steps", "per_step")
    chosen = set(forward(found)[["layout", "steps", "per_step"]].itertuples(index=False, name=None))
    per_step = sorted(full.per_step.unique())
    rows = []
    for (layout, steps), of in full.groupby(["layout", "steps"], sort=False):
        cells = [
            _shift(of[of.per_step == k], bold=(layout, steps, k) in chosen, both=True)
            for k in per_step
        ]
        rows.append([str(layout), str(steps), *cells])
    return markdown(["layout", "N", *(f"K_bar = {k}" for k in per_step)], rows)


def _shift(of: pd.DataFrame, *, bold: bool = False, both: bool = False) -> str:
    star = "**" if bold else ""
    low, high = of["shift"].min(), of["shift"].max()
    words = f"{star}{of['shift'].mean():+z.1f}{star} ({low:z.0f} to {high:z.0f})"
    return f"{words}<br>{of.cifar10_1.mean():.0f} → {of.cifar10.mean():.0f}" if both else words


def _alone(found: pd.DataFrame) -> str:
    rows = []
    for factor in FACTORS:
        some = base_but(found, factor)
        for value, of in some.groupby(factor, sort=False):
            by_layout = [_shift(of[of.layout == layout]) for layout in LAYOUTS]
            rows.append([TITLES[factor], level_name(value), *by_layout])
    return markdown(["factor", "level", *LAYOUTS], rows)


def level_name(value: object) -> str:
    """A value of a factor, as it is printed."""
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def rounds_paid(path_m: "pd.Series[float]", total_m: float) -> "pd.Series[float]":
    """Rounds of so many metres that a budget pays for."""
    return (total_m / path_m.clip(lower=total_m / MOST_ROUNDS)).astype(float)


def _rounds(found: pd.DataFrame) -> str:
    rows = []
    for layout, of in base_but(found).groupby("layout", sort=False):
        paid = [
            " → ".join(f"{rounds_paid(m, total_m).mean():.0f}" for m in (of.path_m_1, of.path_m))
            for total_m in L_TOTAL_M
        ]
        rows.append([str(layout), f"{of.path_m_1.mean():.0f} → {of.path_m.mean():.0f}", *paid])
    heads = (f"rounds, {total_m / 1e3:.0f} km" for total_m in L_TOTAL_M)
    return markdown(["layout", "metres", *heads], rows)


def _forward(found: pd.DataFrame) -> str:
    rows = [
        [
            str(cell.layout), str(cell.steps), str(cell.per_step), f"{cell.shift:+.1f}",
            f"{cell.cifar10_1:.0f} → {cell.cifar10:.0f}", f"{cell.mnist_1:.0f} → {cell.mnist:.0f}",
            f"{cell.path_m_1:.0f} → {cell.path_m:.0f}",
        ]
        for cell in forward(found).itertuples()
    ]  # fmt: skip
    heads = ["layout", "N", "K_bar", "shift", "CIFAR-10, %", "MNIST, %", "metres a round"]
    return markdown(heads, rows)
