"""Options that several commands share, and what they are turned into."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from mission.base.console import PLAIN, RunConsole, Terminal
from mission.base.errors import InputError

if TYPE_CHECKING:
    from mission.config.models import RunConfig

LIVE_PORT = 8765  # that Foxglove proposes

Overrides = Annotated[tuple[str, ...], Parameter(name="--set", negative=())]
Limits = Annotated[tuple[str, ...], Parameter(name="--limit", negative=())]
Offsets = Annotated[tuple[str, ...], Parameter(name="--offset", negative=())]
Flag = Annotated[bool, Parameter(negative=())]
Json = Annotated[bool, Parameter(name="--json", negative=())]

_NOBODY = {"name": "nobody", "task": "digits", "devices": 1}  # where no file says whom to serve
# Options of their own that set a key: what is wrong with one is said of the option.
_OPTIONS = {
    "seed": "--seed",
    "mission.rounds": "--rounds",
    "planner.kind": "--method",
    "planner.gap": "--gap",
    "link.gcs": "--gcs",
    "link.kind": "--vehicle",
    "link.url": "--vehicle",
    "vehicle.aircraft.wind.speed_mps": "--wind",
    "area.home_lat_deg": "--home: latitude",
    "area.home_lon_deg": "--home: longitude",
    "area.home_alt_msl_m": "--home: altitude",
}


def load(
    config: Path | None,
    set_: Sequence[str],
    options: Mapping[str, object] | None = None,
    *,
    usual: Mapping[str, object] | None = None,
    counts: Sequence[str] = (),
) -> "RunConfig":
    """Load a configuration, or the quick start's, under `--set` and options of their own.

    `options` maps keys to values; None where the option was not given. `usual` are values that
    count where `--set` gives no other. Where only some keys and tables `counts`, a file needs no
    others, and no other is set.

    Raises:
        InputError: a key is set twice, by an option of its own too; or see `load_config`.
    """
    # Only now: the configuration's models take half a second to import.
    from mission.config.loading import builtin_config, load_config, parse_override

    overrides: dict[str, object] = {}
    for key, value in map(parse_override, set_):
        if key in overrides:
            raise InputError(f"--set {key}: given twice; leave one of them out")
        overrides[key] = value
    mine = {key: value for key, value in (options or {}).items() if value is not None}
    named = {key: _OPTIONS[key] for key in mine}
    for key in overrides:
        if key in named:
            option = named[key].partition(":")[0]
            raise InputError(f"--set {key}: {option} sets it too; leave one of them out")
    source = config or builtin_config("quickstart.toml")
    beneath = {"communities": [_NOBODY]} if counts else {}
    return load_config(
        source,
        {**(usual or {}), **overrides, **mine},
        options=named,
        beneath=beneath,
        counts=counts,
    )


def single(set_: Sequence[str]) -> tuple[tuple[str, ...], dict[str, list[str]]]:
    """Of `--set` options those for all, and by name those of single vehicles, NAME:KEY=VALUE, with
    all others."""
    split = [(head.partition(":"), text) for text in set_ for head in [text.partition("=")[0]]]
    common = tuple(text for (_, colon, _), text in split if not colon)
    own: dict[str, list[str]] = {}
    for (name, colon, _), text in split:
        if colon:
            own.setdefault(name, []).append(text[len(name) + 1 :])
    for name, texts in own.items():
        keys = {text.partition("=")[0] for text in texts}
        own[name] = [*(text for text in common if text.partition("=")[0] not in keys), *texts]
    return common, own


def pace_of(speed: float | Literal["max"]) -> float:
    """Simulated seconds per second; infinity for "max". InputError: it is out of range."""
    if speed == "max":
        return math.inf
    if not 0 < speed <= 1000:
        raise InputError(f'--speed {speed:g}: more than 0 and at most 1000, or "max"')
    return speed


def given_offsets(options: Sequence[str]) -> dict[str, float]:
    """Seconds by log of options LOG=SECONDS; InputError where one is not."""
    found = {}
    for option in options:
        name, _, seconds = option.rpartition("=")
        try:
            found[name] = float(seconds)
        except ValueError:
            raise InputError(f"--offset {option}: must be LOG=SECONDS, as b.ulg=12.5") from None
    return found


def print_json(value: object) -> None:
    """Print a value of dataclasses, paths and arrays as JSON; NaN and infinity as null."""
    from pydantic_core import to_json

    text = to_json(value, indent=2, inf_nan_mode="null", fallback=lambda array: array.tolist())
    # Letters beyond ASCII as JSON writes them: standard output may know no others.
    Terminal(**PLAIN).print(json.dumps(json.loads(text), indent=2))


def tell(value: object, lines: Iterable[object], *, as_json: bool) -> None:
    """Print lines as they are, or `as_json` in their place the value that they tell."""
    if as_json:
        print_json(value)
        return
    for line in lines:
        Terminal(**PLAIN).print(line)


def console(*, quiet: bool, live: bool, live_port: int) -> RunConsole:
    """Console of a command: terminal, quiet, live view.

    Raises:
        InputError: the port is out of range.
    """
    if not 0 <= live_port <= 65535:
        raise InputError(f"--live-port {live_port}: must be from 0 to 65535")
    return RunConsole(Terminal(quiet=quiet), live_port if live else None)
