"""What was flown where communities live apart, judged in the words of docs/data/PLAN.md, stage 3.

    python docs/apart_flown.py FLOWN --out docs/data/apart-flown --figures docs/images

FLOWN is what `apart_runs.py 3` left, as for `apart_gains.py`, whose measures these are.
"""

import argparse
from itertools import product
from pathlib import Path

import apart_runs
import pandas as pd
from apart_gains import (
    CELL,
    NAMES,
    TASKS,
    WAYS,
    Floats,
    collected,
    gain,
    gains,
    levels,
    name_of,
    need_three,
    write,
)  # fmt: skip
from apart_shift import corrected_half, holm, markdown, two_sided

from mission.figures.charts import DotRow, dot_rows
from mission.figures.render import save_all
from mission.figures.style import COOL, WARM, WIDTH, Chart, arranged, heading
from mission.sweep.outcome.curves import interval

CLAIM, MOST_LOST = 0.14, 2.0  # the paper's relative gain; points of MNIST that it may cost


def verdict_of(ahead: Floats, level: Floats, mnist: Floats, p: float) -> str:
    """PLAN's words for a cell and a way, by p as Holm corrects it."""
    found, price = interval(ahead), interval(mnist)
    claimed = CLAIM * level.mean()
    refused = "; 14 % refused" if claimed > found.mean + found.half else ""
    if p >= 0.05 or found.mean <= 0.0:
        return f"not shown{refused}"
    if found.mean < claimed:
        return f"ahead{refused}"
    free = price.mean + price.half >= 0.0 and price.mean >= -MOST_LOST
    return "the claim holds" if free else "at a price"


def cells_of(rounds: pd.DataFrame) -> dict[str, dict[str, list[pd.DataFrame]]]:
    """The runs of stage 3 by cell and strategy, one a seed that is whole; last, the first cell with
    the paper's planner.

    Raises:
        SystemExit: no three seeds have all their runs.
    """
    by_run = dict(iter(rounds.groupby([*CELL, "planner", "strategy", "seed"])))
    wanted = [task.values for task in apart_runs.judging_tasks()]
    done = {(strategy, seed, *cell, planner) for *cell, planner, strategy, seed in by_run}
    every = apart_runs.JUDGING_SEEDS
    whole = [s for s in every if all(task in done for task in wanted if task[1] == s)]
    need_three(len(whole), every)

    def runs_of(cell: apart_runs.Cell, planner: str, *names: str) -> dict[str, list[pd.DataFrame]]:
        at = cell.layout, cell.steps, cell.per_step, planner
        return {name: [by_run[(*at, name, seed)] for seed in whole] for name in names}

    first = apart_runs.JUDGED[0]
    names = ("cov", "no_cov", "rectangular", "barycenter")
    cells = {name_of(cell): runs_of(cell, "certified", *names) for cell in apart_runs.JUDGED}
    cells[name_of(first)] |= runs_of(first, "certified", "ideal")
    return cells | {
        f"{name_of(first)}, the paper's planner": runs_of(first, "paper", "cov", "no_cov")
    }


def picture(rounds: pd.DataFrame) -> Chart:
    """A panel a cell: what `cov` gains on `no_cov`, by task and way."""
    cells, colours, panels = cells_of(rounds), {"cifar10": WARM, "mnist": COOL}, []
    for cell, runs in cells.items():
        rows = []
        for task, way in product(TASKS, WAYS):
            ahead, _ = gains(runs, "no_cov", task, way)
            of = interval(ahead)
            ends = of.mean - of.half, of.mean + of.half
            name = f"{NAMES[task]} per {way}"
            rows.append(DotRow(name, colours[task], tuple(ahead), of.mean, ends))
        panel = dot_rows(cell, rows, x="accuracy, points", zero=True)
        panel["width"] = WIDTH / 2
        panels.append(panel)
    scales = [layer["encoding"]["x"]["scale"] for p in panels for layer in p["layer"]]
    ends = [scale["domain"] for scale in scales]
    for scale in scales:  # one for all
        scale["domain"] = [min(map(min, ends)), max(map(max, ends))]
    title = heading("Flown: what cov gains on no_cov where communities live in corners")
    return arranged(panels, how="hconcat", spacing=24, title=title)


def tables(rounds: pd.DataFrame) -> str:
    """README.md of stage 3.

    Raises:
        SystemExit: as `cells_of`.
    """
    every = cells_of(rounds)
    *cells, last = every
    paper, first = every[last], cells[0]
    tested = {
        (name, f"{number}, {way}, less {other}"): (runs, other, way)
        for name, runs in ((name, every[name]) for name in cells)
        for number, way, other in (
            ("H16", "metre", "no_cov"), ("H17", "round", "no_cov"), ("H18", "joule", "no_cov"),
            ("H20", "metre", "rectangular"), ("H21", "metre", "barycenter"),
        )
    }  # fmt: skip
    tested[first, "H19, metre, less no_cov, paper's planner"] = (paper, "no_cov", "metre")
    found = {
        what: gains(runs, other, "cifar10", way) for what, (runs, other, way) in tested.items()
    }
    rows = []
    every_p = [two_sided(ahead) for ahead, _ in found.values()]
    for index, (p, (what, (runs, other, way))) in enumerate(
        zip(holm(every_p), tested.items(), strict=True)
    ):
        (ahead, level), (mnist, there) = found[what], gains(runs, other, "mnist", way)
        half = corrected_half(ahead, every_p, index)
        ends = f"{ahead.mean() - half:+.1f} to {ahead.mean() + half:+.1f} (p {p:.1g})"
        verdict = verdict_of(ahead, level, mnist, p)
        rows.append([*what, gain(ahead, level), ends, gain(mnist, there), verdict])
    seeds, wanted = len(paper["cov"]), len(apart_runs.JUDGING_SEEDS)
    undecided = "" if seeds == wanted else "; until all are, nothing is decided"
    heads = ["cell", "hypothesis, per", "CIFAR-10", "corrected by Holm", "MNIST", "in PLAN's words"]
    head = _HEAD.format(seeds=seeds, of=wanted, undecided=undecided)
    return f"{head}\n{markdown(heads, rows)}\n\n## What each comes to\n\n{levels(every)}\n"


_HEAD = """\
# Flown, on all data: where communities live in opposite corners

Made from rounds.csv.gz by `python docs/apart_flown.py`; the runs by `python docs/apart_runs.py
3`. Planned before: [PLAN](../PLAN.md), stage 3. {seeds} of {of} seeds are whole{undecided}.

Points that `cov` is ahead, mean ± 95 % interval over seeds; in brackets over the other's mean, and
in how many seeds ahead; then CIFAR-10's interval at the level at which Holm tests it.
"""


def main() -> None:
    """Judge, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("runs", type=Path, nargs="+", metavar="FLOWN")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="draw into it")
    options = parser.parse_args()
    rounds = collected(options.runs)
    write(options.out, rounds, tables(rounds))
    if options.figures:
        save_all({"apart-flown.png": picture(rounds)}, options.figures)


if __name__ == "__main__":
    main()
