"""What a round gave, and those whom an experiment tells."""

from dataclasses import dataclass
from typing import Protocol

from fl.federation.rounds import FederationState, RoundLearning
from mission.flight.flight_plan import FlightPlan
from mission.log.records import RoundRecord, UplinkRecord
from mission.planner.performance import Foreseen
from mission.planner.problem import RoundPlan, RoundProblem
from mission.run.checkpoint import RoundMemory


@dataclass(frozen=True)
class RoundResult:
    """Everything about one round, for those who record it."""

    record: RoundRecord
    uplinks: tuple[UplinkRecord, ...]
    memory: RoundMemory
    state: FederationState  # after the round
    remembered: bool  # flown again, from a checkpoint


class Recorder(Protocol):
    """Takes what happens, in order. Nothing that it does alters the run."""

    def planned(
        self,
        t_ns: int,
        round_number: int,
        problem: RoundProblem,
        plan: RoundPlan,
        flight_plan: FlightPlan,
        foreseen: Foreseen,
    ) -> None:
        """A round is about to be flown."""
        ...

    def learnt(self, round_number: int, learnt: RoundLearning) -> None:
        """What the models know after a round, or, as round 0, untrained."""
        ...

    def finished(self, result: RoundResult) -> None:
        """A round is over."""
        ...

    def phase(self, name: str) -> None:
        """What is going on now, for people."""
        ...

    def notice(self, text: str) -> None:
        """What people should know, a line."""
        ...
