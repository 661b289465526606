"""The state machine of a flight: mode, manoeuvre and mission, and the transitions between them."""

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from typing import TypeAlias

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import Triple
from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying import route
from sitl.autopilot.flying.mission import Mission
from sitl.autopilot.flying.navigator import Navigator
from sitl.autopilot.guard import Guard
from sitl.autopilot.modes import NEEDS_TO_ARM, ORDERS, PILOTED, Mode, Need, Trigger, possible
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.order_rules import LOOKS, NAVIGATION
from sitl.autopilot.reporter import Reporter

_LEAST_CLIMB_M = 0.5  # of a take-off
_STARTING = "starting up"
_LIFTS = frozenset({Trigger.ORDER_TAKEOFF, Trigger.ORDER_MISSION})  # orders that take off
# Modes in which another order for them may ask for something else.
_ANEW = frozenset({Mode.HOLD, Mode.TAKEOFF, Mode.MISSION, Mode.LAND, Mode.ORBIT})
# Modes with a speed of their own, which is not to be changed.
_PACED = frozenset({Mode.TAKEOFF, Mode.LAND, Mode.ORBIT, Mode.TERMINATED}) | PILOTED

Goal: TypeAlias = tuple[Triple, float]


def _goal(place_ned_m: Iterable[float] | None, yaw_rad: float, down_m: float = math.nan) -> Goal:
    """What an order asks for: a place (m, NED) and a heading (rad); NaN is left open."""
    north, east, down = (math.nan, math.nan, down_m) if place_ned_m is None else place_ned_m
    # Goals are compared, and NaN is equal only as the same object.
    return (float(north), float(east), float(down)), math.nan if math.isnan(yaw_rad) else yaw_rad


class Flight:
    """Mode and manoeuvre of one aircraft.

    Orders return None when they are carried out, or the reason why not. An order for what is
    already being done changes nothing, so that a repeated command repeats nothing.
    """

    def __init__(
        self, aircraft: Aircraft, parameters: Parameters, *, guard: Guard, reporter: Reporter
    ) -> None:
        self.mode = Mode.HOLD
        self.rally: tuple[MissionItem, ...] = ()
        self.flights = 0  # how often the motors were released
        self.armed_t_ns = self.took_off_t_ns = self.landed_t_ns = 0  # when last; 0: not since armed
        # What modes need; each pilot adds what its own mode does.
        self.needs: dict[Need, Callable[[], bool]] = {
            Need.ARMED: lambda: aircraft.armed,
            Need.ON_GROUND: lambda: aircraft.on_ground,
            Need.AIRBORNE: lambda: not aircraft.on_ground,
            Need.MISSION: lambda: bool(self.mission.items),
            Need.POSITION: guard.position_ok,
        }
        self.frame = aircraft.frame
        self.guard = guard
        self.navigator = Navigator(aircraft, parameters, guard)
        self.mission = Mission()
        self._aircraft = aircraft
        self._parameters = parameters
        self._report = reporter
        self._ordered_speed_mps: float | None = None
        # What the order under way asks for: place (m, NED) and heading (rad; NaN: as it is).
        self._goal: Goal | None = None
        self._ended_by: int | None = None  # the command of the mission's last stage
        # The order of a mode that was chosen before arming, to be given when the motors turn.
        self._chosen: Callable[[], str | None] | None = None
        self._manoeuvre: do.Manoeuvre | None = do.settle(aircraft)
        self._settling = True
        self._released = False  # the motors, by an order; a crash stops them without one
        self._wrecked = False

    # --- what is going on -----------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """Whether something is being done that needs simulated time."""
        return self._manoeuvre is not None

    @property
    def patient(self) -> bool:
        """Whether `tick` may be skipped until the progress along a path changes."""
        return self._manoeuvre is None or self._manoeuvre.patient

    @property
    def airborne(self) -> bool:
        """Whether the aircraft is in the air with its motors armed."""
        return self._aircraft.armed and not self._aircraft.on_ground

    @property
    def bound(self) -> bool:
        """Whether it is on its way to a place at which it was ordered to land."""
        return self.mode is Mode.LAND and self._goal is not None

    @property
    def _on_mission(self) -> bool:
        """Whether the mission has begun, and the mode is still its own."""
        return self.mode is Mode.MISSION and self._chosen is None

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

    def not_ready(self) -> str:
        """Why the aircraft cannot be armed; empty if it can."""
        if not self._aircraft.ready:
            return self._aircraft.why_not_ready
        if self.mode is Mode.TERMINATED:
            return "flight was terminated"
        if self._settling:
            return _STARTING
        if not self._aircraft.armed:
            for need in NEEDS_TO_ARM[self.mode]:
                if not self.needs[need]():
                    return f"in mode {self.mode.name}: {need.value}"
        return self.guard.arming_denied()

    def here(self) -> Vector:
        """Return where new paths begin, (3,) NED: the point held, or the estimated position."""
        return self.navigator.here(resting=not self.moving)

    def not_at_rest(self) -> str:
        """Why the aircraft cannot be switched off; empty if it can. A wreck can."""
        if self._aircraft.armed:
            return "armed"
        return "" if self._aircraft.on_ground else "in the air"

    def tick(self) -> bool:
        """Advance the manoeuvre after a step of the aircraft; return whether one is under way."""
        manoeuvre = self._manoeuvre
        if manoeuvre is None:
            return False
        try:
            if not manoeuvre.tick():
                return True
            self._finished()
        except do.StuckError as stuck:
            self._stuck(str(stuck))
        except Exception as error:
            self._report.internal_error("flying", error)
            self._give_up()
        return self._manoeuvre is not None

    def _stuck(self, why: str) -> None:
        """Handle a manoeuvre that is stuck: land, or terminate if the landing itself is stuck."""
        if self.notice_crash():
            return
        self._manoeuvre = None
        self._report.failsafe(f"{why[0].upper()}{why[1:]}")
        if not self.airborne:
            self._stop_motors()
            self._enter(Mode.HOLD, why, None)
        elif self.mode is Mode.LAND or self.land(why) is not None:
            self.terminate(why)

    def _give_up(self) -> None:
        """Handle an internal error of the manoeuvre: hold, or stay on the ground."""
        self._manoeuvre = None
        self._settling = False
        if self.airborne and self.mode is not Mode.TERMINATED:
            self._enter(Mode.HOLD, "internal error", self.navigator.stop())

    # --- orders ---------------------------------------------------------------------------------

    def choose(self, mode: Mode, order: Callable[[], str | None]) -> str | None:
        """Give an order that leads to a mode; before arming show the mode, and order it then."""
        if self._aircraft.armed or self._settling or self.mode is Mode.TERMINATED:
            return order()
        self._aircraft.idle()
        self._enter(mode, "chosen before arming", None)
        self._chosen = order
        return None

    def arm(self, begin: Callable[[], str | None] | None = None) -> str | None:
        """Arm: let the motors turn, and `begin` an order, or what was chosen before."""
        if self._aircraft.armed:
            return None
        if reason := self.not_ready():
            return reason
        begin = begin or self._chosen
        self._aircraft.arm()
        if begin is not None and (refused := begin()):
            self._aircraft.disarm()
            return refused
        self._chosen = None
        self._aircraft.happened("arming")
        self._released = True
        self.flights += 1
        self.armed_t_ns = self._aircraft.t_ns
        self.took_off_t_ns = self.landed_t_ns = 0
        self._report.armed(True)
        return None

    def disarm(self, *, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, which ends the flight."""
        if not self._aircraft.armed:
            return None
        if not self._aircraft.on_ground:
            return self.terminate("forced disarming in the air") if force else "in the air"
        self._stop_motors()
        if self.mode is not Mode.TERMINATED:
            self._enter(Mode.HOLD, "disarmed", None)
        return None

    def terminate(self, why: str = "termination ordered") -> str | None:
        """Stop the motors wherever the aircraft is."""
        self._settling = False
        self._stop_motors()
        self._enter(Mode.TERMINATED, why, do.fall(self._aircraft))
        return None

    def notice_crash(self) -> bool:
        """Return whether the aircraft has crashed; the first time, report it and terminate."""
        impact_mps = self._aircraft.impact_mps
        if impact_mps is not None and not self._wrecked:
            self._wrecked = True
            said = f"Crashed: hit {self._aircraft.hit} at {impact_mps:.1f} m/s"
            self._report.say(said, mav.MAV_SEVERITY_CRITICAL)
            self._settling = False
            self._stop_motors()
            self._enter(Mode.TERMINATED, "crashed", None)
        return self._wrecked

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

    # --- transitions ----------------------------------------------------------------------------

    def order(
        self,
        trigger: Trigger,
        make: Callable[[], do.Manoeuvre],
        why: str | None = None,
        *,
        goal: Goal | None = None,
    ) -> str | None:
        """Begin the manoeuvre that `make` makes, if the mode and its needs allow it."""
        if self._settling:
            return _STARTING
        target, needs = ORDERS[trigger]
        if target is self.mode and target not in _ANEW and self._chosen is None:
            return None
        if not possible(self.mode, trigger):
            return f"not possible in mode {self.mode.name}"
        for need in needs:
            if not self.needs[need]():
                return need.value
        lifts = trigger in _LIFTS and not self.airborne
        if lifts and (denied := self.guard.arming_denied()):
            return denied  # what keeps it from being armed may have come since it was
        if target is Mode.HOLD and not self.airborne:
            self._aircraft.idle()
            self._enter(target, why or trigger.value, None)
        else:
            self._enter(target, why or trigger.value, make())
            self._goal = goal
        return None

    def _enter(self, mode: Mode, why: str, manoeuvre: do.Manoeuvre | None) -> None:
        self._manoeuvre = manoeuvre
        self._goal = self._chosen = None
        self._report.nudge(mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        if mode is not self.mode:
            self.mode = mode
            self._ordered_speed_mps = None
            self._report.mode(mode, why)

    def _finished(self) -> None:
        if self.notice_crash():
            return
        self._manoeuvre = None
        if self._settling:
            self._settling = False
            if self._aircraft.ready:
                self._report.say("Ready for takeoff", mav.MAV_SEVERITY_INFO)
            else:
                why = self._aircraft.why_not_ready
                self._report.say(f"Not ready: {why}", mav.MAV_SEVERITY_ERROR)
        elif self.mode is Mode.MISSION:
            self._mission_ended()
        elif self.mode is Mode.RETURN:
            self._enter(Mode.LAND, "manoeuvre finished, landing follows", self._land())
        elif self.mode is Mode.LAND or self.mode in PILOTED:
            self._landed()
        else:
            self._done()

    def _done(self) -> None:
        mode = self.mode if self.mode is Mode.TERMINATED else Mode.HOLD
        self._enter(mode, "manoeuvre finished", None)

    def _mission_ended(self) -> None:
        last = self._ended_by
        if last == mav.MAV_CMD_NAV_LOITER_UNLIM or self.mission.waiting:
            return  # stays in the mission, at an item without end
        self.mission.finish()
        self._report.nudge(mav.MAVLINK_MSG_ID_MISSION_CURRENT)
        if last == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH and self.return_home("mission") is None:
            return
        if last == mav.MAV_CMD_NAV_LAND:
            self._landed()
        else:
            self._done()

    def _landed(self) -> None:
        above_m = float(self.guard.home_ned_m[2] - self._aircraft.belief.pos_ned_m[2])
        by_itself = self.mode not in PILOTED and self.guard.position_ok()
        if by_itself and above_m > self._parameters["MPC_LAND_ALT2"]:
            why = "landings slow down near home's height"
            self._report.say(f"Touched down {above_m:.0f} m above home: {why}")
        self._stop_motors()
        self._done()

    def _stop_motors(self) -> None:
        if self._released:
            self._released = False
            self._aircraft.disarm()
            self._report.armed(False)

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
        self._aircraft.happened(seq)
        self.mission.reached(seq)
        self._report.reached(seq, place=item.command in NAVIGATION)
