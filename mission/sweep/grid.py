"""The runs of a sweep: every strategy with every seed and every value of every setting."""

import hashlib
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fl.plugin_code import label_of
from mission.base.errors import InputError
from mission.config.loading import load_config, parse_override
from mission.config.models import RunConfig

Cell = str | int | float | bool

# Keys that have an option of their own, by which the tables name them.
_OPTIONS = {"mission.strategy": "strategies", "seed": "seeds", "mission.rounds": "rounds"}
_NAME_LENGTH = 100


@dataclass(frozen=True)
class Axis:
    """A configuration key and the values that it takes."""

    key: str
    values: tuple[object, ...]


def file_name(text: str) -> str:
    """Replace characters that some file systems refuse in names by a dash."""
    return re.sub(r"[^A-Za-z0-9._=+-]+", "-", text)


@dataclass(frozen=True)
class Point:
    """Strategy, seed and settings of one run."""

    strategy: str  # what it is called, without the name of its code
    seed: int
    settings: tuple[tuple[str, object], ...]  # swept keys and this run's values

    @property
    def name(self) -> str:
        """Name of the run's folder: readable; with a hash where it had to be changed or cut."""
        parts = [self.strategy, *(f"{k.rpartition('.')[2]}={v}" for k, v in self.settings)]
        plain = "-".join([*parts, f"seed{self.seed}"])
        name = file_name(plain)[:_NAME_LENGTH]
        if name == plain:
            return name
        return f"{name}-{hashlib.sha256(plain.encode()).hexdigest()[:8]}"

    @property
    def where(self) -> str:
        """The settings in words; empty where none are swept."""
        return ", ".join(f"{key.rpartition('.')[2]} = {value}" for key, value in self.settings)

    @property
    def label(self) -> str:
        """Name of the group of runs that differ by their seeds only: strategy and settings."""
        return f"{self.strategy}, {self.where}" if self.where else self.strategy

    @property
    def keys(self) -> dict[str, Cell]:
        """Strategy, seed and settings as they stand in tables."""
        return {
            "strategy": self.strategy,
            "seed": self.seed,
            **{key: _cell(value) for key, value in self.settings},
        }


@dataclass(frozen=True)
class SweepRun(Point):
    """One run of a sweep."""

    config: RunConfig


@dataclass(frozen=True)
class Grid:
    """A sweep's common configuration, what varies, and the runs that follow."""

    base: RunConfig
    strategies: tuple[str, ...]
    seeds: tuple[int, ...]
    axes: tuple[Axis, ...]
    runs: tuple[SweepRun, ...]


def make_grid(
    source: Path | RunConfig,
    *,
    strategies: Sequence[str],
    seeds: int,
    axes: Sequence[Axis] = (),
    common: Mapping[str, object] | None = None,
    giver: str = "command line",
) -> Grid:
    """Make the grid of a sweep over a configuration, or that in a file; validate every run.

    Seeds count up from the configuration's. All runs have the `common` values by dotted key. A
    run's own value replaces one of these before files are read. `giver` is what an error calls
    the place that the values come from.

    Raises:
        InputError: a value is refused, named twice, or belongs to an option of its own.
    """
    if seeds < 1:
        raise InputError(f"seeds = {seeds}: at least 1")
    if not strategies:
        raise InputError("strategies: at least one")
    for axis in axes:
        if axis.key in _OPTIONS:
            raise InputError(f"{axis.key}: use {_OPTIONS[axis.key]} in a sweep")
    names = {label_of(strategy): strategy for strategy in strategies}
    _refuse_twice("strategies", [label_of(strategy) for strategy in strategies])
    _refuse_twice("settings", [axis.key for axis in axes])
    for axis in axes:
        _refuse_twice(axis.key, axis.values)
    # What has one value is common to all runs and need not be told in every row.
    single = {axis.key: axis.values[0] for axis in axes if len(axis.values) == 1}
    common, axes = {**(common or {}), **single}, [axis for axis in axes if len(axis.values) > 1]
    base = load_config(source, common, giver=giver)
    numbers = tuple(range(base.seed, base.seed + seeds))
    runs = []
    for point in points(strategies, numbers, axes):
        own = {"mission.strategy": names[point.strategy], "seed": point.seed}
        config = load_config(source, {**common, **dict(point.settings), **own}, giver=giver)
        if config.link.kind != "in_process":
            raise InputError(
                f"link.kind = {config.link.kind!r}: the runs of a sweep fly side by side, "
                "each in its own process; only 'in_process' does"
            )
        runs.append(SweepRun(point.strategy, point.seed, point.settings, config))
    return Grid(base, tuple(strategies), numbers, tuple(axes), tuple(runs))


def points(
    strategies: Sequence[str], seeds: Sequence[int], axes: Sequence[Axis]
) -> tuple[Point, ...]:
    """Cartesian product of strategies, seeds and settings, seed by seed.

    A sweep that is looked at before it is over then compares strategies on equal terms.
    """
    return tuple(
        Point(
            label_of(strategy), seed, tuple(zip((axis.key for axis in axes), values, strict=True))
        )
        for seed, values, strategy in itertools.product(
            seeds, itertools.product(*(axis.values for axis in axes)), strategies
        )
    )


def parse_axis(text: str) -> Axis:
    """Parse `key=v1,v2` into an axis; commas inside brackets, braces and quotes do not separate.

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


def _refuse_twice(what: str, values: Sequence[object]) -> None:
    for index, value in enumerate(values):
        if value in values[:index]:
            raise InputError(f"{what}: {value!r} is named twice")


def _cell(value: object) -> Cell:
    return value if isinstance(value, str | int | float | bool) else str(value)
