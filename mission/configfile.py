"""Configurations from TOML files and `--set` overrides.

Anything wrong becomes one line per key: file, dotted path, value, what is allowed.
"""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mission.config import RunConfig
from mission.errors import InputError
from mission.precheck import faults
from mission.refusals import explain, refusal


def builtin_config(name: str) -> Path:
    """A configuration that comes with the product, installed or in a checkout."""
    package = Path(__file__).parent
    for folder in (package / "configs", package.parent / "configs"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"built-in configuration {name} is missing from the installation")


def load_config(path: Path, overrides: Mapping[str, Any] | None = None) -> RunConfig:
    """Read a TOML file, apply overrides by dotted path, and validate.

    Raises:
        InputError: the file cannot be read or parsed, a key is unknown or out of range, or it
            names a file, parameter or module that is not there; a line for each.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise InputError(f"{path}: cannot read the configuration: {reason}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    for dotted, value in (overrides or {}).items():
        _put(data, dotted, value)
    given = frozenset(overrides or {})
    try:
        # By way of JSON, where pydantic tells lists, numbers, texts and truths apart as TOML does.
        config = RunConfig.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        lines = explain(error, RunConfig, str(path), given=given)
        raise InputError("\n".join(lines)) from None
    lines = [refusal(*fault, str(path), given) for fault in faults(config)]
    if lines:
        raise InputError("\n".join(lines))
    return config


def parse_override(text: str) -> tuple[str, Any]:
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
    except tomllib.TOMLDecodeError:
        return key, raw.strip()


def _put(data: dict[str, Any], dotted: str, value: Any) -> None:
    node: Any = data
    parts = dotted.split(".")
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        if isinstance(node, list):
            if not part.isdigit() or int(part) >= len(node):
                raise InputError(
                    f"--set {dotted}: {'.'.join(parts[:depth])} is a list of {len(node)}, "
                    f"so an index from 0 to {len(node) - 1} must follow, not {part!r}"
                )
            index: Any = int(part)
        elif isinstance(node, dict):
            index = part
            if not last:
                node.setdefault(part, {})
        else:
            raise InputError(f"--set {dotted}: {'.'.join(parts[:depth])} is not a table")
        if last:
            node[index] = value
        else:
            node = node[index]
