"""What `cov` gains where communities live apart: per metre, per round and per joule.

    python docs/studies/apart_gains.py 2a RUNS --out docs/data/apart-runs
    python docs/studies/apart_gains.py 2b FACTORS --out docs/data/apart-factors
    python docs/studies/apart_gains.py 2c RUNS WEIGHTS --out docs/data/apart-weights

RUNS is what `apart_runs.py` left, finished or not: folders, and tables made from them before.
`--out` gets all rounds as one table, rounds.csv.gz, and README.md with the tables of that stage:
docs/data/PLAN.md. What was flown, stage 3, is judged by `apart_flown.py`.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import apart_runs
import numpy as np
import pandas as pd
from study import Floats, ahead, markdown, mean_of, parts, two_sided, write

CELL = ["layout", "N", "K_bar"]
TESTS = 13  # of stage 2, those of 2b too; times so many, no p is less than Holm's
LAST = 10  # rounds that the accuracy at an end is a mean of
WAYS = ("metre", "round", "joule")
TASKS = ("cifar10", "mnist")
NAMES = {"cifar10": "CIFAR-10", "mnist": "MNIST"}


def collected(folders: Sequence[Path]) -> pd.DataFrame:
    """The rounds of all runs that are done, in folders of them or tables of many."""
    files = [
        path
        for given in folders
        for path in (sorted(given.glob("*.csv")) if given.is_dir() else [given])
    ]
    every = pd.concat([pd.read_csv(path) for path in files], ignore_index=True)
    return every.drop_duplicates(ignore_index=True)  # a run may be in a folder and a table


def ends(runs: Sequence[pd.DataFrame], way: str) -> list[int]:
    """How many rounds of each run count: to its own end per metre, else as far as the run that has
    fewest, or that took least energy."""
    if way == "metre":
        return [len(run) for run in runs]
    if way == "round":
        return [min(len(run) for run in runs)] * len(runs)
    least_j = min(float(run.energy_used_j.iloc[-1]) for run in runs)
    return [int((run.energy_used_j <= least_j).sum()) for run in runs]


def accuracy(run: pd.DataFrame, task: str, count: int, *, last: int = LAST) -> float:
    """In percent: mean of the last of `count` rounds."""
    return 100.0 * float(run[f"accuracy_{task}"].iloc[max(0, count - last) : count].mean())


def heard(run: pd.DataFrame, task: str) -> float:
    """In percent: updates that arrived, over devices and rounds."""
    return 100.0 * float(run[f"participation_{task}"].iloc[0])


def whole_cells(
    rounds: pd.DataFrame,
) -> Iterator[tuple[apart_runs.Cell, dict[str, list[pd.DataFrame]]]]:
    """Cells of which every run is done: by strategy its runs in the order of their seeds."""
    by_run = dict(iter(rounds.groupby([*CELL, "strategy", "seed"], sort=False)))
    ideal = apart_runs.CELLS[0]
    for cell in apart_runs.CELLS:
        runs = {}
        for strategy in apart_runs.STRATEGIES:
            at = ideal if strategy == "ideal" else cell
            keys = [(at.layout, at.steps, at.per_step, strategy, seed) for seed in apart_runs.SEEDS]
            runs[strategy] = [by_run[key] for key in keys if key in by_run]
        if all(len(of) == len(apart_runs.SEEDS) for of in runs.values()):
            yield cell, runs


def gains(
    runs: dict[str, list[pd.DataFrame]], other: str, task: str, way: str, *, of: str = "cov"
) -> tuple[Floats, Floats]:
    """(seeds,) points that `of` is ahead of another strategy, and the other's accuracy."""
    pairs = []
    for mine, theirs in zip(runs[of], runs[other], strict=True):
        counts = ends((mine, theirs), way)
        pairs.append(
            [accuracy(run, task, n) for run, n in zip((mine, theirs), counts, strict=True)]
        )
    ahead, level = np.array(pairs).T
    return ahead - level, level


def need_three(whole: int, seeds: Sequence[int]) -> None:
    """An interval of fewer seeds says nothing.

    Raises:
        SystemExit: fewer than three of the seeds have all their runs.
    """
    if whole < 3:
        raise SystemExit(f"{whole} of {len(seeds)} seeds are whole: three are needed")


def gain(of: Floats, level: Floats) -> str:
    share = 100.0 * of.mean() / level.mean()
    return f"{mean_of(of, sign='+')} ({share:+.0f} %, {ahead(of)})"


def name_of(cell: apart_runs.Cell) -> str:
    return f"{cell.layout}, N = {cell.steps}, K_bar = {cell.per_step}"


