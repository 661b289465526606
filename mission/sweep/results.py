"""A sweep's results: one row a run and one row a round, read from the finished runs' folders."""

import csv
import gzip
import io
import itertools
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from fl.errors import first_line
from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, RunSummary, write_atomically
from mission.base.tables import csv_lines, parquet
from mission.log.records import DeviceRecord, RoundRecord, UplinkRecord, flat
from mission.log.tables import read_table
from mission.sweep.grid import Key, Point

Cell: TypeAlias = str | int | float | bool
Row: TypeAlias = dict[str, Cell]

FINAL_ROUNDS = 10  # the last ones, whose mean is the final accuracy: one round swings by points


@dataclass(frozen=True)
class RunResult:
    """One finished run of a sweep."""

    point: Point
    summary: Row  # its row in `runs.csv`, the keys among them
    rounds: tuple[Row, ...]  # its rows in `rounds.csv`
    wall_s: dict[str, float]  # by phase

    @property
    def label(self) -> str:
        """Names its group: strategy and settings."""
        return self.point.label

    def curve(self, column: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(rounds,) one column of its rounds."""
        return np.array([row[column] for row in self.rounds], dtype=np.float64)


def read_run(folder: RunFolder, point: Point) -> RunResult:
    """The results of a finished run.

    Raises:
        InputError: a table or the summary is missing or damaged.
    """
    try:
        summary: RunSummary = json.loads(folder.summary.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{folder.summary}: cannot read the summary: {error}") from None
    records = read_table(folder.rounds, RoundRecord)
    uplinks = read_table(folder.uplinks, UplinkRecord)
    learnt = read_table(folder.learning, DeviceRecord)  # a device that trained has a loss
    devices = len(folder.devices.read_text(encoding="utf-8").splitlines()) - 1
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
        **_energy(records),
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
        last = records[-FINAL_ROUNDS:]
        if name in summary.get("untrained_accuracy", {}):  # not of runs before 0.2
            row[f"untrained_accuracy_{name}"] = float(summary["untrained_accuracy"][name])
        row[f"final_accuracy_{name}"] = _mean([record.accuracy[name] for record in last])
        row[f"final_cov_{name}"] = _mean([record.cov[name] for record in last])
    row["final_jain_communities"] = _mean(
        [float(r["jain_communities"]) for r in rounds[-FINAL_ROUNDS:]]
    )
    return RunResult(point, row, rounds, dict(summary["wall_s"]))


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
        if name != "timings":
            by_column = {column: [row.get(column) for row in rows] for column in columns}
            write_atomically(folder / f"{name}.parquet", parquet(by_column))


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


def _read_rows(folder: Path, name: str) -> list[Row]:
    plain = folder / f"{name}.csv"
    packed = plain.with_name(f"{plain.name}.gz")
    path = packed if packed.is_file() and not plain.is_file() else plain
    try:
        raw = gzip.decompress(path.read_bytes()) if path is packed else path.read_bytes()
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
    keys: dict[str, Key],
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


def _energy(records: Sequence[RoundRecord]) -> Row:
    """Joules of the flights, of runs that limit time or energy and know what was flown."""
    used = math.fsum(record.optional.get("energy_j", math.nan) for record in records)
    return {"energy_j": used} if math.isfinite(used) else {}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan
