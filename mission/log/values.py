"""What a flight log holds, as values: area coordinates (x east, y north, height above home).

A field with a description is part of the log's record; one without (its time) is not.
"""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np

from fl.radio.per_grid import PerGrid
from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.area import Area
from mission.base.arrays import Bools, Floats, Ints
from mission.log.records import (
    INTEGERS,
    ITEMS,
    MAYBE_INTEGER,
    MAYBE_NUMBERS,
    NUMBERS,
    OUTLINES,
    PAIRS,
    STRINGS,
    WHERE_TRUE,
    XYZ_M,
    Kind,
    Maybe,
    RoundRecord,
    UplinkRecord,
    described,
)
from mission.log.signals import Signal

XYZ = tuple[float, float, float]

NS_PER_S = 1_000_000_000
AUTOPILOT = "autopilot: "  # begins a status event that names who flies


@dataclass(frozen=True)
class Devices:
    """The ground devices, in the order of the federation; written at the start and with every
    plan."""

    pos_m: Annotated[Floats, PAIRS, "x east, y north of each device, area coordinates"]  # (K, 2)
    community: Annotated[tuple[str, ...], STRINGS, "name of each device's community"]  # (K,)

    def __post_init__(self) -> None:
        if self.pos_m.shape != (len(self.community), 2):
            raise ValueError(
                f"pos_m has shape {self.pos_m.shape}, expected ({len(self.community)}, 2)"
            )

    @property
    def communities(self) -> tuple[str, ...]:
        """Community names in order of first appearance."""
        return tuple(dict.fromkeys(self.community))

    @property
    def community_of(self) -> Ints:
        """(K,) index of each device's community into `communities`."""
        order = {name: index for index, name in enumerate(self.communities)}
        return np.array([order[name] for name in self.community], dtype=np.int64)


@dataclass(frozen=True)
class Zone:
    """A polygon of the geofence, to stay inside of (`keep_in`) or outside of."""

    outline_m: Floats  # (n, 2) corners in area coordinates; the last joins the first
    keep_in: bool


@dataclass(frozen=True)
class FenceRecord:
    """The fence that the vehicle was given, where it was given one; written at the start and with
    every plan."""

    keep_in_m: Annotated[
        list[Any], OUTLINES, "corners [x, y] of each area to keep to, area coordinates"
    ]
    keep_out_m: Annotated[list[Any], OUTLINES, "corners [x, y] of each area to keep out of"]


@dataclass(frozen=True)
class Track:
    """Trajectory of the aircraft, true or believed: times and positions."""

    t_ns: Ints  # (n,)
    pos_m: Floats  # (n, 3) x east, y north, height above home

    def between(self, start_ns: int, end_ns: int) -> "Track":
        """The samples with start <= t <= end."""
        first, last = np.searchsorted(self.t_ns, (start_ns, end_ns + 1))
        return Track(self.t_ns[first:last], self.pos_m[first:last])

    def at(self, t_ns: Ints) -> "Track":
        """Return the positions at the times `t_ns`, interpolated linearly between samples."""
        return Track(t_ns, polyline.at(t_ns, self.t_ns, self.pos_m))


