"""The one dialect of our CSV files: comma, "\\n", UTF-8, numbers in their shortest exact form.

`nan` where a number has no value, `true` and `false`. Reading a number back gives the very same.
"""

import csv
import io
from collections.abc import Iterable


def lines(rows: Iterable[Iterable[object]]) -> str:
    """Rows of values, a line each; None is an empty cell."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(map(_cell, row) for row in rows)
    return out.getvalue()


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))  # numpy's own floats would say np.float64(...)
    return "" if value is None else str(value)
