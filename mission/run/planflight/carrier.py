"""Who carries a plan file out: the simulated vehicle, or an external autopilot. Chosen once."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial

import numpy as np

from mission.base import polyline
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.flight.flyers.contact import await_vehicle
from mission.flight.flyers.external import ExternalFlyer, check_end, open_external, telemetry_of
from mission.flight.flyers.simulated import SIMULATED_POSITIONS, SimulatedFlyer, open_simulated
from mission.flight.pilot.limits import Demand, Limits
from mission.flight.pilot.pilot import Pilot
from mission.log.values import PlanRecord
from mission.log.write.writer import FlightLog
from mission.run.planflight.prepare import PreparedPlan, prepare_plan
from sitl.autopilot.codec.names import command_name
from sitl.autopilot.protocol.item_rules import PLACES
from sitl.autopilot.values.enums import ABSOLUTE_FRAMES, Command
from sitl.autopilot.values.messages import MissionItem

Say = Callable[[str], None]

_SPEEDS_MPS = (1.0, 30.0)  # that a plan's path may have


class PlanCarrier(ABC):
    """Carries out one plan, from the ground to the ground."""

    position_source: str  # where the positions come from, for people
    t_ns = 0  # the vehicle's time, once it has flown

    def __init__(self, ready: PreparedPlan) -> None:
        self.ready = ready

    @abstractmethod
    async def fly(self, log: FlightLog) -> None:
        """Fly the plan.

        Raises:
            FlightError, LinkLostError: see `Pilot`.
        """

    async def _draw(self, pilot: Pilot) -> None:
        """Give the vehicle the plan's fence and rally points."""
        plan = self.ready.plan
        if plan.fence:
            await pilot.upload_fence(plan.fence)
        if plan.rally:
            await pilot.upload_rally(plan.rally)


class SimulatedCarrier(PlanCarrier):
    """The simulated vehicle, whose time stands still while it is given its mission."""

    position_source = SIMULATED_POSITIONS

    async def fly(self, log: FlightLog) -> None:
        ready = self.ready
        try:
            async with open_simulated(
                ready.config, ready.vehicle, area=ready.area, observers=(log,)
            ) as flyer:
                await self._carry_out(flyer, log)
        finally:
            self.t_ns = ready.vehicle.t_ns

    async def _carry_out(self, flyer: SimulatedFlyer, log: FlightLog) -> None:
        pilot, plan = flyer.pilot, self.ready.plan
        await pilot.ready()
        await self._draw(pilot)
        log_path(flyer.t_ns, log, self.ready)
        await pilot.upload_items(plan.items)
        await pilot.arm()
        await pilot.carry_out()
        if self.ready.path.returns:
            await pilot.landed()
        else:
            await pilot.land()


class ExternalCarrier(PlanCarrier):
    """An external autopilot. Its return is ordered, not part of the mission: each family has its
    own idea of when a mission with a return is over.
    """

    def __init__(self, ready: PreparedPlan, *, say: Say) -> None:
        """Wait for the vehicle, and time the plan by its parameters.

        Raises:
            InputError: heights above sea level are in the plan; the vehicle stands elsewhere.
            FlightError, LinkLostError: see `await_vehicle`.
        """
        _check_frames(ready)
        link = ready.config.link
        limits = await_vehicle(link, area=ready.area, say=say)
        super().__init__(prepare_plan(_with_limits(ready.config, limits), ready.plan))
        self.position_source = telemetry_of(link)
        self._say = say

    async def fly(self, log: FlightLog) -> None:
        ready = self.ready
        async with open_external(
            ready.config.link,
            mission=ready.config.mission,
            area=ready.area,
            demand=_demand(ready),
            observers=(log,),
            say=partial(self._notice, log),
        ) as flyer:
            try:
                await self._carry_out(flyer, log)
            finally:
                self.t_ns = flyer.t_ns

    def _notice(self, log: FlightLog, text: str) -> None:
        log.note(text, severity=4)
        self._say(text)

    async def _carry_out(self, flyer: ExternalFlyer, log: FlightLog) -> None:
        pilot, path = flyer.pilot, self.ready.path
        items = [
            item for item in self.ready.plan.items if item.command != Command.NAV_RETURN_TO_LAUNCH
        ]
        lands = items[-1].command == Command.NAV_LAND
        await flyer.ready()
        await self._draw(pilot)
        await pilot.upload_items(items)
        if items[0].command == Command.NAV_TAKEOFF:
            await pilot.arm()
        else:  # not every autopilot leaves the ground for a waypoint
            await pilot.take_off(-float(path.places[min(path.places)][2]))
        log_path(flyer.t_ns, log, self.ready)
        flight = await flyer.record(lambda: pilot.carry_out(lands=lands))
        sequence = sorted(path.places)
        places = np.array([path.places[seq] for seq in sequence])
        passages = flyer.find_passages(
            flight, places, items=sequence, hold_s=[_wait_s(items, seq) for seq in sequence]
        )
        miss_m = float(np.linalg.norm((passages[-1].est_ned_m - places[-1])[:2]))
        check_end(miss_m)
        if lands:
            await flyer.seen_down()
        else:
            await flyer.land()


