"""Runs where communities live apart: who learns what; all but those of stage 3 not flown, on small
data.

    python docs/studies/apart_runs.py 2a --data-dir DATA --out RUNS --jobs 2 [--cells 3]
    python docs/studies/apart_runs.py 2b --data-dir DATA --out FACTORS --jobs 2
    python docs/studies/apart_runs.py 2c --data-dir DATA --out WEIGHTS --jobs 2
    python docs/studies/apart_runs.py 3 --data-dir DATA --out FLOWN --jobs 2

DATA holds MNIST and CIFAR-10; a tenth of each is used. CIFAR-10 is best unpacked: half of a run is
reading it from an archive. `--out` gets a table a run, with a row a round. Runs that are there
already are kept, so the command goes on where it was cut off; so are those of `--known TABLE`, such
as docs/data/apart-runs/rounds.csv.gz. What is run, in which order and why, was written before:
docs/data/PLAN.md, stages 2 and 3. A run of stage 3 is flown, on all data, and takes minutes.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import apart
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from study import csv, finished, in_parallel

import aerofed
from mission.base.run_folder import RunFolder, write_atomically
from mission.sweep.grid import Point
from mission.sweep.results import read_run

SEEDS = range(201, 217)
FACTOR_SEEDS = range(201, 209)
JUDGING_SEEDS = range(301, 313)
ONLY = "cifar10_only"  # the ceiling of weights: all importance is CIFAR-10's
STRATEGIES = ("cov", "no_cov", ONLY, "ideal")
WEIGHTS = {
    "sqrt_cov": "examples.weights:sqrt_cov",
    "worst_device": "examples.weights:worst_device",
    "per_metre": "examples.per_metre:per_metre",
}
KEYS = ("strategy", "seed", "layout", "N", "K_bar")
SPENT = ("budget_used_m", "energy_used_j")
LEARNT = ("accuracy_cifar10", "accuracy_mnist")
Level = float | bool | str
HEARD = ("participation_cifar10", "participation_mnist")  # of the whole run


@dataclass(frozen=True)
class Cell:
    """A setting that goes forward from stage 1."""

    layout: str
    steps: int  # N
    per_step: int  # K_bar


# In the order in which they are run, each whole before the next: the cell of the hypotheses and its
# control, then the best cell of each other layout, then the rest by their shift.
CELLS = (
    Cell("corners", 2, 3), Cell("mixed", 2, 3), Cell("clusters", 2, 3), Cell("halves", 2, 3),
    Cell("rim", 2, 2), Cell("mixed", 3, 2), Cell("mixed", 3, 3), Cell("clusters", 2, 4),
    Cell("corners", 2, 2), Cell("halves", 2, 4), Cell("corners", 3, 2), Cell("clusters", 3, 2),
    Cell("halves", 3, 2), Cell("corners", 4, 2),
)  # fmt: skip


# Those of the largest lower end of H3's interval among all whose ceiling is at least 3 %.
JUDGED = (Cell("corners", 2, 3), Cell("corners", 2, 2))


@dataclass(frozen=True)
class Factor:
    """What the paper leaves open or gives no reason for: its usual level, and another."""

    keys: tuple[str, ...]
    levels: tuple[Level, Level]


FACTORS = {
    "lambda": Factor(("learning.importance_boost",), (1.5, 3.0)),
    "l": Factor(("learning.cov_period_rounds",), (4, 1)),
    "epochs": Factor(("learning.local_epochs",), (1, 5)),
    "coverage": Factor(("communities.0.coverage", "communities.1.coverage"), (False, True)),
    "cov_floor": Factor(("learning.cov_floor",), (0.1, 0.01)),
    "missed": Factor(("learning.missed",), ("lost-too", "unscheduled")),
    "cov_unheard": Factor(("learning.cov_unheard",), ("left-out", "zero")),
}


def factors(levels: Sequence[int] | None) -> dict[str, Level]:
    """The value of each factor; stage 2a has none."""
    if levels is None:
        return {}
    found = zip(FACTORS.items(), levels, strict=True)
    return {name: factor.levels[level] for (name, factor), level in found}


def treatments() -> list[tuple[int, ...]]:
    """The level of each factor in each of the sixteen treatments of a 2^(7-3) fractional factorial.

    Its generators are E = ABC, F = BCD, G = ACD: main effects are free of pairs (resolution IV).
    """
    return [
        (a, b, c, d, a ^ b ^ c, b ^ c ^ d, a ^ c ^ d) for a, b, c, d in product((0, 1), repeat=4)
    ]


@dataclass(frozen=True)
class _Only:
    planner: aerofed.Planner
    fairness: bool = True
    approach_m: NDArray[np.float64] | None = None

    def importance(self, info: aerofed.RoundInfo) -> NDArray[np.float64]:
        return info.delta * (info.community_of == 0)

    def sortie(self, _: int, problem: aerofed.RoundProblem) -> aerofed.Sortie:
        return aerofed.Sortie(self.planner.plan(problem))


def cifar10_only(context: aerofed.StrategyContext) -> aerofed.Strategy:
    """The strategy to which MNIST's devices are worth nothing."""
    return _Only(context.planner)


