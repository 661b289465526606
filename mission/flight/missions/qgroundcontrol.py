"""What a QGroundControl `.plan` may hold: the schema of its document, as far as it is flown.

Format: QGroundControl developer guide, "Plan File Format". The items of a structure scan are not in
the file; they are made here as QGroundControl makes them.
"""

# ruff: noqa: N815  the names are QGroundControl's

from collections.abc import Sequence
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, field_validator, model_validator
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint

SCANS = ("survey", "CorridorScan", "StructureScan", "fwLandingPattern", "vtolLandingPattern")

_Place: TypeAlias = tuple[FiniteFloat, FiniteFloat]  # latitude, longitude in degrees


class _Part(BaseModel):
    model_config = ConfigDict(strict=True)


class SimpleItem(_Part):
    """A mission item as it is uploaded."""

    type: Literal["SimpleItem"]
    command: Annotated[int, Field(ge=0, le=0xFFFF)]
    frame: Annotated[int, Field(ge=0, le=0xFF)]
    params: Annotated[list[FiniteFloat | None], Field(min_length=7, max_length=7)]
    autoContinue: bool = True  # QGroundControl's names
    doJumpId: int | None = None

    def flown(self) -> Sequence["SimpleItem"]:
        """Return the item itself, as the only one to fly."""
        return (self,)


class _Transects(_Part):
    Items: list[SimpleItem]

    @field_validator("Items")
    @classmethod
    def _some(cls, items: list[SimpleItem]) -> list[SimpleItem]:
        if not items:
            raise ValueError(
                "empty: the scan has no path; draw it in QGroundControl and save again"
            )
        return items


class _Transect(_Part):
    """A survey or a corridor scan."""

    type: Literal["ComplexItem"]
    complexItemType: Literal["survey", "CorridorScan"]
    TransectStyleComplexItem: _Transects

    def flown(self) -> Sequence[SimpleItem]:
        """Return the mission items of the scan, which the file contains."""
        return self.TransectStyleComplexItem.Items


class _Camera(_Part):
    DistanceToSurface: FiniteFloat
    AdjustedFootprintFrontal: Annotated[FiniteFloat, Field(gt=0)]
    AdjustedFootprintSide: FiniteFloat


class _StructureScan(_Part):
    """A structure scan: layers of waypoints around a building."""

    type: Literal["ComplexItem"]
    complexItemType: Literal["StructureScan"]
    version: Literal[3]
    CameraCalc: _Camera
    EntranceAltitude: FiniteFloat
    ScanBottomAlt: FiniteFloat
    StructureHeight: FiniteFloat
    StartFromTop: bool
    Layers: Annotated[float, Field(ge=1, le=100, multiple_of=1)]
    GimbalPitch: FiniteFloat
    polygon: Annotated[list[_Place], Field(min_length=3)]

    def flown(self) -> Sequence[SimpleItem]:
        """Generate the scan's mission items, as QGroundControl does at upload: the file has none.
        Every layer begins and ends at the first corner, with the camera at work."""
        camera, ring = self.CameraCalc, self._ring()
        first = _waypoint(ring[0], self.EntranceAltitude)
        offset = _command(mav.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET, 0, 0, 0, 0, self.GimbalPitch, 0, 90)
        items = [first, offset]
        down = -1.0 if self.StartFromTop else 1.0
        begin_m = self.StructureHeight if self.StartFromTop else self.ScanBottomAlt
        for layer in range(int(self.Layers)):
            height_m = begin_m + down * (layer + 0.5) * camera.AdjustedFootprintFrontal
            corners = [_waypoint(place, height_m) for place in (*ring, ring[0])]
            begin = _command(mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST, camera.AdjustedFootprintSide, 0, 1)
            end = _command(mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST)
            items += [corners[0], begin, *corners[1:], end]
        return [*items, _command(mav.MAV_CMD_DO_SET_ROI_NONE), first]

    def _ring(self) -> list[_Place]:
        """Return the corners of the polygon, its edges moved out by the distance to the surface."""
        frame = LocalFrame(GeodeticPoint(*self.polygon[0], 0.0))
        corners = np.array([frame.to_ned(*place, 0.0)[:2] for place in self.polygon])
        edges = np.roll(corners, -1, axis=0) - corners
        with np.errstate(invalid="ignore"):  # a corner twice has no place, and is refused as such
            edges /= np.linalg.norm(edges, axis=1, keepdims=True)
        following = np.roll(corners, -1, axis=0)
        north_first = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
        outwards = np.column_stack((edges[:, 1], -edges[:, 0])) * np.sign(north_first.sum())
        both = outwards + np.roll(outwards, 1, axis=0)  # of the edges that meet at a corner
        moved = corners + 2.0 * self.CameraCalc.DistanceToSurface * both / (both**2).sum(
            axis=1, keepdims=True
        )
        places = [frame.to_geodetic(np.array([*corner, 0.0])) for corner in moved]
        return [(place.lat_deg, place.lon_deg) for place in places]


class _LandingPattern(_Part):
    type: Literal["ComplexItem"]
    complexItemType: Literal["fwLandingPattern", "vtolLandingPattern"]

    @model_validator(mode="after")
    def _no_aeroplane(self) -> Self:
        raise ValueError(
            "a landing of aeroplanes, and this is a multirotor: plan Land or Return in its place"
        )

    def flown(self) -> Sequence[SimpleItem]:
        """Return no items: validation refuses landing patterns."""
        return ()


_Complex: TypeAlias = Annotated[
    _Transect | _StructureScan | _LandingPattern, Field(discriminator="complexItemType")
]


class _Mission(_Part):
    version: Literal[2] = 2
    items: list[Annotated[SimpleItem | _Complex, Field(discriminator="type")]]
    plannedHomePosition: (
        Annotated[list[FiniteFloat | None], Field(min_length=2, max_length=3)] | None
    ) = None


class _Polygon(_Part):
    inclusion: bool
    polygon: Annotated[list[_Place], Field(min_length=3)]


class _Disc(_Part):
    center: _Place
    radius: FiniteFloat


class _Circle(_Part):
    inclusion: bool
    circle: _Disc


class Fence(_Part):
    """A geofence: polygons and circles to stay inside or outside of."""

    version: Literal[1, 2] = 2
    polygon: list[_Place] = []  # of version 1: to stay inside of
    polygons: list[_Polygon] = []
    circles: list[_Circle] = []
    breachReturn: tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None = None


class _Rally(_Part):
    points: list[tuple[FiniteFloat, FiniteFloat, FiniteFloat]] = []


class Document(_Part):
    """A whole plan file: mission, geofence and rally points."""

    fileType: Literal["Plan"]
    version: Literal[1] = 1
    mission: _Mission
    geoFence: Fence = Fence()
    rallyPoints: _Rally = _Rally()


def _waypoint(place: _Place, height_m: float) -> SimpleItem:
    """A waypoint that is flown through, at a height above home."""
    return SimpleItem(
        type="SimpleItem",
        command=mav.MAV_CMD_NAV_WAYPOINT,
        frame=mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        params=[0.0, 0.0, 0.0, None, *place, height_m],
    )


def _command(command: int, *params: float) -> SimpleItem:
    """A command without a place."""
    seven = [*params, *[0.0] * (7 - len(params))]
    return SimpleItem(
        type="SimpleItem", command=command, frame=mav.MAV_FRAME_MISSION, params=[*seven]
    )