@dataclass(frozen=True)
class PlanRecord:
    """A round's plan, at the instant the round starts."""

    round: Annotated[int, "round, from 1"]
    t_ns: int
    waypoints_m: Annotated[Floats, PAIRS, "(N, 2) path in area coordinates; the first is the start"]
    # (N, K)
    schedule: Annotated[
        Bools, WHERE_TRUE, "[step, device] of each scheduled transmission, both from 0"
    ]
    importance: Annotated[Floats, NUMBERS, "(K,) delta of each device"]
    value: Annotated[float, "expected objective of the plan"]
    upper_bound: Annotated[Maybe, "proven bound on the objective; null where there is none"]
    path_budget_m: Annotated[float, "L_max"]
    speed_mps: Annotated[float, "planned ground speed"]
    altitude_m: Annotated[float, "planned height above home; the greatest, where it varies"]
    # Differs from `altitude_m` in plan files only.
    height_m: Annotated[Floats, NUMBERS, "(N,) planned height above home of each waypoint"]
    slot_s: Annotated[Floats, NUMBERS, "(N,) planned seconds after the start of each step"]
    duration_s: Annotated[float, "planned seconds from start to end"]
    route_m: Annotated[
        Floats, PAIRS, "(P, 2) path as it is flown: waypoints, and corners around areas"
    ]
    stops_at: Annotated[Ints, INTEGERS, "(N,) which points of the route are the waypoints"]

    @classmethod
    def of_flight(cls, number: int, t_ns: int, points_m: Floats, *, slot_s: Floats) -> Self:
        """The plan of a flight along (N, 3) points that serves nobody, passing each at a time (N,)
        in seconds; NaN where nobody knows."""
        flat, duration_s = points_m[:, :2], float(slot_s[-1])
        speed_mps = polyline.length(points_m) / duration_s
        return cls(
            round=number,
            t_ns=t_ns,
            waypoints_m=flat,
            schedule=np.zeros((len(flat), 0), dtype=bool),
            importance=np.zeros(0),
            value=0.0,
            upper_bound=math.nan,
            path_budget_m=polyline.length(flat),
            speed_mps=speed_mps,
            altitude_m=float(points_m[:, 2].max()),
            height_m=points_m[:, 2],
            slot_s=slot_s,
            duration_s=duration_s,
            route_m=flat,
            stops_at=np.arange(len(flat)),
        )

    @property
    def route_height_m(self) -> Floats:
        """(P,) planned height above home of each point of the route."""
        if len(self.route_m) == len(self.height_m):
            return self.height_m
        return np.full(len(self.route_m), self.altitude_m)  # around areas only rounds fly

    @property
    def route_3d_m(self) -> Floats:
        """(P, 3) the route with its heights."""
        return np.column_stack((self.route_m, self.route_height_m))

    @property
    def path_m(self) -> float:
        """Length of the planned polyline."""
        return polyline.length(self.route_m)


@dataclass(frozen=True)
class PlannedPlaces:
    """Places of the mission items that a flight was compared with, and the items reached."""

    source: str  # what the missions were read from
    places_m: Mapping[int, Floats]  # (3,) where an item leads, by its number
    rally_m: tuple[Floats, ...]  # (3,) each: where a return may lead beside home
    reached: frozenset[int]  # items
    in_holes: bool = False  # whether others may have been, as positions are missing


@dataclass(frozen=True)
class LearningRecord:
    """Accuracy and fairness of one community after a round."""

    round: Annotated[int, "round, from 1; 0: the untrained model"]
    t_ns: int
    community: Annotated[str, "name of the community"]
    accuracy: Annotated[float, "accuracy 0..1 on the images that it is reported on"]
    cov: Annotated[float, "fairness CoV psi"]
    loss: Annotated[Maybe, "mean local loss of the devices that trained; null where nobody did"]


@dataclass(frozen=True)
class EventRecord:
    """Something that happened, with truth and belief of that instant."""

    t_ns: int
    kind: Annotated[str, "mode, armed, reached, status, failsafe or fault"]
    text: Annotated[str, "what a person reads"]
    seq: Annotated[int | None, MAYBE_INTEGER, "mission item for `reached`; else null"]
    severity: Annotated[int, "MAV_SEVERITY, 0 emergency .. 7 debug"]
    true_m: Annotated[XYZ, XYZ_M, "true x east, y north, height above home"]
    est_m: Annotated[XYZ, XYZ_M, "believed x east, y north, height above home"]


@dataclass(frozen=True)
class ModeRecord:
    """Flight mode, whenever it changes."""

    mode: Annotated[str, "name of the mode"]
    armed: Annotated[bool, "motors enabled"]


