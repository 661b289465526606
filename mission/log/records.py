"""The rows of `rounds.csv`, `aircraft.csv`, `uplinks.csv` and `learning.csv`; records as JSON.

Each column is declared here alone; tables, readers, the log's schemas and the pages follow: field
order is column order, the text is what people read of the column. Metres, seconds; positions are
area coordinates: x east, y north. NaN stands where there is no value.
"""

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self, TypeAlias, TypeVar, get_origin

import numpy as np

from mission.base.tables import Column, columns

Record = TypeVar("Record")
_ITEM_NUMBERS = 11  # the first three, number, command and frame, are known


def _as_it_is(value: Any) -> Any:
    return value


def _nan_for_none(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _text(value: str) -> str:
    return value + ""  # TypeError: it is none


def _item(row: Sequence[float | None]) -> tuple[float, ...]:
    found = tuple(map(_nan_for_none, row))
    if len(found) != _ITEM_NUMBERS or not all(map(math.isfinite, found[:3])):
        raise ValueError(f"item {row}")
    return found


@dataclass(frozen=True)
class OfSeveral:
    """Description of a column that tables have only where several aircraft fly. The log has none of
    it: there the name of the topic says whose a record is."""

    words: str


@dataclass(frozen=True)
class Kind:
    """JSON schema of a field, and how its value is converted to JSON and back."""

    schema: Mapping[str, object]  # JSON schema
    write: Callable[[Any], object] = _as_it_is
    read: Callable[[Any], Any] = _as_it_is


def _array(schema: Mapping[str, object], *shape: int, dtype: type = np.float64) -> Kind:
    """Return the Kind of a numpy array that JSON holds as a list, reshaped when it is read."""
    return Kind(
        schema, np.ndarray.tolist, lambda value: np.array(value, dtype=dtype).reshape(shape)
    )


_LIST: dict[str, object] = {"type": "array", "items": {"type": "number"}}
_LISTS: dict[str, object] = {"type": "array", "items": _LIST}

# By the type of a field that says no kind of its own.
KINDS: Mapping[object, Kind] = {
    int: Kind({"type": "integer"}, read=operator.index),
    float: Kind({"type": "number"}, float, _nan_for_none),
    bool: Kind({"type": "boolean"}),
    str: Kind({"type": "string"}, read=_text),
}
MAYBE = Kind({"type": ["number", "null"]}, float, _nan_for_none)
MAYBE_INTEGER = Kind(
    {"type": ["number", "null"]},
    read=lambda value: None if value is None else operator.index(value),
)
NUMBERS, INTEGERS = _array(_LIST, -1), _array(_LIST, -1, dtype=np.int64)
PAIRS = _array(_LISTS, -1, 2)
WHERE_TRUE = Kind(_LISTS, lambda mask: np.argwhere(mask).tolist())  # indices; the reader knows more
XYZ_M = Kind(_LIST, list, lambda row: tuple(_nan_for_none(row[axis]) for axis in range(3)))
STRINGS = Kind(
    {"type": "array", "items": {"type": "string"}}, list, lambda row: tuple(map(_text, row))
)
_MAYBE_LIST: dict[str, object] = {"type": "array", "items": {"type": ["number", "null"]}}
MAYBE_NUMBERS = Kind(_MAYBE_LIST, list, lambda row: tuple(map(_nan_for_none, row)))
ITEMS = Kind({"type": "array", "items": _MAYBE_LIST}, list, lambda rows: tuple(map(_item, rows)))
OUTLINES = Kind({"type": "array", "items": _LISTS})
Maybe: TypeAlias = Annotated[float, MAYBE]
# A number for each community, and a column each in a table: `accuracy_<name>`.
BY_COMMUNITY = Kind(
    {"type": "object", "additionalProperties": {"type": "number"}},
    read=lambda row: {name: _nan_for_none(value) for name, value in row.items()},
)
ByCommunity: TypeAlias = Annotated[dict[str, float], BY_COMMUNITY]


def described(record: type) -> Iterator[tuple[str, Kind, str]]:
    """Yield name, kind and description of each field that has a description: those in the log."""
    for column in columns(record):
        words = column.find(str)
        if words is not None:
            yield column.name, column.find(Kind) or KINDS[column.holds], words


def as_json(record: Any) -> dict[str, object]:
    """Convert a record to the JSON object in the log, with a key for each described field."""
    return {name: kind.write(getattr(record, name)) for name, kind, _ in described(type(record))}


def from_json(record: type[Record], row: Mapping[str, Any], **beside: object) -> Record:
    """Build a record from its JSON object; `beside` gives fields that are not in it, or not whole.

    Raises:
        KeyError, TypeError, ValueError: the row is of another kind.
    """
    values = {name: kind.read(row[name]) for name, kind, _ in described(record)}
    return record(**{**values, **beside})


LATE = "late"
OUTCOMES = ("delivered", "lost", LATE)


@dataclass(frozen=True, slots=True)
class UplinkRecord:
    """One scheduled device of one round: where it was served and what became of its update."""

    round: Annotated[int, "round, from 1"]
    device: Annotated[int, "device, from 0 over all communities"]
    community: Annotated[str, "name of the device's community"]
    step: Annotated[int, "time step of the plan, from 0"]
    slot_t_s: Annotated[Maybe, "simulated time of the transmission; null where never reached"]
    plan_x_m: Annotated[float, "planned position, east"]
    plan_y_m: Annotated[float, "planned position, north"]
    est_x_m: Annotated[Maybe, "believed position, east"]
    est_y_m: Annotated[Maybe, "believed position, north"]
    est_alt_m: Annotated[Maybe, "believed height above home"]
    true_x_m: Annotated[Maybe, "true position, east"]
    true_y_m: Annotated[Maybe, "true position, north"]
    true_alt_m: Annotated[Maybe, "true height above home"]
    plan_per: Annotated[float, "packet error rate at the planned position"]
    est_per: Annotated[Maybe, "packet error rate at the believed position"]
    true_per: Annotated[float, "packet error rate at the true position; 1 where never reached"]
    importance: Annotated[float, "delta of the device in this round"]
    delivered: Annotated[bool, "the update arrived"]
    aircraft: Annotated[str, OfSeveral("name of the aircraft that served it")] = ""

    @property
    def outcome(self) -> str:
        """What became of the update, in a word: one of `OUTCOMES`."""
        return "delivered" if self.delivered else "lost"


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedUplinkRecord(UplinkRecord):
    """The same of a run whose devices take time to train, or to send."""

    ready_t_s: Annotated[float, "simulated time from which the device has its update to send"]
    late: Annotated[bool, "it was not ready when its turn came and sent nothing: PER 1"]
    staleness: Annotated[int, "rounds since the model that it trains from came down"]
    upload_s: Annotated[float, "how long its turn lasts, from `slot_t_s` on"]

    @property
    def outcome(self) -> str:
        return LATE if self.late else "delivered" if self.delivered else "lost"


@dataclass(frozen=True, slots=True)
class RoundRecord:
    """One round: what was planned, what was flown and what was learnt."""

    round: Annotated[int, "round, from 1"]
    start_t_s: Annotated[float, "simulated time at which the round started"]
    duration_s: Annotated[float, "simulated seconds from start to end"]
    plan_objective: Annotated[float, "sum of importance (1 - PER) at the planned positions"]
    est_objective: Annotated[float, "the same at the believed positions of the transmissions"]
    true_objective: Annotated[float, "the same at the true positions"]
    upper_bound: Annotated[Maybe, "proven bound on the plan's objective; null where there is none"]
    plan_path_m: Annotated[float, "length of the planned path"]
    flown_path_m: Annotated[float, "length of the flown track"]
    budget_used_m: Annotated[float, "metres of L_total spent so far"]
    scheduled: Annotated[int, "devices scheduled"]
    delivered: Annotated[int, "updates that arrived"]
    battery_remaining: Annotated[float, "0..1 of the capacity at the end"]
    accuracy: Annotated[ByCommunity, "accuracy 0..1 after the round, on the images to report on"]
    cov: Annotated[ByCommunity, "fairness CoV psi in force for the next round"]
    plan_altitude_m: Annotated[Maybe, "height above home that was chosen; nan where it is given"]
    plan_duration_s: Annotated[Maybe, "planned seconds from start to end"]
    plan_energy_j: Annotated[Maybe, "planned joules of the battery"]
    energy_j: Annotated[Maybe, "joules that the flight took of the battery; nan where nobody knows"]
    time_used_s: Annotated[
        Maybe, "seconds of the rounds so far, which mission.total_deadline_s limits"
    ]
    energy_used_j: Annotated[
        Maybe, "joules of the rounds so far, which mission.total_energy_j limits"
    ]


@dataclass(frozen=True, slots=True)
class AircraftRecord:
    """What one aircraft has done in a round: a row of `aircraft.csv`."""

    round: Annotated[int, "round, from 1"]
    aircraft: Annotated[str, "name of the aircraft"]
    start_t_s: Annotated[float, "simulated time at which it began"]
    duration_s: Annotated[float, "simulated seconds from its start to its end"]
    plan_path_m: Annotated[float, "length of its planned path"]
    flown_path_m: Annotated[float, "length of its track"]
    scheduled: Annotated[int, "devices that it was to serve"]
    delivered: Annotated[int, "updates that arrived with it"]
    battery_remaining: Annotated[float, "0..1 of its capacity at the end"]
    plan_altitude_m: Annotated[Maybe, "height above home that was chosen; nan where it is given"]
    plan_duration_s: Annotated[Maybe, "planned seconds from its start to its end"]
    plan_energy_j: Annotated[Maybe, "planned joules of its battery"]
    energy_j: Annotated[Maybe, "joules that its flight took; nan where nobody knows"]
    idle_s: Annotated[
        Maybe, OfSeveral("seconds of hover at its end, until the last aircraft had finished")
    ] = math.nan
    nearest: Annotated[str, OfSeveral("name of the aircraft that came nearest to it")] = ""
    nearest_m: Annotated[
        Maybe,
        OfSeveral(
            "how near, straight in space; in the first round from when a pair is as far apart as "
            "mission.separation_m, inf: none ever was"
        ),
    ] = math.nan
    nearest_t_s: Annotated[Maybe, OfSeveral("simulated time of that")] = math.nan
    plan_nearest_m: Annotated[Maybe, OfSeveral("how near any was to come, by plan")] = math.nan

    @classmethod
    def alone(cls, round_: RoundRecord, name: str) -> Self:
        """The row of the only aircraft of a round."""
        of_all = {c.name: getattr(round_, c.name) for c in columns(cls) if hasattr(round_, c.name)}
        return cls(aircraft=name, **of_all)


@dataclass(frozen=True, slots=True)
class DeviceRecord:
    """What one device has learnt after a round: a row of `learning.csv`."""

    round: Annotated[int, "round, from 1; 0: the untrained models"]
    device: Annotated[int, "device, from 0 over all communities"]
    community: Annotated[str, "name of the device's community"]
    accuracy: Annotated[float, "of its community's new model, on its validation set"]
    received_accuracy: Annotated[float, "eps_k as the UAV last received it; nan where it never did"]
    loss: Annotated[float, "mean local training loss; nan where its update did not arrive"]


def is_by_community(column: Column) -> bool:
    """Return whether a column of a record becomes one table column for each community."""
    return get_origin(column.holds) is dict


def flat(record: object, *, several: bool = False) -> dict[str, Any]:
    """Convert a record to a table row by column name; fields by community give a column each, and
    those of several aircraft none where they are empty, unless the table is of `several`."""
    row: dict[str, Any] = {}
    for column in columns(type(record)):
        value = getattr(record, column.name)
        if is_by_community(column):
            row |= {f"{column.name}_{name}": float(item) for name, item in value.items()}
        elif several or not column.find(OfSeveral) or (value != "" and value == value):
            row[column.name] = value
    return row


_NOTHING: dict[object, Any] = {float: math.nan, int: 0}

# A round of which nothing is known, for `dataclasses.replace`.
UNKNOWN_ROUND = RoundRecord(**{c.name: _NOTHING.get(c.holds, {}) for c in columns(RoundRecord)})
