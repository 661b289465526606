"""Parameters of a vehicle: read, set for the length of a flight, and what they let it do against
what a flight asks of it."""

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TypeAlias

from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.exceptions import MavsdkError

from flightdyn.config import LimitsConfig
from mission.base.errors import AerofedError, FlightError
from mission.flight.missions.round_mission import Demand
from mission.flight.pilot.mavsdk_calls import reason, settled

logger = logging.getLogger(__name__)

RESTORE_TIMEOUT_S = 15.0  # wall time, of a link that may be lost
_HEIGHT, _RADIUS = 1, 2  # bits of FENCE_TYPE
_EVERY_KIND = 3
SET_BY = "link.set_parameters = true sets it for the flight"

# What a family of autopilots calls its limits, by what they limit: the parameter's name in each of
# its versions, the n-th that of the n-th, and how many of our units (SI) one of its own is.
LimitNames: TypeAlias = Mapping[str, Mapping[str, float]]

# PX4 v1.16: FlightTaskAuto takes the lesser of what a mission orders and MPC_XY_VEL_MAX.
PX4_LIMITS: LimitNames = {
    "cruise_mps": {"MPC_XY_CRUISE": 1.0},  # of legs for which no speed is ordered
    "speed_mps": {"MPC_XY_VEL_MAX": 1.0},  # fastest, whatever is ordered
    "acceleration_mps2": {"MPC_ACC_HOR": 1.0},  # along a leg, and in its corners
    "tilt_deg": {"MPC_TILTMAX_AIR": 1.0},
    "fence_on": {"GF_ACTION": 1.0},
    "fence_radius_m": {"GF_MAX_HOR_DIST": 1.0},
    "fence_height_m": {"GF_MAX_VER_DIST": 1.0},
}
# ArduCopter: DO_CHANGE_SPEED is not held against WPNAV_SPEED; only its lean limits it.
ARDUPILOT_LIMITS: LimitNames = {
    "cruise_mps": {"WPNAV_SPEED": 0.01, "WP_SPD": 1.0},
    "acceleration_mps2": {"WPNAV_ACCEL": 0.01, "WP_ACC": 1.0},
    "tilt_deg": {"ANGLE_MAX": 0.01, "ATC_ANGLE_MAX": 1.0},
    "acceptance_m": {"WPNAV_RADIUS": 0.01, "WP_RADIUS_M": 1.0},  # the items' own does not count
    "fence_on": {"FENCE_ENABLE": 1.0},
    "fence_kinds": {"FENCE_TYPE": 1.0},  # bits: which of its fences are meant; without it all
    "fence_radius_m": {"FENCE_RADIUS": 1.0},
    "fence_height_m": {"FENCE_ALT_MAX": 1.0},
}


class Parameters:
    """The parameters of one vehicle; those that are whole numbers there come as floats too."""

    def __init__(self, system: System) -> None:
        self._plugin = ParamAsync(system)

    async def get(self, name: str) -> float | None:
        """The value of a parameter; None where the vehicle has none such, or does not answer."""
        for read in (self._plugin.get_param_float, self._plugin.get_param_int):
            try:
                return float(await settled(read(name)))
            except MavsdkError as error:
                logger.info("parameter %s: %s", name, error)
                if "WRONG_TYPE" not in reason(error):
                    return None
        return None

    async def set(self, name: str, value: float) -> None:
        """Set a parameter that is a float there.

        Raises:
            FlightError: the vehicle refuses, or does not answer.
        """
        try:
            await settled(self._plugin.set_param_float(name, value))
        except MavsdkError as error:
            raise FlightError(
                f"the vehicle did not set {name} = {value:g}: {reason(error)}"
            ) from None


@asynccontextmanager
async def adjusted(
    parameters: Parameters, values: Mapping[str, tuple[float, float]], *, say: Callable[[str], None]
) -> AsyncIterator[None]:
    """Set each parameter to the second of its values, and back to the first when the block ends.

    However it ends: what could not be set back is named, in the error that ends the flight where
    there is one, else by `say`.
    """
    changed: dict[str, tuple[float, float]] = {}
    try:
        for name, (before, during) in values.items():
            changed[name] = (before, during)
            await parameters.set(name, during)
        yield
    except AerofedError as error:
        if left := await _restored(parameters, changed):
            raise type(error)(f"{error}; {left}") from error
        raise
    except BaseException:
        if left := await _restored(parameters, changed):
            say(left)
        raise
    else:
        if left := await _restored(parameters, changed):
            raise FlightError(left)


