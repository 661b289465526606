"""Orders to the aircraft in flight: whether each may be carried out, and the manoeuvre for it."""

import math
from collections.abc import Iterable, Sequence
from copy import copy

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import Triple
from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying import route
from sitl.autopilot.flying.mission import Mission
from sitl.autopilot.flying.modes import PILOTED, Goal, Mode, ModeMachine, Need, Trigger
from sitl.autopilot.guard import Guard
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.order_rules import LOOKS, NAVIGATION
from sitl.autopilot.reporter import Reporter

_LEAST_CLIMB_M = 0.5  # of a take-off
# Modes with a speed of their own, which is not to be changed.
_PACED = frozenset({Mode.TAKEOFF, Mode.LAND, Mode.ORBIT, Mode.TERMINATED}) | PILOTED


def _goal(place_ned_m: Iterable[float] | None, yaw_rad: float, down_m: float = math.nan) -> Goal:
    """What an order asks for: a place (m, NED) and a heading (rad); NaN is left open."""
    north, east, down = (math.nan, math.nan, down_m) if place_ned_m is None else place_ned_m
    # Goals are compared, and NaN is equal only as the same object.
    return (float(north), float(east), float(down)), math.nan if math.isnan(yaw_rad) else yaw_rad


class Flight(ModeMachine):
    """One aircraft in flight: orders, and the manoeuvres that they begin.

    Orders return None when they are carried out, or the reason why not. An order for what is
    already being done changes nothing, so that a repeated command repeats nothing.
    """

    def __init__(
        self, aircraft: Aircraft, parameters: Parameters, *, guard: Guard, reporter: Reporter
    ) -> None:
        super().__init__(aircraft, parameters, guard=guard, reporter=reporter)
        self.rally: tuple[MissionItem, ...] = ()
        self.frame = aircraft.frame
        self._makes |= {Mode.LAND: self._land, Mode.RETURN: self._return}

    @property
    def patient(self) -> bool:
        """Whether `tick` may be skipped until the progress along a path changes."""
        return self._manoeuvre is None or self._manoeuvre.patient

    @property
    def bound(self) -> bool:
        """Whether it is on its way to a place at which it was ordered to land."""
        return self.mode is Mode.LAND and self._goal is not None

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE: on ground, taking off, landing or in air; undefined for a wreck."""
        if self._aircraft.crashed:
            # A wreck is down, but it has not landed.
            return mav.MAV_LANDED_STATE_UNDEFINED
        if self._aircraft.on_ground:
            return mav.MAV_LANDED_STATE_ON_GROUND
        if self._manoeuvre is not None and self._manoeuvre.landing:
            return mav.MAV_LANDED_STATE_LANDING
        takes_off = self.mode is Mode.TAKEOFF
        if self._on_mission:
            item = self.mission.items[self.mission.current]
            takes_off = item.command == mav.MAV_CMD_NAV_TAKEOFF
        return mav.MAV_LANDED_STATE_TAKEOFF if takes_off else mav.MAV_LANDED_STATE_IN_AIR

    def not_at_rest(self) -> str:
        """Why the aircraft cannot be switched off; empty if it can. A wreck can."""
        if self._aircraft.armed:
            return "armed"
        return "" if self._aircraft.on_ground else "in the air"

    def here(self) -> Vector:
        """Return where new paths begin, (3,) NED: the point held, or the estimated position."""
        return self.navigator.here(resting=not self.moving)

    # --- orders ---------------------------------------------------------------------------------

    def take_off(
        self,
        altitude_msl_m: float | None = None,
        *,
        place_ned_m: Vector | None = None,
        yaw_rad: float = math.nan,
    ) -> str | None:
        """Climb straight up to an altitude (None: MIS_TAKEOFF_ALT above home), then fly above a
        place, if one is given; with a heading (NaN: as it is)."""
        altitude = altitude_msl_m
        if altitude is None:
            altitude = self.guard.home.alt_msl_m + self._parameters["MIS_TAKEOFF_ALT"]
        here = self.here()
        down_m = self.frame.origin.alt_msl_m - altitude
        goal = _goal(None if place_ned_m is None else (*place_ned_m[:2], down_m), yaw_rad, down_m)
        if self.mode is Mode.TAKEOFF and goal == self._goal:
            return None
        to = np.array([*(here if place_ned_m is None else place_ned_m)[:2], down_m])
        if down_m > here[2] - _LEAST_CLIMB_M:
            here_msl_m = self.frame.origin.alt_msl_m - here[2]
            return (
                f"take-off altitude {altitude:.1f} m is not above the aircraft: both count from "
                f"mean sea level, where it is at {here_msl_m:.1f} m; give more than "
                f"{here_msl_m + _LEAST_CLIMB_M:.1f} m"
            )
        if forbidden := self.guard.forbidden(np.array([[here[0], here[1], down_m], to])):
            return f"the end of the take-off is {forbidden}"
        speed = self._ordered_speed_mps
        return self.order(
            Trigger.ORDER_TAKEOFF,
            lambda: self.navigator.climb(here, to, speed_mps=speed, yaw_rad=yaw_rad),
            goal=goal,
        )

    def fly_mission(self) -> str | None:
        """Start the mission, or go on with it."""
        if self._on_mission:
            return None
        return self._fly_mission(self.mission)

    def start_mission(self, first: int | None, last: int | None) -> str | None:
        """Fly the mission from item `first` to `last`; None: from where it stands, to its end.

        From an item without autocontinue, at which it waits, it goes on whatever is first.
        """
        mission, count = copy(self.mission), len(self.mission.items)
        mission.last = last
        if first is not None and not mission.waiting:
            if first >= max(count, 1):
                return f"mission has {count} items, no item {first}"
            mission.rewind(first)
        if last is not None and not mission.next_start[0] <= last < count:
            return f"mission has {count} items, and ends after {last} only if it begins before"
        if self._on_mission and not mission.waiting:
            begun = self.mission.begun, self.mission.last
            if begun == (first, last) or (first is None and begun[1] == last):
                return None
        return self._fly_mission(mission)

    def _fly_mission(self, mission: Mission) -> str | None:
        stages = self._stages(mission)
        if mission.waiting and mission.over:
            self.mission.waiting = False
            self._mission_ended()
            return None
        if barred := self._barred(mission, stages):
            return barred
        kept, self.mission = self.mission, mission
        reason = self.order(Trigger.ORDER_MISSION, lambda: self._fly_on(stages))
        if reason:
            self.mission = kept
        return reason

    def replace_mission(self, items: tuple[MissionItem, ...]) -> str | None:
        """Replace the mission by one to be started later; refuse that while it is being flown."""
        if self._on_mission:
            if self.moving:
                return "Mission is being flown: hold before a new one"
            self._enter(Mode.HOLD, "mission replaced at its end", None)  # it was loitering there
        self.mission.replace(items)
        self._report.nudge(mav.MAVLINK_MSG_ID_MISSION_CURRENT)
        return None

    def rewind_mission(self, seq: int, *, reset: bool) -> str | None:
        """Go on with item `seq`, at once if the mission is being flown; `reset` jump counters."""
        if seq >= max(len(self.mission.items), 1):
            return f"mission has {len(self.mission.items)} items, no item {seq}"
        rewound = copy(self.mission)
        rewound.rewind(seq, reset=reset)
        if not self._on_mission:
            self.mission = rewound
        elif (seq != self.mission.current or reset or self.mission.waiting) and (
            reason := self._fly_mission(rewound)
        ):
            return reason
        self._report.nudge(mav.MAVLINK_MSG_ID_MISSION_CURRENT)
        return None

    def hold(self, why: str | None = None, *, yaw_rad: float = math.nan) -> str | None:
        """Brake and hold the position; then turn to a heading, if one is given."""
        if self.mode is Mode.HOLD and self._goal is None and math.isnan(yaw_rad):
            return None
        return self.order(Trigger.ORDER_HOLD, lambda: self.navigator.stop(yaw_rad), why)

    def go_to(self, pos_ned_m: Vector, *, yaw_rad: float = math.nan) -> str | None:
        """Fly straight to a position and stay there."""
        goal = _goal(pos_ned_m, yaw_rad)
        if self.mode is Mode.HOLD and goal == self._goal:
            return None
        if forbidden := self.guard.forbidden(np.array(goal[0])):
            return f"the position is {forbidden}"
        return self.order(Trigger.ORDER_GOTO, lambda: self._go(*goal), goal=goal)

    def turn(self, params: Sequence[float]) -> str | None:
        """Turn on the spot as the parameters of a CONDITION_YAW ask for."""
        if self.mode is not Mode.HOLD or self.moving:
            return "the heading can be set only while holding"
        return self.order(Trigger.ORDER_GOTO, lambda: self.navigator.turn_by(self.here(), params))

    def return_home(self, why: str | None = None) -> str | None:
        """Fly home, or to a rally point that is closer, at a safe height and land."""
        return self.order(Trigger.ORDER_RETURN, self._return, why)

    def land(
        self,
        why: str | None = None,
        *,
        place_ned_m: Vector | None = None,
        yaw_rad: float = math.nan,
    ) -> str | None:
        """Land where the aircraft is, or fly above a place and land there; with a heading."""
        goal = None
        if place_ned_m is not None or not math.isnan(yaw_rad):
            goal = _goal(place_ned_m, yaw_rad)
        if self.mode is Mode.LAND and goal == self._goal:
            return None
        if place_ned_m is not None:
            if not self.guard.position_ok():
                return Need.POSITION.value
            if forbidden := self.guard.forbidden(place_ned_m):
                return f"the place is {forbidden}"
        return self.order(
            Trigger.ORDER_LAND, lambda: self._land(place_ned_m, yaw_rad), why, goal=goal
        )

    def change_speed(self, speed_mps: float | None) -> str | None:
        """Set the speed until the mode changes or the mission sets another; None: the default."""
        if self.mode in _PACED:
            return f"mode {self.mode.name} has a speed of its own"
        if self.mode is Mode.HOLD and not self.airborne:
            return "on the ground it would end with the mode HOLD"
        default, ordered = self._parameters["MPC_XY_CRUISE"], self._ordered_speed_mps
        self._ordered_speed_mps = default if speed_mps is None else speed_mps
        if self._ordered_speed_mps == (default if ordered is None else ordered) and (
            self.mode is not Mode.MISSION
        ):
            return None
        if self.mode is Mode.MISSION and self.moving:
            self._manoeuvre = self._fly_on(self._stages(self.mission))
        elif self.mode is Mode.RETURN and self.moving:
            self._manoeuvre = self._return()
        elif self._goal is not None:
            self._manoeuvre = self._go(*self._goal)
        return None

    def set_home(self, home: GeodeticPoint) -> None:
        """Move home to a place."""
        self.guard.home = home
        self._report.nudge(mav.MAVLINK_MSG_ID_HOME_POSITION)

    def _go(self, pos_ned_m: Triple, yaw_rad: float) -> do.Manoeuvre:
        return self.navigator.go_to(
            self.here(), np.array(pos_ned_m), speed_mps=self._ordered_speed_mps, yaw_rad=yaw_rad
        )

    def _return(self) -> do.Manoeuvre:
        here = self.here()
        name, goal = self.navigator.refuge(here, self.rally)
        self._report.say(f"Returning to {name}", mav.MAV_SEVERITY_INFO)
        return self.navigator.return_to(here, goal, speed_mps=self._ordered_speed_mps)

    def _land(self, place_ned_m: Vector | None = None, yaw_rad: float = math.nan) -> do.Manoeuvre:
        sure, here, speed = self.guard.position_ok(), self.here(), self._ordered_speed_mps
        if place_ned_m is None:
            return self.navigator.land(here, sure=sure, heading_rad=yaw_rad)
        return self.navigator.land_at(here, place_ned_m, speed_mps=speed, yaw_rad=yaw_rad)

    def _stages(self, mission: Mission) -> tuple[route.Stage, ...]:
        """Stages of a mission that are still to be flown, from the present position."""
        return self.navigator.stages(mission, self.here(), self._ordered_speed_mps)

    def _barred(self, mission: Mission, stages: Sequence[route.Stage]) -> str:
        """Why the stages of a mission may not be flown; empty if they may."""
        if mission.items and not stages:
            return f"from item {mission.next_start[0]} on the mission holds nothing to fly"
        if trouble := self.navigator.trouble(mission.items):  # home may have moved since
            return trouble
        paths = route.points_of(stages)
        forbidden = self.guard.forbidden(np.vstack(paths)) if paths else ""
        return f"the mission leads {forbidden}" if forbidden else ""

    def _fly_on(self, stages: Sequence[route.Stage]) -> do.Manoeuvre:
        """Begin the stages of the mission, or go on with them."""
        self.mission.start()
        self._ended_by = None
        self._report.nudge(mav.MAVLINK_MSG_ID_MISSION_CURRENT)
        return self.navigator.fly(stages, reached=self._reached, ended=self._ended)

    def _ended(self, command: int) -> None:
        self._ended_by = command

    def _reached(self, seq: int) -> None:
        item = self.mission.items[seq]
        if item.command == mav.MAV_CMD_DO_CHANGE_SPEED and item.params[1] != -1.0:
            self._ordered_speed_mps = None
        if item.command in LOOKS:
            self._aircraft.look_at(route.looked_at(item, self.frame, self.guard.home))
        self._aircraft.faults.happened(seq)
        self.mission.reached(seq)
        self._report.reached(seq, place=item.command in NAVIGATION)
