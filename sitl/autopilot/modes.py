"""Flight modes, and which order leads to which: one table.

The numbers are PX4's (main and sub mode), because ground stations know them.
"""

from collections.abc import Mapping
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
    by_number = {4 << 16: Mode.MISSION} | {mode.custom_mode: mode for mode in Mode}
    return by_number.get(custom_mode)


class Trigger(Enum):
    """An order that leads to a mode; the value is the reason reported with the change."""

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

# The mode that an order leads to, and what it needs.
ORDERS: Mapping[Trigger, tuple[Mode, tuple[Need, ...]]] = {
    Trigger.ORDER_TAKEOFF: (Mode.TAKEOFF, (Need.ARMED, Need.ON_GROUND, Need.POSITION)),
    Trigger.ORDER_MISSION: (Mode.MISSION, (Need.ARMED, Need.MISSION, Need.POSITION)),
    Trigger.ORDER_HOLD: (Mode.HOLD, ()),
    Trigger.ORDER_GOTO: (Mode.HOLD, (*_IN_AIR, Need.POSITION)),
    Trigger.ORDER_RETURN: (Mode.RETURN, (*_IN_AIR, Need.POSITION)),
    Trigger.ORDER_LAND: (Mode.LAND, _IN_AIR),
    Trigger.ORDER_OFFBOARD: (Mode.OFFBOARD, (Need.SETPOINTS,)),
    Trigger.ORDER_POSITION: (Mode.POSITION, (Need.STICKS, Need.POSITION)),
    Trigger.ORDER_ALTITUDE: (Mode.ALTITUDE, (Need.STICKS,)),
    Trigger.ORDER_STABILIZED: (Mode.STABILIZED, (Need.STICKS,)),
    Trigger.ORDER_MANUAL: (Mode.MANUAL, (Need.STICKS,)),
    Trigger.ORDER_ORBIT: (Mode.ORBIT, (*_IN_AIR, Need.POSITION)),
    Trigger.ORDER_FOLLOW: (Mode.FOLLOW, (*_IN_AIR, Need.POSITION)),
}
# What a mode that was chosen before needs when the motors are released. As with PX4, any may be
# chosen, and those of the air keep the vehicle from being armed.
NEEDS_TO_ARM: Mapping[Mode, tuple[Need, ...]] = {
    mode: tuple(need for need in needs if need is not Need.ARMED)
    for trigger, (mode, needs) in ORDERS.items()
    if trigger is not Trigger.ORDER_GOTO
}


def possible(mode: Mode, trigger: Trigger) -> bool:
    """Whether an order can be given in a mode at all, whatever it needs."""
    if trigger is Trigger.ORDER_TAKEOFF:
        return mode in PILOTED | {Mode.HOLD, Mode.TAKEOFF}
    return mode is not Mode.TERMINATED
