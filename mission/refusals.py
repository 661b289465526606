"""What is wrong with a configuration, a line a key: where it stands, its value, what it may be."""

from collections.abc import Collection
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mission.keys import Key, every, locate, tag, top

_LONG = 60  # characters of a value that are shown


def explain(
    error: ValidationError, model: type[BaseModel], path: Path, *, given: Collection[str] = ()
) -> list[str]:
    """A line for each wrong key of the configuration in `path`.

    Keys in `given` were set on the command line and are not blamed on the file.
    """
    items = error.errors()
    # Pydantic counts the elements of a list without those that it refuses.
    counted = [item["loc"] for item in items if item["type"] == "too_short"]
    within = {loc for loc in counted for item in items if item["loc"][: len(loc) + 1] > loc}
    lines = (
        _line(item, top(model), path, given)
        for item in items
        if not (item["type"] == "too_short" and item["loc"] in within)
    )
    # The branches of a union all complain about the same key.
    return list(dict.fromkeys(lines))


def refusal(name: str, value: Any, reason: str, path: Path, given: Collection[str]) -> str:
    """The line about one key; a value of None is not shown."""
    source = "command line" if _is_given(name, given) else str(path)
    shown = "" if value is None else f" = {_shown(value)}"
    return f"{source}: {name or 'configuration'}{shown}: {reason}"


def _line(item: ErrorDetails, root: Key, path: Path, given: Collection[str]) -> str:
    kind, key, value = item["type"], locate(root, item["loc"]), item["input"]
    if kind == "missing" and isinstance(item["loc"][-1], int):
        # A list that is too short; its input is what the element is missing from.
        kind, key = "too_short", locate(root, item["loc"][:-1])
    name = key.name
    match kind:
        case "extra_forbidden":
            name = ".".join(map(str, (*key.path, item["loc"][-1])))
            value, reason = None, f"unknown key{_hint(item, key, root)}"
        case "missing":
            value, reason = None, f"missing, and it has no default; it is {key.words}"
        case "union_tag_not_found" | "union_tag_invalid":
            name, value = f"{name}.kind", item["input"].get("kind")
            reason = f"must be one of {', '.join(repr(tag(model)) for model in key.models)}"
        case "value_error":
            reason = str(item["ctx"]["error"])
        case _:
            reason = f"must be {key.words}{_like(item, key)}"
    return refusal(
        name, None if key.models and isinstance(value, dict) else value, reason, path, given
    )


def _is_given(name: str, given: Collection[str]) -> bool:
    """Whether a key, or something in it, was set on the command line."""
    return any(f"{name}.".startswith(f"{k}.") or f"{k}.".startswith(f"{name}.") for k in given)


def _hint(item: ErrorDetails, key: Key, root: Key) -> str:
    """What may have been meant by an unknown key, and what is known beside it."""
    name, known = str(item["loc"][-1]), key.known()
    close = get_close_matches(name, known, n=1)
    # The right name in the wrong table.
    elsewhere = [found.name for found in every(root) if found.path[-1] == name]
    meant = close or elsewhere[:1]
    hint = f"; did you mean {meant[0]}?" if meant else ""
    return f"{hint} (known: {', '.join(known)})"


def _like(item: ErrorDetails, key: Key) -> str:
    """How it is written, where the type alone does not say: the closest choice, a table."""
    value = item["input"]
    if get_origin(key.annotation) is Literal and isinstance(value, str):
        close = get_close_matches(value, get_args(key.annotation), n=1)
        return f"; did you mean {close[0]!r}?" if close else ""
    if key.path and all(isinstance(part, str) for part in key.path):
        if key.words == "a table":
            return f", written [{key.name}]"
        if key.words.endswith("tables") and not isinstance(value, list):
            return f", each written [[{key.name}]]"
    return ""


def _shown(value: Any) -> str:
    """A value as TOML has it; shortened if it is long."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONG else f"{text[: _LONG - 3]}..."
