"""Configurations from TOML files and `--set` overrides.

Anything wrong becomes one line per key: file, dotted path, value, what is allowed.
"""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mission.base.errors import InputError
from mission.base.explain import explain, refusal
from mission.config.models import RunConfig
from mission.config.overrides import override
from mission.config.preflight import problems


def builtin_config(name: str) -> Path:
    """A configuration that comes with the product, installed or in a checkout."""
    package = Path(__file__).parents[1]
    for folder in (package / "configs", package.parent / "configs"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"built-in configuration {name} is missing from the installation")


def built_in_names() -> tuple[str, ...]:
    """The configurations that come with the product, without their `.toml`."""
    return tuple(
        sorted(path.stem for path in builtin_config("quickstart.toml").parent.glob("*.toml"))
    )


def load_config(
    source: Path | RunConfig,
    overrides: Mapping[str, Any] | None = None,
    *,
    giver: str = "command line",
) -> RunConfig:
    """Read a TOML file, or take a configuration; apply overrides by dotted path, and validate.

    `giver` is what an error calls the place that the overrides come from.

    Raises:
        InputError: the file cannot be read or parsed, a key is unknown or out of range, or it
            names a file, parameter or module that is not there; a line for each.
    """
    if isinstance(source, RunConfig):
        name, data = "configuration", source.model_dump(mode="json", exclude_none=True)
    else:
        name, data = str(source), _read(source)
    given = frozenset(overrides or {})
    for dotted, value in (overrides or {}).items():
        override(data, dotted, value, source=name, giver=giver)
    try:
        # By way of JSON, where pydantic tells lists, numbers, texts and truths apart as TOML does.
        config = RunConfig.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        lines = explain(error, RunConfig, name, given=given, giver=giver)
        raise InputError("\n".join(lines)) from None
    lines = [refusal(*item, name, given=given, giver=giver) for item in problems(config)]
    if lines:
        raise InputError("\n".join(lines))
    return config


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise InputError(f"{path}: cannot read the configuration: {reason}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: not a configuration: brackets nested too deep") from None