def _hypotheses(cells: dict[apart_runs.Cell, dict[str, list[pd.DataFrame]]]) -> str:
    corners, mixed = (cells.get(cell) for cell in apart_runs.CELLS[:2])
    if corners is None or mixed is None:
        return "Not yet: corners or its control is not whole."
    at, there = ({w: gains(c, "no_cov", "cifar10", w)[0] for w in WAYS} for c in (corners, mixed))
    more = [len(a) - len(b) for a, b in zip(corners["cov"], corners["no_cov"], strict=True)]
    tested = {
        "H3: corners, per metre, points": at["metre"],
        "H4: corners, per round, points": at["round"],
        "H5: corners, per joule, points": at["joule"],
        "H6: corners, rounds that `cov` has more": np.array(more, dtype=np.float64),
        "H7: per metre, corners less mixed, points": at["metre"] - there["metre"],
        "H8: per round, corners less mixed, points": at["round"] - there["round"],
    }
    rows = []
    for what, of in tested.items():
        p = min(1.0, TESTS * two_sided(of))
        rows.append([what, mean_of(of, sign="+"), f"{p:.1g}", ahead(of)])
    return markdown(["", "mean ± 95 % interval", "p times 13", "seeds above 0"], rows)


def tables(rounds: pd.DataFrame) -> str:
    """README.md of the runs."""
    cells = dict(whole_cells(rounds))
    missing = [name_of(cell) for cell in apart_runs.CELLS if cell not in cells]
    gained, last = [], []
    for cell, runs in cells.items():
        for task in TASKS:
            by_way = [gain(*gains(runs, "no_cov", task, way)) for way in WAYS]
            gained.append([name_of(cell), NAMES[task], *by_way])
            single = [
                accuracy(a, task, len(a), last=1) - accuracy(b, task, len(b), last=1)
                for a, b in zip(runs["cov"], runs["no_cov"], strict=True)
            ]
            last.append([name_of(cell), NAMES[task], mean_of(single)])
    texts = {
        "Hypotheses": _hypotheses(cells),
        "`cov` less `no_cov`, three ways": markdown(
            ["cell", "task", *(f"per {way}" for way in WAYS)], gained
        ),
        "The same of the last round alone, per metre": markdown(["cell", "task", "points"], last),
        "What each strategy comes to": levels(
            {name_of(cell): runs for cell, runs in cells.items()}
        ),
        "Not computed": "\n".join(f"- {name}" for name in missing) or "Nothing is missing.",
    }
    return _HEAD + parts(texts)


def factor_gains(rounds: pd.DataFrame, task: str, way: str) -> Floats:
    """(seeds, treatments) points that `cov` is ahead of `no_cov`, in seeds that are whole."""
    treatments = apart_runs.treatments()
    by_run: dict[tuple[object, ...], pd.DataFrame] = {
        tuple(run.iloc[0][["strategy", "seed", *apart_runs.FACTORS]]): run
        for _, run in rounds.groupby(["strategy", "seed", *apart_runs.FACTORS], sort=False)
    }
    found = []
    for seed in apart_runs.FACTOR_SEEDS:
        runs: dict[str, list[pd.DataFrame]] = {
            strategy: [
                by_run[key]
                for levels in treatments
                if (key := (strategy, seed, *apart_runs.factors(levels).values())) in by_run
            ]
            for strategy in ("cov", "no_cov")
        }
        if all(len(of) == len(treatments) for of in runs.values()):
            found.append(gains(runs, "no_cov", task, way)[0])
    return np.array(found).reshape(-1, len(treatments))


def effects(gained: Floats) -> Floats:
    """(seeds, factors) what a factor's second level adds to the gain, over all treatments."""
    signs = 2.0 * np.array(apart_runs.treatments()) - 1.0
    return gained @ signs / (len(signs) / 2)


def factor_tables(rounds: pd.DataFrame) -> str:
    """README.md of stage 2b.

    Raises:
        SystemExit: no three seeds have all their runs.
    """
    added = {
        (task, way): effects(factor_gains(rounds, task, way)) for task in TASKS for way in WAYS
    }
    seeds = len(added["cifar10", "metre"])
    need_three(seeds, apart_runs.FACTOR_SEEDS)
    rows = []
    for number, (name, factor) in enumerate(apart_runs.FACTORS.items()):
        of = {key: each[:, number] for key, each in added.items()}
        judged = of["cifar10", "metre"]
        first, second = (f"`{level}`".lower() for level in factor.levels)
        rows.append(
            [
                f"H{9 + number}: {name}, {first} to {second}",
                f"{mean_of(judged)}, {ahead(judged)}",
                f"{min(1.0, TESTS * two_sided(judged)):.1g}",
                *(mean_of(of["cifar10", way]) for way in WAYS[1:]),
                *(mean_of(of["mnist", way]) for way in WAYS),
            ]
        )
    ways = [f"{NAMES[task]} per {way}" for task in TASKS for way in WAYS]
    table = markdown(["factor", ways[0], "p times 13", *ways[1:]], rows)
    return _FACTORS_HEAD.format(seeds=seeds, of=len(apart_runs.FACTOR_SEEDS)) + table + "\n"


