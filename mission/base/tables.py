"""Tables: columns declared once as the fields of a dataclass, and their cells as text or Parquet.

    path_m: Annotated[float, "length of the planned path"]

Annotations of a field are found again by their own type, so that headers, schemas, pages and
tables on the terminal all follow from the one declaration.
"""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from mission.base.errors import InputError

Annotation = TypeVar("Annotation")


@dataclass(frozen=True)
class Column:
    """A table's column, from a field of a dataclass: name, bare type and annotations."""

    name: str
    holds: object  # its bare type
    annotations: tuple[object, ...]

    def find(self, kind: type[Annotation]) -> Annotation | None:
        """Return the annotation of a type (`str`: the description); None where there is none."""
        return next((item for item in self.annotations if isinstance(item, kind)), None)


def columns(record: type) -> tuple[Column, ...]:
    """The fields of a dataclass, in their order."""
    return _columns(record)


@cache
def _columns(record: type) -> tuple[Column, ...]:
    hints = get_type_hints(record, include_extras=True)
    return tuple(_column(field.name, hints[field.name]) for field in fields(record))


def annotated(record: type, kind: type[Annotation]) -> Iterator[tuple[str, Annotation]]:
    """Yield name and annotation of the fields that have an annotation of type `kind`."""
    for column in columns(record):
        values = column.find(kind)
        if values is not None:
            yield column.name, values


def number(value: float, digits: int = 2) -> str:
    """Format a number for tables, with `digits` decimals; a dash for NaN."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _column(name: str, hint: object) -> Column:
    if get_origin(hint) is Annotated:
        bare, *about = get_args(hint)
        return Column(name, bare, tuple(about))
    return Column(name, hint, ())


def dotted(value: object, prefix: str = "") -> dict[str, object]:
    """Flatten nested dicts and lists into values by dotted key."""
    if isinstance(value, dict):
        items = [(str(key), item) for key, item in value.items()]
    elif isinstance(value, list):
        items = [(str(index), item) for index, item in enumerate(value)]
    else:
        return {prefix: value}
    flat: dict[str, object] = {}
    for key, item in items:
        flat |= dotted(item, f"{prefix}.{key}" if prefix else key)
    return flat


def count(number: int, noun: str) -> str:
    """Format a count: `1 round`, `2 rounds of flight`; the first word of the noun gets the s."""
    first, *others = noun.split(" ")
    return " ".join((str(number), first if number == 1 else f"{first}s", *others))


def csv_lines(rows: Iterable[Iterable[object]]) -> str:
    """Rows in the one dialect of our CSV files: comma, "\\n", numbers in their shortest exact form.

    `nan` where a number has no value, `true` and `false`, an empty cell for None. Reading a number
    back gives the very same.
    """
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(map(_cell, row) for row in rows)
    return out.getvalue()


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))  # numpy's own floats would say np.float64(...)
    return "" if value is None else str(value)


def parquet(columns: Mapping[str, Iterable[Any]]) -> bytes:
    """A Parquet file (zstd) of columns of equal length, None where there is no value.

    Raises:
        InputError: pyarrow, an extra, is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise InputError(
            "Parquet needs pyarrow, which is an extra and not installed: pip install "
            "'aerofed[parquet]', or take csv"
        ) from None

    out = io.BytesIO()
    table = pa.table({name: pa.array(list(values)) for name, values in columns.items()})
    pyarrow.parquet.write_table(table, out, compression="zstd")
    return out.getvalue()
