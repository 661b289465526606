"""The mission on board and how far it has come."""

from sitl.autopilot.flying.route import next_navigation
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Command, MissionState


class Mission:
    """Items and progress. What MISSION_CURRENT says is computed, never stored."""

    def __init__(self) -> None:
        self.items: tuple[m.MissionItem, ...] = ()
        self.current = 0
        self.complete = False
        self.item_speed_mps: float | None = None  # of the last DO_CHANGE_SPEED carried out
        self._started = False

    def replace(self, items: tuple[m.MissionItem, ...]) -> None:
        """Another mission, to be flown from its beginning."""
        self.items = items
        self.rewind(0)

    def rewind(self, seq: int) -> None:
        """Go on with item `seq`; with the speed that the items before it ask for."""
        self.current = seq
        self.complete = False
        self._started = False
        self.item_speed_mps = None
        for item in self.items[:seq]:
            self._note_speed(item)

    @property
    def next_start(self) -> tuple[int, float | None]:
        """Where a start would begin, and the speed that items have ordered for there."""
        return (0, None) if self.complete else (self.current, self.item_speed_mps)

    def start(self) -> None:
        """The mission is being flown; a complete one from its beginning."""
        if self.complete:
            self.rewind(0)
        self._started = True

    def reached(self, seq: int) -> None:
        """Item `seq` has been reached or carried out."""
        self._note_speed(self.items[seq])
        self.current = next_navigation(self.items, seq + 1)

    def finish(self) -> None:
        """The last item has been reached and the aircraft has come to rest."""
        self.complete = True
        self.current = max(len(self.items) - 1, 0)

    def message(self, *, in_mission_mode: bool) -> m.MissionCurrent:
        """MISSION_CURRENT as things stand."""
        return m.MissionCurrent(
            self.current, len(self.items), self._state(in_mission_mode), in_mission_mode
        )

    def _state(self, in_mission_mode: bool) -> MissionState:
        if not self.items:
            return MissionState.NO_MISSION
        if self.complete:
            return MissionState.COMPLETE
        if in_mission_mode:
            return MissionState.ACTIVE
        return MissionState.PAUSED if self._started else MissionState.NOT_STARTED

    def _note_speed(self, item: m.MissionItem) -> None:
        if item.command == Command.DO_CHANGE_SPEED:
            speed = item.params[1]
            if speed == -2.0:
                self.item_speed_mps = None
            elif speed > 0:
                self.item_speed_mps = speed
