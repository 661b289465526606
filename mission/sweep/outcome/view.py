"""The outcome of a sweep as a table: its columns, declared once, and how values are written."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rich import box
from rich.table import Table

from mission.base.tables import number
from mission.sweep.outcome.curves import Interval, groups_of, interval
from mission.sweep.results import EQUAL, RunResult, communities_of

Cells: TypeAlias = tuple[list[str], list[list[str]]]  # heads, rows


@dataclass(frozen=True)
class Column:
    """A column of `runs.csv` over the seeds; `{}` in it stands for each community in turn."""

    name: str
    head: str
    digits: int | None = None  # of the mean alone; None: percent, with its interval
    unit: float = 1.0

    def cell(self, runs: Sequence[RunResult], community: str) -> str:
        """Text of the column's cell for a group of runs."""
        value = over_seeds(runs, self.name.format(community))
        return (
            percent(value) if self.digits is None else number(value.mean / self.unit, self.digits)
        )


ACCURACY = (
    Column("final_accuracy_{}", "{} %"),
    *(Column(f"equal_{what}_accuracy_{{}}", f"{{}} % at equal {what}") for what in EQUAL),
)
FAIRNESS = (
    Column("final_cov_{}", "CoV {}", 2),
    Column("final_jain_communities", "Jain", 3),
)
REST = (
    Column("participation_{}", "{} arrived %"),
    Column("delivered_share", "scheduled arrived %"),
    Column("plan_per", "PER planned", 3),
    Column("true_per", "PER true", 3),
    Column("rounds", "rounds", 0),
    Column("flown_m", "km of path", 1, unit=1000.0),
    Column("energy_j", "kJ flown", 0, unit=1000.0),
)
AT_THE_END = "accuracy: after the last round"
_TERMINAL = (
    Column("final_accuracy_{}", "{}\n%"),
    Column("delivered_share", "delivered\n%", 1, unit=0.01),
    Column("participation", "partici-\npation %", 1, unit=0.01),
    Column("flown_m", "path\nkm", 1, unit=1000.0),
    Column("energy_j", "energy\nkJ", 0, unit=1000.0),
)


def outcome(
    results: Sequence[RunResult], columns: Sequence[Column], *, seeds: Callable[[str], str]
) -> Cells:
    """Make a table, a row for each strategy and setting; `seeds` counts the seeds of a group.

    Columns for which no run has a number are left out, such as energy where nothing was flown.
    """
    each = [
        (column, name)
        for column in columns
        for name in (communities_of(results) if "{}" in column.name else ("",))
        if _values(results, column.name.format(name))
    ]
    heads = ["strategy", "seeds", *(column.head.format(name) for column, name in each)]
    rows = [
        [label, seeds(label), *(column.cell(runs, name) for column, name in each)]
        for label, runs in groups_of(results).items()
    ]
    return heads, rows


def final_table(results: Sequence[RunResult]) -> Table:
    """Make the table for the terminal: means over the seeds, with 95 % intervals."""
    groups = groups_of(results)
    (first, *heads), rows = outcome(results, _TERMINAL, seeds=lambda name: str(len(groups[name])))
    table = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        caption=f"{AT_THE_END}; mean over seeds ± 95 % interval",
        caption_justify="left",
    )
    # Where room is short the names are broken: a number that is cut is another number.
    table.add_column(first, overflow="fold")
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def over_seeds(runs: Sequence[RunResult], column: str) -> Interval:
    """Return mean and interval, over the runs that have a number there, of a column of `runs.csv`
    or of accuracy at equal rounds, metres or energy."""
    return interval(_values(runs, column))


def _values(runs: Sequence[RunResult], column: str) -> list[float]:
    rows = (run.summary | run.equal for run in runs)
    found = (float(row.get(column, math.nan)) for row in rows)
    return [value for value in found if not math.isnan(value)]


def percent(value: Interval, *, signed: bool = False) -> str:
    """Format in percent: `41.2 ± 1.3`; no interval below three values, `-` without a value."""
    if math.isnan(value.mean):
        return "-"
    half = "" if math.isnan(value.half) else f" ± {100 * value.half:.1f}"
    return f"{points(value.mean, signed=signed)}{half}"


def points(share: float, *, signed: bool = False) -> str:
    """A share as percent or points, `+1.2` where `signed`; what rounds to 0 has no sign."""
    shown = f"{100 * share:z.1f}"
    return f"+{shown}" if signed and float(shown) > 0.0 else shown