def make_carrier(ready: PreparedPlan, *, say: Say) -> PlanCarrier:
    """The carrier that the plan's configuration asks for.

    Raises:
        InputError, FlightError, LinkLostError: an external vehicle that cannot fly it.
    """
    if ready.config.link.kind == "external":
        return ExternalCarrier(ready, say=say)
    return SimulatedCarrier(ready)


def _check_frames(ready: PreparedPlan) -> None:
    for item in ready.plan.items:
        if item.command in PLACES and item.frame in ABSOLUTE_FRAMES:
            raise InputError(
                f"{ready.plan.path}: item {item.seq}, {command_name(item.command)}: its height is "
                "above sea level; an external vehicle (--vehicle) is sent to heights above its home"
            )


def _with_limits(config: RunConfig, limits: Limits) -> RunConfig:
    """The configuration of a simulated vehicle that is as fast as the external one."""
    known = {
        "MPC_XY_CRUISE": limits.value("cruise_mps", otherwise=math.nan),
        "MPC_XY_VEL_MAX": math.inf if config.link.set_parameters else limits.speed_mps,
    }
    speeds = {
        name: float(np.clip(value, *_SPEEDS_MPS))
        for name, value in known.items()
        if not math.isnan(value)
    }
    vehicle = config.vehicle.model_copy(
        update={"parameters": {**config.vehicle.parameters, **speeds}}
    )
    return config.model_copy(update={"vehicle": vehicle})


def _demand(ready: PreparedPlan) -> Demand:
    """What the plan asks of the vehicle."""
    items, points = ready.plan.items, ready.path.points_ned_m
    ordered = [item.params[1] for item in items if item.command == Command.DO_CHANGE_SPEED]
    radii = [item.params[1] for item in items if item.command == Command.NAV_WAYPOINT]
    return Demand(
        speed_mps=max(ordered, default=0.0),
        altitude_m=ready.path.top_m,
        distance_m=float(np.linalg.norm(points[:, :2], axis=1).max()),
        acceptance_m=min((radius for radius in radii if radius > 0.0), default=math.inf),
    )


def _wait_s(items: list[MissionItem], seq: int) -> float:
    waits = items[seq].command in (Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME)
    return items[seq].params[0] if waits and items[seq].params[0] > 0.0 else 0.0


def log_path(t_ns: int, log: FlightLog, ready: PreparedPlan) -> None:
    """The planned path, as the log has it for rounds: one that serves nobody."""
    points = area_xyz(ready.area, ready.path.points_ned_m)
    speed_mps = polyline.length(points) / ready.path.duration_s
    log.plan_record(
        PlanRecord(
            round=1,
            t_ns=t_ns,
            waypoints_m=points[:, :2],
            schedule=np.zeros((len(points), 0), dtype=bool),
            importance=np.zeros(0),
            value=0.0,
            upper_bound=math.nan,
            path_budget_m=ready.path.path_m,
            speed_mps=speed_mps,
            altitude_m=ready.path.top_m,
            height_m=points[:, 2],
            slot_s=polyline.along(points) / speed_mps,
            duration_s=ready.path.duration_s,
            route_m=points[:, :2],
            stops_at=np.arange(len(points)),
        )
    )


def area_xyz(area: Area, pos_ned_m: Floats) -> Floats:
    """(n, 3) NED -> x east, y north in area coordinates, height above home."""
    return np.column_stack((area.from_ned(pos_ned_m), -pos_ned_m[:, 2]))
