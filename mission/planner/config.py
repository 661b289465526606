"""Which planner a run uses."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

PlannerKind = Literal["paper", "paper_literal"]


class PlannerConfig(BaseModel):
    """The planner of a run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: PlannerKind = Field(
        "paper",
        description="paper: the paper's alternation with the exact cone; paper_literal: as "
        "printed, for study",
    )
