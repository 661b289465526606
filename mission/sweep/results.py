"""A sweep's results: one row a run and one row a round, read from the finished runs' folders."""

import csv
import gzip
import io
import itertools
import math
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, RunSummary, write_atomically
from mission.base.tables import csv_lines
from mission.base.user_files import read_json, read_text
from mission.log.records import DeviceRecord, RoundRecord, UplinkRecord, flat
from mission.log.tables import read_table
from mission.sweep.grid import Cell, Point
from native.errors import first_line

Row: TypeAlias = dict[str, Cell]

# Runs that end apart are compared where the one that spent least ends: columns of `rounds.csv`.
EQUAL = {"rounds": "round", "metres": "budget_used_m", "energy": "energy_j"}


@dataclass(frozen=True)
class RunResult:
    """One finished run of a sweep."""

    point: Point
    summary: Row  # its row in `runs.csv`, the keys among them
    rounds: tuple[Row, ...]  # its rows in `rounds.csv`
    wall_s: dict[str, float]  # by phase
    # Accuracies at equal rounds, metres and energy, which rest on the other runs: no table's.
    equal: Row = field(default_factory=dict)

    def curve(self, column: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return one column of its rows in `rounds.csv`: (rounds,)."""
        return np.array([row[column] for row in self.rounds], dtype=np.float64)


def read_run(folder: RunFolder, point: Point) -> RunResult:
    """The results of a finished run.

    Raises:
        InputError: a table or the summary is missing, damaged or altered.
    """
    folder.check_unchanged()
    summary: RunSummary = read_json(folder.summary)
    records = read_table(folder.rounds, RoundRecord)
    uplinks = read_table(folder.uplinks, UplinkRecord)
    learnt = read_table(folder.learning, DeviceRecord)  # a device that trained has a loss
    devices = len(read_text(folder.devices).splitlines()) - 1
    keys = point.keys
    rounds = _round_rows(keys, records, uplinks, devices=devices)
    scheduled, delivered = (
        sum(getattr(record, name) for record in records) for name in ("scheduled", "delivered")
    )
    row: Row = {
        **keys,
        "run": folder.path.name,
        "rounds": len(records),
        "flown_m": float(summary["flown_in_rounds_m"]),
        "budget_used_m": float(summary["budget_used_m"]),
        "simulated_s": float(summary["simulated_s"]),
        "energy_j": math.fsum(record.energy_j for record in records),
        "scheduled": scheduled,
        "delivered": delivered,
        "delivered_share": _ratio(delivered, scheduled),
        "participation": _ratio(delivered, devices * len(records)),
        "plan_per": _mean([uplink.plan_per for uplink in uplinks]),
        "true_per": _mean([uplink.true_per for uplink in uplinks]),
    }
    for name in records[-1].accuracy if records else ():
        mine = [item for item in learnt if item.community == name and item.round > 0]
        row[f"participation_{name}"] = _mean([math.isfinite(item.loss) for item in mine])
        if name in summary.get("untrained_accuracy", {}):  # not of runs before 0.2
            row[f"untrained_accuracy_{name}"] = float(summary["untrained_accuracy"][name])
        row[f"final_accuracy_{name}"] = records[-1].accuracy[name]
        row[f"final_cov_{name}"] = records[-1].cov[name]
    row["final_jain_communities"] = rounds[-1]["jain_communities"] if rounds else math.nan
    return RunResult(point, row, rounds, dict(summary["wall_s"]))


def communities_of(results: Sequence[RunResult]) -> list[str]:
    """Names of all communities, in order of appearance."""
    prefix = "final_accuracy_"
    keys = (key for result in results for key in result.summary if key.startswith(prefix))
    return list(dict.fromkeys(key.removeprefix(prefix) for key in keys))


def at_equal(runs: Sequence[RunResult], what: str, column: str) -> list[float]:
    """Return each run's value of a `rounds.csv` column where the one that spent least `what` ends.

    `what` is a key of `EQUAL`. Values are interpolated linearly, from the untrained model on. NaN
    for a run that spends none of it, as `ideal` no energy, or that has no such column.
    """
    clocks = [
        run.curve(EQUAL[what])
        if run.rounds and {EQUAL[what], column} <= run.rounds[0].keys()
        else np.zeros(1)
        for run in runs
    ]
    if what == "energy":  # the others are sums already
        clocks = [np.cumsum(clock) for clock in clocks]
    least = min((clock[-1] for clock in clocks if clock[-1] > 0.0), default=math.nan)
    return [
        float(np.interp(least, *_with_start(run, clock, column))) if clock[-1] > 0.0 else math.nan
        for run, clock in zip(runs, clocks, strict=True)
    ]


def _with_start(run: RunResult, clock: Floats, column: str) -> tuple[Floats, Floats]:
    """Return `clock` and a column of the rounds, both begun with the untrained model if known."""
    values, start = run.curve(column), run.summary.get(f"untrained_{column}")
    if start is None:
        return clock, values
    return np.concatenate(([0.0], clock)), np.concatenate(([float(start)], values))


def differ(values: Sequence[float], others: Sequence[float]) -> bool:
    """Whether two lists differ anywhere but where one has no value (NaN)."""
    return any(abs(a - b) > 0.0 for a, b in zip(values, others, strict=True))


def with_equals(results: Sequence[RunResult]) -> tuple[RunResult, ...]:
    """The results with their accuracies at equal rounds, metres and energy, where these differ
    from the final ones in any run."""
    rows: list[Row] = [{} for _ in results]
    for what, name in itertools.product(EQUAL, communities_of(results)):
        column, final = f"accuracy_{name}", f"final_accuracy_{name}"
        values = at_equal(results, what, column)
        if differ(values, [float(run.summary.get(final, math.nan)) for run in results]):
            for value, row in zip(values, rows, strict=True):
                row[f"equal_{what}_{column}"] = value
    return tuple(replace(r, equal=row) for r, row in zip(results, rows, strict=True))


def write_results(folder: Path, results: Sequence[RunResult]) -> None:
    """Write `runs` and `rounds` as CSV and Parquet, and `timings.csv`.

    The same runs give the same bytes, however many workers flew them; only wall times, which
    stand in a table of their own, differ.

    Raises:
        InputError: a table cannot be written.
    """
    tables = {
        "runs": [result.summary for result in results],
        "rounds": [row for result in results for row in result.rounds],
        "timings": [
            {**r.point.keys, **{f"{k}_s": v for k, v in r.wall_s.items()}} for r in results
        ],
    }
    for name, rows in tables.items():
        columns = list(dict.fromkeys(key for row in rows for key in row))
        # Where communities are swept, a run has no value in another's columns.
        cells = [[row.get(column) for column in columns] for row in rows]
        write_atomically(folder / f"{name}.csv", csv_lines([columns, *cells]))


def read_results(folder: Path, points: Sequence[Point]) -> tuple[RunResult, ...]:
    """The results that `write_results` left in a folder, where the runs' own folders are gone.

    The tables may be packed by gzip (`rounds.csv.gz`).

    Raises:
        InputError: a table is missing, damaged, or not about these runs.
    """
    try:
        return _results(folder, {point.name: point for point in points})
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{folder}: its tables are damaged: {first_line(error)}") from None


def _results(folder: Path, by_name: Mapping[str, Point]) -> tuple[RunResult, ...]:
    runs, rounds, timings = (_read_rows(folder, name) for name in ("runs", "rounds", "timings"))
    if len(timings) != len(runs) or sum(int(row.get("rounds", -1)) for row in runs) != len(rounds):
        raise InputError(f"{folder}: runs.csv, rounds.csv and timings.csv are not of the same runs")
    following, results = iter(rounds), []
    for row, timing in zip(runs, timings, strict=True):
        point = by_name.get(str(row.get("run")))
        if point is None:
            raise InputError(f"{folder}/runs.csv: {row.get('run')}: no run of this sweep")
        own = tuple(itertools.islice(following, int(row["rounds"])))
        wall_s = {
            name.removesuffix("_s"): float(value)
            for name, value in timing.items()
            if name not in point.keys
        }
        results.append(RunResult(point, row, own, wall_s))
    return tuple(results)


def table_of(folder: Path, name: str) -> Path:
    """Return the path of a sweep's table: the CSV file, or the gzip file if only that exists."""
    plain = folder / f"{name}.csv"
    packed = plain.with_name(f"{plain.name}.gz")
    return packed if packed.is_file() and not plain.is_file() else plain


def _read_rows(folder: Path, name: str) -> list[Row]:
    path = table_of(folder, name)
    try:
        raw = path.read_bytes()
        raw = gzip.decompress(raw) if path.suffix == ".gz" else raw
        rows = list(csv.DictReader(io.StringIO(raw.decode("utf-8")), strict=True))
    except (OSError, EOFError, zlib.error, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot read the table: {error}") from None
    # An empty cell: this run has no such column.
    return [{key: _number(text) for key, text in row.items() if text} for row in rows]


def _number(text: str) -> Cell:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def jain(values: Sequence[float]) -> float:
    """Jain's fairness index (sum a)^2 / (n sum a^2): 1 all equal, 1/n one has everything.

    All zero is equal: 1. Source: Jain, Chiu, Hawe (1984), DEC-TR-301.
    """
    squares = sum(value * value for value in values)
    return sum(values) ** 2 / (len(values) * squares) if squares > 0.0 else 1.0


def _round_rows(
    keys: dict[str, Cell],
    records: Sequence[RoundRecord],
    uplinks: Sequence[UplinkRecord],
    *,
    devices: int,
) -> tuple[Row, ...]:
    by_round: dict[int, list[UplinkRecord]] = {record.round: [] for record in records}
    for uplink in uplinks:
        by_round[uplink.round].append(uplink)
    rows = []
    for record in records:
        served = by_round[record.round]
        row: Row = {
            **keys,
            **flat(record),
            "end_t_s": record.start_t_s + record.duration_s,
            "participation": _ratio(record.delivered, devices),
            "plan_per": _mean([uplink.plan_per for uplink in served]),
            "true_per": _mean([uplink.true_per for uplink in served]),
            "jain_communities": jain(list(record.accuracy.values())),
        }
        rows.append(row)
    return tuple(rows)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan
