"""How autopilots differ in what they take and say. Plain values; modes by MAVSDK's names."""

from dataclasses import dataclass

from mission.pilot.limits import ARDUPILOT_LIMITS, PX4_LIMITS, LimitNames
from mission.pilot.readiness import EKF_STATUS_REPORT, ESTIMATOR_STATUS, EstimatorMessage


@dataclass(frozen=True)
class Dialect:
    """One family of autopilots."""

    name: str
    home_first: bool  # item 0 of a mission is the home position
    finite: bool  # parameters may not be NaN
    keeps_radius: bool  # a downloaded waypoint still has its acceptance radius
    resting: frozenset[str]  # modes in which the vehicle holds its position
    arming_mode: int | None  # custom mode to arm in, which needs a position; None: any does
    estimator: EstimatorMessage
    limits: LimitNames

    @property
    def first_item(self) -> int:
        """The number of a mission's first item of ours."""
        return int(self.home_first)


# The simulated vehicle speaks it too.
PX4 = Dialect(
    name="PX4",
    home_first=False,
    finite=False,
    keeps_radius=True,
    resting=frozenset({"HOLD"}),
    arming_mode=None,
    estimator=ESTIMATOR_STATUS,
    limits=PX4_LIMITS,
)
# Guided mode (MAVSDK: OFFBOARD) holds after a take-off, AUTO (MISSION) after a mission's end.
# In the mode that it starts in, STABILIZE, it arms without a position.
ARDUPILOT = Dialect(
    name="ArduPilot",
    home_first=True,
    finite=True,
    keeps_radius=False,
    resting=frozenset({"HOLD", "OFFBOARD", "MISSION"}),
    arming_mode=4,
    estimator=EKF_STATUS_REPORT,
    limits=ARDUPILOT_LIMITS,
)
