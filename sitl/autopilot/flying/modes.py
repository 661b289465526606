"""The state machine of a flight: its modes, and everything that leads from one to another.

A flight is always in one mode, with at most one manoeuvre under way. HOLD without a manoeuvre is
rest; TERMINATED is never left. Until the estimator is ready the vehicle starts up: it stands in
HOLD, and refuses every order. A mode that is chosen before the motors turn is shown at once, and
its order is given when they do. Three kinds of things move the machine, and nothing else does:

1. An **order**: of a ground station, a failsafe, a pilot at the sticks, or a mission's last item.
   `Trigger` says to which mode it leads and what it needs, `possible` in which modes it can be
   given. Whoever orders brings the manoeuvre: `ModeMachine.order`.
2. The **end** of a manoeuvre. `AFTER` says what comes next in each mode, `AFTER_MISSION` what a
   mission's last item asks for.
3. A **mishap**:

   =====================================  =========================================================
   no progress, on the ground             motors stop, HOLD
   no progress, in the air                LAND; TERMINATED, if that is what makes no progress
   an internal error, in the air          HOLD, braking at once; on the ground: nothing is done
   the aircraft has hit something         motors stop, TERMINATED
   disarmed, on the ground                motors stop, HOLD (or TERMINATED, if it was)
   disarmed by force in the air           motors stop, TERMINATED
   =====================================  =========================================================

The numbers of modes are PX4's, because ground stations know them.
"""

from collections.abc import Callable, Mapping
from enum import Enum
from typing import NamedTuple, TypeAlias

from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.frames import Triple
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.mission import Mission
from sitl.autopilot.flying.navigator import Navigator
from sitl.autopilot.guard import Guard
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.reporter import Reporter

Goal: TypeAlias = tuple[Triple, float]  # a place (m, NED) and a heading (rad); NaN is left open


