"""`rounds.csv`, `uplinks.csv`, `learning.csv`: written row by row, read back with checks.

Plain CSV (comma, "\\n", UTF-8), one header line; numbers in their shortest exact form, so that
reading gives back the very same float; `nan` where there is no value; `true` and `false`. A
round's accuracies and CoVs stand in one column a community: `accuracy_<name>`, `cov_<name>`.
The same records give the same bytes.
"""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self, TypeVar

from mission.base.errors import InputError
from mission.log.records import DeviceRecord, RoundRecord, UplinkRecord

_BY_COMMUNITY = ("accuracy", "cov")
Record = TypeVar("Record", UplinkRecord, DeviceRecord)


class TableError(InputError):
    """A table cannot be written, or what is in the file is not such a table."""


class _Table:
    """An open CSV file that takes whole rows: what was appended survives the process."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.path = path
        try:
            self._file: IO[str] = path.open("w", encoding="utf-8", newline="")
        except OSError as error:
            raise TableError(f"{path}: cannot write the table: {error.strerror}") from None
        self._append([columns])

    def _append(self, rows: Iterable[Sequence[str]]) -> None:
        try:
            self._file.write("".join(_line(row) for row in rows))
            self._file.flush()
        except OSError as error:
            raise TableError(f"{self.path}: cannot write the table: {error.strerror}") from None

    def close(self) -> None:
        """Closing twice is fine."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class RoundTable(_Table):
    """`rounds.csv` being written."""

    def __init__(self, path: Path, communities: Sequence[str]) -> None:
        """Start the table, replacing a file that is there.

        Raises:
            TableError: the file cannot be written.
        """
        self._communities = tuple(communities)
        super().__init__(path, _round_columns(self._communities))

    def append(self, record: RoundRecord) -> None:
        """Write one row and hand it to the operating system."""
        row = []
        for field in fields(record):
            value = getattr(record, field.name)
            if field.name in _BY_COMMUNITY:
                row += [_text(value[name]) for name in self._communities]
            else:
                row.append(_text(value))
        self._append([row])


class UplinkTable(_Table):
    """`uplinks.csv` being written."""

    def __init__(self, path: Path) -> None:
        """Start the table, replacing a file that is there; raises TableError if it cannot be."""
        super().__init__(path, _columns(UplinkRecord))

    def extend(self, records: Iterable[UplinkRecord]) -> None:
        """Write a round's rows and hand them to the operating system."""
        names = _columns(UplinkRecord)
        self._append([_text(getattr(record, name)) for name in names] for record in records)


class LearningTable(_Table):
    """`learning.csv` being written."""

    def __init__(self, path: Path) -> None:
        """Start the table, replacing a file that is there; raises TableError if it cannot be."""
        super().__init__(path, _columns(DeviceRecord))

    def extend(self, records: Iterable[DeviceRecord]) -> None:
        """Write a round's rows and hand them to the operating system."""
        self._append([_text(value) for value in astuple(record)] for record in records)


def read_rounds(path: Path) -> tuple[RoundRecord, ...]:
    """The records of a `rounds.csv`, equal to those that were written.

    Raises:
        TableError: no such file, other columns, or a value that is not what its column holds.
    """
    header, rows = _read(path)
    communities = [c.removeprefix("accuracy_") for c in header if c.startswith("accuracy_")]
    _check_header(path, header, _round_columns(communities))
    records = []
    for number, row in rows:
        values: dict[str, Any] = {}
        cells = iter(zip(header, row, strict=True))
        for field in fields(RoundRecord):
            if field.name in _BY_COMMUNITY:
                values[field.name] = {
                    name: _parse(path, number, *next(cells), float) for name in communities
                }
            else:
                values[field.name] = _parse(path, number, *next(cells), _KINDS[field.type])
        records.append(RoundRecord(**values))
    return tuple(records)


def read_uplinks(path: Path) -> tuple[UplinkRecord, ...]:
    """The records of an `uplinks.csv`, equal to those that were written.

    Raises:
        TableError: no such file, other columns, or a value that is not what its column holds.
    """
    return _records(path, UplinkRecord)


def read_learning(path: Path) -> tuple[DeviceRecord, ...]:
    """The records of a `learning.csv`, equal to those that were written.

    Raises:
        TableError: no such file, other columns, or a value that is not what its column holds.
    """
    return _records(path, DeviceRecord)


def _records(path: Path, record: type[Record]) -> tuple[Record, ...]:
    header, rows = _read(path)
    _check_header(path, header, _columns(record))
    kinds = [_KINDS[field.type] for field in fields(record)]
    return tuple(
        record(
            **{
                name: _parse(path, number, name, cell, kind)
                for name, cell, kind in zip(header, row, kinds, strict=True)
            }
        )
        for number, row in rows
    )


def _round_columns(communities: Sequence[str]) -> tuple[str, ...]:
    columns: list[str] = []
    for field in fields(RoundRecord):
        if field.name in _BY_COMMUNITY:
            columns += [f"{field.name}_{name}" for name in communities]
        else:
            columns.append(field.name)
    return tuple(columns)


def _columns(record: type[UplinkRecord | DeviceRecord]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(record))


def _text(value: float | int | bool | str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))  # numpy's own floats would say np.float64(...)
    return str(value)


def _line(cells: Sequence[str]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue()


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


# Field types as dataclasses give them.
_KINDS: Mapping[Any, Callable[[str], Any]] = {int: int, float: float, str: str, bool: _boolean}
_ALLOWED = {int: "a whole number", float: "a number", _boolean: "true or false"}


def _parse(path: Path, line: int, column: str, cell: str, kind: Callable[[str], Any]) -> Any:
    try:
        return kind(cell)
    except (ValueError, KeyError):
        allowed = _ALLOWED[kind]
        raise TableError(f"{path}: line {line}: {column} = {cell!r}: must be {allowed}") from None
