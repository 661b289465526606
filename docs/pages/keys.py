"""The keys of a configuration in words: what each may be, made from the models."""

from dataclasses import dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeGuard, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

# A key's last word is its unit; the longest ending that fits counts.
UNITS = {
    "_m": "m",
    "_s": "s",
    "_mps": "m/s",
    "_mps2": "m/s2",
    "_deg": "degrees",
    "_degps": "degrees/s",
    "_radps": "rad/s",
    "_per_rad": "1/rad",
    "_db": "dB",
    "_hz": "Hz",
    "_j": "J",
    "_mah": "mAh",
    "_ohm": "ohm",
    "_pa": "Pa",
    "_gauss": "gauss",
    "_rounds": "rounds",
}
_NOUNS: dict[object, tuple[str, str]] = {
    float: ("a number", "numbers"),
    int: ("a whole number", "whole numbers"),
    str: ("text", "texts"),
    bool: ("true or false", "truths"),
    Path: ("a path", "paths"),
}


@dataclass(frozen=True)
class Key:
    """A place in a configuration: a table, a value, or an element of a list."""

    path: tuple[str | int, ...]
    annotation: object  # its type, without what `Annotated` adds
    bounds: tuple[object, ...] = ()  # what `Annotated` and the field add: limits, patterns

    @property
    def name(self) -> str:
        """The key as a dotted path."""
        return ".".join(map(str, self.path))

    @property
    def words(self) -> str:
        """What it may be: type, limits, unit."""
        text = _words(self)
        last = next((part for part in reversed(self.path) if isinstance(part, str)), "")
        ending = max((e for e in UNITS if last.endswith(e)), key=len, default=None)
        return f"{text}, in {UNITS[ending]}" if ending and "number" in text else text

    @property
    def models(self) -> tuple[type[BaseModel], ...]:
        """The kinds of table it may be: none for a value, several where `kind` tells."""
        return tuple(option for option in _options(self.annotation) if _is_model(option))

    def inner(self, part: str | int) -> "Key | None":
        """The key `part` within this one; None where there is none."""
        for option in _options(self.annotation):
            found = _inner(option, part)
            if found is not None:
                return _key((*self.path, part), *found)
        return None

    def bound(self, name: str) -> Any:
        """A limit of that name among the bounds; None without one."""
        values = (getattr(item, name, None) for item in self.bounds)
        return next((value for value in values if value is not None), None)

    @property
    def example(self) -> str | None:
        """A value, for keys whose pattern alone says little."""
        examples = self.bound("examples")
        return examples[0] if examples else None


def top(model: type[BaseModel]) -> Key:
    """Root key: the configuration as a whole."""
    return Key((), model)


def _key(path: tuple[str | int, ...], annotation: object, bounds: tuple[object, ...]) -> Key:
    while get_origin(annotation) is Annotated:
        annotation, *more = get_args(annotation)
        for item in more:
            bounds = (*(_bounds(item) if isinstance(item, FieldInfo) else (item,)), *bounds)
    options = [a for a in get_args(annotation) if a is not NoneType]
    if get_origin(annotation) in (Union, UnionType) and len(options) == 1:
        return _key(path, options[0], bounds)
    return Key(path, annotation, bounds)


def _bounds(field: FieldInfo) -> tuple[object, ...]:
    # The field itself holds the examples.
    return (*field.metadata, field)


def _options(annotation: object) -> tuple[object, ...]:
    """The members of a union, or the one type."""
    if get_origin(annotation) in (Union, UnionType):
        return get_args(annotation)
    return (annotation,)


def _inner(annotation: object, part: str | int) -> tuple[object, tuple[object, ...]] | None:
    arguments = get_args(annotation)
    if _is_model(annotation):
        field = annotation.model_fields.get(str(part))
        return None if field is None else (field.annotation, _bounds(field))
    if get_origin(annotation) is tuple and isinstance(part, int):
        elements = arguments[:1] if arguments[-1] is Ellipsis else arguments[part : part + 1]
        return (elements[0], ()) if elements else None
    if get_origin(annotation) is dict and isinstance(part, str):
        return arguments[1], ()
    return None


def _is_model(annotation: object) -> TypeGuard[type[BaseModel]]:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def tag(model: type[BaseModel]) -> str | None:
    """The `kind` by which a table is told from others."""
    kind = model.model_fields.get("kind")
    return kind.default if kind is not None and isinstance(kind.default, str) else None


def _words(key: Key, *, many: bool = False) -> str:
    """Type and limits, in the singular with its article or in the plural without."""
    annotation, arguments = key.annotation, get_args(key.annotation)
    origin = get_origin(annotation)
    if origin in (Union, UnionType) and not key.models:
        given = (option for option in arguments if option is not NoneType)
        options = [_key(key.path, option, key.bounds) for option in given]
        return " or ".join(_words(option, many=many) for option in options)
    if origin is Literal:
        choices = ", ".join(map(repr, arguments))
        return choices if len(arguments) == 1 else f"one of {choices}"
    if origin is tuple:
        element = _key((*key.path, 0), arguments[0], ())
        return f"{'lists' if many else 'a list'} of {_count(key)}{_words(element, many=True)}"
    if origin is dict:
        return f"a table of {_words(_key(key.path, arguments[1], ()), many=True)} by name"
    one, several = _NOUNS.get(annotation, ("a table", "tables"))
    return (several if many else one) + _limits(key)


def _count(key: Key) -> str:
    """How many elements a list must have."""
    arguments = get_args(key.annotation)
    if arguments[-1] is not Ellipsis:
        return f"{len(arguments)} "
    low, high = key.bound("min_length"), key.bound("max_length")
    return "" if low is None or high is None else f"{low} to {high} "


def _limits(key: Key) -> str:
    if key.example is not None:
        pattern = key.bound("pattern")
        return f" such as {key.example!r}" + (f", matching {pattern}" if pattern else "")
    if key.annotation is str and key.bound("max_length") is not None:
        return f" of {key.bound('min_length')} to {key.bound('max_length')} characters"
    low, high = key.bound("ge"), key.bound("le")
    if low is not None and high is not None:
        return f" from {_number(low)} to {_number(high)}"
    words = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
    limits = [
        f"{word} {_number(bound)}"
        for name, word in words.items()
        if (bound := key.bound(name)) is not None
    ]
    return f" {' and '.join(limits)}" if limits else ""


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