_A_ROW = Kind({"type": "number"})  # an array here, one number in each of the log's records
_INNOVATION = Kind(
    {
        "type": ["object", "null"],
        "properties": {
            "values": {**NUMBERS.schema, "description": "measured less predicted"},
            "stds": {**NUMBERS.schema, "description": "standard deviations expected of the values"},
            "ratio": {"type": "number", "description": "size; refused from 1 on"},
            "accepted": {"type": "boolean", "description": "whether it was used"},
        },
    }
)
Innovated = Annotated[Mapping[str, Any] | None, _INNOVATION]


@dataclass(frozen=True)
class BatteryTrack:
    """The battery over time."""

    t_ns: Ints  # (n,)
    voltage_v: Annotated[Floats, _A_ROW, "terminal voltage"]
    current_a: Annotated[Floats, _A_ROW, "current drawn"]
    consumed_mah: Annotated[Floats, _A_ROW, "charge used since the start"]
    remaining: Annotated[Floats, _A_ROW, "0..1 of the capacity"]

    def energy_j(self, start_ns: int, end_ns: int) -> float:
        """Return the energy (J) drawn between two instants; NaN where it is not known."""
        during = (self.t_ns >= start_ns) & (self.t_ns <= end_ns)
        charge_as = np.diff(self.consumed_mah[during]) * 3.6
        current_as = np.diff(self.t_ns[during]) / NS_PER_S * self.current_a[during][1:]
        given_as = np.where(np.isnan(charge_as), current_as, charge_as)
        energy_j = float((given_as * self.voltage_v[during][1:]).sum())
        return energy_j if energy_j > 0.0 else math.nan

    def left(self, at_ns: int) -> float:
        """Return what is left (0..1) at an instant; NaN where it is not known."""
        found = self.remaining[self.t_ns <= at_ns]
        return float(found[-1]) if len(found) else math.nan


@dataclass(frozen=True)
class WindTrack:
    """The wind at the aircraft over time."""

    t_ns: Ints  # (n,)
    vel_mps: Floats  # (n, 3) velocity of the air: east, north, up

    def across_mps(self, start_ns: int, end_ns: int) -> Floats:
        """(k,) its horizontal speeds between two instants."""
        during = (self.t_ns >= start_ns) & (self.t_ns <= end_ns)
        return np.asarray(np.linalg.norm(self.vel_mps[during, :2], axis=1))


_XYZ = ("x", "y", "z")
_XYZW, _ALONE = (*_XYZ, "w"), ("",)


@dataclass(frozen=True)
class ControlTrack:
    """What the autopilot's control believed and ordered while armed, at `vehicle.control_rate_hz`.
    Axes are those of `map` and `base_link`; what is not ordered is NaN. A firmware is asked for
    attitude and setpoints by MAVLink; ArduPilot tells none of rates, position, velocity,
    acceleration and heading. With `aerofed world` there is no such topic."""

    t_ns: Ints  # (n,)
    # (n, as many as names)
    attitude: Annotated[Floats, _XYZW, "believed, `base_link` to `map`: a quaternion"]
    rates_radps: Annotated[Floats, _XYZ, "believed body rates"]
    attitude_setpoint: Annotated[Floats, _XYZW, "ordered attitude"]
    rates_setpoint_radps: Annotated[Floats, _XYZ, "body rates that the attitude loop asks for"]
    thrust_setpoint: Annotated[Floats, _ALONE, "of all rotors; 1: full"]
    motors: Annotated[
        Floats, ("0", "1", "2", "3"), "duty cycles; front right, rear left, front left, rear right"
    ]
    position_setpoint_m: Annotated[Floats, _XYZ, "area coordinates, height above home"]
    velocity_setpoint_mps: Annotated[Floats, _XYZ, "east, north, up"]
    acceleration_setpoint_mps2: Annotated[Floats, _XYZ, "east, north, up"]
    yaw_setpoint_rad: Annotated[Floats, _ALONE, "from east towards north"]
    yaw_rate_setpoint_radps: Annotated[Floats, _ALONE, "the same way round"]


