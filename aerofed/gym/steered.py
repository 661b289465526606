"""Vehicles that hover in a world, and are then steered by setpoints of 0.1 s."""

import math
from collections.abc import Callable, Mapping
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mav

from flightdyn.state import Kinematics
from mission.base.arrays import Floats
from mission.base.errors import FlightError
from mission.config.models import RunConfig
from mission.flight.serve.hosts import enu
from mission.flight.serve.vehicle import Served
from mission.scenario.limits import guidance_of
from native.errors import ModelDivergedError
from sitl.world import World

Array: TypeAlias = NDArray[np.float32]
Setpoint: TypeAlias = Literal["velocity", "acceleration"]

SEEN = np.array([1000.0] * 3 + [50.0] * 3, dtype=np.float32)  # most metres, metres a second
HEIGHT_M = 20.0  # of the hover that an episode begins in
_STEP_NS = 100_000_000
_LONGEST_NS = 60 * 10**9  # until they hover
_OFFBOARD = (129.0, 6.0)  # PX4's main mode
# Bits of a setpoint's mask: all that is left out beside three numbers.
_ONLY = {"velocity": 0b0000_1101_1100_0111, "acceleration": 0b0000_1100_0011_1111}


class Steered:
    """A vehicle under a client of its own, which speaks MAVLink to it."""

    def __init__(self, served: Served, setpoint: Setpoint) -> None:
        self.vehicle, self._setpoint = served.vehicle, setpoint
        self.alt_msl_m = served.area.home.alt_msl_m
        self._system = self.vehicle.transponder("").system
        self._client = mav.MAVLink(None, srcSystem=255, srcComponent=190)

    @property
    def mode(self) -> str:
        """The autopilot's mode."""
        return self.vehicle.autopilot.mode.name

    @property
    def truth(self) -> Floats:
        """(6,) east, north, up of home in metres, and velocity in m/s, as they are."""
        return _east_north_up(self.vehicle.aircraft.truth)

    @property
    def belief(self) -> Floats:
        """The same as its autopilot believes it."""
        return _east_north_up(self.vehicle.aircraft.belief)

    def set(self, value: Floats) -> None:
        """Order a velocity or acceleration (3,), to east, north and up."""
        numbers, first = np.zeros(11), 3 if self._setpoint == "velocity" else 6
        numbers[first : first + 3] = value[1], value[0], -value[2]
        self._say(
            self._client.set_position_target_local_ned_encode(
                0, self._system, 1, mav.MAV_FRAME_LOCAL_NED, _ONLY[self._setpoint],
                *numbers.tolist(),
            )
        )  # fmt: skip

    def order(self, command: int, *params: float) -> None:
        """Give an order as COMMAND_LONG; the parameters left out are 0."""
        values = (*params, *[0.0] * (7 - len(params)))
        self._say(self._client.command_long_encode(self._system, 1, command, 0, *values))

    def _say(self, message: mav.MAVLink_message) -> None:
        """Send a MAVLink message to the vehicle, which receives it at its simulated time."""
        self.vehicle.receive(bytes(message.pack(self._client)), self.vehicle.t_ns * 1e-9)


def _east_north_up(at: Kinematics) -> Floats:
    return np.concatenate((enu(at.pos_ned_m), enu(at.vel_ned_mps)))


def largest(config: RunConfig, setpoint: Setpoint) -> Floats:
    """The largest setpoint (3,) that is ordered: to east, north and up."""
    limits = guidance_of(config.vehicle)
    if setpoint == "velocity":
        return np.array([limits.speed_mps, limits.speed_mps, limits.climb_mps])
    return np.array([limits.acceleration_mps2] * 2 + [limits.vertical_acceleration_mps2])


def hovering(fleet: Mapping[str, Steered]) -> World:
    """A world in which all hover and take setpoints.

    Raises:
        FlightError: one does not come to that, as where faults keep it on the ground.
    """
    world, all_ = World({name: one.vehicle for name, one in fleet.items()}), [*fleet.values()]

    def fly(done: Callable[[], bool]) -> None:
        while not done() and world.t_ns < _LONGEST_NS:
            world.stride()

    fly(lambda: not world.moving)
    for one in all_:
        one.order(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        at = math.nan, math.nan, math.nan, one.alt_msl_m + HEIGHT_M
        one.order(mav.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, *at)
    fly(lambda: all(one.mode == "HOLD" for one in all_))
    for one in all_:
        one.set(np.zeros(3))
        one.order(mav.MAV_CMD_DO_SET_MODE, *_OFFBOARD)
        if one.mode != "OFFBOARD":
            raise FlightError(f"the vehicle takes no setpoints in mode {one.mode}")
    return world


def stepped(world: World, fleet: Mapping[str, Steered]) -> dict[str, bool]:
    """Fly on for 0.1 s; which of these take setpoints after it."""
    until_ns = world.t_ns + _STEP_NS
    try:
        while world.t_ns < until_ns:
            world.stride(until_ns)
    except ModelDivergedError:
        return dict.fromkeys(fleet, False)
    return {name: one.mode == "OFFBOARD" for name, one in fleet.items()}
