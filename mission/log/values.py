"""What a flight log holds, as values: area coordinates (x east, y north, height above home)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.log.records import RoundRecord, UplinkRecord

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class Devices:
    """The ground devices of all communities, in the order of the federation."""

    pos_m: Floats  # (K, 2) area coordinates
    community: tuple[str, ...]  # (K,)

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
    """An area of the fence: to be kept to, or to be kept out of."""

    outline_m: Floats  # (n, 2) corners in area coordinates; the last joins the first
    keep_in: bool


@dataclass(frozen=True)
class Track:
    """Where the aircraft was, or believed to be."""

    t_ns: Ints  # (n,)
    pos_m: Floats  # (n, 3) x east, y north, height above home

    def between(self, start_ns: int, end_ns: int) -> "Track":
        """The samples with start <= t <= end."""
        first, last = np.searchsorted(self.t_ns, (start_ns, end_ns + 1))
        return Track(self.t_ns[first:last], self.pos_m[first:last])


@dataclass(frozen=True)
class PlanRecord:
    """A round's plan as it stands in the log."""

    round: int
    t_ns: int
    waypoints_m: Floats  # (N, 2)
    schedule: Bools  # (N, K)
    importance: Floats  # (K,)
    value: float
    upper_bound: float  # NaN where the planner gives none
    path_budget_m: float
    speed_mps: float
    altitude_m: float
    height_m: Floats  # (N,) of each waypoint; differs from `altitude_m` in plan files only
    ideal_slot_s: Floats  # (N,) seconds after t_ns at which a step is passed at planned speed

    @property
    def path_m(self) -> float:
        """Length of the planned polyline."""
        return float(np.linalg.norm(np.diff(self.waypoints_m, axis=0), axis=1).sum())


@dataclass(frozen=True)
class LearningRecord:
    """What one community had learnt after a round."""

    round: int
    t_ns: int
    community: str
    accuracy: float
    cov: float
    loss: float  # mean local loss of the devices that trained; NaN where nobody did


@dataclass(frozen=True)
class EventRecord:
    """Something that happened, with truth and belief of that instant."""

    t_ns: int
    kind: str
    text: str
    seq: int | None
    severity: int
    true_m: tuple[float, float, float]
    est_m: tuple[float, float, float]


@dataclass(frozen=True)
class BatteryTrack:
    """The battery over time."""

    t_ns: Ints  # (n,)
    voltage_v: Floats
    current_a: Floats
    consumed_mah: Floats
    remaining: Floats  # 0..1


@dataclass(frozen=True)
class WindTrack:
    """The wind at the aircraft over time."""

    t_ns: Ints  # (n,)
    vel_mps: Floats  # (n, 3) velocity of the air: east, north, up


@dataclass(frozen=True)
class InnovationTrack:
    """One of the estimator's sensors over time, against what the estimator expected of it."""

    t_ns: Ints  # (n,) the instants that the filter was at
    values: Floats  # (n, axes) measured less predicted, in the sensor's unit
    stds: Floats  # (n, axes)
    ratio: Floats  # (n,) refused from 1 on
    accepted: Bools  # (n,)


@dataclass(frozen=True)
class FlightData:
    """Everything that a log holds, read back."""

    area: Area
    devices: Devices
    fence: tuple[Zone, ...]
    truth: Track
    belief: Track
    plans: tuple[PlanRecord, ...]
    rounds: tuple[RoundRecord, ...]
    uplinks: tuple[UplinkRecord, ...]
    learning: tuple[LearningRecord, ...]
    events: tuple[EventRecord, ...]
    battery: BatteryTrack
    wind: WindTrack
    innovations: Mapping[str, InnovationTrack]  # by sensor; empty where the vehicle tells none
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Mapping[str, bytes]


def area_to_text(area: Area) -> dict[str, str]:
    """The area as MCAP metadata: numbers in their shortest exact form."""
    return {
        "size_x_m": repr(float(area.size_m[0])),
        "size_y_m": repr(float(area.size_m[1])),
        "home_x_m": repr(float(area.home_m[0])),
        "home_y_m": repr(float(area.home_m[1])),
        "home_lat_deg": repr(float(area.home.lat_deg)),
        "home_lon_deg": repr(float(area.home.lon_deg)),
        "home_alt_msl_m": repr(float(area.home.alt_msl_m)),
    }


def area_from_text(values: Mapping[str, str]) -> Area:
    """The inverse of `area_to_text`.

    Raises:
        KeyError, ValueError: a key is missing or not a number.
    """
    return Area(
        size_m=(float(values["size_x_m"]), float(values["size_y_m"])),
        home_m=(float(values["home_x_m"]), float(values["home_y_m"])),
        home=GeodeticPoint(
            lat_deg=float(values["home_lat_deg"]),
            lon_deg=float(values["home_lon_deg"]),
            alt_msl_m=float(values["home_alt_msl_m"]),
        ),
    )
