"""Columns of a table, declared once: as the fields of a dataclass.

    path_m: Annotated[float, "length of the planned path"]

What stands beside a field's type is found again by its own type, so that headers, schemas, pages
and tables on the terminal all follow from the one declaration.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, TypeVar, get_args, get_origin, get_type_hints

Told = TypeVar("Told")


@dataclass(frozen=True)
class Column:
    """One field: its name, what it holds, and what is told of it."""

    name: str
    holds: object  # its bare type
    told: tuple[object, ...]

    def find(self, kind: type[Told]) -> Told | None:
        """What is told that is of a kind: `str` gives the words; None where nothing is."""
        return next((item for item in self.told if isinstance(item, kind)), None)


def columns(record: type) -> tuple[Column, ...]:
    """The fields of a dataclass, in their order."""
    return _columns(record)


@cache
def _columns(record: type) -> tuple[Column, ...]:
    hints = get_type_hints(record, include_extras=True)
    return tuple(_column(field.name, hints[field.name]) for field in fields(record))


def told(record: type, kind: type[Told]) -> Iterator[tuple[str, Told]]:
    """Names of the fields of which something of a kind is told, and what."""
    for column in columns(record):
        found = column.find(kind)
        if found is not None:
            yield column.name, found


def number(value: float, digits: int = 2) -> str:
    """As tables show it, also those of pages; a dash for NaN."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _column(name: str, hint: object) -> Column:
    if get_origin(hint) is Annotated:
        bare, *about = get_args(hint)
        return Column(name, bare, tuple(about))
    return Column(name, hint, ())
