"""The mission on board as it is flown: from its items to a manoeuvre, and how that ended."""

from collections.abc import Sequence

from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying import route
from sitl.autopilot.flying.mission import Mission
from sitl.autopilot.flying.navigator import Navigator
from sitl.autopilot.protocol.item_rules import NAVIGATION
from sitl.autopilot.reporter import Reporter
from sitl.autopilot.values.messages import MissionItem


class MissionFlight:
    """Flies the mission stage by stage, and tells of its items."""

    def __init__(self, navigator: Navigator, reporter: Reporter) -> None:
        self.mission = Mission()
        self._navigator = navigator
        self._report = reporter
        self._last_stage: route.Stage | None = None  # that ended the mission by itself

    def replace(self, items: tuple[MissionItem, ...]) -> None:
        """Have another mission on board."""
        self.mission.replace(items)
        self._report.mission_changed()

    def stages(
        self, here: Vector, *, home: GeodeticPoint, speed_mps: float | None
    ) -> tuple[route.Stage, ...]:
        """What is left to fly from `here` (NED), at the ordered speed or the default."""
        return self._navigator.stages(self.mission, here, home=home, speed_mps=speed_mps)

    def fly(self, stages: Sequence[route.Stage], *, ground_down_m: float) -> do.Manoeuvre:
        """Begin the stages, or go on with them."""
        self.mission.start()
        self._last_stage = None
        self._report.mission_changed()
        return self._navigator.fly(
            stages, reached=self._reached, ended=self._ended_by, ground_down_m=ground_down_m
        )

    def finish(self) -> route.Stage | None:
        """The manoeuvre is over: the stage that ended the mission, if one did.

        A mission that loiters at its last item is not finished.
        """
        if not isinstance(self._last_stage, route.Loiter):
            self.mission.finish()
            self._report.mission_changed()
        return self._last_stage

    def _ended_by(self, stage: route.Stage) -> None:
        self._last_stage = stage

    def _reached(self, seq: int) -> None:
        self.mission.reached(seq)
        self._report.reached(seq, place=self.mission.items[seq].command in NAVIGATION)
