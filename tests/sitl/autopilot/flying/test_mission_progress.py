"""How far a mission has come, against the whole of it written out."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying import mission as flown
from sitl.autopilot.flying.mission import Mission
from sitl.autopilot.flying.route import flown_order

KINDS = (mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_DO_CHANGE_SPEED, mav.MAV_CMD_DO_JUMP)


def some_mission(rng: np.random.Generator) -> tuple[MissionItem, ...]:
    """Items of all kinds; jumps lead back, to what is no jump."""
    items: list[MissionItem] = []
    for seq in range(int(rng.integers(1, 8))):
        places = [item.seq for item in items if item.command != mav.MAV_CMD_DO_JUMP]
        command = KINDS[int(rng.integers(3 if places else 2))]
        params = (1.0, 5.0, -1.0, 0.0)
        if command == mav.MAV_CMD_DO_JUMP:
            params = (float(rng.choice(places)), float(rng.integers(0, 3)), 0.0, 0.0)
        items.append(
            MissionItem(seq, command, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, params, 0, 0, 0)
        )
    return tuple(items)


def written_out(items: tuple[MissionItem, ...]) -> list[MissionItem]:
    """The items in the order in which they are carried out, without jumps."""
    order, index = [], 0
    left = [int(item.params[1]) for item in items]
    while index < len(items):
        item = items[index]
        index += 1
        if item.command != mav.MAV_CMD_DO_JUMP:
            order.append(item)
        elif left[item.seq]:
            left[item.seq] -= 1
            index = int(item.params[0])
    return order


@pytest.mark.parametrize("seed", range(40))
def test_what_comes_next_is_what_the_written_out_mission_says(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    items = some_mission(np.random.default_rng(seed))
    walks: list[int] = []

    def counted(items, first, left):
        walks.append(first)
        return flown_order(items, first, left)

    monkeypatch.setattr(flown, "flown_order", counted)
    mission = Mission()
    mission.replace(items)
    order = written_out(items)
    for number, item in enumerate(order):
        mission.reached(item.seq)
        ahead = order[number + 1 :]
        following, left, _ = mission.next_start
        assert following == (ahead[0].seq if ahead else item.seq)
        if ahead:
            assert [i.seq for i in flown_order(items, following, dict(left))] == [
                i.seq for i in ahead
            ]
        lap = ahead[: len(items)]
        places = [i.seq for i in lap if i.command == mav.MAV_CMD_NAV_WAYPOINT]
        assert mission.current == (places[0] if places else max(i.seq for i in order))
    assert len(walks) == len(order)  # once for each item