@dataclass(frozen=True)
class Task:
    """One run; in stage 2b with the factors at these levels."""

    cell: Cell
    strategy: str
    seed: int
    levels: tuple[int, ...] | None = None
    planner: str | None = None  # of a run of stage 3: flown, all data

    @property
    def point(self) -> Point:
        """What tells the run from the others, as it stands in the tables."""
        settings = (
            ("layout", self.cell.layout),
            ("N", self.cell.steps),
            ("K_bar", self.cell.per_step),
            *factors(self.levels).items(),
            *([] if self.planner is None else [("planner", self.planner)]),
        )
        return Point(self.strategy, self.seed, settings)

    @property
    def values(self) -> tuple[object, ...]:
        """What tells the run from the others: `KEYS`, then `FACTORS` or the planner."""
        point = self.point
        return point.strategy, point.seed, *(value for _, value in point.settings)

    def config(self) -> aerofed.RunConfig:
        """`paper-sweep` with the devices where the layout has them."""
        places = apart.positions_m(self.cell.layout, self.seed).round(3).tolist()
        strategy = {ONLY: f"apart_runs:{ONLY}", **WEIGHTS}.get(self.strategy, self.strategy)
        flown = self.planner is not None
        return aerofed.config(
            "paper-sweep",
            {
                "seed": self.seed,
                "mission.strategy": strategy,
                "mission.flight": "flown" if flown else "none",
                "planner.kind": self.planner or "certified",
                "mission.steps": self.cell.steps,
                "mission.devices_per_step": self.cell.per_step,
                "communities.0.subset": 1.0 if flown else 0.1,
                "communities.1.subset": 1.0 if flown else 0.1,
                "communities.0.positions_m": places[: apart.EACH],
                "communities.1.positions_m": places[apart.EACH :],
                **{
                    key: value
                    for name, value in factors(self.levels).items()
                    for key in FACTORS[name].keys
                },
            },
        )


def tasks(cells: int) -> Iterator[Task]:
    """The runs of the first cells. The ideal knows no cell, so the first has all of it."""
    for cell, seed, strategy in product(CELLS[:cells], SEEDS, STRATEGIES):
        if strategy != "ideal" or cell == CELLS[0]:
            yield Task(cell, strategy, seed)


def factor_tasks() -> Iterator[Task]:
    """The runs of stage 2b: all treatments of a seed before the next."""
    for seed, levels, strategy in product(FACTOR_SEEDS, treatments(), ("cov", "no_cov")):
        yield Task(CELLS[0], strategy, seed, levels)


def weight_tasks() -> Iterator[Task]:
    """The runs of stage 2c, in the cell of the hypotheses."""
    for seed, strategy in product(SEEDS, WEIGHTS):
        yield Task(CELLS[0], strategy, seed)


def judging_tasks() -> Iterator[Task]:
    """The runs of stage 3: all of a seed before the next. The ideal knows no cell."""
    for seed in JUDGING_SEEDS:
        for cell, strategy in product(JUDGED, ("cov", "no_cov", "rectangular", "barycenter")):
            yield Task(cell, strategy, seed, planner="certified")
        yield Task(JUDGED[0], "ideal", seed, planner="certified")
        for strategy in ("cov", "no_cov"):
            yield Task(JUDGED[0], strategy, seed, planner="paper")


def run(task: Task, data_dir: Path) -> pd.DataFrame:
    """The rounds of a run.

    Raises:
        RuntimeError: the run failed, with what it said.
    """
    with finished(
        task.config(), task.point.name, data_dir=data_dir, code=Path(__file__).parent
    ) as path:
        found = read_run(RunFolder(path), task.point)
    rounds = pd.DataFrame(found.rounds)[[*task.point.keys, "round", *SPENT, *LEARNT]]
    heard = {name: round(float(found.summary[name]), 4) for name in HEARD}
    return rounds.round({"budget_used_m": 2, "energy_used_j": 1} | dict.fromkeys(LEARNT, 4)).assign(
        **heard
    )


def known(tables: Sequence[Path]) -> set[tuple[object, ...]]:
    """The values that tell runs apart, of all runs in the tables of `apart_gains.py`."""
    found: set[tuple[object, ...]] = set()
    for table in map(pd.read_csv, tables):
        keys = [name for name in (*KEYS, *FACTORS, "planner") if name in table]
        found |= set(table[keys].drop_duplicates().itertuples(index=False, name=None))
    return found


def _made(task: Task, data_dir: Path, path: Path) -> str:
    write_atomically(path, csv(run(task, data_dir)))
    return path.name


def main() -> None:
    """Run what was not yet."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stage", choices=("2a", "2b", "2c", "3"))
    parser.add_argument("--data-dir", type=Path, required=True, metavar="DATA")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--known", type=Path, nargs="+", default=[], metavar="TABLE")
    parser.add_argument("--cells", type=int, default=len(CELLS), help="2a: the first so many")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    stages = {
        "2a": tasks(options.cells),
        "2b": factor_tasks(),
        "2c": weight_tasks(),
        "3": judging_tasks(),
    }
    done = known(options.known)
    in_parallel(
        options.jobs,
        (
            (_made, (task, options.data_dir, path))
            for task in stages[options.stage]
            if task.values not in done
            and not (path := options.out / f"{task.point.name}.csv").exists()
        ),
    )


if __name__ == "__main__":
    main()
