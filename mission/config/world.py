"""What a configuration's files say of the ground, written into the configuration itself.

So a run's own `config.toml` needs no other file, and all that reads a configuration knows places
in area coordinates only.
"""

import hashlib
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from fl.config import WEIGHED_PARTITIONS, CommunityConfig, RadioConfig
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.explain import Blame
from mission.base.geo_file import Pair, Place, read_places
from mission.base.user_files import read_bytes
from mission.config.area import AreaConfig
from mission.config.models import RunConfig
from mission.config.polygons import check_near, home_words, on_ground, read_of, with_polygons
from native.errors import SettingError

_MARGIN = 0.1  # around the extent of all places, as a share of its longer side
_LEAST_MARGIN_M = 50.0
_LARGEST_M = 100_000.0
MOST_BYTES = 1 << 30  # of a radio map


def with_world(config: RunConfig, blame: Blame) -> RunConfig:
    """Return a configuration with its files read; `blame` says where its keys come from.

    Files are found beside its own; those named on the command line from the working directory. Area
    and home, where they are not given, are placed around the devices.

    Raises:
        InputError: a file cannot be used, or something stands outside the area.
    """
    found = {
        index: _places_of(config, index, blame)
        for index, community in enumerate(config.communities)
        if community.positions_file is not None
    }
    area = config.area
    if found or any(community.positions_m is not None for community in config.communities):
        area = _area(config, [place for places in found.values() for place in places], blame.source)
    communities = tuple(
        _placed(community, found[index], area) if index in found else community
        for index, community in enumerate(config.communities)
    )
    area = with_polygons(area, blame, config.mission.heights_m)
    known: dict[str, object] = {
        "area": area,
        "communities": communities,
        "radio": _known_map(config.radio, blame),
    }
    placed = config.model_copy(update=known)
    given = {"size_m", "home_lat_deg"} & config.area.model_fields_set
    _check_inside(placed, found, blame.source, fixed=bool(given))
    return placed


def _known_map(radio: RadioConfig, blame: Blame) -> RadioConfig:
    """Add the SHA-256 of the radio map's file; refuse a file that differs from a given one."""
    if radio.map_file is None:
        return radio
    # A run that is resumed has its own configuration only: that may not be changed.
    back = "; put the map of radio.map_sha256 back there, or begin a new run without that key"
    try:
        content = read_of(
            partial(read_bytes, most=MOST_BYTES), "radio.map_file", str(radio.map_file), blame
        )
    except InputError as error:
        raise error.in_words(f"{error}{back if radio.map_sha256 else ''}") from None
    digest = hashlib.sha256(content).hexdigest()
    if radio.map_sha256 not in (None, digest):
        reason = f"{radio.map_file} has {digest}: it is another map{back}"
        raise SettingError("radio.map_sha256", radio.map_sha256, reason)
    return radio.model_copy(update={"map_sha256": digest})


def _places_of(config: RunConfig, index: int, blame: Blame) -> tuple[Place, ...]:
    """The places of one community; a file that names communities holds those of several."""
    community = config.communities[index]
    key = f"communities.{index}.positions_file"
    name = community.positions_file
    assert name is not None
    every = read_of(read_places, key, name, blame)
    names = list(dict.fromkeys(place.community for place in every))
    places = every if names == [None] else [p for p in every if p.community == community.name]

    def refuse(reason: str) -> SettingError:
        return SettingError(key, name, reason)

    known = [one.name for one in config.communities]
    lost = next((p for p in every if p.community not in (None, *known)), None)
    if lost is not None:
        allowed = ", ".join(map(repr, known))
        raise refuse(f"{lost.where}: community = {lost.community!r}: must be one of {allowed}")
    if None in names and len(names) > 1:
        lost = next(place for place in every if place.community is None)
        raise refuse(f"{lost.where}: names no community, as others in the file do")
    if not places:
        raise refuse(
            f"holds no device of community {community.name!r}, only of "
            f"{', '.join(repr(name) for name in names)}"
        )
    if "devices" in community.model_fields_set and len(places) != community.devices:
        reason = (
            f"{key} = {name!r} holds {len(places)} places of community {community.name!r}; leave "
            "devices out to have as many as there are"
        )
        raise SettingError(f"communities.{index}.devices", community.devices, reason)
    if len(places) > 1000:
        raise refuse(f"holds {len(places)} places; a community has 1000 devices at most")
    shares = [place for place in places if place.share is not None]
    if shares and len(shares) < len(places):
        lost = next(place for place in places if place.share is None)
        raise refuse(f"{lost.where}: has no share, as other devices of the community do")
    if shares and community.data_shares is not None:
        raise refuse(f"has shares, as communities.{index}.data_shares has: one of them, not both")
    return tuple(places)


def _placed(
    community: CommunityConfig, places: Sequence[Place], area: AreaConfig
) -> CommunityConfig:
    known: dict[str, Any] = {
        "positions_m": tuple(on_ground(place, area) for place in places),
        "positions_file": None,
        "devices": len(places),
    }
    if places[0].share is not None and community.partition in WEIGHED_PARTITIONS:
        known["data_shares"] = tuple(place.share for place in places)
    for name in ("data_shares", "compute_times_s"):
        given = known.get(name, getattr(community, name))
        if given is not None and len(given) != len(places):
            raise InputError(
                f"{places[0].where}: community {community.name!r} has {len(places)} places, but "
                f"{len(given)} {name}; there must be one for each"
            )
    return community.model_copy(update=known)


