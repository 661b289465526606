"""Which planner a run uses."""

from collections.abc import Sequence
from typing import Literal, Self

from pydantic import Field, model_validator

from fl.config import PluginName
from flightdyn.tables import Table
from mission.base.tables import count

_ROUNDING = 1e-9  # of a gap that was met

PlannerKind = Literal["certified", "sqp", "paper", "paper_literal", "import"]


class PlannerConfig(Table):
    """The planner of a run."""

    kind: PlannerKind = "certified"
    """certified: the best plan and a proven bound; sqp: large instances, no bound; paper: the
    paper's alternation with the exact cone; paper_literal: as printed, for study; import: your own,
    which factory names"""
    gap: float = Field(0.01, ge=1e-4, lt=1.0)
    """certified: relative gap between plan and bound that is enough; with more than 40 devices and
    more than 5 steps (6 where slots are fewer than devices) nothing is searched for, and the gap is
    what it is"""
    max_nodes: int = Field(60_000, ge=0, le=10_000_000)
    """certified: nodes of the search at most; it ends earlier where its pace says that they would
    not do. Counted, not timed, so that plans are the same on every machine"""
    factory: PluginName | None = Field(None, examples=["my_package.my_module:make_planner"])
    """for kind = 'import': 'package.module:callable' that gives a planner"""

    @model_validator(mode="after")
    def _factory_with_import_only(self) -> Self:
        if self.kind == "import" and self.factory is None:
            raise ValueError("kind = 'import' needs factory = 'package.module:callable'")
        if self.kind != "import" and self.factory is not None:
            raise ValueError(f"factory belongs to kind = 'import', but kind is {self.kind!r}")
        return self

    def loosely_proven(self, gaps: Sequence[float]) -> str:
        """How many plans of such gaps are proven less closely than asked for, in words; empty where
        none is. NaN stands for a plan without a bound."""
        loose = [gap for gap in gaps if gap > self.gap + _ROUNDING]
        if self.kind != "certified" or not loose:
            return ""
        verb = "is" if len(loose) == 1 else "are"
        return (
            f"{len(loose)} of {count(len(gaps), 'plan')} {verb} proven less closely than "
            f"planner.gap = {self.gap:g} asks: the largest gap is {100.0 * max(loose):.1f} %; "
            "docs/planner.md says what is proven where"
        )
