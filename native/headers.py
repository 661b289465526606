"""What C declares, as ctypes: the one description of what C and Python hand each other.

This reads C in the style of this project, each from the beginning of a line: `typedef struct {...}
Name;`, `enum {...};` and functions marked EXPORTED. Anything else that it meets there is an error.
"""

import ctypes
import re
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from native.building import INCLUDE
from native.errors import InputError

_TYPES: dict[str, Any] = {
    **{f"{name}_t": getattr(ctypes, f"c_{name}") for name in ("int64", "uint64", "int32", "uint8")},
    **{name: getattr(ctypes, f"c_{name}") for name in ("int", "size_t", "float", "double")},
    "Object": ctypes.py_object,  # a `void *` to what a structure keeps alive
    "void": None,
}
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_DECLARATION = re.compile(
    r'^#include "(.+?)"|^enum[^{]*\{(.*?)\};|^typedef struct \{(.*?)^\} (\w+);|^EXPORTED ([^{]*)\{',
    re.DOTALL | re.MULTILINE,
)
_FUNCTION = re.compile(r"(?:const )?(\w+) (\*?)(?:\(\*)?(\w+)\)?\((.*)\)", re.DOTALL)
_MEMBER = re.compile(r"(?:const )?(\w+) (.*)", re.DOTALL)
_NAME = re.compile(r"(\(?\*?)(\w+)\)?(\[[^]]*\])?")


class Structure(ctypes.Structure):
    """A C structure, made of values by name, not by place; it has no other attributes than C's."""

    __slots__ = ()
    functions: ClassVar[dict[str, list[Any]]]  # of its pointers to some: types as in `declared`

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)


@cache
def declared(source: Path) -> dict[str, Any]:
    """Structures, constants, and types of exported functions (the result's, then arguments') by
    name, with those of what a source includes from its own folder or `native/include`.

    A file is read once: structures that two libraries share are the same class.

    Raises:
        InputError: a declaration of another form.
    """
    found: dict[str, Any] = {}
    text = _COMMENT.sub("", source.read_text(encoding="utf-8"))
    for included, constants, members, name, function in _DECLARATION.findall(text):
        if included:
            beside = source.with_name(included)
            found |= declared(beside if beside.exists() else INCLUDE / included)
        elif name:
            found[name] = _structure(name, members, found)
        elif function:
            found |= [_function(function.strip())]
        value = -1
        for constant in filter(str.strip, constants.split(",")):
            key, _, given = constant.partition("=")
            found[key.strip()] = value = _number(given, found) if given else value + 1
    return found


def columns(structure: type[Structure], members: str) -> int:
    """How many numbers an array has in a row that C reads as a structure of these members.

    Raises:
        InputError: C has others, or in another order.
    """
    there = " ".join(name for name, *_ in structure._fields_)
    if members != there:
        raise InputError(f"{structure.__name__} is {there} in C, {members} in Python")
    return ctypes.sizeof(structure) // ctypes.sizeof(ctypes.c_double)


def _read(pattern: re.Pattern[str], text: str) -> tuple[str, ...]:
    if (read := pattern.fullmatch(text)) is None:
        raise InputError(f"C that is not read: {text}")
    return read.groups("")


def _number(text: str, found: dict[str, Any]) -> int:
    return int(eval(text.strip(), {}, found))  # arithmetic of our own, over constants before


def _structure(name: str, members: str, found: dict[str, Any]) -> Any:
    fields: list[tuple[str, Any]] = []
    functions: dict[str, list[Any]] = {}
    for member in filter(None, map(str.strip, members.split(";"))):
        if "(*" in member and member.endswith(")"):
            functions |= [_function(member)]
            fields.append(([*functions][-1], ctypes.c_void_p))
            continue
        kind, variables = _read(_MEMBER, member)
        for variable in variables.split(","):
            pointer, key, size = _read(_NAME, variable.strip())
            made = ctypes.c_void_p if pointer else _TYPES.get(kind) or found[kind]
            if size and "(" not in pointer:
                made *= _number(size[1:-1] or "0", found)
            fields.append((key, made))
    return type(name, (Structure,), {"__slots__": (), "_fields_": fields, "functions": functions})


def _function(text: str) -> tuple[str, list[Any]]:
    result, pointer, name, arguments = _read(_FUNCTION, text)
    given = [] if arguments == "void" else arguments.split(",")
    words = [re.findall(r"\w+|[*[]", argument.replace("const ", "")) for argument in given]
    kinds = [ctypes.c_void_p if {"*", "["} & {*word} else _TYPES[word[0]] for word in words]
    return name, [ctypes.c_void_p if pointer else _TYPES[result], *kinds]
