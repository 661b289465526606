"""Which planner a run uses."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mission.importing import IMPORT_PATH

PlannerKind = Literal["paper", "paper_literal", "import"]


class PlannerConfig(BaseModel):
    """The planner of a run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: PlannerKind = Field(
        "paper",
        description="paper: the paper's alternation with the exact cone; paper_literal: as "
        "printed, for study; import: your own, which factory names",
    )
    factory: str | None = Field(
        None,
        pattern=f"^{IMPORT_PATH}$",
        description="for kind = 'import': 'package.module:callable' that gives a planner",
    )

    @model_validator(mode="after")
    def _factory_with_import_only(self) -> Self:
        if (self.kind == "import") != (self.factory is not None):
            raise ValueError("factory belongs to kind = 'import', which needs it")
        return self
