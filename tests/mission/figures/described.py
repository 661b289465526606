"""Reads what a picture's description promises, the way a renderer would."""

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any

from altair.utils.schemapi import validate_jsonschema
from altair.vegalite.v6.schema.core import load_schema
from jsonschema import Draft7Validator, ValidationError
from jsonschema.protocols import Validator
from jsonschema.validators import extend

from mission.figures.style import Chart

Row = dict[str, Any]
VEGA_LITE = load_schema()


def _ref(validator: Validator, ref: str, value: object, _: object) -> Iterator[ValidationError]:
    return validator.descend(value, VEGA_LITE["definitions"][ref.removeprefix("#/definitions/")])


def _any_of(
    validator: Validator, kinds: Sequence[Any], value: object, _: object
) -> Iterator[ValidationError]:
    if all(next(validator.descend(value, kind), None) for kind in kinds):
        yield ValidationError("of no kind that is allowed")


# It ends at the first error, of each kind too, and copies no schema: a tenth of Altair's time,
# which can say what is wrong.
_CHECKS = {"$ref": _ref, "anyOf": _any_of}
_VALIDATOR = extend(Draft7Validator, _CHECKS)(
    VEGA_LITE, format_checker=Draft7Validator.FORMAT_CHECKER
)


def described(chart: Chart) -> dict[str, Any]:
    """The description, checked against Vega-Lite's schema."""
    for rows in chart["datasets"].values():
        for row in rows:
            assert all(isinstance(value, str | int | float | None) for value in row.values())
    _check(chart)
    return chart


def _check(chart: Chart) -> None:
    bare = {**chart, "datasets": {}}
    assert _VALIDATOR.is_valid(bare), validate_jsonschema(bare, VEGA_LITE, raise_error=False)


def layers(spec: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every layer of a picture, however deep, in the order in which they lie."""
    for key in ("vconcat", "concat", "layer"):
        for part in spec.get(key, ()):
            yield from layers(part)
    if "mark" in spec:
        yield spec


def tables(spec: dict[str, Any], *columns: str) -> list[list[Row]]:
    """All tables that have these columns; of a picture, or of a page's chart."""
    found = []
    for table in spec["datasets"].values():
        if isinstance(table, dict):
            each = zip(*table.values(), strict=True)
            table = [dict(zip(table, row, strict=True)) for row in each]
        if table and set(columns) <= set(table[0]):
            found.append(list(table))
    return found


def rows(spec: dict[str, Any], *columns: str) -> list[Row]:
    """The rows of the first of them."""
    return tables(spec, *columns)[0]


def axes(spec: dict[str, Any]) -> set[str]:
    """The titles of all axes."""
    return {
        layer["encoding"][channel]["title"]
        for layer in layers(spec)
        for channel in ("x", "y")
        if layer.get("encoding", {}).get(channel, {}).get("title")
    }


def keys(spec: dict[str, Any]) -> dict[str, list[Any]]:
    """What legends there are, and the names in them, by channel; the first of each."""
    found: dict[str, list[Any]] = {}
    for layer in layers(spec):
        for channel, coded in layer.get("encoding", {}).items():
            if isinstance(coded, dict) and coded.get("legend") and "domain" in coded["scale"]:
                found.setdefault(channel, coded["scale"]["domain"])
    return found


def charts(page: str) -> dict[str, dict[str, Any]]:
    """The charts of a report's page by their title, checked against Vega-Lite's schema."""
    found = re.findall(
        r'<div class="chart" role="img" aria-label="([^"]*)">'
        r'<script type="application/json">(.*?)</script></div>',
        page,
        flags=re.DOTALL,
    )
    shown = {title: json.loads(text)["spec"] for title, text in found}
    for chart in shown.values():
        _check(chart)
    return shown
