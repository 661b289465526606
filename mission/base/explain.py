"""Errors of a configuration in words, one line per key: its source, value and allowed values."""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticUndefined

from mission.base.errors import InputError, several
from native.errors import SettingError, did_you_mean, printable

_LONG = 60  # characters of a value that are shown
_WORDS = (  # of pydantic, and those that users of files know
    ("a valid (array|tuple|list)", "a list"),
    ("a valid integer", "a whole number"),
    (r"a valid dictionary( or instance of \w+)?", "an object"),
    ("a valid ", "a "),
)

Notation: TypeAlias = Literal["TOML", "JSON"]
Path: TypeAlias = tuple[str | int, ...]  # of a key, with the indices of lists
WrongKey: TypeAlias = tuple[str, object, str]  # dotted path, its value, why it cannot be used


@dataclass(frozen=True)
class Blame:
    """The origin of configuration keys, for messages: a file or place in one, or who set them.

    `giver` set those in `given`, each with the option that set it (empty for `--set`). All compare
    equal: configurations differ by their values, not by where those come from.
    """

    source: str = field(compare=False)
    given: Mapping[str, str] = field(default_factory=dict, compare=False)  # keys -> their options
    giver: str = field(default="command line", compare=False)
    notes: list[str] = field(default_factory=list, compare=False)  # of what was read, for its user

    def sets(self, name: str) -> bool:
        """Whether `giver` set a key, or something in it."""
        return any(
            f"{name}.".startswith(f"{k}.") or f"{k}.".startswith(f"{name}.") for k in self.given
        )

    def on(self, name: str) -> str:
        """Return a key's origin: `giver` where it or something in it was given, else `source`."""
        return self.giver if self.sets(name) else self.source

    @contextmanager
    def named(self) -> Iterator[None]:
        """Context manager: name the origin of the key in a `SettingError` of the block.

        Raises:
            InputError: in its place.
        """
        try:
            yield
        except SettingError as error:
            reason = refusal(error.key, error.value, error.allowed, self)
            raise InputError(reason) from None


def explain(
    error: ValidationError,
    model: type[BaseModel],
    data: object,
    blame: Blame,
    *,
    notation: Notation = "TOML",
) -> list[str]:
    """One line for each wrong key of `data`: source, key, value, what is allowed."""
    found: dict[Path, list[ErrorDetails]] = {}
    for item in error.errors():
        # Undefined: a default that could not be made, as what it is made from is wrong.
        if item["input"] is not PydanticUndefined:
            found.setdefault(_key(item, data), []).append(item)
    # A list is counted without the elements that are refused, and one branch of a union is refused
    # as a whole where another knows which part is wrong.
    deepest = [key for key in found if not any(_is_within(other, key) for other in found)]
    return [_line(key, found[key], model, blame, notation) for key in deepest]


@contextmanager
def explained(model: type[BaseModel], data: object, blame: Blame) -> Iterator[None]:
    """Context manager: turn a `ValidationError` about `data` into the lines of `explain`.

    Raises:
        InputError: the block raised a `ValidationError`.
    """
    try:
        yield
    except ValidationError as error:
        raise InputError("\n".join(explain(error, model, data, blame))) from None


def tables(kind: object, path: Path = ()) -> Iterator[tuple[Path, type[BaseModel]]]:
    """Yield path and model of every table in a type; elements of a list have the index 0."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield path, kind
        for name, item in kind.model_fields.items():
            yield from tables(item.annotation, (*path, name))
    within = (*path, 0) if get_origin(kind) is tuple else path
    for inner in get_args(kind):
        yield from tables(inner, within)


def refusal(name: str, value: object, reason: str, blame: Blame) -> str:
    """Error line about one key and its value."""
    if option := blame.given.get(name):
        # Of an option that may be given several times, the reason says which one is meant.
        several = isinstance(value, list | tuple)
        return f"{option}: {reason}" if several else f"{option} {value}: {reason}"
    return f"{blame.on(name)}: {printable(name, most=100)} = {shown(value)}: {reason}"


def shown(value: object) -> str:
    """Format a value for a message: null, true, false, or Python's repr, shortened if long."""
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    return printable(value, _in_a_line, most=_LONG)


