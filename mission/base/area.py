"""Conversion between area coordinates (planner) and the vehicle's local frame (flight).

Area coordinates are x east, y north in metres from the south-west corner of the site. The
vehicle's frame is NED about its take-off point, which lies at `home_m` in the area.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from fl.radio.city import Building
from flightdyn.frames import LocalFrame
from flightdyn.obstacles import Obstacles
from flightdyn.state import GeodeticPoint
from mission.base.airspace import OPEN, Airspace
from mission.base.arrays import Floats


@dataclass(frozen=True)
class Site:
    """A rectangle on the ground and what stands there, the same for all aircraft above it."""

    size_m: tuple[float, float]  # width (x), height (y)
    origin_m: tuple[float, float]  # which place of it is `origin`; may lie outside
    origin: GeodeticPoint
    airspace: Airspace = field(default=OPEN, compare=False)  # where in it may be flown
    buildings: tuple[Building, ...] = field(default=(), compare=False)

    @cached_property
    def obstacles(self) -> Obstacles | None:
        """The buildings, in metres north and east of `origin`; None without buildings."""
        known = [
            (
                [(ring - self.origin_m)[:, ::-1] for ring in building.outlines_m],
                building.from_m or -math.inf,
                building.height_m,
            )
            for building in self.buildings
        ]
        return Obstacles(known) if known else None

    def from_home(self, home_m: tuple[float, float]) -> "Area":
        """The site with a take-off point `home_m`, as high as `origin`."""
        north, east = home_m[1] - self.origin_m[1], home_m[0] - self.origin_m[0]
        home = LocalFrame(self.origin).to_geodetic(np.array([north, east, 0.0]))
        return Area(self, home_m, replace(home, alt_msl_m=self.origin.alt_msl_m))


@dataclass(frozen=True)
class Area:
    """A site with the take-off point (home) of one aircraft, which may lie outside it."""

    site: Site
    home_m: tuple[float, float]
    home: GeodeticPoint

    @classmethod
    def at(
        cls,
        size_m: tuple[float, float],
        home_m: tuple[float, float],
        home: GeodeticPoint,
        airspace: Airspace = OPEN,
        buildings: tuple[Building, ...] = (),
    ) -> Self:
        """Make the area of a site whose origin is this home."""
        return cls(Site(size_m, home_m, home, airspace, buildings), home_m, home)

    @classmethod
    def around(cls, home: GeodeticPoint, pos_ned_m: Floats, *, margin_m: float) -> Self:
        """Make the rectangle, with a margin, around positions (n, 3), in NED metres from `home`."""
        low = pos_ned_m.min(axis=0) - margin_m
        north_m, east_m, _ = (pos_ned_m.max(axis=0) + margin_m - low).tolist()
        return cls.at((east_m, north_m), (-float(low[1]), -float(low[0])), home)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (x) and height (y) of the site."""
        return self.site.size_m

    @property
    def airspace(self) -> Airspace:
        """Where in the site may be flown."""
        return self.site.airspace

    @property
    def buildings(self) -> tuple[Building, ...]:
        """The site's buildings."""
        return self.site.buildings

    @property
    def obstacles(self) -> Obstacles | None:
        """The buildings as obstacles to an aircraft, in its local frame; None without buildings."""
        (x, y), (at_x, at_y), found = self.home_m, self.site.origin_m, self.site.obstacles
        return None if found is None else found.seen_from(y - at_y, x - at_x)

    @property
    def frame(self) -> LocalFrame:
        """The vehicle's local NED frame."""
        return LocalFrame(self.home)

    def to_ned(self, xy_m: Floats, alt_rel_m: float | Floats) -> Floats:
        """(..., 2) area coordinates at heights above home, or one -> (..., 3) NED."""
        xy = np.asarray(xy_m, dtype=np.float64)
        ned = np.empty((*xy.shape[:-1], 3))
        ned[..., 0] = xy[..., 1] - self.home_m[1]
        ned[..., 1] = xy[..., 0] - self.home_m[0]
        ned[..., 2] = -alt_rel_m
        return ned

    def xyz(self, pos_ned_m: Floats) -> Floats:
        """(..., 3) NED -> area coordinates and height above home."""
        return np.concatenate((self.from_ned(pos_ned_m), -pos_ned_m[..., 2:]), axis=-1)

    def from_ned(self, pos_ned_m: Floats) -> Floats:
        """(..., 3) NED -> (..., 2) area coordinates."""
        ned = np.asarray(pos_ned_m, dtype=np.float64)
        return np.stack((ned[..., 1] + self.home_m[0], ned[..., 0] + self.home_m[1]), axis=-1)


def on_globe(area: Area, xy_m: Floats, alt_rel_m: float | Floats) -> list[GeodeticPoint]:
    """Convert area coordinates (n, 2) at heights above home (or one) to geodetic points. Heights
    count from the globe, not from the plane that touches it at home."""
    frame, alt_m = area.frame, area.home.alt_msl_m
    return [
        replace(frame.to_geodetic(ned), alt_msl_m=alt_m - float(ned[2]))
        for ned in area.to_ned(xy_m, alt_rel_m)
    ]