class Mode(Enum):
    """A flight mode with its PX4 main and sub mode."""

    MANUAL = (1, 0)
    ALTITUDE = (2, 0)
    POSITION = (3, 0)
    ORBIT = (3, 1)
    HOLD = (4, 3)
    TAKEOFF = (4, 2)
    MISSION = (4, 4)
    RETURN = (4, 5)
    LAND = (4, 6)
    FOLLOW = (4, 8)
    TERMINATED = (4, 12)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of the mode."""
        main, sub = self.value
        return main << 16 | sub << 24


class Need(Enum):
    """A precondition of an order; the value is the reason given if it is not met."""

    ARMED = "not armed"
    ON_GROUND = "already in the air"
    AIRBORNE = "on the ground"
    MISSION = "no mission uploaded"
    POSITION = "no position estimate"
    SETPOINTS = "no setpoints are streamed, or no position estimate for them"
    STICKS = "no manual control input"


# Flown by somebody outside, who may land; what lands has landed for good.
PILOTED = frozenset(
    {Mode.OFFBOARD, Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZED, Mode.MANUAL, Mode.FOLLOW}
)
_IN_AIR = (Need.ARMED, Need.AIRBORNE)


class Trigger(Enum):
    """An order: the reason reported with the change, the mode that it leads to, and its needs."""

    ORDER_TAKEOFF = "take-off ordered", Mode.TAKEOFF, (Need.ARMED, Need.ON_GROUND, Need.POSITION)
    ORDER_MISSION = "mission ordered", Mode.MISSION, (Need.ARMED, Need.MISSION, Need.POSITION)
    ORDER_HOLD = "hold ordered", Mode.HOLD, ()
    ORDER_GOTO = "position ordered", Mode.HOLD, (*_IN_AIR, Need.POSITION)
    ORDER_RETURN = "return ordered", Mode.RETURN, (*_IN_AIR, Need.POSITION)
    ORDER_LAND = "landing ordered", Mode.LAND, _IN_AIR
    ORDER_OFFBOARD = "offboard control ordered", Mode.OFFBOARD, (Need.SETPOINTS,)
    ORDER_POSITION = "position control ordered", Mode.POSITION, (Need.STICKS, Need.POSITION)
    ORDER_ALTITUDE = "altitude control ordered", Mode.ALTITUDE, (Need.STICKS,)
    ORDER_STABILIZED = "stabilized flight ordered", Mode.STABILIZED, (Need.STICKS,)
    ORDER_MANUAL = "manual control ordered", Mode.MANUAL, (Need.STICKS,)
    ORDER_ORBIT = "orbit ordered", Mode.ORBIT, (*_IN_AIR, Need.POSITION)
    ORDER_FOLLOW = "following ordered", Mode.FOLLOW, (*_IN_AIR, Need.POSITION)

    def __init__(self, why: str, mode: Mode, needs: tuple[Need, ...]) -> None:
        self.why, self.mode, self.needs = why, mode, needs


def possible(mode: Mode, trigger: Trigger) -> bool:
    """Whether an order can be given in a mode at all, whatever it needs."""
    if trigger is Trigger.ORDER_TAKEOFF:
        return mode in PILOTED | {Mode.HOLD, Mode.TAKEOFF}
    return mode is not Mode.TERMINATED


class After(NamedTuple):
    """What follows the end of a manoeuvre."""

    mode: Mode
    landed: bool = False  # for good: the motors stop
    why: str = "manoeuvre finished"


_REST, _LANDED = After(Mode.HOLD), After(Mode.HOLD, landed=True)
AFTER: Mapping[Mode, After] = {
    **dict.fromkeys((Mode.HOLD, Mode.TAKEOFF, Mode.ORBIT), _REST),
    **dict.fromkeys((Mode.LAND, *PILOTED), _LANDED),
    Mode.RETURN: After(Mode.LAND, why="manoeuvre finished, landing follows"),
    Mode.TERMINATED: After(Mode.TERMINATED),
}
# By the command of a mission's last item; after any other, and a return that is not possible, it
# rests. At an item without end or without autocontinue the mission goes on, and waits there.
AFTER_MISSION: Mapping[int | None, After] = {
    mav.MAV_CMD_NAV_LOITER_UNLIM: After(Mode.MISSION),
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: After(Mode.RETURN, why="mission"),
    mav.MAV_CMD_NAV_LAND: _LANDED,
}
_STARTING = "starting up"
_LIFTS = frozenset({Trigger.ORDER_TAKEOFF, Trigger.ORDER_MISSION})  # orders that take off
# Modes in which another order for them may ask for something else.
_ANEW = frozenset({Mode.HOLD, Mode.TAKEOFF, Mode.MISSION, Mode.LAND, Mode.ORBIT})


class ModeMachine:
    """Mode, manoeuvre and mission of one aircraft, and the transitions between modes.

    Orders return None when they are carried out, or the reason why not.
    """

    def __init__(
        self, aircraft: Aircraft, parameters: Parameters, *, guard: Guard, reporter: Reporter
    ) -> None:
        self.mode = Mode.HOLD
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
        # How to land or return from where it is, where that follows by itself.
        self._makes: dict[Mode, Callable[[], do.Manoeuvre]] = {}
        self._manoeuvre: do.Manoeuvre | None = do.settle(aircraft)
        self._settling = True
        self._released = False  # the motors, by an order; a crash stops them without one
        self._wrecked = False

    @property
    def moving(self) -> bool:
        """Whether something is being done that needs simulated time."""
        return self._manoeuvre is not None

    @property
    def airborne(self) -> bool:
        """Whether the aircraft is in the air with its motors armed."""
        return self._aircraft.armed and not self._aircraft.on_ground

    @property
    def _on_mission(self) -> bool:
        """Whether the mission has begun, and the mode is still its own."""
        return self.mode is Mode.MISSION and self._chosen is None

    def not_ready(self) -> str:
        """Why the aircraft cannot be armed; empty if it can."""
        if not self._aircraft.ready:
            return self._aircraft.why_not_ready
        if self.mode is Mode.TERMINATED:
            return "flight was terminated"
        if self._settling:
            return _STARTING
        if not self._aircraft.armed:
            # As with PX4, any mode may be chosen; those of the air keep it from being armed.
            order = next(one for one in Trigger if one.mode is self.mode)
            for need in order.needs:
                if need is not Need.ARMED and not self.needs[need]():
                    return f"in mode {self.mode.name}: {need.value}"
        return self.guard.arming_denied()

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
        self._aircraft.faults.happened("arming")
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
        target = trigger.mode
        if target is self.mode and target not in _ANEW and self._chosen is None:
            return None
        if not possible(self.mode, trigger):
            return f"not possible in mode {self.mode.name}"
        for need in trigger.needs:
            if not self.needs[need]():
                return need.value
        lifts = trigger in _LIFTS and not self.airborne
        if lifts and (denied := self.guard.arming_denied()):
            return denied  # what keeps it from being armed may have come since it was
        if target is Mode.HOLD and not self.airborne:
            self._aircraft.idle()
            self._enter(target, why or trigger.why, None)
        else:
            self._enter(target, why or trigger.why, make())
            self._goal = goal
        return None

    def _by_itself(self, trigger: Trigger, why: str) -> str | None:
        return self.order(trigger, self._makes[trigger.mode], why)

    def _enter(self, mode: Mode, why: str, manoeuvre: do.Manoeuvre | None) -> None:
        self._manoeuvre = manoeuvre
        self._goal = self._chosen = None
        self._report.nudge(mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        if mode is not self.mode:
            self.mode = mode
            self._ordered_speed_mps = None
            self._report.mode(mode.name, why)

    # --- ends and mishaps -----------------------------------------------------------------------

    def tick(self) -> bool:
        """Advance the manoeuvre after a step of the aircraft; return whether one is under way."""
        manoeuvre = self._manoeuvre
        if manoeuvre is None:
            return False
        try:
            if not manoeuvre.tick():
                return True
            self._manoeuvre_ended()
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
        elif self.mode is Mode.LAND or self._by_itself(Trigger.ORDER_LAND, why) is not None:
            self.terminate(why)

    def _give_up(self) -> None:
        """Handle an internal error of the manoeuvre: hold, or stay on the ground."""
        self._manoeuvre = None
        self._settling = False
        if self.airborne and self.mode is not Mode.TERMINATED:
            self._enter(Mode.HOLD, "internal error", self.navigator.stop())

    def _manoeuvre_ended(self) -> None:
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
        else:
            self._go_on(AFTER[self.mode])

    def _mission_ended(self) -> None:
        after = AFTER_MISSION.get(self._ended_by, _REST)
        if after.mode is Mode.MISSION or self.mission.waiting:
            return
        self.mission.finish()
        self._report.nudge(mav.MAVLINK_MSG_ID_MISSION_CURRENT)
        if after.mode is not Mode.RETURN:
            self._go_on(after)
        elif self._by_itself(Trigger.ORDER_RETURN, after.why) is not None:
            self._go_on(_REST)

    def _go_on(self, after: After) -> None:
        if after.landed:
            self._touched_down()
        make = self._makes.get(after.mode)
        self._enter(after.mode, after.why, make and make())

    def _touched_down(self) -> None:
        above_m = float(self.guard.home_ned_m[2] - self._aircraft.belief.pos_ned_m[2])
        by_itself = self.mode not in PILOTED and self.guard.position_ok()
        if by_itself and above_m > self._parameters["MPC_LAND_ALT2"]:
            why = "landings slow down near home's height"
            self._report.say(f"Touched down {above_m:.0f} m above home: {why}")
        self._stop_motors()

    def _stop_motors(self) -> None:
        if self._released:
            self._released = False
            self._aircraft.disarm()
            self._report.armed(False)
