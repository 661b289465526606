"""`rounds.csv`, `uplinks.csv`, `learning.csv`: written row by row, read back with checks.

CSV of the dialect of `csv_lines` with one header line. A round's accuracies and CoVs stand in one
column a community: `accuracy_<name>`, `cov_<name>`. The same records give the same bytes.
"""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Generic, Self, TypeVar

from mission.base.errors import InputError
from mission.base.tables import columns, csv_lines
from mission.log.records import (
    OPTIONAL,
    DeviceRecord,
    RoundRecord,
    TimedUplinkRecord,
    UplinkRecord,
    flat,
    is_by_community,
)

Cell = TypeVar("Cell")
Record = TypeVar("Record", bound=UplinkRecord | RoundRecord | DeviceRecord)

# A record, and the one with more columns that may stand in its table.
_WIDER: Mapping[type, type] = {UplinkRecord: TimedUplinkRecord}


class TableError(InputError):
    """A table cannot be written, or what is in the file is not such a table."""


class Table(Generic[Record]):
    """A CSV file of records being written: what was appended survives the process."""

    def __init__(
        self,
        path: Path,
        record: type[Record],
        *,
        communities: Sequence[str] = (),
        optional: Sequence[str] = (),
    ) -> None:
        """Start the table, replacing a file that is there.

        `communities`: those that the records have numbers of; `optional`: columns of `OPTIONAL`.

        Raises:
            TableError: the file cannot be written.
        """
        self.path = path
        self._header = _header(record, communities, optional)
        try:
            self._file: IO[str] = path.open("w", encoding="utf-8", newline="")
        except OSError as error:
            raise TableError(f"{path}: cannot write the table: {error.strerror}") from None
        self._append([self._header])

    def extend(self, records: Iterable[Record]) -> None:
        """Write a row each and hand them to the operating system."""
        rows = map(flat, records)
        self._append([row[name] for name in self._header] for row in rows)

    def _append(self, rows: Iterable[Sequence[object]]) -> None:
        try:
            self._file.write(csv_lines(rows))
            self._file.flush()
        except OSError as error:
            raise TableError(f"{self.path}: cannot write the table: {error.strerror}") from None

    def close(self) -> None:
        """Closing twice is fine."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_table(path: Path, record: type[Record]) -> tuple[Record, ...]:
    """The records of a table, equal to those that were written; also of a kind of `record`.

    Raises:
        TableError: no such file, other columns, or a value that is not what its column holds.
    """
    header, rows = _read(path)
    communities = [c.removeprefix("accuracy_") for c in header if c.startswith("accuracy_")]
    optional = tuple(name for name in OPTIONAL if name in header)
    wider: Any = _WIDER.get(record, record)
    record = wider if tuple(header) == _header(wider, communities, optional) else record
    _check_header(path, header, _header(record, communities, optional))
    return tuple(_record(path, record, communities, optional, *row) for row in rows)


def _record(
    path: Path,
    record: type[Record],
    communities: Sequence[str],
    optional: Sequence[str],
    line: int,
    row: Sequence[str],
) -> Record:
    values: dict[str, Any] = {}
    cells = iter(row)
    for column in columns(record):
        name = column.name
        if name == "optional":
            values[name] = {key: _parse(path, line, key, next(cells), float) for key in optional}
        elif is_by_community(column):
            values[name] = {
                c: _parse(path, line, f"{name}_{c}", next(cells), float) for c in communities
            }
        else:
            values[name] = _parse(path, line, name, next(cells), _KINDS[column.holds])
    return record(**values)


def _header(
    record: type, communities: Sequence[str] = (), optional: Sequence[str] = ()
) -> tuple[str, ...]:
    names: list[str] = []
    for column in columns(record):
        if column.name == "optional":
            names += optional
        elif is_by_community(column):
            names += [f"{column.name}_{name}" for name in communities]
        else:
            names.append(column.name)
    return tuple(names)


def _read(path: Path) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise TableError(f"{path}: cannot read the table: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TableError(f"{path}: not a table: not UTF-8 text") from None
    if not text:
        raise TableError(f"{path}: not a table: the file is empty")
    if not text.endswith("\n"):
        last = text.count("\n") + 1
        raise TableError(f"{path}: line {last}: the last row is cut short")
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        header = next(reader)
    except csv.Error as error:
        raise TableError(f"{path}: line 1: not a table: {error}") from None

    def rows() -> Iterator[tuple[int, list[str]]]:
        try:
            for row in reader:
                if len(row) != len(header):
                    raise TableError(
                        f"{path}: line {reader.line_num}: {len(row)} values for "
                        f"{len(header)} columns"
                    )
                yield reader.line_num, row
        except csv.Error as error:
            raise TableError(f"{path}: line {reader.line_num}: {error}") from None

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
    raise TableError(f"{path}: line 1: other columns than this table has: {what or 'their order'}")


def _boolean(text: str) -> bool:
    return {"true": True, "false": False}[text]


# By the type of a column.
_KINDS: Mapping[object, Callable[[str], object]] = {
    int: int,
    float: float,
    str: str,
    bool: _boolean,
}
_ALLOWED = {int: "a whole number", float: "a number", _boolean: "true or false"}


def _parse(path: Path, line: int, column: str, cell: str, kind: Callable[[str], Cell]) -> Cell:
    try:
        return kind(cell)
    except (ValueError, KeyError):
        allowed = _ALLOWED[kind]
        raise TableError(f"{path}: line {line}: {column} = {cell!r}: must be {allowed}") from None
