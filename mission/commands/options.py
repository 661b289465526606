"""Options that several commands have, and what is made of them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mission.base.console import RunConsole
from mission.base.errors import InputError
from mission.base.terminal import Terminal

if TYPE_CHECKING:
    from mission.config.models import RunConfig

RUNS = Path("runs")  # of folders that nobody named
LIVE_PORT = 8765  # that Foxglove proposes

Overrides = Annotated[tuple[str, ...], Parameter(name="--set", negative=(), consume_multiple=True)]
Flag = Annotated[bool, Parameter(negative=())]


def load(
    config: Path | None, set_: Sequence[str], options: Mapping[str, Any] | None = None
) -> "RunConfig":
    """The configuration in a file, or the quick start's, under `--set` and options of their own.

    `options` maps keys to values; None where the option was not given.

    Raises:
        InputError: see `load_config`.
    """
    # Only now: the configuration's models take half a second to import.
    from mission.config.loading import builtin_config, load_config
    from mission.config.overrides import parse_override

    overrides = dict(parse_override(text) for text in set_)
    overrides |= {key: value for key, value in (options or {}).items() if value is not None}
    return load_config(config or builtin_config("quickstart.toml"), overrides)


def console(*, quiet: bool, live: bool, live_port: int, log_mavlink: bool = False) -> RunConsole:
    """Who looks on, on this terminal and in Foxglove.

    Raises:
        InputError: the port is none.
    """
    if not 0 <= live_port <= 65535:
        raise InputError(f"--live-port {live_port}: must be from 0 to 65535")
    return RunConsole(Terminal(), quiet, live_port if live else None, log_mavlink)