def _in_a_line(value: object) -> str:
    text = repr(value)
    if "\n" in text:  # of arrays
        text = " ".join(text.split())
    if len(text) > _LONG and text.startswith("'/"):  # a path, which its end tells from others
        return f"'...{text[5 - _LONG :]}"
    return text


def _key(item: ErrorDetails, data: object) -> Path:
    """Return the path of an error's key, without the names that pydantic adds for branches."""
    path: Path = ()
    for part in item["loc"]:
        is_key = isinstance(data, Mapping) and part in data
        if is_key or (isinstance(data, list | tuple) and part in range(len(data))):
            path, data = (*path, part), data[part]  # type: ignore[index]
    if item["type"] == "missing":
        return (*path, item["loc"][-1])
    return (*path, "kind") if item["type"].startswith("union_tag") else path


def _is_within(key: Path, whole: Path) -> bool:
    return len(key) > len(whole) and key[: len(whole)] == whole


def _line(
    key: Path, items: list[ErrorDetails], model: type[BaseModel], blame: Blame, notation: Notation
) -> str:
    kind, value, name = items[0]["type"], items[0]["input"], ".".join(map(str, key))
    if kind == "extra_forbidden":
        reason = f"unknown key{_hint(key, model, sets=blame.sets(name), notation=notation)}"
        return f"{blame.on(name)}: {name}: {reason}"
    if kind.startswith("union_tag"):
        value = value.get("kind", PydanticUndefined)
    reasons = [_reason(item, notation) for item in items]
    said = "must be " if reasons[0].startswith("must be ") else "must "
    others = (one.removeprefix(said).removeprefix("must ") for one in reasons[1:])
    reason = ", or ".join([reasons[0], *others])
    if kind == "missing" or value is PydanticUndefined:
        return f"{blame.on(name)}: {name}: {reason}"
    if isinstance(value, dict) and kind == "value_error":
        # Rules of a table as a whole say themselves which of its keys they are about.
        named = [key for key in blame.given if re.search(rf"(?<![\w.]){re.escape(key)}\b", reason)]
        source = blame.giver if named else blame.on(name)
        return f"{source}: {f'{name}: ' if name else ''}{reason}"
    more = several("vehicles") if name == "vehicle" and isinstance(value, list) else ""
    return refusal(name or "configuration", value, reason + more, blame)


def _reason(item: ErrorDetails, notation: Notation) -> str:
    """What is wrong, in pydantic's words made ours."""
    context = item.get("ctx", {})
    match item["type"]:
        case "value_error":
            return str(context["error"])
        case "missing":
            return "missing, and it has no default"
        case "union_tag_not_found":
            return "missing; it says which kind of table this is"
        case "union_tag_invalid":
            return f"must be one of {context['expected_tags']}"
    text = re.sub(r"^\w+ should ", "must ", item["msg"].replace(" after validation", ""))
    for theirs, ours in _WORDS:
        text = re.sub(theirs, ours, text)
    if notation == "TOML":
        text = text.replace("an object", "a table")
    choices = re.findall(r"'([^']*)'", str(context.get("expected", "")))
    return text + (did_you_mean(item["input"], choices) if isinstance(item["input"], str) else "")


def _hint(key: Path, model: type[BaseModel], *, sets: bool, notation: Notation) -> str:
    """Suggest what an unknown key may mean, and list the known keys of its table."""
    if words := several(".".join(map(str, key))):
        return words
    *way, name = (0 if isinstance(part, int) else part for part in key)
    every = [(path, set(kind.model_fields)) for path, kind in tables(model)]
    elsewhere = [".".join(map(str, (*path, name))) for path, known in every if name in known]
    if name in elsewhere and notation == "TOML":
        return f"; {name} belongs to the top level{'' if sets else ', before the first table'}"
    known = sorted({one for path, names in every if path == tuple(way) for one in names})
    has_unit = name in {one.rpartition("_")[0] for one in known}
    if elsewhere and not has_unit:  # the right name in the wrong table
        return f"; did you mean {' or '.join(elsewhere[:3])}?"
    return f"{did_you_mean(str(name), known)} (known: {', '.join(known)})"
