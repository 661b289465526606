"""Configurations from TOML files and `--set` overrides.

Anything wrong becomes one line per key: file, dotted path, value, what is allowed.
"""

import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from fl.plugin_code import register
from mission.base.errors import InputError
from mission.base.explain import Blame, explained, refusal, shown
from mission.base.user_files import MOST_DEEP, parse_toml, read_text, taken_by, whole_path
from mission.config import Shipped
from mission.config.models import RunConfig
from mission.config.preflight import problems
from mission.config.vehicles import shared_with
from mission.config.world import with_world
from native.errors import SettingError, did_you_mean, printable
from sitl.config import BINARIES, VehicleConfig

_PATHS = (
    ("vehicle", "firmware", "path"),
    ("vehicle", "parameter_file"),
    ("vehicles", "firmware", "path"),
    ("vehicles", "parameter_file"),
    ("link", "signing_key"),
    ("radio", "map_file"),
)
SHIPPED: tuple[str, ...] = get_args(Shipped)


def builtin_config(name: str) -> Path:
    """Return the path of a shipped configuration file; raise InputError if it is missing."""
    package = Path(__file__).parents[1]
    for folder in (package / "configs", package.parent / "configs"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"built-in configuration {name} is missing from the installation")


def shipped_files(name: str) -> tuple[Path, ...]:
    """Return the shipped configuration of that name, and the GeoJSON files named after it."""
    config = builtin_config(f"{name}.toml")
    return (config, *sorted(config.parent.glob(f"{name}-*.geojson")))


def config_file(path: Path) -> Path:
    """The file itself, or the shipped configuration of that name where there is no such file.

    Raises:
        InputError: neither; says which names are known.
    """
    if path.is_file() or path.suffix or len(path.parts) != 1:
        return path
    if str(path) in SHIPPED:
        return builtin_config(f"{path}.toml")
    raise InputError(
        f"{path}: no such configuration file; shipped are {', '.join(SHIPPED)}"
        f"{did_you_mean(str(path), SHIPPED)}"
    )


def load_config(
    source: Path | RunConfig,
    overrides: Mapping[str, object] | None = None,
    *,
    options: Mapping[str, str] | None = None,
    giver: str = "command line",
    beneath: Mapping[str, object] | None = None,
    counts: Sequence[str] = (),
) -> RunConfig:
    """Read a TOML file, or a shipped configuration by its name, or take a configuration; apply
    overrides by dotted path, and validate.

    `giver` is what an error calls the place that the overrides come from; `options` says which of
    them an option of the command line made; `beneath` are keys that a file may leave out. Where
    `counts` names keys and tables, no others may be overridden.

    Raises:
        InputError: the file cannot be read or parsed, a key is unknown or out of range, or it
            names a file, parameter or module that is not there; a line for each.
    """
    for dotted in overrides or {}:
        if counts and not any(f"{dotted}.".startswith(f"{name}.") for name in counts):
            raise InputError(f"{giver}: {dotted}: counts for nothing here; {', '.join(counts)} do")
    if isinstance(source, RunConfig):
        path = Path("configuration")
        data = source.model_dump(mode="json", exclude_none=True)
    else:
        path = config_file(source)
        data = {**(beneath or {}), **_read(path)}
        _make_absolute(data, path.parent)
    given = {key: (options or {}).get(key, "") for key in overrides or {}}
    blame = Blame(str(path), given, giver)
    with blame.named():
        return _checked(data, overrides or {}, blame)


def _checked(data: dict[str, Any], overrides: Mapping[str, object], blame: Blame) -> RunConfig:
    for dotted, value in overrides.items():
        override(data, dotted, value)
    if "radio.map_file" in overrides and "radio.map_sha256" not in overrides:
        data["radio"].pop("map_sha256", None)  # of another file
    _find_firmware(data)
    _make_absolute(data, Path())
    if "vehicles" in data:
        with suppress(ValidationError):  # what is wrong for all is told once
            VehicleConfig.model_validate_json(_json(data.get("vehicle", {})))
            data["vehicles"] = shared_with(data["vehicles"], data.get("vehicle", {}))
    with explained(RunConfig, data, blame):
        # By way of JSON, where pydantic tells lists, numbers, texts and truths apart as TOML does.
        config = RunConfig.model_validate_json(_json(data), strict=True)
    config = with_world(config, blame).read_from(blame)
    lines = [refusal(*problem, blame) for problem in problems(config)]
    if lines:
        raise InputError("\n".join(lines))
    return config


