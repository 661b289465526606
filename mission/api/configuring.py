"""Configurations of runs, by name, file or value, and channels."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from fl.config import ChannelConfig
from mission.base.errors import InputError
from mission.base.explain import Blame, explained
from mission.config.models import RunConfig

if TYPE_CHECKING:
    from fl.radio.channel import Channel

# A name ("quickstart"), a TOML file, or a configuration.
Source: TypeAlias = "str | Path | RunConfig"


def config(
    source: Source = "quickstart", overrides: Mapping[str, object] | None = None
) -> "RunConfig":
    """A run's configuration: `source`, with single keys set over it, checked as a whole.

    Args:
        source: "quickstart", "paper", "paper-sweep", "apart", "town", "city" or "munich", which
            come along; the path of a TOML file; or a configuration, which stays as it is.
        overrides: values by dotted key, as on the command line: {"mission.rounds": 3}.

    Raises:
        InputError: there is no such file, or a key or value is refused; a line for each.
    """
    return config_of(source, overrides)


def config_of(
    source: Source, overrides: Mapping[str, object] | None, counts: Sequence[str] = ()
) -> "RunConfig":
    """Return a configuration as `config` does; `counts`: the keys and tables that may be set."""
    from mission.config.loading import load_config

    return load_config(checked(source, overrides), overrides, giver="overrides", counts=counts)


def checked(source: Source, overrides: object) -> "Path | RunConfig":
    """Check the types of `source` and `overrides`, as notebooks do not; return the source.

    Raises:
        InputError: one of the two is of another type.
    """
    if not isinstance(source, str | PathLike | RunConfig):
        raise InputError(
            f"source = {source!r}: must be a configuration's name, its file, or a RunConfig"
        )
    if not isinstance(overrides, Mapping | None):
        raise InputError(
            f"overrides = {overrides!r}: must be a dictionary, such as {{'mission.rounds': 3}}"
        )
    return source if isinstance(source, RunConfig) else Path(source)


def channel(
    preset: str = "suburban", *, altitude_m: float | None = None, **constants: float
) -> "Channel":
    """An air-to-ground channel: `channel("urban").per(distance_m, height_m)`.

    Args:
        preset: a name of docs/channels.md.
        altitude_m: height that `per` assumes where it is given none; default: the preset's 60 m.
        constants: keys of the table `channel` of a configuration: `extra_gain_db=3.0`.

    Raises:
        InputError: an unknown preset or constant, or one out of range.
    """
    given = {"preset": preset, **constants}
    blame = Blame("channel")
    with blame.named(), explained(ChannelConfig, given, blame):
        return ChannelConfig.model_validate(given).channel(altitude_m=altitude_m)


def as_path(path: object, what: str) -> Path:
    """Return `path` as a Path; `what` names the argument in errors.

    Raises:
        InputError: it is not a path.
    """
    if not isinstance(path, str | PathLike) or "\0" in str(path):
        raise InputError(f"{what} = {path!r}: must be a path")
    return Path(path)


def folder(path: Path | str | None) -> Path | None:
    """Return a data folder, which must exist; None for None.

    Raises:
        InputError: it does not exist.
    """
    if path is None:
        return None
    folder = as_path(path, "data_dir")
    if not folder.is_dir():
        raise InputError(f"data_dir = {str(path)!r}: no such folder")
    return folder
