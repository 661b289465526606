"""The vehicle at one instant, as telemetry reports it. SI units, degrees for positions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

from pymavlink.dialects.v20 import common as mav

from flightdyn.instruments import Instruments
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Kinematics, Vector


@dataclass(frozen=True, slots=True)
class Dials:
    """What only some telemetry messages are made from, and costs more to put together."""

    instruments: Instruments
    target: GeodeticPoint | None  # where the guidance wants to be
    innovation_ratios: Mapping[str, float]  # by kind of measurement; refused from 1 on
    orbit: tuple[float, GeodeticPoint] | None  # radius (m, positive clockwise) and middle


@dataclass(frozen=True)
class Snapshot:
    """Everything that telemetry messages are made from."""

    t_ns: int
    belief: Kinematics
    position: GeodeticPoint  # of `belief`
    truth: Kinematics
    true_position: GeodeticPoint  # of `truth`
    origin: GeodeticPoint  # of the local frame
    home: GeodeticPoint
    home_ned_m: Vector
    gnss: GnssFix | None  # the last solution, None where there is no current one
    gnss_position: GeodeticPoint | None
    battery: BatteryState
    battery_low: bool
    battery_critical: bool
    custom_mode: int
    armed: bool
    system_state: int  # MAV_STATE
    landed_state: int  # MAV_LANDED_STATE
    sensors_present: int  # bits of MAV_SYS_STATUS_SENSOR
    sensors_healthy: int
    armed_t_ns: int  # when it was armed last; 0 for never
    flights: int  # how often it was armed
    mission: mav.MAVLink_message  # MISSION_CURRENT
    read_dials: Callable[[], Dials]

    @cached_property
    def dials(self) -> Dials:
        """What only some messages are made from."""
        return self.read_dials()
