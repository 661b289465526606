"""`--set KEY=VALUE`: single keys of a configuration, set over what its file says."""

import tomllib
from typing import Any

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from mission.base.errors import InputError
from mission.base.explain import Blame, refusal
from mission.base.schema import Key, top
from mission.config.models import RunConfig


def parse_override(text: str) -> tuple[str, object]:
    """`a.b=value` into a dotted path and a TOML value; a bare word is a string.

    Raises:
        InputError: there is no `=` or no key.
    """
    key, sep, raw = text.partition("=")
    key = key.strip()
    if not sep or not key or any(not part for part in key.split(".")):
        raise InputError(
            f"--set {text}: expected KEY=VALUE with a dotted key, e.g. mission.steps=8"
        )
    try:
        return key, tomllib.loads(f"value = {raw}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return key, raw.strip()


def override(
    data: dict[str, Any], dotted: str, value: object, *, source: str, giver: str = "command line"
) -> None:
    """Set one key in `data`, read from `source`; the value is not checked yet.

    Tables on the way that the file does not have are made; lists begin with their defaults.

    Raises:
        InputError: the way leads through what is neither a table nor a list, or past its end.
    """
    *way, last = dotted.split(".")
    node: Any = data
    key = top(RunConfig)
    try:
        for part in way:
            place = _place(node, part, key)
            inner = key.inner(place)
            if inner is None:  # validation says what is known there
                node[place] = value
                return
            key = inner
            if isinstance(node, dict):
                node.setdefault(place, _beginning(key))
            node = node[place]
            if not isinstance(node, dict | list) and _holds(key):  # the file's own fault
                raise InputError(refusal(key.name, node, f"must be {key.words}", Blame(source)))
        node[_place(node, last, key)] = value
    except _NoPlaceError as error:
        raise InputError(refusal(dotted, value, str(error), Blame(giver))) from None


class _NoPlaceError(Exception):
    """A dotted path that leads to no key."""


def _place(node: object, part: str, key: Key) -> str | int:
    """Where in a table or a list a part of a dotted path leads."""
    if isinstance(node, dict):
        return part
    if not isinstance(node, list):
        raise _NoPlaceError(f"{key.name} is {key.words}, and has nothing in it")
    if not node:
        raise _NoPlaceError(f"{key.name} is {key.words}, and empty; give it as a whole")
    if not part.isdecimal() or int(part) >= len(node):
        raise _NoPlaceError(
            f"{key.name} is a list of {len(node)}, so an index from 0 to {len(node) - 1} must "
            f"follow, not {part!r}"
        )
    return int(part)


def _holds(key: Key) -> bool:
    """Whether it is a table or a list."""
    return bool(key.models) or key.inner(0) is not None or key.inner("") is not None


def _beginning(key: Key) -> object:
    """What a key starts as that the file does not have; nothing, where it holds nothing."""
    if key.inner(0) is None:
        return {} if _holds(key) else None
    field = next(item for item in reversed(key.bounds) if isinstance(item, FieldInfo))
    default = field.get_default(call_default_factory=True, validated_data={})
    return [] if default is PydanticUndefined else list(default)