@dataclass(frozen=True)
class InnovationsRecord:
    """Measurements against the estimator's predictions of them, once a second, and all that were
    refused: for each sensor `values` (measured less predicted), `stds` (their expected standard
    deviations), `ratio` (size divided by the largest that is accepted) and `accepted`."""

    t_s: Annotated[float, "the instant that the estimator was at; behind the log's by its delay"]
    gnss_position: Annotated[Innovated, "metres north, east, down; null where not measured then"]
    gnss_velocity: Annotated[Innovated, "m/s north, east, down; null where not measured then"]
    baro: Annotated[Innovated, "metres of height; null where not measured then"]
    heading: Annotated[Innovated, "radians; null where not measured then"]


# What the estimator calls its sensors, by the name in the log.
SENSORS = {
    name: name.replace("_", " ") for name, _, _ in described(InnovationsRecord) if name != "t_s"
}


@dataclass(frozen=True)
class InnovationTrack:
    """Innovations of one of the estimator's sensors over time, and whether they were accepted."""

    t_ns: Ints  # (n,) the instants that the filter was at
    values: Floats  # (n, axes) measured less predicted, in the sensor's unit
    stds: Floats  # (n, axes)
    ratio: Floats  # (n,) refused from 1 on
    accepted: Bools  # (n,)


@dataclass(frozen=True)
class MissionRecord:
    """A mission, a fence or rally points that the vehicle took, at that instant; one without items
    clears the list. Numbers are MAVLink's, places in degrees."""

    t_ns: int
    kind: Annotated[str, "mission, fence or rally"]
    items: Annotated[
        tuple[tuple[float, ...], ...],
        ITEMS,
        "seq, command, frame, param1..4, x, y, z, autocontinue of each item; null: left open",
    ]


@dataclass(frozen=True)
class SetpointRecord:
    """A setpoint that a program sent to the vehicle, with MAVLink's numbers."""

    t_ns: int
    message: Annotated[str, "name of the MAVLink message"]
    frame: Annotated[int | None, MAYBE_INTEGER, "MAV_FRAME; null of an attitude"]
    mask: Annotated[int, "type mask: the bits of what is to be ignored"]
    values: Annotated[
        tuple[float, ...],
        MAYBE_NUMBERS,
        "x, y, z (degrees where global), velocity, acceleration, yaw, yaw rate; of an attitude "
        "quaternion (w, x, y, z), body rates, thrust; null where not a number",
    ]


@dataclass(frozen=True)
class Modes:
    """Flight modes over time: each is in force from its time to that of the next."""

    t_ns: Ints  # (n,)
    names: tuple[str, ...]


@dataclass(frozen=True)
class Source:
    """Kind of a log, its clock, which positions it has if only one kind, and what was skipped."""

    kind: str  # of the file
    clock: str  # what its times count from
    # What its positions are, where it has one kind: truth and belief are then the same track.
    only: str | None = None
    skipped: Mapping[str, int] = field(default_factory=dict)  # what was not read, and how often
    utc_ns: int | None = None  # since 1970, where its clock is zero; None: not told

    @property
    def on_globe(self) -> bool:
        """Whether its positions are places on the globe."""
        return self.only not in (LOCAL, HEIGHTS)


COPTER, PLANE, ROVER = "copter", "plane", "rover"
# Of `Source.only`: around where the vehicle began, for which 0/0 stands; or all above there.
LOCAL, HEIGHTS = "local", "heights"
OURS = Source("MCAP", "simulated time")
_NONE: Ints = np.zeros(0, dtype=np.int64)
NO_MODES = Modes(_NONE, ())
NOBODY = Devices(np.zeros((0, 2)), ())


