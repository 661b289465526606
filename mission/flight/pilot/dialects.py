"""How autopilots differ in what they take and say (plain values; modes by MAVSDK's names), and
mission items as MAVSDK uploads them to each family, and as they come back."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from pymavlink.dialects.v20 import common as mav

from mission.flight.missions.round_mission import DEG_E7
from mission.flight.pilot.parameters import ARDUPILOT_LIMITS, PX4_LIMITS, LimitNames
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, MissionItem
from sitl.autopilot.protocol.order_rules import LOOKS, PLACES


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


_PLACED = PLACES | LOOKS - {mav.MAV_CMD_DO_SET_ROI_NONE}


def raw_items(items: Sequence[MissionItem]) -> list[RawItem]:
    """Items as MAVSDK uploads them; the first is the one to begin with.

    It takes a field that is left out for NaN, so every one is set.
    """
    return [_to_raw(item) for item in items]


def _to_raw(item: MissionItem) -> RawItem:
    scale = DEG_E7 if item.frame in GLOBAL_FRAMES else 1.0
    placeless = item.mission_type == mav.MAV_MISSION_TYPE_MISSION and item.command not in _PLACED
    return RawItem(
        seq=item.seq,
        frame=mav.MAV_FRAME_MISSION if placeless else item.frame,
        command=item.command,
        current=int(item.seq == 0),
        autocontinue=int(item.autocontinue),
        param1=item.params[0],
        param2=item.params[1],
        param3=item.params[2],
        param4=item.params[3],
        x=0 if math.isnan(item.x) else round(item.x * scale),
        y=0 if math.isnan(item.y) else round(item.y * scale),
        z=0.0 if placeless and math.isnan(item.z) else item.z,
        mission_type=item.mission_type,
    )


def from_raw(item: RawItem, dialect: Dialect) -> MissionItem:
    """Convert a downloaded item; item 0, where it is the home position, gets command 0."""
    scale = DEG_E7 if item.frame in GLOBAL_FRAMES else 1.0
    home = item.seq < dialect.first_item and item.mission_type == 0
    return MissionItem(
        item.seq,
        0 if home else item.command,
        item.frame,
        (item.param1, item.param2, item.param3, item.param4),
        item.x / scale,
        item.y / scale,
        item.z,
        item.mission_type,
        bool(item.autocontinue),
    )


def as_dialect(items: Sequence[RawItem], dialect: Dialect) -> list[RawItem]:
    """Mission items in the form that the family of autopilots `dialect` takes."""
    taken = [copy(item) for item in items]
    if dialect.first_item:
        # The autopilot puts its own home there.
        home = copy(taken[0])
        home.command, home.frame = mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        home.autocontinue = 1
        home.param1 = home.param2 = home.param3 = home.param4 = home.z = 0.0
        taken.insert(0, home)
    if dialect.finite:
        for item in taken:
            params = (item.param1, item.param2, item.param3, item.param4)
            item.param1, item.param2, item.param3, item.param4 = (
                0.0 if math.isnan(param) else param for param in params
            )
    if dialect.whole_holds:
        for item in taken:
            if item.command == mav.MAV_CMD_NAV_WAYPOINT:
                item.param1 = float(math.ceil(item.param1))
    for seq, item in enumerate(taken):
        if item.command == mav.MAV_CMD_DO_JUMP:
            item.param1 += dialect.first_item
        item.seq, item.current = seq, int(seq == dialect.first_item)
    return taken


def same_mission(sent: list[RawItem], back: list[RawItem], dialect: Dialect) -> bool:
    """Whether the items that came back are those sent, as far as the dialect keeps them."""
    first = dialect.first_item
    return _essence(sent[first:], dialect) == _essence(back[first:], dialect)


def _essence(items: list[RawItem], dialect: Dialect) -> list[tuple[int, ...]]:
    """The fields of an item that a download must give back unchanged; heights to 1 cm."""
    return [
        (
            item.seq,
            item.command,
            *((item.x, item.y, round(item.z * 100)) if item.command in _PLACED else ()),
            _thousandths(item.param1) if item.command == mav.MAV_CMD_NAV_WAYPOINT else 0,
            _thousandths(item.param2) if dialect.keeps_radius else 0,
        )
        for item in items
    ]


def _thousandths(param: float) -> int:
    """Return a 32-bit float parameter in thousandths; NaN as 0, for it may come back as 0."""
    return 0 if math.isnan(param) else round(float(np.float32(param)) * 1000)
