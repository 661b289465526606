"""What is wrong with a configuration, a line a key: where it stands, its value, what it may be."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Literal, TypeAlias, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticUndefined

from fl.errors import did_you_mean
from mission.base.schema import Key, every, locate, tag, top

_LONG = 60  # characters of a value that are shown
_TABLE = "a table"

Notation: TypeAlias = Literal["TOML", "JSON"]
_OTHER_KIND = ("float_type", "int_type", "literal_error")  # a value where a list is one, too


@dataclass(frozen=True)
class Blame:
    """Where a wrong key may come from: a file or a place in one, but for those that were `given`.

    Those were set by `giver`; each has the option that set it, or nothing for `--set`. All are
    equal: configurations differ by their values, not by where those come from.
    """

    source: str = field(compare=False)
    given: Mapping[str, str] = field(default_factory=dict, compare=False)  # keys -> their options
    giver: str = field(default="command line", compare=False)

    def sets(self, name: str) -> bool:
        """Whether `giver` set a key, or something in it."""
        return any(
            f"{name}.".startswith(f"{k}.") or f"{k}.".startswith(f"{name}.") for k in self.given
        )

    def on(self, name: str) -> str:
        """Who set a key: `giver`, where it or something in it was given so."""
        return self.giver if self.sets(name) else self.source


def explain(
    error: ValidationError, model: type[BaseModel], blame: Blame, *, notation: Notation = "TOML"
) -> list[str]:
    """One line for each wrong key: source, key, value, what is allowed."""
    items = error.errors()
    # Pydantic counts the elements of a list without those that it refuses.
    counted = [item["loc"] for item in items if item["type"] == "too_short"]
    within = {loc for loc in counted for item in items if item["loc"][: len(loc) + 1] > loc}
    keys = [locate(top(model), item["loc"]).path for item in items]
    lines = (
        _line(item, top(model), notation, blame)
        for item, key in zip(items, keys, strict=True)
        if not (item["type"] == "too_short" and item["loc"] in within)
        # One branch of a union is refused as a whole, where another knows which part is wrong.
        and not (item["type"] in _OTHER_KIND and any(_is_within(other, key) for other in keys))
        # A default that could not be made, as what it is made from is wrong.
        and item["input"] is not PydanticUndefined
    )
    # The branches of a union all complain about the same key.
    return list(dict.fromkeys(lines))


def _is_within(key: tuple[str | int, ...], whole: tuple[str | int, ...]) -> bool:
    return len(key) > len(whole) and key[: len(whole)] == whole


def refusal(name: str, value: object, reason: str, blame: Blame) -> str:
    """Error line about one key and its value."""
    if option := blame.given.get(name):
        return _of_option(option, value, reason)
    return f"{blame.on(name)}: {name} = {shown(value)}: {reason}"


def _of_option(option: str, value: object, reason: str) -> str:
    """Of an option that may be given several times, the reason says which one is meant."""
    several = isinstance(value, list | tuple)
    return f"{option}: {reason}" if several else f"{option} {value}: {reason}"


def shown(value: object) -> str:
    """A value as TOML and JSON have it; shortened if it is long."""
    text = json.dumps(value) if value is None or isinstance(value, bool) else repr(value)
    if "\n" in text:  # of arrays
        text = " ".join(text.split())
    return text if len(text) <= _LONG else f"{text[: _LONG - 3]}..."


def _line(item: ErrorDetails, root: Key, notation: Notation, blame: Blame) -> str:
    kind, key, value = item["type"], locate(root, item["loc"]), item["input"]
    if kind == "missing" and isinstance(item["loc"][-1], int):
        # A list that is too short; its input is what the element is missing from.
        kind, key = "too_short", locate(root, item["loc"][:-1])
    name = key.name
    equals = "" if key.models and isinstance(value, dict) else f" = {shown(value)}"
    words = "an object" if notation == "JSON" and key.words == _TABLE else key.words
    match kind:
        case "extra_forbidden":
            last = str(item["loc"][-1])
            name = ".".join(map(str, (*key.path, last)))
            in_file = notation == "TOML" and not blame.sets(name)
            equals, reason = "", f"unknown key{_hint(last, key, root, in_file=in_file)}"
        case "missing":
            equals, reason = "", f"missing, and it has no default; it is {words}"
        case "union_tag_not_found" | "union_tag_invalid":
            name, tagged = f"{name}.kind", item["input"].get("kind")
            equals = "" if tagged is None else f" = {shown(tagged)}"
            reason = f"must be one of {', '.join(repr(tag(model)) for model in key.models)}"
        case "value_error":
            reason = str(item["ctx"]["error"])
        case _:
            reason = f"must be {words}{_choice(value, key)}"
            if notation == "TOML":
                reason += _heading(value, key)
    if option := blame.given.get(name):
        return _of_option(option, value, reason)
    # Rules of a table as a whole say themselves which of its keys they are about.
    about = f"{name or 'configuration'}{equals}: " if name or equals else ""
    return f"{blame.on(name)}: {about}{reason}"


def _hint(name: str, key: Key, root: Key, *, in_file: bool) -> str:
    """What may have been meant by an unknown key in the table `key`, and what is known there."""
    elsewhere = [found.name for found in every(root) if found.path[-1] == name]
    if in_file and name in elsewhere:
        return f"; {name} belongs to the top level, before the first table"
    if elsewhere:  # the right name in the wrong table
        return f"; did you mean {' or '.join(elsewhere[:3])}?"
    known = key.known()
    return f"{did_you_mean(name, known)} (known: {', '.join(known)})"


def _choice(value: object, key: Key) -> str:
    """Suggestion of the closest choice, for a misspelt one."""
    if get_origin(key.annotation) is not Literal or not isinstance(value, str):
        return ""
    texts = [choice for choice in get_args(key.annotation) if isinstance(choice, str)]
    close = get_close_matches(value, texts, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def _heading(value: object, key: Key) -> str:
    """How TOML writes a key that is a table or a list of them."""
    if key.path and all(isinstance(part, str) for part in key.path):
        if key.words == _TABLE:
            return f", written [{key.name}]"
        if key.words.endswith("tables") and not isinstance(value, list):
            return f", each written [[{key.name}]]"
    return ""
