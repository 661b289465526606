"""Failsafes: what the vehicle does by itself when something is wrong. One table."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum

from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.guard import CRITICAL, EMERGENCY, LOW, Guard
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.reporter import Reporter


class Action(IntEnum):
    """A failsafe action; a greater one overrides a smaller one."""

    NOTHING = 0
    WARN = 1
    STABILIZED = 2
    ALTITUDE = 3
    POSITION = 4
    HOLD = 5
    RETURN = 6
    LAND = 7
    TERMINATE = 8


# Somebody at the sticks takes over.
BY_STICKS = {
    Action.STABILIZED: Mode.STABILIZED,
    Action.ALTITUDE: Mode.ALTITUDE,
    Action.POSITION: Mode.POSITION,
}


class Cause(Enum):
    """What a failsafe reacts to; the value is its wording in status texts."""

    FENCE_BREACHED = "Fence breached"
    BATTERY_LOW = "Battery low"
    BATTERY_CRITICAL = "Battery critical"
    BATTERY_EMERGENCY = "Battery almost empty"
    GNSS_LOST = "GNSS lost"
    GROUND_STATION_LOST = "Ground station lost"
    SETPOINTS_LOST = "Offboard setpoints lost"
    STICKS_LOST = "Manual control lost"


@dataclass(frozen=True, slots=True)
class Rule:
    """A failsafe rule: the parameter that selects the action, and the action for each value."""

    parameter: str
    actions: tuple[Action, ...]


def _rule(parameter: str, actions: str) -> Rule:
    return Rule(parameter, tuple(Action[name.upper()] for name in actions.split()))


RULES: Mapping[Cause, Rule] = {
    Cause.FENCE_BREACHED: _rule("GF_ACTION", "nothing warn hold return terminate land"),
    Cause.BATTERY_LOW: _rule("COM_LOW_BAT_ACT", "warn warn warn warn"),
    Cause.BATTERY_CRITICAL: _rule("COM_LOW_BAT_ACT", "warn warn land return"),
    Cause.BATTERY_EMERGENCY: _rule("COM_LOW_BAT_ACT", "warn warn land land"),
    # No return: it would be flown by the very position that is in doubt.
    Cause.GNSS_LOST: _rule("COM_POSLOSS_ACT", "nothing warn hold land terminate"),
    Cause.GROUND_STATION_LOST: _rule("NAV_DLL_ACT", "nothing hold return land warn terminate"),
    Cause.SETPOINTS_LOST: _rule(
        "COM_OBL_RC_ACT", "position altitude stabilized return land hold terminate terminate"
    ),
    Cause.STICKS_LOST: _rule("NAV_RCL_ACT", "nothing hold return land warn terminate terminate"),
}
# What the vehicle is doing already, in terms of actions.
_UNDER_WAY = {Mode.RETURN: Action.RETURN, Mode.LAND: Action.LAND, Mode.TERMINATED: Action.TERMINATE}


_CHARGE = {
    Cause.BATTERY_LOW: LOW,
    Cause.BATTERY_CRITICAL: CRITICAL,
    Cause.BATTERY_EMERGENCY: EMERGENCY,
}


@dataclass
class Failsafes:
    """Looks for causes on board (`watch`) and for a silent ground station (`poll`), and acts.

    It acts once, when a cause appears; a pilot may override that afterwards. A cause that appears
    on the ground is reported there, and acted on as soon as the aircraft flies.
    """

    aircraft: Aircraft
    flight: Flight
    parameters: Parameters
    guard: Guard
    by_sticks: Callable[[Mode, str], str | None]  # gives them the flight; the reason if not
    report: Reporter
    ground_station_heard_s: float = math.nan  # when the last heartbeat from one came
    _present: set[Cause] = field(default_factory=set)
    _acted: dict[Cause, int] = field(default_factory=dict)  # in which flight each was acted on

    def watch(self) -> None:
        """Look for causes that show in simulated time: battery, GNSS, fence."""
        guard, charge = self.guard, self.aircraft.battery.remaining
        below = guard.look_at_charge()
        for cause, threshold in _CHARGE.items():
            self.update(cause, below[threshold], lambda: f"{charge * 100:.0f} % left")
        age_s = guard.gnss_age_s()
        lost = age_s < math.inf and not guard.position_ok()
        self.update(Cause.GNSS_LOST, lost, lambda: f"no solution for {age_s:.0f} s")
        breach = ""
        if self.flight.airborne:
            breach = guard.forbidden(self.aircraft.belief.pos_ned_m)
        self.update(Cause.FENCE_BREACHED, bool(breach), lambda: breach)

    def poll(self, now: float) -> None:
        """Look for a ground station that has fallen silent by `now` (s)."""
        silence_s = now - self.ground_station_heard_s
        if not math.isnan(silence_s):
            lost = silence_s > self.parameters["COM_DL_LOSS_T"]
            words = f"silent for {silence_s:.0f} s"
            self.update(Cause.GROUND_STATION_LOST, lost, lambda: words)

    def present(self, cause: Cause) -> bool:
        """Whether a cause holds at the moment."""
        return bool(self._present) and cause in self._present

    def acted(self, cause: Cause) -> bool:
        """Whether a cause is there and was acted on in this flight."""
        return self._acted.get(cause) == self.flight.flights

    @property
    def acting(self) -> bool:
        """Whether a cause is there that asks for more than a warning."""
        return any(self._action(cause) > Action.WARN for cause in self._present)

    def update(self, cause: Cause, present: bool, detail: Callable[[], str] = str) -> None:
        """Set whether a cause is present, act on a new one, and report that with `detail`."""
        if not (present or self._present):
            return
        was = cause in self._present
        if not present:
            if was:
                self._present.discard(cause)
                self._acted.pop(cause, None)
                if self._action(cause) is not Action.NOTHING:
                    self.report.say(f"{cause.value}: over", mav.MAV_SEVERITY_NOTICE)
            return
        airborne = self.flight.airborne
        if was and (not airborne or self.acted(cause)):
            return
        self._present.add(cause)
        if airborne:
            self._acted[cause] = self.flight.flights
        if not was or self._action(cause) > Action.WARN:
            words = detail()
            self._act(self._action(cause), f"{cause.value}: {words}" if words else cause.value)

    def _action(self, cause: Cause) -> Action:
        rule = RULES[cause]
        return rule.actions[int(self.parameters[rule.parameter])]

    def _act(self, action: Action, why: str) -> None:
        if action is Action.NOTHING:
            return
        flight = self.flight
        under_way = Action.HOLD if flight.bound else _UNDER_WAY.get(flight.mode, Action.WARN)
        stronger = action > under_way
        if action is Action.WARN or not flight.airborne or not stronger:
            self.report.failsafe(why)
            return
        self.report.failsafe(f"{why}, {action.name.lower()}")
        refused = self._carry_out(action, why)
        while refused is not None and action not in (Action.LAND, Action.TERMINATE):
            # Sticks may be silent; returning needs a position; sinking where it is needs neither.
            instead = Action.RETURN if action in BY_STICKS else Action.LAND
            self.report.failsafe(
                f"{action.name.lower()} not possible ({refused}), {instead.name.lower()}"
            )
            action = instead
            refused = self._carry_out(action, why)

    def _carry_out(self, action: Action, why: str) -> str | None:
        match action:
            case _ if action in BY_STICKS:
                return self.by_sticks(BY_STICKS[action], why)
            case Action.HOLD:
                return self.flight.hold(why)
            case Action.RETURN:
                return self.flight.return_home(why)
            case Action.LAND:
                return self.flight.land(why)
            case _:
                return self.flight.terminate(why)