@dataclass(frozen=True)
class FlightData:
    """A flight: everything that a log holds, whoever wrote it."""

    area: Area
    truth: Track
    belief: Track
    battery: BatteryTrack
    wind: WindTrack
    events: tuple[EventRecord, ...]
    devices: Devices = NOBODY
    fence: tuple[Zone, ...] = ()
    plans: tuple[PlanRecord, ...] = ()  # of each round, as it became: the last that was made
    rounds: tuple[RoundRecord, ...] = ()
    uplinks: tuple[UplinkRecord, ...] = ()
    learning: tuple[LearningRecord, ...] = ()
    # By sensor; empty where the vehicle tells none.
    innovations: Mapping[str, InnovationTrack] = field(default_factory=dict)
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    planned: PlannedPlaces | None = None  # of a flight that is no run, once it has been matched
    missions: tuple[MissionRecord, ...] = ()  # each list that was in force, and from when
    setpoints: tuple[SetpointRecord, ...] = ()
    modes: Modes = NO_MODES
    current: tuple[Ints, Ints] = (_NONE, _NONE)  # times, and the mission item flown to from then on
    control: ControlTrack | None = None  # None: the vehicle tells none
    # Success by place that rounds were planned with, each from an instant on, and as it was.
    radio_believed: tuple[tuple[int, PerGrid], ...] = ()
    radio_true: PerGrid | None = None
    gnss_ns: Ints = field(default_factory=lambda: _NONE)  # when satellites gave a position
    signals: Mapping[str, Signal] = field(default_factory=dict)  # by name, of `signals.AXES`
    dropouts_s: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # when, how long: as told
    vehicle: str = COPTER  # or PLANE, ROVER
    source: Source = OURS

    @property
    def climbs_straight(self) -> bool:
        """Whether ArduPilot flew: up from where it stands, wherever its take-off names."""
        said = [event.text for event in self.events if event.text.startswith(AUTOPILOT)]
        ours = any("ArduPilot" in text for text in (self.source.kind, *said))
        return ours and self.vehicle == COPTER

    @cached_property
    def armed_ns(self) -> tuple[tuple[int, int], ...]:
        """From when up to when the vehicle was armed; all of the track where nothing says so."""
        begin_ns, end_ns = self.truth.t_ns[[0, -1]].tolist()
        told = sorted((e.t_ns, e.text == "armed") for e in self.events if e.kind == "armed")
        if not told or not told[0][1]:
            told.insert(0, (begin_ns, True))
        before = [False, *(on for _, on in told)]
        edges = [t_ns for (t_ns, on), was in zip(told, before, strict=False) if on != was]
        return tuple(zip(edges[::2], [*edges[1::2], end_ns + 1], strict=False))

    @cached_property
    def flown_events(self) -> tuple[EventRecord, ...]:
        """The events while it was armed."""
        spans = self.armed_ns
        return tuple(e for e in self.events if any(since <= e.t_ns < to for since, to in spans))

    @cached_property
    def config(self) -> Mapping[str, Any]:
        """The configuration that the log holds, as TOML has it; empty where it holds none."""
        return tomllib.loads(self.attachments.get("config.toml", b"").decode())


def area_to_text(area: Area) -> dict[str, str]:
    """The area as MCAP metadata: JSON by field, numbers in their shortest exact form.

    Without its airspace: what of that the vehicle was given stands in the log as its fence.
    """
    fields = {"size_m": area.size_m, "home_m": area.home_m, "home": asdict(area.home)}
    return {name: json.dumps(value) for name, value in fields.items()}


def area_from_text(values: Mapping[str, str]) -> Area:
    """The inverse of `area_to_text`.

    Raises:
        KeyError, TypeError, ValueError: a key is missing or not what it should be.
        InputError: home is nowhere.
    """
    (width, height), (x, y), home = (
        json.loads(values[key]) for key in ("size_m", "home_m", "home")
    )
    place = GeodeticPoint(**{name: float(value) for name, value in home.items()})
    area = Area.at((float(width), float(height)), (float(x), float(y)), place)
    _ = area.frame
    return area
