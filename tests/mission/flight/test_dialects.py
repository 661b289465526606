"""Mission items on their way to each family of autopilots, field by field, and back."""

import math

import pytest
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from pymavlink.dialects.v20 import common as mav

from mission.flight.pilot.dialects import (
    ARDUPILOT,
    PX4,
    Dialect,
    as_dialect,
    from_raw,
    raw_items,
    same_mission,
)
from sitl.autopilot.codec.orders import MissionItem

NAN = math.nan
GLOBE, NOWHERE = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mav.MAV_FRAME_MISSION
PLACE = 473977420, 85455940
# What a plan holds: command, frame, parameters, latitude, longitude, height.
ITEMS = [
    (mav.MAV_CMD_NAV_TAKEOFF, GLOBE, (15.0, 0.0, 0.0, NAN), 47.397742, 8.545594, 20.0),
    (mav.MAV_CMD_NAV_WAYPOINT, GLOBE, (2.2, 5.0, 0.0, NAN), 47.397742, 8.545594, 30.0),
    (mav.MAV_CMD_DO_CHANGE_SPEED, GLOBE, (1.0, 8.0, -1.0, NAN), NAN, NAN, NAN),
    (mav.MAV_CMD_NAV_LOITER_TIME, GLOBE, (2.2, 0.0, NAN, 1.0), 47.397742, 8.545594, 30.0),
    (mav.MAV_CMD_DO_JUMP, NOWHERE, (1.0, 3.0, 0.0, 0.0), 0.0, 0.0, 0.0),
]
AS_PX4 = [
    (0, 1, GLOBE, 22, 15.0, 0.0, 0.0, NAN, *PLACE, 20.0),
    (1, 0, GLOBE, 16, 2.2, 5.0, 0.0, NAN, *PLACE, 30.0),
    (2, 0, NOWHERE, 178, 1.0, 8.0, -1.0, NAN, 0, 0, 0.0),
    (3, 0, GLOBE, 19, 2.2, 0.0, NAN, 1.0, *PLACE, 30.0),
    (4, 0, NOWHERE, 177, 1.0, 3.0, 0.0, 0.0, 0, 0, 0.0),
]
# Home comes first and moves every number by one; no NaN; a waypoint holds whole seconds.
AS_ARDUPILOT = [
    (0, 0, GLOBE, 16, 0.0, 0.0, 0.0, 0.0, *PLACE, 0.0),
    (1, 1, GLOBE, 22, 15.0, 0.0, 0.0, 0.0, *PLACE, 20.0),
    (2, 0, GLOBE, 16, 3.0, 5.0, 0.0, 0.0, *PLACE, 30.0),
    (3, 0, NOWHERE, 178, 1.0, 8.0, -1.0, 0.0, 0, 0, 0.0),
    (4, 0, GLOBE, 19, 2.2, 0.0, 0.0, 1.0, *PLACE, 30.0),
    (5, 0, NOWHERE, 177, 2.0, 3.0, 0.0, 0.0, 0, 0, 0.0),
]


def items() -> list[MissionItem]:
    return [MissionItem(seq, *told) for seq, told in enumerate(ITEMS)]


def fields(item: RawItem) -> tuple[float, ...]:
    params = item.param1, item.param2, item.param3, item.param4
    place = item.x, item.y, item.z
    return (item.seq, item.current, item.frame, item.command, *params, *place)


@pytest.mark.parametrize(("dialect", "expected"), [(PX4, AS_PX4), (ARDUPILOT, AS_ARDUPILOT)])
def test_every_field_that_an_autopilot_is_sent(
    dialect: Dialect, expected: list[tuple[float, ...]]
) -> None:
    sent = as_dialect(raw_items(items()), dialect)
    for item, wanted in zip(sent, expected, strict=True):
        assert fields(item) == pytest.approx(wanted, rel=0.0, abs=0.0, nan_ok=True)
        assert (item.autocontinue, item.mission_type) == (1, 0)


def test_what_comes_back_is_what_was_sent() -> None:
    back = [from_raw(item, ARDUPILOT) for item in as_dialect(raw_items(items()), ARDUPILOT)]
    assert back[0].command == 0  # the vehicle's own home
    place = back[2]
    assert (place.seq, place.command, place.params) == (2, 16, (3.0, 5.0, 0.0, 0.0))
    assert (place.x, place.y, place.z) == (47.397742, 8.545594, 30.0)
    assert place.autocontinue is True
    assert from_raw(as_dialect(raw_items(items()), PX4)[0], PX4).command == 22


@pytest.mark.parametrize("dialect", [PX4, ARDUPILOT])
@pytest.mark.parametrize(
    ("number", "changes", "same"),
    [
        (1, {"x": PLACE[0] + 1}, False), (1, {"y": PLACE[1] + 1}, False), (1, {"z": 30.011}, False),
        (1, {"z": 30.004}, True), (1, {"seq": 9}, False), (1, {"command": 82}, False),
        (1, {"param1": 2.2007}, None), (1, {"param2": 5.001}, None), (1, {"param3": 7.0}, True),
        (2, {"x": 7, "z": 3.0, "param1": 7.0}, True), (2, {"param2": 8.5}, None),
        (4, {"y": 5}, True),
    ],
)  # fmt: skip
def test_a_mission_is_the_same_if_what_it_keeps_came_back(
    dialect: Dialect, number: int, changes: dict[str, float], same: bool | None
) -> None:
    """None: PX4 keeps the second parameter, and tells holds of parts of a second apart."""
    sent, back = (as_dialect(raw_items(items()), dialect) for _ in range(2))
    for name, value in changes.items():
        setattr(back[number + dialect.first_item], name, value)
    kept = dialect is PX4 or "param1" in changes
    assert same_mission(sent, back, dialect) is (not kept if same is None else same)
    if dialect is ARDUPILOT:  # its own home
        back = as_dialect(raw_items(items()), dialect)
        back[0].x, back[0].z = 1, 400.0
        assert same_mission(sent, back, dialect)
    assert not same_mission(sent, sent[:-1], dialect)
