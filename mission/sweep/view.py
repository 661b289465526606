"""The table at the end of a sweep."""

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table

from mission.sweep.curves import communities_of, groups_of
from mission.sweep.results import FINAL_ROUNDS, RunResult
from mission.sweep.stats import Interval, interval

_NUMBER = len("41.2 ± 11.3")


def final_table(results: Sequence[RunResult]) -> Table:
    """A row for each strategy and setting: means over the seeds, with 95 % intervals."""
    communities = communities_of(results)
    table = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        caption=f"accuracy: {final_rounds(results)}; mean over seeds ± 95 % interval",
        caption_justify="left",
    )
    table.add_column("strategy")
    table.add_column("seeds", justify="right")
    for name in communities:
        table.add_column(f"{name} %", justify="right", min_width=_NUMBER)
    for name in ("delivered", "participation", "metres flown"):
        table.add_column(name, justify="right")
    for label, runs in groups_of(results).items():
        means = {
            key: interval([float(run.summary[key]) for run in runs]).mean
            for key in ("delivered_share", "participation", "flown_m")
        }
        table.add_row(
            label,
            str(len(runs)),
            *(percent(over_seeds(runs, f"final_accuracy_{name}")) for name in communities),
            f"{100 * means['delivered_share']:.1f} %",
            f"{100 * means['participation']:.1f} %",
            f"{means['flown_m']:.0f}",
        )
    return table


def final_rounds(results: Sequence[RunResult]) -> str:
    """Of which rounds a final value is the mean, in words."""
    lengths = {len(run.rounds) for run in results}
    if min(lengths) >= FINAL_ROUNDS:
        return f"mean of the last {FINAL_ROUNDS} rounds"
    if lengths == {1}:
        return "after the only round"
    if len(lengths) == 1:
        return f"mean of all {min(lengths)} rounds"
    return f"mean of the last {FINAL_ROUNDS} rounds, or of all where a run has fewer"


def over_seeds(runs: Sequence[RunResult], column: str) -> Interval:
    """Mean and interval of a column of `runs.csv`, over the runs that have it."""
    return interval([float(run.summary[column]) for run in runs if column in run.summary])


def percent(value: Interval, *, signed: bool = False) -> str:
    """`41.2 ± 1.3`; without an interval for a single seed, `-` without a value."""
    if math.isnan(value.mean):
        return "-"
    half = "" if math.isnan(value.half) else f" ± {100 * value.half:.1f}"
    return f"{100 * value.mean:{'+' if signed else ''}z.1f}{half}"
