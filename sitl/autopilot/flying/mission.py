"""The mission on board and how far it has come."""

from collections.abc import Mapping
from itertools import islice

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.flying.route import flown_order, repeats, speed_from
from sitl.autopilot.protocol.order_rules import NAVIGATION


class Mission:
    """Items and progress. What MISSION_CURRENT says is computed, never stored."""

    def __init__(self) -> None:
        self.items: tuple[MissionItem, ...] = ()
        self.last: int | None = None  # the item after which it ends; None: the last of all
        self.current = 0
        self.complete = False
        self.waiting = False  # at an item without autocontinue
        self.over = False  # no item comes after the one that was reached last
        self.begun = 0  # the item with which it was started last
        self.item_speed_mps: float | None = None  # of the last DO_CHANGE_SPEED carried out
        self._started = False
        self._next = 0  # in the order in which they are flown; `current` is where it leads
        self._jumps_left: dict[int, int] = {}

    def replace(self, items: tuple[MissionItem, ...]) -> None:
        """Take another mission, to be flown from its current item on, or from its beginning."""
        self.items, self.last = items, None
        self.rewind(next((item.seq for item in items if item.current), 0))

    @property
    def flown(self) -> tuple[MissionItem, ...]:
        """The items up to the one after which it ends."""
        return self.items if self.last is None else self.items[: self.last + 1]

    @property
    def _end(self) -> int:
        """The last item that is carried out, which a jump is not."""
        end = len(self.flown) - 1
        while end > 0 and self.items[end].command == mav.MAV_CMD_DO_JUMP:
            end -= 1
        return max(end, 0)

    def rewind(self, seq: int, *, reset: bool = True) -> None:
        """Go on with item `seq`, at the speed that the items before it ask for.

        `reset`: jumps are counted anew; they are after its end anyway.
        """
        self.current = self._next = seq
        if reset or self.complete:
            self._jumps_left = repeats(self.items)
        self.complete = self.waiting = self._started = False
        self.item_speed_mps = None
        for item in self.items[:seq]:
            self.item_speed_mps = speed_from(item, self.item_speed_mps)

    @property
    def next_start(self) -> tuple[int, Mapping[int, int], float | None]:
        """The first item of a start, the jumps left there by item, and the speed (m/s) ordered."""
        if self.complete:
            return 0, repeats(self.items), None
        return self._next, self._jumps_left, self.item_speed_mps

    def start(self) -> None:
        """Note that the mission is being flown; a complete one begins again."""
        if self.complete:
            self.rewind(0)
        self._started, self.waiting, self.begun = True, False, self._next
        first = next(flown_order(self.flown, self._next, self._jumps_left), None)
        if first is not None and first.seq != self._next:  # it was to go on with a jump
            self.current = self._next = first.seq

    def reached(self, seq: int) -> None:
        """Note that item `seq` has been reached or carried out."""
        self.item_speed_mps = speed_from(self.items[seq], self.item_speed_mps)
        # After the last item it stays the last: a hold may come before the aircraft is at rest.
        self._next, self.current = seq, self._end
        left, self.over = self._jumps_left, True
        # Jumps over items without navigation are not followed for ever.
        ahead = islice(flown_order(self.flown, seq + 1, left), len(self.items))
        for steps, item in enumerate(ahead):
            if steps == 0:  # jumps farther on have not been taken yet
                self._next, self._jumps_left, self.over = item.seq, dict(left), False
            if item.command in NAVIGATION:
                self.current = item.seq
                break
        self.waiting = not self.items[seq].autocontinue
        if self.waiting:
            self.current = seq

    def finish(self) -> None:
        """Note that the last item has been reached and the aircraft has come to rest."""
        self.complete, self.waiting = True, False
        self.current, self.last = self._end, None

    def message(self, *, in_mission_mode: bool) -> mav.MAVLink_message:
        """MISSION_CURRENT: current item, number of items, state, and whether it is flown."""
        return mav.MAVLink_mission_current_message(
            self.current,
            len(self.items) or 65535,  # no mission
            self._state(in_mission_mode),
            1 if in_mission_mode else 2,
        )

    def _state(self, in_mission_mode: bool) -> int:
        if not self.items:
            return mav.MISSION_STATE_NO_MISSION
        if self.complete:
            return mav.MISSION_STATE_COMPLETE
        if not self._started:
            return mav.MISSION_STATE_NOT_STARTED
        return mav.MISSION_STATE_ACTIVE if in_mission_mode else mav.MISSION_STATE_PAUSED
