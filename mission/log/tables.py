"""A run's tables of records: written row by row, read back with checks.

CSV of the dialect of `csv_lines` with one header line. A round's accuracies and CoVs stand in one
column a community: `accuracy_<name>`, `cov_<name>`. The same records give the same bytes. Columns
that came later may be missing in a table of an earlier version: those of which a value may be, too.
"""

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, Self, TypeVar

from mission.base.errors import InputError
from mission.base.record_file import RecordFile
from mission.base.tables import columns, csv_lines
from mission.base.user_files import DATA_BYTES, read_text
from mission.log.records import (
    MAYBE,
    AircraftRecord,
    DeviceRecord,
    Kind,
    OfSeveral,
    RoundRecord,
    TimedUplinkRecord,
    UplinkRecord,
    flat,
    is_by_community,
)

Record = TypeVar("Record", bound=UplinkRecord | RoundRecord | AircraftRecord | DeviceRecord)

# A record, and the one with more columns that may stand in its table.
_WIDER: Mapping[type, type] = {UplinkRecord: TimedUplinkRecord}


class Table(Generic[Record]):
    """A CSV file of records being written: what was appended survives the process."""

    def __init__(
        self,
        path: Path,
        record: type[Record],
        *,
        communities: Sequence[str] = (),
        several: bool = False,
    ) -> None:
        """Start the table, replacing a file that is there.

        `communities`: names, for the columns of fields by community. `several`: with the columns of
        several aircraft.

        Raises:
            InputError: the file cannot be written.
        """
        cells = _cells(record, communities)
        self._cells = [cell for cell in cells if several or not cell.of_several]
        self.file = RecordFile(path)
        self._append([[cell.name for cell in self._cells]])

    def extend(self, records: Iterable[Record]) -> None:
        """Write a row each and hand them to the operating system.

        Raises:
            InputError: they could not be written, or somebody else changed the file.
        """
        rows = map(flat, records)
        self._append([row.get(cell.name, cell.missing) for cell in self._cells] for row in rows)

    def _append(self, rows: Iterable[Sequence[object]]) -> None:
        self.file.write(csv_lines(rows).encode())
        self.file.flush()
        self.file.check()

    def close(self) -> None:
        """Close the file; what was appended is in it. Closing twice is fine."""
        self.file.close()
        self.file.check()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_table(path: Path, record: type[Record]) -> tuple[Record, ...]:
    """Read a table's records, equal to those written; uplinks may be of `TimedUplinkRecord`.

    Raises:
        InputError: the file cannot be read, or is no table of these records: other columns, or a
            value that is not what its column holds.
    """
    header, rows = _read(path)
    communities = [c.removeprefix("accuracy_") for c in header if c.startswith("accuracy_")]
    wider: Any = _WIDER.get(record, record)
    if {cell.name for cell in _cells(wider, communities) if cell.missing is None} <= {*header}:
        record = wider
    cells = _cells(record, communities)
    there = [cell for cell in cells if cell.name in header or cell.missing is None]
    _check_header(path, header, [cell.name for cell in there])
    lacking: dict[str, Any] = {cell.field: cell.missing for cell in cells if cell not in there}
    return tuple(record(**lacking, **_values(path, record, there, *row)) for row in rows)


class _Cell(NamedTuple):
    """One column of a file, and where its value stands in a record."""

    name: str
    field: str
    key: str | None  # in the field, where it holds several columns
    kind: object  # type of the value
    missing: object = None  # value where the table lacks the column; None: it must not
    of_several: bool = False  # whether tables have it only where several aircraft fly


def _cells(record: type, communities: Sequence[str]) -> list[_Cell]:
    cells: list[_Cell] = []
    for column in columns(record):
        field = column.name
        if is_by_community(column):
            cells += [_Cell(f"{field}_{name}", field, name, float) for name in communities]
        else:
            may, of_several = column.find(Kind) is MAYBE, column.find(OfSeveral) is not None
            missing = math.nan if may else "" if of_several else None
            cells.append(_Cell(field, field, None, column.holds, missing, of_several))
    return cells


def _values(
    path: Path, record: type, cells: Sequence[_Cell], line: int, row: Sequence[str]
) -> dict[str, Any]:
    """Parse the cells of a row into the fields of a record."""
    values: dict[str, Any] = {c.name: {} for c in columns(record) if is_by_community(c)}
    for cell, text in zip(cells, row, strict=True):
        parse, allowed = _KINDS[cell.kind]
        try:
            value = parse(text)
        except (ValueError, KeyError):
            raise InputError(
                f"{path}: line {line}: {cell.name} = {text!r}: must be {allowed}"
            ) from None
        if cell.key is None:
            values[cell.field] = value
        else:
            values[cell.field][cell.key] = value
    return values


def _read(path: Path) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    text = read_text(path, most=DATA_BYTES)
    if not text:
        raise InputError(f"{path}: not a table: the file is empty")
    if not text.endswith("\n"):
        last = text.count("\n") + 1
        raise InputError(f"{path}: line {last}: the last row is cut short")
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        header = next(reader)
    except csv.Error as error:
        raise InputError(f"{path}: line 1: not a table: {error}") from None

    def rows() -> Iterator[tuple[int, list[str]]]:
        try:
            for row in reader:
                if len(row) != len(header):
                    raise InputError(
                        f"{path}: line {reader.line_num}: {len(row)} values for "
                        f"{len(header)} columns"
                    )
                yield reader.line_num, row
        except csv.Error as error:
            raise InputError(f"{path}: line {reader.line_num}: {error}") from None

    return header, rows()


def _check_header(path: Path, header: Sequence[str], expected: Sequence[str]) -> None:
    if tuple(header) == tuple(expected):
        return
    missing = [name for name in expected if name not in header]
    unknown = [name for name in header if name not in expected]
    what = "; ".join(
        f"{kind} {', '.join(names[:5])}"
        for kind, names in (("missing", missing), ("unknown", unknown))
        if names
    )
    raise InputError(f"{path}: line 1: other columns than this table has: {what or 'their order'}")


# How the values of a type are read, and what is allowed.
_KINDS: Mapping[object, tuple[Callable[[str], object], str]] = {
    int: (int, "a whole number"),
    float: (float, "a number"),
    str: (str, "a text"),
    bool: ({"true": True, "false": False}.__getitem__, "true or false"),
}
