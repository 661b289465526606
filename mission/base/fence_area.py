"""An area that flights stay within, as a configuration or a problem file has it."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from flightdyn.outlines import flaw
from flightdyn.tables import Table
from mission.base.airspace import circle
from mission.base.arrays import Floats

Length = Annotated[float, Field(gt=0, le=100_000, strict=True)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000, strict=True)]
Corners = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=500)]


class FenceArea(Table):
    """An area that flights stay within: in all those of its group, or in all those of another."""

    polygon_m: Corners | None = Field(None, description="its corners in area coordinates; or")
    center_m: tuple[Coordinate, Coordinate] | None = Field(
        None, description="the centre of a circle, in area coordinates, with"
    )
    radius_m: Length | None = Field(None, description="its radius")
    group: int = Field(0, strict=True, ge=0, le=255, description="flights are inside all of one")

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        given = [self.polygon_m is None, self.center_m is None, self.radius_m is None]
        if given not in ([False, True, True], [True, False, False]):
            raise ValueError("must have polygon_m, or center_m and radius_m")
        if wrong := flaw(self.outline_m):
            raise ValueError(f"its outline {wrong}")
        return self

    @property
    def outline_m(self) -> Floats:
        """Its corners (n, 2); a circle's lie on it."""
        if self.center_m is not None and self.radius_m is not None:
            return circle(np.array(self.center_m), self.radius_m)
        return np.array(self.polygon_m)
