"""Names of MAVLink's numbers, for people."""

from pymavlink.dialects.v20 import common as mav


def command_name(number: int) -> str:
    """`DO_SET_SERVO (183)` for 183; a number that MAVLink does not know stays a number."""
    entry = mav.enums["MAV_CMD"].get(number)
    name = "unknown command" if entry is None else entry.name.removeprefix("MAV_CMD_")
    return f"{name} ({number})"
