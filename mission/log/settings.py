"""The configuration that a log holds: what is read back from it has to be of its kind.

Of another version keys may be missing or unknown; nobody reads those.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from mission.base.explain import Blame, explained
from mission.log import ForeignLogError

_Ring = Annotated[
    list[Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]], Field(min_length=3)
]


class _Read(BaseModel):
    model_config = ConfigDict(strict=True)


class _Area(_Read):
    class NoFly(_Read):
        name: str
        polygon_m: _Ring
        from_m: FiniteFloat = 0.0
        to_m: FiniteFloat | None = None

    class Building(_Read):
        model_config = ConfigDict(extra="forbid")
        polygon_m: _Ring
        height_m: FiniteFloat
        from_m: FiniteFloat = 0.0
        holes_m: list[_Ring] = []

    no_fly: list[NoFly] = []
    buildings: list[Building] = []


class _Wind(_Read):
    speed_mps: FiniteFloat = 0.0
    from_deg: FiniteFloat = 0.0
    turbulence_severity: int = 0
    gusts: list[Any] = []


class _Aircraft(_Read):
    wind: _Wind = _Wind()


class _Vehicle(_Read):
    aircraft: _Aircraft = _Aircraft()


class _Settings(_Read):
    mission: dict[str, Any] = {}
    link: dict[str, Any] = {}
    radio: dict[str, Any] = {}
    area: _Area = _Area()
    vehicle: _Vehicle = _Vehicle()


def check_settings(path: Path, text: bytes) -> None:
    """Check the configuration that the log `path` holds.

    Raises:
        InputError: it is no TOML, or what is read back of it is not of its kind.
    """
    try:
        values = tomllib.loads(text.decode())
    except ValueError as error:
        raise ForeignLogError(path, f"its config.toml is not valid TOML: {error}") from None
    with explained(_Settings, values, Blame(f"{path}: config.toml")):
        _Settings.model_validate(values)
