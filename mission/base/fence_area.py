"""Areas that flights stay within, as configurations and problem files have them."""

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from flightdyn.outlines import flaw
from flightdyn.tables import Table
from mission.base.airspace import circle, within
from mission.base.arrays import Floats

Length = Annotated[float, Field(gt=0, le=100_000, strict=True)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000, strict=True)]
Corners = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=500)]


class FenceArea(Table):
    """A polygon or a circle; flights are inside all areas of one group, whichever."""

    polygon_m: Corners | None = Field(None, description="its corners in area coordinates")
    center_m: tuple[Coordinate, Coordinate] | None = Field(None, description="of a circle")
    radius_m: Length | None = Field(None, description="of a circle")
    group: int = Field(0, strict=True, ge=0, le=255, description="its group")

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        if [self.center_m is None, self.radius_m is None] != [self.polygon_m is not None] * 2:
            raise ValueError("must have polygon_m, or center_m and radius_m")
        if wrong := flaw(self.outline_m):
            raise ValueError(f"its outline {wrong}")
        return self

    @property
    def outline_m(self) -> Floats:
        """Its corners (n, 2)."""
        if self.center_m is None or self.radius_m is None:
            return np.array(self.polygon_m)
        return circle(np.array(self.center_m), self.radius_m)


def joined(
    first_m: Sequence[ArrayLike] | None, areas: Sequence[FenceArea], place_m: ArrayLike
) -> tuple[Floats, ...]:
    """`within` of areas, and of corners (n, 2) that are one of group 0."""
    first = [] if first_m is None else [(0, np.array(first_m))]
    return within([*first, *((area.group, area.outline_m) for area in areas)], place_m)