def of_cell(rounds: pd.DataFrame, cell: apart_runs.Cell) -> pd.DataFrame:
    """The rounds of one cell."""
    here = (rounds.layout == cell.layout) & rounds.N.eq(cell.steps)
    return rounds[here & rounds.K_bar.eq(cell.per_step)]


def weight_tables(rounds: pd.DataFrame) -> str:
    """README.md of stage 2c.

    Raises:
        SystemExit: no three seeds have all their runs.
    """
    cell, strategies = apart_runs.CELLS[0], ("cov", "no_cov", *apart_runs.WEIGHTS)
    by_run = dict(iter(of_cell(rounds, cell).groupby(["strategy", "seed"])))
    whole = [s for s in apart_runs.SEEDS if all((name, s) in by_run for name in strategies)]
    need_three(len(whole), apart_runs.SEEDS)
    runs = {name: [by_run[name, seed] for seed in whole] for name in strategies}
    pieces = [_WEIGHTS_HEAD.format(seeds=len(whole), of=len(apart_runs.SEEDS))]
    for other in ("no_cov", "cov"):
        rows = [
            [
                f"`{name}`",
                NAMES[task],
                *(gain(*gains(runs, other, task, w, of=name)) for w in WAYS),
            ]
            for name in strategies
            for task in TASKS
            if name not in ("no_cov", other)
        ]
        heads = ["weight", "task", *(f"per {way}" for way in WAYS)]
        pieces.append(f"## Points less `{other}`\n\n{markdown(heads, rows)}\n")
    pieces.append(f"## What each comes to\n\n{levels({name_of(cell): runs})}\n")
    return "\n".join(pieces)


def levels(cells: dict[str, dict[str, list[pd.DataFrame]]]) -> str:
    """The table of what each strategy comes to, by cell."""
    rows = [
        [
            cell, f"`{name}`",
            *(mean_of([accuracy(run, task, len(run)) for run in of]) for task in TASKS),
            *(mean_of([heard(run, task) for run in of]) for task in TASKS),
            mean_of([len(run) for run in of]),
        ]
        for cell, runs in cells.items()
        for name, of in runs.items()
    ]  # fmt: skip
    said = [f"{NAMES[task]}{what}, %" for what in ("", " heard") for task in TASKS]
    return markdown(["cell", "strategy", *said, "rounds"], rows)


_WEIGHTS_HEAD = """\
# Other weights where communities live in opposite corners

Made from rounds.csv.gz by `python docs/studies/apart_gains.py 2c`; the runs by
`python docs/studies/apart_runs.py 2c`, not flown, on a tenth of the data, N = 2, K_bar = 3; the
weights are those of `examples/weights.py` and `examples/per_metre.py`. Planned before:
[PLAN](../PLAN.md), stage 2c. {seeds} of {of} seeds are whole.

Mean ± 95 % interval over seeds; in brackets over the other's mean, and in how many seeds ahead.
"""

_FACTORS_HEAD = """\
# What moves the gain where communities live in opposite corners

Made from rounds.csv.gz by `python docs/studies/apart_gains.py 2b`; the runs by
`python docs/studies/apart_runs.py 2b`, not flown, on a tenth of the data, N = 2, K_bar = 3. Planned
before: [PLAN](../PLAN.md), stage 2b: a 2^(7-3) fractional factorial of resolution IV. {seeds} of
{of} seeds are whole.

Points that the second level of a factor adds to the gain of `cov` over `no_cov`, mean ± 95 %
interval over seeds. Per metre, CIFAR-10, is what is tested; all else is exploratory.

"""

_HEAD = """\
# Who learns what where communities live apart

Made from rounds.csv.gz by `python docs/studies/apart_gains.py 2a`; the runs by
`python docs/studies/apart_runs.py 2a`, not flown, on a tenth of the data. Planned before:
[PLAN](../PLAN.md), stage 2a.

Accuracy: on held-out images, mean of the last ten rounds that count. Per metre: when 40 km are
spent. Per round: after as many rounds as the shorter run has. Per joule: up to what the cheaper run
took in all. In brackets: over `no_cov`'s mean, and in how many seeds `cov` is ahead. `cifar10_only`
gives MNIST's devices no importance; `ideal` hears everybody in 50 rounds, whatever the cell. A p
times thirteen, the tests of the stage, is at least what Holm makes of it.
"""


def main() -> None:
    """Collect and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stage", choices=("2a", "2b", "2c"))
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUNS")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    options = parser.parse_args()
    rounds = collected(options.runs)
    if options.stage == "2c":
        rounds = of_cell(rounds, apart_runs.CELLS[0])
    made = {"2a": tables, "2b": factor_tables, "2c": weight_tables}[options.stage]
    write(options.out, made(rounds), rounds=rounds)


if __name__ == "__main__":
    main()
