"""How autopilots differ in what they take and say. Plain values; modes by MAVSDK's names."""

from dataclasses import dataclass

from mission.flight.pilot.limits import ARDUPILOT_LIMITS, PX4_LIMITS, LimitNames
from mission.flight.pilot.readiness import EKF_STATUS_REPORT, ESTIMATOR_STATUS, EstimatorMessage


@dataclass(frozen=True)
class ArmingMode:
    """A mode that no vehicle takes before it has a position."""

    custom: int  # its custom mode number
    shown: str


@dataclass(frozen=True)
class Dialect:
    """How one family of autopilots (PX4, ArduPilot) differs in what it takes and says."""

    name: str
    home_first: bool  # item 0 of a mission is the home position
    finite: bool  # parameters may not be NaN
    whole_holds: bool  # a hover lasts whole seconds: of others the rest is cut off
    keeps_radius: bool  # a downloaded waypoint still has its acceptance radius
    resting: frozenset[str]  # modes in which the vehicle holds its position
    arming_mode: ArmingMode | None  # to arm in; None: any mode will do
    estimator: EstimatorMessage
    limits: LimitNames
    tells_commit: bool  # its version has a commit as bytes; ArduPilot's are letters of one

    @property
    def first_item(self) -> int:
        """Sequence number of the first item that we give: 1 where item 0 is the home position."""
        return int(self.home_first)


# The simulated vehicle speaks it too.
PX4 = Dialect(
    name="PX4",
    home_first=False,
    finite=False,
    whole_holds=False,
    keeps_radius=True,
    resting=frozenset({"HOLD"}),
    arming_mode=None,
    estimator=ESTIMATOR_STATUS,
    limits=PX4_LIMITS,
    tells_commit=True,
)
# Guided mode (MAVSDK: OFFBOARD) holds after a take-off, AUTO (MISSION) after a mission's end.
# In the mode that it starts in, STABILIZE, it arms without a position.
ARDUPILOT = Dialect(
    name="ArduPilot",
    home_first=True,
    finite=True,
    whole_holds=True,
    keeps_radius=False,
    resting=frozenset({"HOLD", "OFFBOARD", "MISSION"}),
    arming_mode=ArmingMode(4, "OFFBOARD"),
    estimator=EKF_STATUS_REPORT,
    limits=ARDUPILOT_LIMITS,
    tells_commit=False,
)
