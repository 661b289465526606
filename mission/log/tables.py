"""`rounds.csv`, `uplinks.csv`, `learning.csv`: written row by row, read back with checks.

CSV of the dialect of `csv_lines` with one header line. A round's accuracies and CoVs stand in one
column a community: `accuracy_<name>`, `cov_<name>`. The same records give the same bytes.
"""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from mission.base.errors import InputError
from mission.base.record_file import RecordFile
from mission.base.tables import columns, csv_lines
from mission.base.user_files import DATA_BYTES, read_text
from mission.log.records import (
    DeviceRecord,
    RoundRecord,
    TimedUplinkRecord,
    UplinkRecord,
    flat,
    is_by_community,
)

Record = TypeVar("Record", bound=UplinkRecord | RoundRecord | DeviceRecord)

# A record, and the one with more columns that may stand in its table.
_WIDER: Mapping[type, type] = {UplinkRecord: TimedUplinkRecord}


class TableError(InputError):
    """What is in a file is not such a table."""


class Table(Generic[Record]):
    """A CSV file of records being written: what was appended survives the process."""

    def __init__(
        self,
        path: Path,
        record: type[Record],
        *,
        communities: Sequence[str] = (),
    ) -> None:
        """Start the table, replacing a file that is there.

        `communities`: those that the records have numbers of.

        Raises:
            InputError: the file cannot be written.
        """
        self._header = _header(record, communities)
        self.file = RecordFile(path)
        self._append([self._header])

    def extend(self, records: Iterable[Record]) -> None:
        """Write a row each and hand them to the operating system.

        Raises:
            InputError: they could not be written, or somebody else changed the file.
        """
        rows = map(flat, records)
        self._append([row[name] for name in self._header] for row in rows)

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
    """The records of a table, equal to those that were written; also of a kind of `record`.

    Raises:
        TableError: no such file, other columns, or a value that is not what its column holds.
    """
    header, rows = _read(path)
    communities = [c.removeprefix("accuracy_") for c in header if c.startswith("accuracy_")]
    wider: Any = _WIDER.get(record, record)
    if header == _header(wider, communities):
        record = wider
    _check_header(path, header, _header(record, communities))
    return tuple(
        record(**_values(path, record, communities, line, dict(zip(header, row, strict=True))))
        for line, row in rows
    )


def _header(record: type, communities: Sequence[str]) -> list[str]:
    names: list[str] = []
    for column in columns(record):
        by_community = [f"{column.name}_{name}" for name in communities]
        names += by_community if is_by_community(column) else [column.name]
    return names


def _values(
    path: Path, record: type, communities: Sequence[str], line: int, row: Mapping[str, str]
) -> dict[str, Any]:
    """The fields of a record, by the texts of its row."""

    def value(name: str, kind: object) -> object:
        parse, allowed = _KINDS[kind]
        try:
            return parse(row[name])
        except (ValueError, KeyError):
            raise TableError(
                f"{path}: line {line}: {name} = {row[name]!r}: must be {allowed}"
            ) from None

    return {
        column.name: {name: value(f"{column.name}_{name}", float) for name in communities}
        if is_by_community(column)
        else value(column.name, column.holds)
        for column in columns(record)
    }


def _read(path: Path) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    text = read_text(path, most=DATA_BYTES)
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


# How the values of a type are read, and what is allowed.
_KINDS: Mapping[object, tuple[Callable[[str], object], str]] = {
    int: (int, "a whole number"),
    float: (float, "a number"),
    str: (str, "a text"),
    bool: ({"true": True, "false": False}.__getitem__, "true or false"),
}
