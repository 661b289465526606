"""How autopilots differ in what they take for a mission. Plain values; modes by MAVSDK's names."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Dialect:
    """One family of autopilots."""

    name: str
    home_first: bool  # item 0 of a mission is the home position
    finite: bool  # parameters may not be NaN
    keeps_radius: bool  # a downloaded waypoint still has its acceptance radius
    resting: frozenset[str]  # modes in which the vehicle holds its position


# The simulated vehicle speaks it too.
PX4 = Dialect(
    name="PX4", home_first=False, finite=False, keeps_radius=True, resting=frozenset({"HOLD"})
)
# Guided mode (MAVSDK: OFFBOARD) holds after a take-off, AUTO (MISSION) after a mission's end.
ARDUPILOT = Dialect(
    name="ArduPilot",
    home_first=True,
    finite=True,
    keeps_radius=False,
    resting=frozenset({"HOLD", "OFFBOARD", "MISSION"}),
)