def _find_firmware(data: Mapping[str, Any]) -> None:
    """Name the binary of the firmware that is to fly as the environment does, where nobody has."""
    for vehicle in (*_tables(data, "vehicle"), *_tables(data, "vehicles")):
        if named := os.environ.get(BINARIES.get(str(vehicle.get("autopilot")), "")):
            firmware = vehicle.setdefault("firmware", {})
            if isinstance(firmware, dict):
                firmware.setdefault("path", named)


def _tables(data: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    """Return the table of that name, or those in its list."""
    found = data.get(name)
    return [one for one in (found if isinstance(found, list) else [found]) if isinstance(one, dict)]


def _make_absolute(data: dict[str, Any], folder: Path) -> None:
    """Make the paths in a configuration absolute: they are relative to `folder`, that of the file
    that names them, or begin with ~ for a home."""
    for *names, key in _PATHS:
        tables = [data]
        for name in names:
            tables = [inner for table in tables for inner in _tables(table, name)]
        for table in tables:
            if isinstance(path := table.get(key), str | Path):
                table[key] = str(whole_path(folder, path))


def plain(value: object) -> object:
    """Convert a key's value to what files can hold: arrays and their scalars to lists and numbers,
    tuples to lists, plug-ins passed as objects to their names, paths and dates to text."""
    return json.loads(_json(value))


def _json(value: object) -> str:
    def of_other(it: object) -> object:
        return it.tolist() if hasattr(it, "tolist") else printable(register(it))

    return json.dumps(value, default=of_other)


def _read(path: Path) -> dict[str, Any]:
    if path.suffix != ".toml" and (words := taken_by(path)):
        raise InputError(f"{path}: not a configuration{words}")
    text = read_text(path)
    try:
        return parse_toml(text)
    except ValueError as error:
        raise InputError(f"{path}: not valid TOML: {_in_words(error, text)}") from None


def _in_words(error: ValueError, text: str) -> str:
    """What is wrong, with the line that it is about; a key that is given twice is named."""
    lines = text.splitlines()
    place = re.search(r"at line (\d+)", str(error))
    number = int(place[1]) if place else len(lines)
    line = lines[number - 1].strip() if 0 < number <= len(lines) else ""
    key, equals, _ = line.partition("=")
    if equals and "Cannot overwrite a value" in str(error):
        return f"line {number}: {key.strip()}: given twice in its table; leave one of them out"
    placed = place or "at end of document" in str(error)
    return f"{error}: {shown(line)}" if placed and line else str(error)


def parse_override(text: str) -> tuple[str, object]:
    """Parse `a.b=value` into a dotted path and a TOML value; a bare word is a string.

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
        return key, parse_toml(f"value = {raw}")["value"]
    except ValueError:
        return key, raw.strip()


def override(data: dict[str, Any], dotted: str, value: object) -> None:
    """Set one key in `data`; the value is not checked yet. Tables on the way are made.

    Raises:
        SettingError: the way leads through what is neither a table nor a list, or past its end.
    """
    parts: list[Any] = dotted.split(".")
    if len(parts) > MOST_DEEP:
        reason = f"no key has {len(parts)} parts; {MOST_DEEP} at most"
        raise SettingError(dotted, value, reason)
    node: Any = data
    for depth, part in enumerate(parts):
        name, last = ".".join(parts[:depth]), depth == len(parts) - 1
        reason = ""
        if isinstance(node, list):
            if part.isdecimal() and int(part) < len(node):
                part = int(part)
            else:
                most = f"an index from 0 to {len(node) - 1} must follow, not {part!r}"
                reason = f"{name} is a list of {len(node)}{f', so {most}' if node else ''}"
        elif not isinstance(node, dict):
            reason = f"{name} is {shown(node)}, and has nothing in it"
        if reason:
            raise SettingError(dotted, value, reason)
        if last:
            node[part] = value
        else:
            node = node.setdefault(part, {}) if isinstance(node, dict) else node[part]
