"""Several aircraft of a run: how many alike, or a table for each."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import dist
from typing import Annotated, Any, NamedTuple, TypeAlias

from pydantic import AfterValidator, Field

from mission.base.airspace import Coordinate
from sitl.config import VehicleConfig

APART_M = 5.0  # between homes side by side, towards the east
MOST = 20
NEAREST_M = 1.0  # between homes: nearer aircraft touch
LAST_ID = 250

_OF_AUTOPILOT = "firmware", "parameters", "parameter_file"

LOWEST_M, HIGHEST_M = 10.0, 500.0
Altitude = Annotated[float, Field(ge=LOWEST_M, le=HIGHEST_M)]
Place: TypeAlias = tuple[Coordinate, Coordinate]


def _lower_first(altitude_m: float | tuple[float, float]) -> float | tuple[float, float]:
    if isinstance(altitude_m, tuple) and not altitude_m[0] < altitude_m[1]:
        low_m, high_m = altitude_m
        raise ValueError(
            f"the lowest altitude must be below the highest, not {low_m:g} and {high_m:g}; "
            "for a fixed altitude give one number"
        )
    return altitude_m


Heights = Annotated[Altitude | tuple[Altitude, Altitude], AfterValidator(_lower_first)]


class OneVehicleConfig(VehicleConfig):
    """One of several aircraft: any key of `vehicle`, whose values it has where it gives none."""

    name: str | None = Field(None, pattern=r"^[A-Za-z0-9_-]{1,32}$")
    """for tables, pictures and the folder of its log; none: uav1, uav2, ... by its place in the
    list"""
    home_m: Place | None = None
    """its take-off point in area coordinates; none: area.home_m, and 5 m farther to the east for
    each aircraft before it"""
    altitude_m: Heights | None = None
    """none: mission.altitude_m"""
    path_budget_m: float | None = Field(None, gt=0, le=20_000)
    """metres a round; none: mission.path_budget_m"""


Vehicles: TypeAlias = (
    Annotated[int, Field(ge=1, le=MOST)]
    | Annotated[tuple[OneVehicleConfig, ...], Field(min_length=1, max_length=MOST)]
)


class Aircraft(NamedTuple):
    """One aircraft of a run, whether it is the only one or one of several."""

    name: str
    home_m: tuple[float, float]
    vehicle: VehicleConfig
    altitude_m: float | tuple[float, float] | None  # None: the mission's
    path_budget_m: float | None  # the same


def aircraft_of(
    vehicles: int | Sequence[OneVehicleConfig] | None,
    vehicle: VehicleConfig,
    home_m: tuple[float, float],
) -> tuple[Aircraft, ...]:
    """Each aircraft that the key `vehicles` asks for; without it the one of `vehicle` at home.

    System ids count up from the first, where tables do not give others.
    """
    if vehicles is None or isinstance(vehicles, int):
        given: Sequence[OneVehicleConfig | None] = [None] * (vehicles or 1)
    else:
        given = vehicles
    found = []
    for n, own in enumerate(given):
        x, y = home_m
        at = (x + APART_M * n, y)
        alike = vehicle if n == 0 else _numbered(vehicle, vehicle.system_id + n)
        name = f"uav{n + 1}"
        if own is None:
            found.append(Aircraft(name, at, alike, None, None))
            continue
        itself = VehicleConfig.model_construct(
            **{key: getattr(own, key) for key in VehicleConfig.model_fields}
        )
        if own.system_id == vehicle.system_id:
            itself = _numbered(itself, vehicle.system_id + n)
        found.append(
            Aircraft(own.name or name, own.home_m or at, itself, own.altitude_m, own.path_budget_m)
        )
    return tuple(found)


def _numbered(vehicle: VehicleConfig, system_id: int) -> VehicleConfig:
    return vehicle.model_copy(update={"system_id": system_id})


def misplaced(
    aircraft: Sequence[Aircraft], home_m: tuple[float, float], size_m: tuple[float, float]
) -> Iterator[str]:
    """Yield what is wrong with names and homes beside each other, in words."""
    names = [one.name for one in aircraft]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"vehicles: {names.count(name)} have the name {name!r}: names must differ"
    for one, other in combinations(aircraft, 2):
        if (apart_m := dist(one.home_m, other.home_m)) < NEAREST_M:
            yield (
                f"vehicles: {one.name} and {other.name} stand {apart_m:g} m apart, at home_m = "
                f"{list(one.home_m)} and {list(other.home_m)}: {NEAREST_M:g} m at least"
            )
    for one in aircraft:
        inside = all(0 <= at <= size for at, size in zip(one.home_m, size_m, strict=True))
        if one.home_m != home_m and not inside:
            yield (
                f"vehicles: {one.name} has home_m = {list(one.home_m)}, outside the area, "
                f"which is area.size_m = {list(size_m)}"
            )


def unable(aircraft: Sequence[Aircraft]) -> Iterator[str]:
    """Yield what several aircraft cannot do beside each other, in words."""
    if len({one.vehicle.aircraft.wind.model_dump_json() for one in aircraft}) > 1:
        yield "vehicles: the wind is of the place, the same for all: vehicle.aircraft.wind has it"
    for one, other in combinations(aircraft, 2):
        if (number := one.vehicle.system_id) == other.vehicle.system_id:
            yield (
                f"vehicles: {one.name} and {other.name} have the system_id {number}: they must "
                "differ"
            )
    for one in aircraft:
        if (autopilot := one.vehicle.autopilot) != "built-in" and one.vehicle.traffic != "off":
            yield (
                f"vehicles: {one.name} has traffic = {one.vehicle.traffic!r} and autopilot = "
                f"{autopilot!r}, a firmware, which cannot be told of others: give it traffic = "
                "'off'"
            )
        if one.vehicle.parameter_file is not None:
            yield (
                f"vehicles: {one.name} has a parameter_file, of one aircraft whose ground station "
                "saves there: give parameters instead"
            )
        if one.vehicle.system_id > LAST_ID:
            yield f"vehicles: {one.name} has system_id {one.vehicle.system_id}: {LAST_ID} at most"


def shared_with(vehicles: object, vehicle: dict[str, Any]) -> object:
    """The tables of `vehicles`, as a file has them, with what `vehicle` has beneath them; what is
    of an autopilot, where they have that."""
    if not isinstance(vehicles, list):
        return vehicles
    shared = {key: value for key, value in vehicle.items() if key not in _OF_AUTOPILOT}
    all_have = vehicle.get("autopilot", "built-in")
    return [
        _over(vehicle if one.get("autopilot", all_have) == all_have else shared, one)
        if isinstance(one, dict)
        else one
        for one in vehicles
    ]


def _over(beneath: dict[str, Any], table: dict[str, Any]) -> dict[str, Any]:
    """A table with the values of another beneath its own, table by table."""
    return beneath | {
        key: _over(beneath[key], value)
        if isinstance(value, dict) and isinstance(beneath.get(key), dict)
        else value
        for key, value in table.items()
    }
