"""Polygons of files, written into a configuration: areas not to be flown, buildings, the fence."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from mission.base.airspace import Airspace, FenceArea
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.explain import Blame, explained, shown
from mission.base.geo_file import MOST_CORNERS, Pair, Place, Ring, read_buildings, read_rings
from mission.base.tables import count
from mission.base.user_files import whole_path
from mission.config.area import HEIGHT_MARGIN_M, AreaConfig, BuildingConfig, NoFlyConfig
from mission.config.models import RunConfig

_FAR_M = 100_000.0  # from home, at most
_LEVEL_M = 3.0  # of a building that tells its levels only
_HOME = ("area.home_m", "area.home_lat_deg", "area.home_lon_deg")

_Found = TypeVar("_Found")
_Zone = TypeVar("_Zone", NoFlyConfig, FenceArea)


def with_polygons(area: AreaConfig, blame: Blame, heights_m: tuple[float, float]) -> AreaConfig:
    """Return an area with its polygon files read; flights are between the two `heights_m`."""
    known: dict[str, object] = {}
    if area.no_fly_file is not None:
        rings = _rings(area, "no_fly_file", blame)
        zones = tuple(_zone(area, ring, blame, NoFlyConfig) for ring in rings)
        known |= {"no_fly": (*area.no_fly, *zones), "no_fly_file": None}
    if area.buildings_file is not None:
        key = "area.buildings_file"
        found, others = read_of(read_buildings, key, area.buildings_file, blame)
        if others:
            blame.notes.append(
                f"{area.buildings_file}: {count(others, 'feature')} passed over that say neither "
                "building, height nor building:levels, or are no polygons"
            )
        buildings = tuple(_building(area, ring, blame) for ring in found)
        known |= {"buildings": (*area.buildings, *buildings), "buildings_file": None}
    if area.fence_file is not None:
        rings = _rings(area, "fence_file", blame)
        fences = tuple(_zone(area, ring, blame, FenceArea) for ring in rings)
        known |= {"fences": (*(area.fences or ()), *fences), "fence_file": None}
    whole = area.model_copy(update=known) if known else area
    _check_beside(area, whole.buildings, blame)
    try:
        fence = whole.fence
    except ValueError as error:
        name = "area.fences" if area.fence_file is None else "area.fence_file"
        raise InputError(f"{blame.on(name)}: {name}: {error}") from None
    tall = [zone for zone in whole.zones[len(whole.no_fly) :] if zone.counts_at(*heights_m)]
    outlines = [*(zone.polygon_m for zone in (*whole.no_fly, *tall)), *fence]
    corners_in_all = sum(map(len, outlines))
    if corners_in_all > MOST_CORNERS:
        raise InputError(
            f"{blame.source}: area: the areas, buildings as high as the flight and the fence have "
            f"{corners_in_all} corners; {MOST_CORNERS} at most, as paths are led around every one "
            "of them: simplify them"
        )
    return whole


def check_start(config: RunConfig) -> None:
    """Refuse homes from which nobody may climb to the mission's altitudes.

    Raises:
        InputError: one lies in an area that must not be flown, outside the fence, or nearer to one
            than the margin.
    """
    for one in config.aircraft:
        start = f"the start, area.home_m = {list(one.home_m)},"
        if config.vehicles is not None:
            start = f"the home of {one.name}, home_m = {list(one.home_m)},"
        _check_home(config, np.array([one.home_m], dtype=np.float64), start)


def _check_home(config: RunConfig, home: Floats, start: str) -> None:
    area, heights_m = config.area, config.heights_m
    # Polygons of a file have their place on the globe, all others in the area.
    way_out = (
        f"move it, or move home (area.home_m; where a GeoJSON file has it, area.home_lat_deg = "
        f"{area.home_lat_deg:.7g} and home_lon_deg = {area.home_lon_deg:.7g})"
    )
    for index, zone in enumerate(area.zones):
        among, first = (
            ("no_fly", 0) if index < len(area.no_fly) else ("buildings", len(area.no_fly))
        )
        if zone.from_m - HEIGHT_MARGIN_M >= heights_m[1]:
            continue  # overhead
        space = Airspace((np.array(zone.polygon_m),), None, area.margin_m)
        if not space.free(home)[0]:
            where = "lies inside" if not space.allows(home)[0] else _nearer(area)
            raise config.contradiction(
                (*_HOME, f"area.{among}.{index - first}", f"area.{among}_file", "area.margin_m"),
                f"{start} {where} the area {zone.name!r}, which must not be flown; {way_out}",
            )
    space = area.build(heights_m).airspace
    if not space.free(home)[0]:
        where = "lies outside" if not space.allows(home)[0] else _nearer(area)
        raise config.contradiction(
            (*_HOME, "area.fence_m", "area.fences", "area.fence_file", "area.margin_m"),
            f"{start} {where} the fence (area.fence_m); {way_out}",
        )


def _nearer(area: AreaConfig) -> str:
    return f"lies nearer than area.margin_m = {area.margin_m:g} m to"


def _rings(area: AreaConfig, name: str, blame: Blame) -> tuple[Ring, ...]:
    return read_of(read_rings, f"area.{name}", getattr(area, name), blame)


def read_of(read: Callable[[Path], _Found], key: str, name: str, blame: Blame) -> _Found:
    """Read the file that `key` names with `read`; its errors then name the key."""
    folder = Path() if key in blame.given else Path(blame.source).parent
    try:
        return read(whole_path(folder, name))
    except InputError as error:
        raise InputError(f"{blame.on(key)}: {key}: {error}") from None


def _zone(area: AreaConfig, ring: Ring, blame: Blame, model: type[_Zone]) -> _Zone:
    keys = [key for key in ("name", "from_m", "to_m", "group") if key in model.model_fields]
    values = {key: ring.properties[key] for key in keys if ring.properties.get(key) is not None}
    values |= {"polygon_m": _corners(area, ring, blame)}
    with explained(model, values, Blame(f"{blame.source}: {ring.where}")):
        return model.model_validate(values, strict=True)


def _check_beside(area: AreaConfig, buildings: Sequence[BuildingConfig], blame: Blame) -> None:
    """Refuse buildings of another place: none of them in the area."""
    if not buildings:
        return
    size = np.array(area.size_m)
    apart = [
        np.maximum(np.maximum(-ring.max(axis=0), ring.min(axis=0) - size), 0.0)
        for ring in (np.array(one.polygon_m) for one in buildings)
    ]
    nearest = float(np.hypot(*np.array(apart).T).min())
    if nearest > 0.0:
        reason = (
            f"none of {len(buildings)} buildings stands in the area; the nearest is "
            f"{nearest:.0f} m away. {home_words(area).capitalize()} lies at area.home_m = "
            f"{list(area.home_m)}"
        )
        name = "area.buildings" if area.buildings_file is None else "area.buildings_file"
        raise InputError(f"{blame.on(name)}: {name}: {reason}")


def _building(area: AreaConfig, ring: Ring, blame: Blame) -> BuildingConfig:
    key = "area.buildings_file"
    source = f"{blame.on(key)}: {key}: {ring.where}"
    height_m = _told_m(ring, source, "height", "building:levels")
    if height_m is None and (height_m := area.building_height_m) is None:
        raise InputError(
            f"{source}: has neither height nor building:levels; give it one, or set "
            "area.building_height_m, the height of those that have none"
        )
    values = {
        "from_m": _told_m(ring, source, "min_height", "building:min_level") or 0.0,
        "polygon_m": _corners(area, ring, blame),
        "holes_m": tuple(_on_map(area, ring.where, hole, blame) for hole in ring.holes_deg),
        "height_m": height_m,
    }
    with explained(BuildingConfig, values, Blame(source)):
        return BuildingConfig.model_validate(values, strict=True)


def _told_m(ring: Ring, source: str, metres: str, levels: str) -> float | None:
    """A height of a building: a property in metres, or one in levels; None if it has neither."""
    name = metres if ring.properties.get(metres) is not None else levels
    value = ring.properties.get(name)
    if value is None:
        return None
    try:  # OpenStreetMap has text, metres where no unit stands there
        told_m = float(str(value).removesuffix("m")) * (1.0 if name == metres else _LEVEL_M)
    except ValueError:
        told_m = math.nan
    if math.isnan(told_m):
        wanted = "a number of metres" if name == metres else "a number"
        raise InputError(f"{source}: {name} = {shown(value)}: must be {wanted}")
    return told_m


def _corners(area: AreaConfig, ring: Ring, blame: Blame) -> tuple[Pair, ...]:
    return _on_map(area, ring.where, ring.corners_deg, blame)


def _on_map(
    area: AreaConfig, where: str, corners_deg: Sequence[Pair], blame: Blame
) -> tuple[Pair, ...]:
    places = [Place(where, corner, geodetic=True) for corner in corners_deg]
    corners = np.array([on_ground(place, area) for place in places])
    check_near(places, corners - np.array(area.home_m), blame.source, home_words(area))
    return tuple((round(x, 3), round(y, 3)) for x, y in corners.tolist())


def on_ground(place: Place, area: AreaConfig) -> Pair:
    """Where a place lies in the area, x and y in metres."""
    if not place.geodetic:
        return place.at
    built = area.build()
    x, y = built.from_ned(built.frame.to_ned(*place.at, built.home.alt_msl_m)).tolist()
    return x, y


def check_near(globe: Sequence[Place], offsets: Floats, source: str, middle: str) -> None:
    """Refuse places too far from `middle` (`offsets`: (n, 2), m), as swapped coordinates are."""
    far = np.hypot(*offsets.T)
    worst = int(far.argmax())
    if far[worst] <= _FAR_M:
        return
    lat, lon = globe[worst].at
    raise InputError(
        f"{source}: {globe[worst].where}: lat {lat:g}, lon {lon:g} lies {far[worst] / 1000:.0f} km "
        f"from {middle}, {_FAR_M / 1000:.0f} km at most are allowed; are lat and lon of one "
        "swapped? (GeoJSON has [lon, lat])"
    )


def home_words(area: AreaConfig) -> str:
    """Return home with its latitude and longitude, in words for error messages."""
    return f"home (lat {area.home_lat_deg:g}, lon {area.home_lon_deg:g})"
