"""Samples and events of the vehicle for its observers, on its own clock."""

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from flightdyn.state import BatteryState, GnssFix, Innovation, Kinematics, Vector

EventKind = Literal["mode", "armed", "reached", "status", "failsafe", "fault"]
# HEARTBEAT.system_status of a vehicle in a failsafe: CRITICAL, EMERGENCY, FLIGHT_TERMINATION.
FAILING = frozenset({5, 6, 8})


class VehicleSample(NamedTuple):
    """The vehicle at one instant, taken at the sampling rate while simulated time runs."""

    t_ns: int
    truth: Kinematics
    belief: Kinematics
    gnss: GnssFix | None  # a solution that arrived since the last sample
    battery: BatteryState
    mode: str
    armed: bool
    wind_ned_mps: Vector | None = None  # velocity of the air there; None where nobody knows
    innovations: tuple[Innovation, ...] = ()  # of the estimator since the last sample
    control: Vector | None = None  # rows of `flightdyn.native.library.Trace` since then


@dataclass(frozen=True, slots=True)
class VehicleEvent:
    """Something that happened at one instant, with truth and belief at that very instant."""

    t_ns: int
    kind: EventKind
    text: str
    truth: Kinematics
    belief: Kinematics
    seq: int | None = None  # "reached": MAVLink sequence number of the mission item
    severity: int = 6  # "status": MAV_SEVERITY


class VehicleObserver(Protocol):
    """Receives samples and events in order of time."""

    def sampled(self, sample: VehicleSample) -> None: ...

    def happened(self, event: VehicleEvent) -> None: ...
