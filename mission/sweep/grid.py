"""The runs of a sweep: every strategy with every seed and every value of every setting."""

import hashlib
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission.config import RunConfig, load_config, parse_override
from mission.errors import InputError

Key = str | int | float | bool

# Keys that have an option of their own, by which the tables name them.
_OPTIONS = {"mission.strategy": "--strategies", "seed": "--seeds", "mission.rounds": "--rounds"}
_NAME_LENGTH = 100


@dataclass(frozen=True)
class Axis:
    """A configuration key and the values that it takes."""

    key: str
    values: tuple[Any, ...]


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep."""

    name: str  # of its folder
    strategy: str
    seed: int
    settings: tuple[tuple[str, Any], ...]  # swept keys and this run's values
    config: RunConfig

    @property
    def keys(self) -> dict[str, Key]:
        """What tells this run from the others, as it stands in tables."""
        return {
            "strategy": self.strategy,
            "seed": self.seed,
            **{key: _cell(value) for key, value in self.settings},
        }


@dataclass(frozen=True)
class Grid:
    """A sweep's common configuration, what varies, and the runs that follow."""

    base: RunConfig
    strategies: tuple[str, ...]
    seeds: tuple[int, ...]
    axes: tuple[Axis, ...]
    runs: tuple[SweepRun, ...]


def make_grid(
    path: Path,
    *,
    strategies: Sequence[str],
    seeds: int,
    rounds: int | None = None,
    axes: Sequence[Axis] = (),
) -> Grid:
    """Every run of a sweep over the configuration in `path`, each validated.

    Seeds count up from the configuration's. Runs are ordered seed by seed, so that a sweep which
    is looked at before it is over compares strategies on equal terms.

    Raises:
        InputError: a value is refused, named twice, or belongs to an option of its own.
    """
    if seeds < 1:
        raise InputError(f"--seeds {seeds}: at least 1")
    for axis in axes:
        if axis.key in _OPTIONS:
            raise InputError(f"--set {axis.key}: use {_OPTIONS[axis.key]} in a sweep")
    _refuse_twice("--strategies", strategies)
    _refuse_twice("--set", [axis.key for axis in axes])
    for axis in axes:
        _refuse_twice(f"--set {axis.key}", axis.values)
    # What has one value is common to all runs and need not be told in every row.
    common = {axis.key: axis.values[0] for axis in axes if len(axis.values) == 1}
    axes = [axis for axis in axes if len(axis.values) > 1]
    keys = [axis.key for axis in axes]
    if rounds is not None:
        common["mission.rounds"] = rounds
    base = load_config(path, common)
    numbers = tuple(range(base.seed, base.seed + seeds))
    runs = []
    for seed, values, strategy in itertools.product(
        numbers, itertools.product(*(axis.values for axis in axes)), strategies
    ):
        settings = tuple(zip(keys, values, strict=True))
        config = load_config(
            path, {**common, **dict(settings), "mission.strategy": strategy, "seed": seed}
        )
        if config.link.kind != "in_process":
            raise InputError(
                f"link.kind = {config.link.kind!r}: the runs of a sweep fly side by side, "
                "each in its own process; only 'in_process' does"
            )
        runs.append(SweepRun(_name(strategy, seed, settings), strategy, seed, settings, config))
    return Grid(base, tuple(strategies), numbers, tuple(axes), tuple(runs))


def parse_axis(text: str) -> Axis:
    """`key=v1,v2` into an axis; commas inside brackets, braces and quotes do not separate.

    Raises:
        InputError: there is no `=`, no key or an empty value.
    """
    key, _, raw = text.partition("=")
    pieces = _split(raw)
    if not all(piece.strip() for piece in pieces):
        raise InputError(f"--set {text}: expected KEY=VALUE or KEY=VALUE,VALUE,...")
    parsed = [parse_override(f"{key}={piece}") for piece in pieces]
    return Axis(parsed[0][0], tuple(value for _, value in parsed))


def _split(text: str) -> list[str]:
    pieces, depth, quote = [""], 0, ""
    for char in text:
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote = char
        elif char in "[{":
            depth += 1
        elif char in "]}":
            depth -= 1
        elif char == "," and depth == 0:
            pieces.append("")
            continue
        pieces[-1] += char
    return pieces


def _refuse_twice(what: str, values: Sequence[Any]) -> None:
    for index, value in enumerate(values):
        if value in values[:index]:
            raise InputError(f"{what}: {value!r} is named twice")


def _name(strategy: str, seed: int, settings: Sequence[tuple[str, Any]]) -> str:
    """A folder's name: readable, and unique where it had to be changed for the file system."""
    parts = [strategy, *(f"{key.rpartition('.')[2]}={value}" for key, value in settings)]
    plain = "-".join([*parts, f"seed{seed}"])
    name = re.sub(r"[^A-Za-z0-9._=-]+", "-", plain)[:_NAME_LENGTH]
    if name == plain:
        return name
    return f"{name}-{hashlib.sha256(plain.encode()).hexdigest()[:8]}"


def _cell(value: Any) -> Key:
    return value if isinstance(value, str | int | float | bool) else str(value)
