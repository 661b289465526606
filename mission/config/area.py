"""The ground of a run: its size and home, areas not to be flown, buildings, the fence."""

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from fl.radio.city import Building
from flightdyn.obstacles import flaw
from flightdyn.state import GeodeticPoint
from flightdyn.tables import Table
from mission.base.airspace import (
    Airspace,
    Coordinate,
    Corners,
    FenceArea,
    Length,
    apart_within,
    joined,
)
from mission.base.area import Area
from mission.base.arrays import Floats

HEIGHT_MARGIN_M = 5.0  # above and below the altitude, where an area counts


class NoFlyConfig(Table):
    """An area that must not be flown: paths lead around it, and the vehicle has it as its fence."""

    name: str = Field("no-fly area", min_length=1, max_length=60)
    """for maps and messages"""
    polygon_m: Corners
    """its corners in area coordinates"""
    from_m: float = Field(0.0, ge=-100, le=5000)
    """height above home where it begins; lower may be flown"""
    to_m: float | None = Field(None, ge=-100, le=5000)
    """height above home where it ends; none: nowhere"""

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        if wrong := flaw(np.array(self.polygon_m)):
            raise ValueError(f"polygon_m of {self.name!r} {wrong}")
        if self.to_m is not None and self.to_m <= self.from_m:
            raise ValueError(f"to_m = {self.to_m:g} must be above from_m = {self.from_m:g}")
        return self

    def counts_at(self, lowest_m: float, highest_m: float) -> bool:
        """Whether flights somewhere between these heights above home must keep out of it."""
        top = math.inf if self.to_m is None else self.to_m
        return self.from_m - HEIGHT_MARGIN_M < highest_m and lowest_m < top + HEIGHT_MARGIN_M


class BuildingConfig(Table):
    """A building: radio does not pass it, and flights as low as its roof keep out of it."""

    polygon_m: Corners
    """its corners in area coordinates"""
    holes_m: tuple[Corners, ...] = ()
    """corners of each courtyard"""
    height_m: float = Field(gt=0, le=1000)
    """of its roof above home"""
    from_m: float = Field(0.0, ge=0, le=1000)
    """where it begins above home, as a bridge between houses does"""

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        for ring in (self.polygon_m, *self.holes_m):
            if wrong := flaw(np.array(ring)):
                raise ValueError(f"its outline {wrong}")
        if self.from_m >= self.height_m:
            raise ValueError(f"from_m = {self.from_m:g} must be below height_m = {self.height_m:g}")
        if self.holes_m and not apart_within(
            np.array(self.polygon_m), list(map(np.array, self.holes_m))
        ):
            raise ValueError("its holes must lie within its outline, and apart from each other")
        return self


class AreaConfig(Table):
    """The ground that the devices stand on. x points east, y north, from the south-west corner."""

    size_m: tuple[Length, Length] = (800.0, 800.0)
    """width (x) and height (y)"""
    home_m: tuple[Coordinate, Coordinate] = (400.0, 400.0)
    """take-off point in area coordinates; it may lie outside"""
    home_lat_deg: float = Field(43.6145, ge=-85, le=85)
    """latitude of the home point"""
    home_lon_deg: float = Field(7.0715, ge=-180, le=180)
    """longitude of the home point"""
    home_alt_msl_m: float = Field(130.0, ge=-400, le=5000)
    """ground altitude above mean sea level"""
    no_fly: tuple[NoFlyConfig, ...] = ()
    """areas that must not be flown"""
    no_fly_file: str | None = None
    """the same as GeoJSON polygons, with properties name, from_m and to_m. Beside the
    configuration, or an absolute path"""
    buildings: tuple[BuildingConfig, ...] = Field((), max_length=20_000)
    """what stands on the ground"""
    buildings_file: str | None = None
    """the same as GeoJSON polygons, as OpenStreetMap exports them, with properties height and
    min_height (metres), or building:levels and building:min_level (3 m each)"""
    building_height_m: float | None = Field(None, gt=0, le=1000)
    """of those that say nothing; none: the file is refused"""
    fence_m: Corners | None = None
    """corners of the area that flights stay within, in area coordinates"""
    fences: tuple[FenceArea, ...] | None = None
    """more such areas, with groups; fence_m is one of group 0"""
    fence_file: str | None = None
    """the same as GeoJSON polygons, with property group"""
    margin_m: float = Field(15.0, ge=5, le=500)
    """how far paths stay away from areas that must not be flown, and from the fence"""

    @model_validator(mode="after")
    def _fenced(self) -> Self:
        if self.fence_m is not None and (wrong := flaw(np.array(self.fence_m))):
            raise ValueError(f"fence_m {wrong}")
        return self

    @property
    def fence(self) -> tuple[Floats, ...]:
        """The outline (n, 2) that flights stay within, and its holes; empty if there is none.

        Raises:
            ValueError: the areas of no group have a place in common.
        """
        return joined(self.fence_m, self.fences or (), self.home_m)

    @property
    def home(self) -> GeodeticPoint:
        """Home on the globe."""
        return GeodeticPoint(self.home_lat_deg, self.home_lon_deg, self.home_alt_msl_m)

    @property
    def zones(self) -> tuple[NoFlyConfig, ...]:
        """What must not be flown: the areas that are said to be so, and the buildings."""
        return *self.no_fly, *(
            NoFlyConfig.model_construct(  # of a checked one
                name=f"building {index}",
                polygon_m=building.polygon_m,
                from_m=building.from_m,
                to_m=building.height_m,
            )
            for index, building in enumerate(self.buildings)
        )

    def build(self, heights_m: tuple[float, float] | None = None) -> Area:
        """Make the area with its local frame, and the airspace that is free at all heights above
        home between the two (m); None: nothing is flown, so all is free."""
        home = self.home
        buildings = tuple(Building.of(**dict(one)) for one in self.buildings)
        if heights_m is None:
            return Area.at(self.size_m, self.home_m, home, buildings=buildings)
        rings = [np.array(zone.polygon_m) for zone in self.zones if zone.counts_at(*heights_m)]
        keep_in, *holes = self.fence or (None,)
        space = Airspace((*rings, *holes), keep_in, self.margin_m)
        return Area.at(self.size_m, self.home_m, home, space, buildings)
