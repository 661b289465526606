"""The outcome of a sweep as tables: columns, declared once, and how values are written.

The method is compared with every other strategy within a seed, which fixes device positions, labels
and samples, so that the difference is free of most of what makes seeds differ.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rich import box
from rich.table import Table

from mission.base.tables import number
from mission.sweep.outcome.curves import Interval, groups_of, interval
from mission.sweep.results import EQUAL, RunResult, at_equal, communities_of, differ

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


METHOD = "cov"
POINTS = (
    "points: mean difference within a seed, ± 95 % interval from three seeds on (Student's t); "
    "relative: that mean as a share of the other's accuracy; each is rounded by itself"
)


@dataclass(frozen=True)
class Gain:
    """Final accuracy of one community: the method's less another strategy's, same settings."""

    other: str
    settings: str
    community: str
    pairs: tuple[tuple[RunResult, RunResult], ...]  # the method's run and the other, one a seed

    @property
    def label(self) -> str:
        """The other group: strategy and settings."""
        return f"{self.other}, {self.settings}" if self.settings else self.other

    @property
    def finals(self) -> tuple[tuple[float, float], ...]:
        """Final accuracies of the method and the other, a pair for each seed."""
        column = f"final_accuracy_{self.community}"
        return tuple((float(a.summary[column]), float(b.summary[column])) for a, b in self.pairs)

    @property
    def differences(self) -> tuple[float, ...]:
        """The method's final accuracy less the other's, for each seed."""
        return tuple(mine - other for mine, other in self.finals)

    def at_equal(self, what: str) -> tuple[float, ...]:
        """Return accuracy differences at equal `what` (see `EQUAL`): where the cheaper run ends."""
        column = f"accuracy_{self.community}"
        ends = (at_equal(pair, what, column) for pair in self.pairs)
        return tuple(mine - other for mine, other in ends)

    @property
    def relative(self) -> float:
        """Ratio of the mean accuracies over seeds, less 1; NaN where the other learnt nothing."""
        mine, other = (math.fsum(values) for values in zip(*self.finals, strict=True))
        return mine / other - 1.0 if other > 0.0 else math.nan

    @property
    def interval(self) -> Interval:
        """Mean of `differences` with its 95 % confidence interval."""
        return interval(self.differences)

    @property
    def better(self) -> int:
        """Number of seeds in which the method is ahead."""
        return sum(difference > 0.0 for difference in self.differences)


def gain_table(gains: Sequence[Gain]) -> tuple[list[str], list[list[str]]]:
    """Heads and a row for each gain; settings have a column where there are any."""
    where = any(gain.settings for gain in gains)
    equals = [what for what in EQUAL if any(differ(g.at_equal(what), g.differences) for g in gains)]
    heads = [f"{METHOD} against", *(["settings"] if where else []), "community"]
    rows = [
        [
            gain.other,
            *([gain.settings] if where else []),
            gain.community,
            percent(gain.interval, signed=True),
            "-" if math.isnan(gain.relative) else f"{points(gain.relative, signed=True)} %",
            f"{gain.better} of {len(gain.differences)}",
            *(percent(interval(gain.at_equal(what)), signed=True) for what in equals),
        ]
        for gain in gains
    ]
    heads += ["points", "relative", "seeds better"]
    return [*heads, *(f"points at equal {what}" for what in equals)], rows


def paired_gains(results: Sequence[RunResult]) -> tuple[Gain, ...]:
    """Pair the method with each other strategy of the same settings, by seeds both have flown."""
    by_key = {(r.point.strategy, r.point.where, r.point.seed): r for r in results}
    gains = []
    for other, where in dict.fromkeys((r.point.strategy, r.point.where) for r in results):
        for community in communities_of(results):
            pairs = [
                (by_key[METHOD, where, seed], run)
                for (strategy, place, seed), run in by_key.items()
                if (strategy, place) == (other, where)
                and (METHOD, where, seed) in by_key
                and f"final_accuracy_{community}" in run.summary
            ]
            if other != METHOD and pairs:
                gains.append(Gain(other, where, community, tuple(pairs)))
    return tuple(gains)
