"""How autopilots differ in what they take and say. Plain values; modes by MAVSDK's names."""

from dataclasses import dataclass

from mission.flight.pilot.limits import ARDUPILOT_LIMITS, PX4_LIMITS, LimitNames


@dataclass(frozen=True)
class Dialect:
    """How one family of autopilots (PX4, ArduPilot) differs in what it takes and says."""

    name: str
    first_item: int  # number of the first item that we give: 1 where item 0 is the home position
    finite: bool  # parameters may not be NaN
    whole_holds: bool  # a hover lasts whole seconds: of others the rest is cut off
    rewinds: bool  # a changed mission, too, begins at its first item only where that is ordered
    keeps_radius: bool  # a downloaded waypoint still has its acceptance radius
    resting: frozenset[str]  # modes in which the vehicle holds its position
    # To arm in: number and MAVSDK's name of one that none takes without a position. None: any.
    arming_mode: tuple[int, str] | None
    estimator: str  # the message that says what its estimator knows
    estimator_number: int
    limits: LimitNames
    tells_commit: bool  # its version has a commit as bytes; ArduPilot's are letters of one


# The simulated vehicle speaks it too.
PX4 = Dialect(
    name="PX4",
    first_item=0,
    finite=False,
    whole_holds=False,
    rewinds=False,  # and an order is answered by MISSION_CURRENT, which PX4 tells once a second
    keeps_radius=True,
    resting=frozenset({"HOLD"}),
    arming_mode=None,
    estimator="ESTIMATOR_STATUS",
    estimator_number=230,
    limits=PX4_LIMITS,
    tells_commit=True,
)
# Guided mode (MAVSDK: OFFBOARD) holds after a take-off, AUTO (MISSION) after a mission's end.
# In the mode that it starts in, STABILIZE, it arms without a position.
ARDUPILOT = Dialect(
    name="ArduPilot",
    first_item=1,
    finite=True,
    whole_holds=True,
    rewinds=True,
    keeps_radius=False,
    resting=frozenset({"HOLD", "OFFBOARD", "MISSION"}),
    arming_mode=(4, "OFFBOARD"),
    estimator="EKF_STATUS_REPORT",
    estimator_number=193,
    limits=ARDUPILOT_LIMITS,
    tells_commit=False,
)