async def _restored(parameters: Parameters, changed: Mapping[str, tuple[float, float]]) -> str:
    """Restore changed parameters; return a line for people on those that failed, empty if none."""
    left = dict(changed)
    try:
        async with asyncio.timeout(RESTORE_TIMEOUT_S):
            for name, (before, _) in changed.items():
                await parameters.set(name, before)
                del left[name]
    except (TimeoutError, AerofedError) as error:
        logger.info("parameters: %s", error)
    if not left:
        return ""
    values = ", ".join(f"{name} = {set_:g} (was {was:g})" for name, (was, set_) in left.items())
    return f"the vehicle keeps what was set for the flight: {values}"


@dataclass(frozen=True)
class VehicleLimit:
    """One limit that a parameter of the vehicle sets."""

    name: str
    unit: float  # SI units that one of the parameter's is
    value: float  # in our unit

    @property
    def raw(self) -> float:
        """The value in the unit of the parameter."""
        return self.value / self.unit


@dataclass(frozen=True)
class VehicleLimits:
    """The limits that a vehicle has, by the keys of `LimitNames`; those it lacks are missing."""

    known: dict[str, VehicleLimit] = field(default_factory=dict)

    def value(self, what: str, *, otherwise: float) -> float:
        """A limit in our unit (SI), `otherwise` where the vehicle has none such."""
        limit = self.known.get(what)
        return otherwise if limit is None else limit.value

    @property
    def speed_mps(self) -> float:
        """The fastest that it will fly, by its parameters; infinity where none says."""
        return self.value("speed_mps", otherwise=math.inf)

    @property
    def guidance(self) -> LimitsConfig:
        """Guidance limits for planning: our own, with the vehicle's acceleration and top speed."""
        ours = LimitsConfig()
        accel = self.value("acceleration_mps2", otherwise=ours.acceleration_mps2)
        return ours.model_copy(
            update={
                "acceleration_mps2": accel if accel > 0.0 else ours.acceleration_mps2,
                "speed_mps": self.speed_mps,
            }
        )

    def lines(self) -> list[str]:
        """Return the parameters behind the limits, one a line, in the vehicle's own units."""
        return [f"{limit.name} = {limit.raw:g}" for limit in self.known.values()]

    def adjustments(self, demand: Demand) -> dict[str, tuple[float, float]]:
        """Parameters to change: the value of each, and the one with which the demand can be flown.

        Speed and acceptance radius only: lean and fence are there to protect the vehicle.
        """
        return {
            limit.name: (limit.raw, asked / limit.unit)
            for limit, asked, _ in self._correctable(demand)
        }

    def shortfalls(self, demand: Demand, *, adjusted: bool) -> Sequence[str]:
        """What of the demand will not be flown as asked, a phrase each, parameters named."""
        phrases = [
            f"{words} ({limit.name} = {limit.raw:g}), {asked:g} asked; {SET_BY}"
            for limit, asked, words in self._correctable(demand)
            if not adjusted
        ]
        return [*phrases, *self._beyond_fence(demand)]

    def _correctable(self, demand: Demand) -> list[tuple[VehicleLimit, float, str]]:
        """Limits that may be set otherwise, what is asked of each, and what it allows in words."""
        speed, radius = self.known.get("speed_mps"), self.known.get("acceptance_m")
        found = []
        if speed is not None and speed.value < demand.speed_mps:
            found.append((speed, demand.speed_mps, f"{speed.value:g} m/s at most"))
        if radius is not None and radius.value > demand.acceptance_m:
            words = f"corners cut by up to {radius.value:g} m"
            found.append((radius, demand.acceptance_m, words))
        return found

    def _beyond_fence(self, demand: Demand) -> list[str]:
        if self.value("fence_on", otherwise=0.0) == 0.0:
            return []
        kinds = int(self.value("fence_kinds", otherwise=_EVERY_KIND))
        asked = {
            "fence_height_m": (_HEIGHT, demand.altitude_m, "above"),
            "fence_radius_m": (_RADIUS, demand.distance_m, "from"),
        }
        return [
            f"its fence ends {limit.value:g} m {where} home ({limit.name}), {wanted_m:.0f} "
            "asked: it will not let the mission pass"
            for what, (kind, wanted_m, where) in asked.items()
            # 0 means that there is none.
            if kinds & kind
            and (limit := self.known.get(what)) is not None
            and 0.0 < limit.value < wanted_m
        ]


async def read_limits(parameters: Parameters, names: LimitNames) -> VehicleLimits:
    """Ask the vehicle for its limits.

    A name that it lacks costs seconds of waiting: the names of the version that has answered come
    first for the others.
    """
    known = {}
    version = 0
    for what, alternatives in names.items():
        versions = enumerate(alternatives.items())
        for number, (name, unit) in sorted(versions, key=lambda one: one[0] != version):
            value = await parameters.get(name)
            if value is not None:
                known[what] = VehicleLimit(name, unit, value * unit)
                version = max(version, number)
                break
    return VehicleLimits(known)
