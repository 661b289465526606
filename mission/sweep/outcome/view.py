"""The table at the end of a sweep."""

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table

from mission.sweep.outcome.curves import communities_of, groups_of
from mission.sweep.outcome.stats import Interval, interval
from mission.sweep.results import FINAL_ROUNDS, RunResult


def final_table(results: Sequence[RunResult]) -> Table:
    """A row for each strategy and setting: means over the seeds, with 95 % intervals."""
    communities = communities_of(results)
    table = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        caption=f"accuracy: {final_rounds(results)}; mean over seeds ± 95 % interval",
        caption_justify="left",
    )
    # Where room is short the names are broken: a number that is cut is another number.
    table.add_column("strategy", overflow="fold")
    for name in ("seeds", *(f"{name}\n%" for name in communities)):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("delivered\n%", "took part\n%", "flown\nkm"):
        table.add_column(name, justify="right", no_wrap=True)
    for label, runs in groups_of(results).items():
        table.add_row(
            label,
            str(len(runs)),
            *(percent(over_seeds(runs, f"final_accuracy_{name}")) for name in communities),
            number(over_seeds(runs, "delivered_share"), 1, unit=0.01),
            number(over_seeds(runs, "participation"), 1, unit=0.01),
            number(over_seeds(runs, "flown_m"), 1, unit=1000.0),
        )
    return table


def final_rounds(results: Sequence[RunResult]) -> str:
    """The rounds of which a final value is the mean, in words."""
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


def number(value: Interval, digits: int, *, unit: float = 1.0) -> str:
    """The mean alone, in units of `unit`; `-` without a value."""
    return "-" if math.isnan(value.mean) else f"{value.mean / unit:.{digits}f}"


def percent(value: Interval, *, signed: bool = False) -> str:
    """`41.2 ± 1.3`; without an interval for a single seed, `-` without a value."""
    if math.isnan(value.mean):
        return "-"
    half = "" if math.isnan(value.half) else f" ± {100 * value.half:.1f}"
    return f"{100 * value.mean:{'+' if signed else ''}z.1f}{half}"
