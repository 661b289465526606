"""Flight modes, and what leads from one to another: one table.

The numbers are PX4's (main and sub mode), because ground stations know them.
"""

from dataclasses import dataclass
from enum import Enum


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


def mode_of_custom(custom_mode: int) -> Mode | None:
    """The mode that a ground station means, or None where the vehicle has no such mode."""
    by_number = {mode.custom_mode: mode for mode in Mode}
    return by_number.get(custom_mode)


class Trigger(Enum):
    """What can change the mode: orders from outside and ends of manoeuvres."""

    ORDER_TAKEOFF = "take-off ordered"
    ORDER_MISSION = "mission ordered"
    ORDER_HOLD = "hold ordered"
    ORDER_GOTO = "position ordered"
    ORDER_RETURN = "return ordered"
    ORDER_LAND = "landing ordered"
    ORDER_OFFBOARD = "offboard control ordered"
    ORDER_POSITION = "position control ordered"
    ORDER_ALTITUDE = "altitude control ordered"
    ORDER_STABILIZED = "stabilized flight ordered"
    ORDER_MANUAL = "manual control ordered"
    ORDER_ORBIT = "orbit ordered"
    ORDER_FOLLOW = "following ordered"
    ORDER_TERMINATE = "termination ordered"
    DONE = "manoeuvre finished"
    DONE_LAND_NEXT = "manoeuvre finished, landing follows"


class Need(Enum):
    """What must be true before a transition; the value is said when it is not."""

    ARMED = "not armed"
    ON_GROUND = "already in the air"
    AIRBORNE = "on the ground"
    MISSION = "no mission uploaded"
    POSITION = "no position estimate"
    SETPOINTS = "no setpoints are streamed, or no position estimate for them"
    STICKS = "no manual control input"


@dataclass(frozen=True, slots=True)
class Transition:
    """From one of `sources` on `trigger`, if all `needs` hold, to `target`."""

    trigger: Trigger
    sources: frozenset[Mode]
    target: Mode
    needs: tuple[Need, ...] = ()


# Flown by somebody outside, who may land; what lands has landed for good.
PILOTED = frozenset(
    {Mode.OFFBOARD, Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZED, Mode.MANUAL, Mode.FOLLOW}
)
_FLYING = PILOTED | {Mode.HOLD, Mode.TAKEOFF, Mode.MISSION, Mode.RETURN, Mode.LAND, Mode.ORBIT}
_IN_AIR = (Need.ARMED, Need.AIRBORNE)

TRANSITIONS: tuple[Transition, ...] = (
    Transition(
        Trigger.ORDER_TAKEOFF,
        PILOTED | {Mode.HOLD, Mode.TAKEOFF},
        Mode.TAKEOFF,
        (Need.ARMED, Need.ON_GROUND, Need.POSITION),
    ),
    Transition(
        Trigger.ORDER_MISSION, _FLYING, Mode.MISSION, (Need.ARMED, Need.MISSION, Need.POSITION)
    ),
    Transition(Trigger.ORDER_HOLD, _FLYING, Mode.HOLD),
    Transition(Trigger.ORDER_GOTO, _FLYING, Mode.HOLD, (*_IN_AIR, Need.POSITION)),
    Transition(Trigger.ORDER_RETURN, _FLYING, Mode.RETURN, (*_IN_AIR, Need.POSITION)),
    Transition(Trigger.ORDER_LAND, _FLYING, Mode.LAND, _IN_AIR),
    Transition(Trigger.ORDER_OFFBOARD, _FLYING, Mode.OFFBOARD, (Need.SETPOINTS,)),
    Transition(Trigger.ORDER_POSITION, _FLYING, Mode.POSITION, (Need.STICKS, Need.POSITION)),
    Transition(Trigger.ORDER_ALTITUDE, _FLYING, Mode.ALTITUDE, (Need.STICKS,)),
    Transition(Trigger.ORDER_STABILIZED, _FLYING, Mode.STABILIZED, (Need.STICKS,)),
    Transition(Trigger.ORDER_MANUAL, _FLYING, Mode.MANUAL, (Need.STICKS,)),
    Transition(Trigger.ORDER_ORBIT, _FLYING, Mode.ORBIT, (*_IN_AIR, Need.POSITION)),
    Transition(Trigger.ORDER_FOLLOW, _FLYING, Mode.FOLLOW, (*_IN_AIR, Need.POSITION)),
    Transition(Trigger.ORDER_TERMINATE, frozenset(Mode), Mode.TERMINATED),
    Transition(Trigger.DONE, _FLYING, Mode.HOLD),
    Transition(Trigger.DONE, frozenset({Mode.TERMINATED}), Mode.TERMINATED),
    Transition(Trigger.DONE_LAND_NEXT, _FLYING, Mode.LAND),
)

_BY_SOURCE = {(t.trigger, source): t for t in TRANSITIONS for source in t.sources}


def transition(mode: Mode, trigger: Trigger) -> Transition | None:
    """The row of the table for this mode and trigger; None where there is none."""
    return _BY_SOURCE.get((trigger, mode))
