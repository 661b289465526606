"""Usage errors of the command line, in words that a newcomer can follow."""

import re
from collections.abc import Sequence
from inspect import Parameter
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from cyclopts import (
    Argument,
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    RepeatArgumentError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from mission.base.errors import several

_NOUNS = {int: "a whole number", float: "a number"}


def spread(tokens: Sequence[str]) -> list[str]:
    """`--set A=1 B=2 FILE` as `--set A=1 --set B=2 FILE`: only KEY=VALUE is a value of it."""
    result: list[str] = []
    more = False  # whether another value of --set may follow
    for token in tokens:
        if more and result[-1] != "--set":
            more = bool(re.match(r"[\w.]+=", token)) and not Path(token).is_file()
            result += ["--set"] if more else []
        more |= token.split("=")[0] == "--set"
        result.append(token)
    return result


def in_words(error: CycloptsError) -> str:
    """Return one line that says why a command line cannot be carried out."""
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        return _missing(error)
    if isinstance(error, CoercionError) and error.token is not None and error.msg is None:
        name = error.token.keyword or _positional(error)
        return f"{name} {error.token.value}: must be {_words(error.target_type)}"
    if isinstance(error, UnknownOptionError):
        option = error.token.keyword or error.token.value
        if words := several(option.partition("=")[0]):
            return f"{_command(error)}: unknown option {option}{words}"
    if isinstance(error, RepeatArgumentError) and error.token.keyword == "--vehicle":
        return f"--vehicle: given twice{several('vehicles')}"
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        command = _command(error)
        many = several("vehicles") if command.endswith(" fly") else ""
        return f"{command}: did not expect {error.unused_tokens[0]!r}{many}; see {command} --help"
    return str(error)


def _missing(error: MissingArgumentError) -> str:
    argument = error.argument
    assert argument is not None
    command = _command(error)
    used = next((t.keyword for t in reversed(argument.tokens) if t.keyword), error.keyword)
    help_ = _help(error).split(". ")[0].rstrip(".")
    about = f" {help_};" if help_ else ""
    lacks = f"{used} needs a value:" if used else f"{_positional(error)} is missing:"
    return f"{lacks}{about} see {command} --help"


def _command(error: CycloptsError) -> str:
    return " ".join(("aerofed", *(error.command_chain or ())))


def _help(error: MissingArgumentError) -> str:
    """What the command's help says of the argument, on one line."""
    if error.app is None or error.argument is None:
        return ""
    for argument in error.app.assemble_argument_collection(parse_docstring=True):
        if argument.name == error.argument.name:
            return " ".join(str(argument.parameter.help or "").split())
    return ""


def _positional(error: CycloptsError) -> str:
    return "a value" if error.argument is None else _shown(error.argument)


def _shown(argument: Argument) -> str:
    """Return an option's name as it is typed, or a positional argument's in capitals."""
    option = argument.field_info.kind is Parameter.KEYWORD_ONLY
    return argument.name if option else argument.name.lstrip("-").upper()


def _words(kind: Any) -> str:
    """Describe the type of an option in words: a number, one of some choices."""
    if get_origin(kind) is Annotated:
        return _words(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(_words(option) for option in get_args(kind) if option is not NoneType)
    if get_origin(kind) is Literal:
        choices = [f'"{choice}"' for choice in get_args(kind)]
        return choices[0] if len(choices) == 1 else f"one of {', '.join(choices)}"
    return _NOUNS.get(kind, str(getattr(kind, "__name__", kind)))