def _area(config: RunConfig, places: Sequence[Place], source: str) -> AreaConfig:
    """The area as configured; what is not given of it, from the extent of what stands there."""
    area, given = config.area, config.area.model_fields_set
    globe = [place for place in places if place.geodetic]
    known: dict[str, Any] = {}
    if globe:
        known |= _home_on_globe(area, globe, source)
    flat = [place.at for place in places if not place.geodetic]
    flat += [xy for c in config.communities for xy in c.positions_m or ()]
    home = area.model_copy(update={**known, "home_m": (0.0, 0.0)})
    offsets = np.array([on_ground(place, home) for place in globe]).reshape(-1, 2)
    if globe:
        named = {"home_lat_deg", "home_lon_deg"} <= given
        check_near(
            globe, offsets, source, home_words(home) if named else "the middle of all places"
        )
    if globe and not {"home_m", "home_lat_deg", "home_lon_deg"} <= given:
        # The extent lies in the middle of the area.
        low, high = offsets.min(axis=0), offsets.max(axis=0)
        size = (
            np.array(area.size_m)
            if "size_m" in given
            else np.ceil(high - low + 2 * _margin(high - low))
        )
        corner = (low + high) / 2.0 - size / 2.0
        known["size_m"] = _pair(size)
        if "home_m" in given:
            known |= _moved(home, corner + area.home_m)
            home = home.model_copy(update=known)
            offsets = np.array([on_ground(place, home) for place in globe])
        else:
            known["home_m"] = _pair(-corner)
    if "size_m" not in given and "size_m" not in known:
        shifted = offsets + np.array(known.get("home_m", area.home_m))
        every = np.vstack([np.array(flat).reshape(-1, 2), shifted])
        high = every.max(axis=0)
        size = np.ceil(high + _margin(np.ptp(every, axis=0)))
        known["size_m"] = _pair(np.clip(size, 1.0, None))
        if "home_m" not in given and "home_m" not in known:
            known["home_m"] = _pair(size / 2.0)
    if max(known.get("size_m", (0.0,))) > _LARGEST_M:
        raise InputError(
            f"{source}: area.size_m: {_extremes(config, places)} lie so far apart that the area "
            f"around all places, margins counted, has {max(known['size_m']) / 1000:.1f} km; "
            f"{_LARGEST_M / 1000:.0f} km at most are allowed"
        )
    return area.model_copy(update=known)


def _extremes(config: RunConfig, places: Sequence[Place]) -> str:
    """The two that lie farthest apart along one of the axes, in words."""
    every = [(place.where, place.at) for place in places]
    every += [
        (f"communities.{index}.positions_m.{device}", at)
        for index, community in enumerate(config.communities)
        for device, at in enumerate(community.positions_m or ())
    ]
    at = np.array([one for _, one in every])
    axis = int(np.ptp(at, axis=0).argmax())
    first, last = sorted((int(at[:, axis].argmin()), int(at[:, axis].argmax())))
    return " and ".join(f"{every[i][0]} ({at[i, 0]:g}, {at[i, 1]:g})" for i in (first, last))


def _home_on_globe(area: AreaConfig, globe: Sequence[Place], source: str) -> dict[str, float]:
    """Home's latitude and longitude: as given, else in the middle of the places."""
    keys = {"home_lat_deg", "home_lon_deg"}
    named = keys & area.model_fields_set
    if named == keys:
        return {}
    if named:
        other = (keys - named).pop()
        raise InputError(
            f"{source}: area.{other}: missing; home_lat_deg and home_lon_deg are given both, or "
            "neither, to have home in the middle of the devices"
        )
    degrees = np.array([place.at for place in globe])
    lat, lon = ((degrees.min(axis=0) + degrees.max(axis=0)) / 2.0).tolist()
    return {"home_lat_deg": round(lat, 7), "home_lon_deg": round(lon, 7)}


def _moved(area: AreaConfig, by_m: Floats) -> dict[str, float]:
    """Latitude and longitude of what lies so far east and north of home, which is at (0, 0)."""
    built = area.build()
    place = built.frame.to_geodetic(built.to_ned(by_m, 0.0))
    return {"home_lat_deg": round(place.lat_deg, 7), "home_lon_deg": round(place.lon_deg, 7)}


def _margin(extent: Floats) -> float:
    return max(_LEAST_MARGIN_M, _MARGIN * float(np.max(extent)))


def _pair(values: Floats) -> Pair:
    x, y = (round(float(value), 3) for value in values)
    return x, y


def _check_inside(
    config: RunConfig, found: dict[int, tuple[Place, ...]], source: str, *, fixed: bool
) -> None:
    """Refuse devices outside the area; `fixed` says whether its size or place was given."""
    width, height = config.area.size_m
    for index, community in enumerate(config.communities):
        for device, (x, y) in enumerate(community.positions_m or ()):
            if not (0.0 <= x <= width and 0.0 <= y <= height):
                key = f"communities.{index}.positions_m.{device}"
                where = found[index][device].where if index in found else f"{source}: {key}"
                allowed = (
                    f", outside the area: x must be from 0 to {width:g}, y from 0 to {height:g} m "
                    "from its south-west corner (area.size_m)"
                    if fixed or min(x, y) >= 0.0
                    else ": x and y must be 0 or more, from the area's south-west corner; add the "
                    "same to all places"
                )
                raise InputError(f"{where}: a device at x = {x:.1f}, y = {y:.1f} m{allowed}")
