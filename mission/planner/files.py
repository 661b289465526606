"""Planning problems and plans as JSON files.

A problem file is a list of objects; the keys are those of `ProblemEntry`. A plan file maps each
problem's id to what `docs/planner.md` lists.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from fl.radio.channel import Channel, constants_model
from flightdyn.config import LimitsConfig
from flightdyn.obstacles import flaw
from flightdyn.tables import Table
from mission.base.airspace import Airspace, FenceArea, joined
from mission.base.arrays import Floats, Ints
from mission.base.errors import PlanInputError
from mission.base.explain import Blame, explain, shown
from mission.base.run_folder import write_atomically
from mission.base.user_files import read_json
from mission.planner.limits import LIMITS, RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import MOST_COUNT, RoundProblem, Start

# Strict: neither texts nor true and false are numbers.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e7, le=1e7)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1e9)]
Seconds = tuple[Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1e6)], ...]
Point = tuple[Number, Number]
Wind = Annotated[float, Field(strict=True, ge=-50, le=50)]
Ring = Annotated[tuple[Point, ...], Field(min_length=3, max_length=500)]
Metres = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1e6)]
Height = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=10, le=500)]

MOST_SHOWN = 10  # wrong entries named in one message


class _Entry(BaseModel):
    # Strict: neither texts nor true and false are numbers.
    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )


if TYPE_CHECKING:  # that may not know what is made while the program runs
    ChannelEntry = _Entry
else:
    ChannelEntry = constants_model("ChannelEntry", _Entry, optional=False)


class FlightEntry(Table):
    """Flight performance for predictions of time and energy: speed, corners, wind, air density."""

    speed_mps: float = Field(20.0, strict=True, ge=1, le=30)
    acceptance_radius_m: float = Field(5.0, strict=True, ge=0.5, le=50)
    wind_mps: tuple[Wind, Wind] = (0.0, 0.0)  # the air's velocity, east and north
    air_density: float = Field(1.0, strict=True, ge=0.3, le=1.5)  # over that at sea level
    guidance: LimitsConfig | None = LimitsConfig()  # null: always at its speed


def _lower_first(limits: tuple[float, float]) -> tuple[float, float]:
    if not limits[0] < limits[1]:
        raise ValueError(
            f"the lowest altitude must be below the highest, not {limits[0]:g} and "
            f"{limits[1]:g}; for a fixed altitude leave it out"
        )
    return limits


Heights = Annotated[tuple[Height, Height], AfterValidator(_lower_first)]


if TYPE_CHECKING:

    class LimitsEntry(Table): ...
else:  # a key for each kind of limit
    LimitsEntry = create_model(
        "LimitsEntry", __base__=Table, **{kind.key: (Positive | None, None) for kind in LIMITS}
    )


class VehicleEntry(LimitsEntry):
    """What one of several aircraft has of its own: what is left out is that of the problem."""

    start: Point
    path_budget_m: Metres | None = None
    altitude_m: Height | None = None
    altitudes_m: Heights | None = None

    @model_validator(mode="after")
    def _one_altitude(self) -> Self:
        if None not in (self.altitude_m, self.altitudes_m):
            raise ValueError("give altitude_m, or altitudes_m to choose from, not both")
        return self


_SHARED = ("path_budget_m", "altitudes_m", *(kind.key for kind in LIMITS))


class ProblemEntry(LimitsEntry):
    """One planning problem of a problem file, in metres, seconds and joules."""

    id: Annotated[str, Field(min_length=1, max_length=200)] | Annotated[int, Field(strict=True)]
    devices: tuple[Point, ...]
    importance: tuple[Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0)], ...]
    start: Point | None = None
    steps: int = Field(strict=True, ge=1, le=1000)
    per_step: int = Field(strict=True, ge=1, le=MOST_COUNT)
    path_budget_m: Metres | None = None
    # In place of `start`, several aircraft; what one leaves out is the problem's.
    vehicles: Annotated[tuple[VehicleEntry, ...], Field(min_length=1, max_length=100)] | None = None
    separation_m: Metres = 0.0  # that they keep from each other
    channel: ChannelEntry
    altitudes_m: Heights | None = None
    areas: tuple[Ring, ...] = ()  # corners of what must not be flown
    fence: Ring | None = None  # of what flights stay within
    fences: tuple[FenceArea, ...] = ()  # more such areas, with groups
    margin_m: float = Field(15.0, strict=True, ge=0.1, le=500)
    upload_s: Seconds | None = None
    ready_in_s: Seconds | None = None
    flight: FlightEntry = FlightEntry()

    @field_validator("areas", "fence")
    @classmethod
    def _outlines(cls, given: "tuple[Ring, ...] | Ring | None", info: ValidationInfo) -> object:
        rings = given if info.field_name == "areas" else (given,) if given else ()
        for number, ring in enumerate(rings or ()):
            if wrong := flaw(np.array(ring)):
                raise ValueError(f"outline {number} {wrong}")
        return given

    @field_validator("fences")
    @classmethod
    def _somewhere(cls, given: tuple[FenceArea, ...], info: ValidationInfo) -> object:
        joined(info.data.get("fence"), given, (0.0, 0.0))
        return given

    @model_validator(mode="after")
    def _each_starts_somewhere(self) -> Self:
        if (self.start is None) == (self.vehicles is None):
            raise ValueError("give either start, or vehicles with the start of each")
        if None in [each.path_budget_m for each in self.each]:
            raise ValueError("path_budget_m is missing: give it here, or each of the vehicles one")
        return self

    @property
    def each(self) -> tuple[VehicleEntry, ...]:
        """Each aircraft with all that it has of its own."""
        own = [{"start": self.start}] if self.vehicles is None else map(_given, self.vehicles)
        shared = {name: getattr(self, name) for name in _SHARED}
        return tuple(VehicleEntry.model_construct(**{**shared, **each}) for each in own)


def _given(each: VehicleEntry) -> dict[str, Any]:
    """Return the keys of an aircraft that are given; a height rules out the choice of all."""
    given = {name: getattr(each, name) for name in each.model_fields_set}
    return {"altitudes_m": None, **given} if "altitude_m" in given else given


@dataclass(frozen=True)
class NamedProblem:
    """A problem of the file with its id."""

    id: str
    problem: RoundProblem


@dataclass(frozen=True)
class NamedPlan:
    """A plan with the id of its problem and the seconds it took."""

    id: str
    plan: RoundPlan
    time_s: float
    hold_s: float = 0.0  # of hover that its strategy asks for, as in `stops_of`


def read_problems(path: Path) -> tuple[NamedProblem, ...]:
    """All problems of a file, in its order.

    Raises:
        InputError: the file cannot be read, or is not JSON.
        PlanInputError: it holds a wrong key, value or shape, or the same id twice; the message
            names file, problem, key and value.
    """
    data = read_json(path)
    if not isinstance(data, list):
        raise PlanInputError(f"{path}: holds {shown(data)}: must be a list of problems")
    return problems_of(data, str(path))


def problems_of(data: Sequence[object], source: str) -> tuple[NamedProblem, ...]:
    """Parse problem entries, objects as in a problem file; `source` names them in messages.

    Raises:
        PlanInputError: as in `read_problems`.
    """
    entries = _entries(source, data)
    seen: dict[str, int] = {}
    for index, entry in enumerate(entries):
        name = str(entry.id)
        if name in seen:
            raise PlanInputError(
                f"{source}: [{index}].id = {name!r}: already used by [{seen[name]}]; ids must "
                "differ"
            )
        seen[name] = index
        for key in ("importance", "upload_s", "ready_in_s"):
            values = getattr(entry, key)
            if values is not None and len(values) != len(entry.devices):
                raise PlanInputError(
                    f"{source}: [{index}] (id {name!r}): {key} has {len(values)} values for "
                    f"{len(entry.devices)} devices: must be one each"
                )
    return tuple(NamedProblem(str(entry.id), _problem(entry)) for entry in entries)


def write_plans(path: Path, plans: Sequence[NamedPlan]) -> None:
    """Write plans so that the file is there whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    content = plans_as_json(plans)
    write_atomically(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def plans_as_json(plans: Sequence[NamedPlan]) -> dict[str, object]:
    """Plans by the ids of their problems, as a plan file has them."""
    return {entry.id: _plan(entry) for entry in plans}


def _entries(source: str, data: Sequence[object]) -> list[ProblemEntry]:
    """Validate entries; PlanInputError has a line for each wrong key, `MOST_SHOWN` at most."""
    entries: list[ProblemEntry] = []
    wrong: list[str] = []
    for index, values in enumerate(data):
        place = f"{source}: [{index}]"
        if not isinstance(values, dict):
            wrong.append(f"{place} = {shown(values)}: must be an object")
            continue
        if "id" in values:
            place += f" (id {shown(values['id'])})"
        try:
            entries.append(ProblemEntry.model_validate(values))
        except ValidationError as error:
            wrong += explain(error, ProblemEntry, values, Blame(place), notation="JSON")
    if len(wrong) > MOST_SHOWN:
        wrong[MOST_SHOWN:] = [f"{source}: and {len(wrong) - MOST_SHOWN} more"]
    if wrong:
        raise PlanInputError("\n".join(wrong))
    return entries


def _problem(entry: ProblemEntry) -> RoundProblem:
    flight, several = entry.flight, (len(entry.devices),)
    performance = Performance(
        flight.speed_mps, flight.acceptance_radius_m, flight.guidance, flight.air_density,
        flight.wind_mps,
    )  # fmt: skip
    first = entry.each[0].start
    fence = [_frozen(ring, (-1, 2)) for ring in joined(entry.fence, entry.fences, first)]
    areas = [_frozen(ring, (-1, 2)) for ring in entry.areas]
    timed = entry.ready_in_s is not None or entry.separation_m > 0.0
    return RoundProblem(
        devices_m=_frozen(entry.devices, (len(entry.devices), 2)),
        importance=_frozen(entry.importance, several),
        starts=tuple(_start(own, performance, timed) for own in entry.each),
        steps=entry.steps,
        per_step=entry.per_step,
        channel=Channel(**entry.channel.model_dump()),
        airspace=Airspace((*areas, *fence[1:]), fence[0] if fence else None, entry.margin_m),
        upload_s=None if entry.upload_s is None else _frozen(entry.upload_s, several),
        ready_in_s=None if entry.ready_in_s is None else _frozen(entry.ready_in_s, several),
        separation_m=entry.separation_m,
    )


def _start(own: VehicleEntry, performance: Performance, limited: bool) -> Start:
    given = {kind.name: getattr(own, kind.key) for kind in LIMITS}
    most = {name: value for name, value in given.items() if value is not None}
    assert own.path_budget_m is not None
    return Start(
        start_m=_frozen(own.start, (2,)),
        path_budget_m=own.path_budget_m,
        limits=RoundLimits(performance, **most) if limited or most else None,
        altitudes_m=own.altitudes_m,
        altitude_m=own.altitude_m,
    )


def _frozen(values: ArrayLike, shape: tuple[int, ...]) -> Floats:
    array = np.array(values, dtype=np.float64).reshape(shape)
    array.flags.writeable = False
    return array


def _plan(entry: NamedPlan) -> dict[str, object]:
    plan = entry.plan
    proven = bool(np.isfinite(plan.upper_bound))
    whole: dict[str, object] = {
        "value": plan.value,
        "upper_bound": plan.upper_bound if proven else None,
        "gap": plan.gap if proven else None,
    }
    each = [_path(*own) for own in zip(plan.paths, plan.schedule.astype(int), strict=True)]
    hold = {"hold_s": entry.hold_s} if entry.hold_s else {}
    rest = {
        "nodes": plan.nodes,
        **({"ended": plan.ended} if plan.ended else {}),
        **({"mended": plan.mended} if plan.mended else {}),
        "time_s": entry.time_s,
    }
    if len(each) > 1:
        return {"vehicles": [flown | chosen for flown, chosen in each], **hold, **whole, **rest}
    ((flown, chosen),) = each
    return {**flown, **hold, **whole, **chosen, **rest}


def _path(path: PlannedPath, schedule: Ints) -> tuple[dict[str, object], dict[str, object]]:
    """What one aircraft flies, and the altitude that was chosen for it, if one was."""
    taken = path.foreseen
    return {
        "waypoints": path.waypoints_m.tolist(),
        "route": path.route_m.tolist(),
        "schedule": schedule.tolist(),
        **({"wait_s": path.wait_s} if path.wait_s else {}),
        **({kind.name: kind.of(vars(taken)) for kind in LIMITS} if taken else {}),
    }, ({} if path.altitude_m is None else {"altitude_m": path.altitude_m})
