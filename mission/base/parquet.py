"""The home of Parquet: tables with columns of one kind each."""

import io
from collections.abc import Iterable, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.parquet


def parquet(columns: Mapping[str, Iterable[Any]]) -> bytes:
    """A file of columns of equal length, None where there is no value.

    A column whose values are of several kinds becomes one of numbers, or else of texts.
    """
    out = io.BytesIO()
    table = pa.table({name: pa.array(_of_one_kind(values)) for name, values in columns.items()})
    pyarrow.parquet.write_table(table, out, compression="zstd")
    return out.getvalue()


def _of_one_kind(values: Iterable[Any]) -> list[Any]:
    values = list(values)
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) < 2:
        return values
    number = kinds <= {int, float}  # as 1 beside 0.5
    return [v if v is None else float(v) if number else str(v) for v in values]
