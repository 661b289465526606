"""What a viewer shows: its panels, and in 3D and on the map ground, devices, links, plan."""

import json
import math
from collections.abc import Mapping, Sequence
from importlib.resources import files
from string import Template

import numpy as np
from foxglove import messages as fox

from mission.base import palette
from mission.base.airspace import triangles
from mission.base.area import Area, on_globe
from mission.base.arrays import Floats
from mission.log.messages import encoded, feature, geojson, timestamp
from mission.log.records import UplinkRecord
from mission.log.topics import FRAME
from mission.log.values import Devices, PlanRecord, Zone

LAYOUT = "foxglove-layout.json"
_MAP_PX = 300  # what the map panel has to spare on an ordinary screen
_WORLD_PX = 256  # of a web map at zoom 0
_EQUATOR_M = 40_075_017.0
_LINK_SHOWN = fox.Duration(4)  # simulated time for which a link stays in the picture
_DEVICE_SIZE_M = (8.0, 22.0)  # smallest and largest importance
_LABEL_M = 18.0  # so far above what it names that it does not hide it
_BODY_M = 3.0  # of an aircraft among several, and of the arms of a cross
_TURN = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
_OCTAGON = np.column_stack((np.cos(_TURN), np.sin(_TURN)))  # (8, 2) what a disc is on the map


def ground(t_ns: int, area: Area, fence: Sequence[Zone]) -> bytes:
    """SceneUpdate of the area's edge, the take-off point and the fence."""
    width, height = area.size_m
    corners = np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
    edge = _line(corners, palette.PLANNED, 2.0, closed=True)
    home = fox.CylinderPrimitive(
        pose=_at(*area.home_m, 0.1),
        size=fox.Vector3(x=12.0, y=12.0, z=0.2),
        bottom_scale=1.0,
        top_scale=1.0,
        color=_colour(palette.rgb(palette.PLANNED), 0.9),
    )
    return _update(
        [
            _entity(t_ns, "area", lines=[edge]),
            _entity(t_ns, "home", cylinders=[home], texts=[_label(*area.home_m, _LABEL_M, "home")]),
            *(_zone(t_ns, f"fence {index}", zone) for index, zone in enumerate(fence)),
        ]
    )


def _zone(t_ns: int, name: str, zone: Zone) -> object:
    """Scene entity of a fence zone: its outline on the ground, and a label at its first corner."""
    x, y = zone.outline_m[0].tolist()
    return _entity(
        t_ns,
        name,
        lines=[_line(zone.outline_m, palette.FENCE, 3.0, closed=True)],
        texts=[_label(x, y, 8.0, "fence" if zone.keep_in else "no-fly area")],
        metadata=[fox.KeyValuePair(key="keep", value="in" if zone.keep_in else "out")],
    )


def buildings(t_ns: int, area: Area) -> bytes:
    """SceneUpdate of what stands in the area: walls and flat roofs."""
    wall, roof = (_colour(palette.rgb(colour), 1.0) for colour in (palette.WALL, palette.ROOF))
    walls: list[Floats] = []
    roofs: list[Floats] = []
    for building in area.buildings:
        for ring in building.outlines_m:
            foot = np.column_stack((ring, np.full(len(ring), building.from_m)))
            top = np.column_stack((ring, np.full(len(ring), building.height_m)))
            foot2, top2 = np.roll(foot, -1, axis=0), np.roll(top, -1, axis=0)
            walls += [np.stack((foot, foot2, top2, foot, top2, top), axis=1).reshape(-1, 3)]
        flat = triangles(building.outlines_m).reshape(-1, 2)
        roofs += [np.column_stack((flat, np.full(len(flat), building.height_m)))]
    parts = [
        fox.TriangleListPrimitive(
            pose=_at(0.0, 0.0, 0.0),
            points=[fox.Point3(x=x, y=y, z=z) for x, y, z in np.vstack(corners).tolist()],
            color=colour,
        )
        for corners, colour in ((walls, wall), (roofs, roof))
    ]
    return _update([_entity(t_ns, "buildings", triangles=parts)])


def devices(t_ns: int, world: Devices, importance: Floats) -> bytes:
    """SceneUpdate of the devices: colour says community, size says importance."""
    sizes_m = _sizes_m(importance)
    entities = []
    for k, (xy, community) in enumerate(zip(world.pos_m.tolist(), world.community_of, strict=True)):
        size = sizes_m[k]
        colour = palette.rgb(palette.community_colour(int(community)))
        body = fox.SpherePrimitive(
            pose=_at(xy[0], xy[1], size / 2),
            size=fox.Vector3(x=size, y=size, z=size),
            color=_colour(colour, 1.0),
        )
        facts = {
            "device": str(k),
            "community": world.community[k],
            "importance": repr(float(importance[k])),
        }
        entities.append(
            _entity(
                t_ns,
                f"device {k}",
                spheres=[body],
                texts=[_label(xy[0], xy[1], size + _LABEL_M, str(k))],
                metadata=[fox.KeyValuePair(key=key, value=value) for key, value in facts.items()],
            )
        )
    return _update(entities)


def _sizes_m(importance: Floats) -> list[float]:
    """Return the devices' diameters (m), which grow with the square root of importance."""
    largest = float(importance.max(initial=0.0))
    small, large = _DEVICE_SIZE_M
    shares = (float(item) / largest if largest > 0 else 0.0 for item in importance)
    return [small + (large - small) * math.sqrt(max(share, 0.0)) for share in shares]


def link(t_ns: int, record: UplinkRecord, world: Devices) -> bytes:
    """SceneUpdate of one transmission: colour says true PER, a thin line that it was lost."""
    x, y = world.pos_m[record.device].tolist()
    line = fox.LinePrimitive(
        type=fox.LinePrimitiveLineType.LineStrip,
        thickness=4.0 if record.delivered else 1.5,
        scale_invariant=True,
        points=[
            fox.Point3(x=record.true_x_m, y=record.true_y_m, z=record.true_alt_m),
            fox.Point3(x=x, y=y, z=0.0),
        ],
        color=_colour(palette.per_colour(record.true_per), 0.95),
    )
    entity = _entity(t_ns, f"link {record.device}", lines=[line], lifetime=_LINK_SHOWN)
    return _update([entity])


def plan_map(area: Area, world: Devices, fence: Sequence[Zone], plan: PlanRecord) -> bytes:
    """GeoJson of the devices, the planned path and the fence, for the map panel.

    Devices are discs: of a point viewers make a pin, which has no colour and hides the path.
    """
    features: list[Mapping[str, object]] = [
        feature(
            "LineString",
            _lonlat(area, plan.route_m, plan.altitude_m),
            name=f"round {plan.round}: plan",
            style={"color": palette.PLANNED, "weight": 3},
        )
    ]
    sizes_m = _sizes_m(plan.importance)
    for k, community in enumerate(world.community_of):
        ring = _ring(area, world.pos_m[k] + sizes_m[k] / 2 * _OCTAGON)
        style = {"color": palette.community_colour(int(community)), "fillOpacity": 0.9}
        name = f"device {k} ({world.community[k]})"
        features.append(feature("Polygon", [ring], name=name, style=style))
    for zone in fence:
        style = {"color": palette.FENCE, "weight": 2}
        name = "fence" if zone.keep_in else "no-fly area"
        ring = _ring(area, zone.outline_m)
        features.append(feature("LineString", ring, name=name, style=style))
    return encoded(fox.GeoJson(geojson=geojson(features)))


def world(
    t_ns: int,
    paths: Sequence[tuple[str, str, float, Floats]],
    crosses: Sequence[tuple[Floats, str]],
) -> bytes:
    """SceneUpdate of several aircraft: paths (name, colour, width, points) and, in the frame that
    is called like it, a body of each; crosses with what they say."""
    entities = []
    for name, colour in dict.fromkeys((name, colour) for name, colour, _, _ in paths):
        lines = [_line(points, colour, width) for of, _, width, points in paths if of == name]
        entities.append(_entity(t_ns, f"paths of {name}", lines=lines))
        body = fox.SpherePrimitive(
            pose=_at(0.0, 0.0, 0.0),
            size=fox.Vector3(x=_BODY_M, y=_BODY_M, z=_BODY_M),
            color=_colour(palette.rgb(colour), 1.0),
        )
        label = _label(0.0, 0.0, 2 * _BODY_M, name)
        entities.append(_entity(t_ns, name, frame=name, spheres=[body], texts=[label]))
    for (x, y, z), words in crosses:
        arms = [
            _line(np.array([[x, y, z - _BODY_M], [x, y, z + _BODY_M]]) + turn, palette.FENCE, 3.0)
            for side in (-_BODY_M, _BODY_M)
            for turn in (np.array([[side, 0.0, 0.0], [-side, 0.0, 0.0]]),)
        ]
        entities.append(_entity(t_ns, words, lines=arms, texts=[_label(x, y, z + _LABEL_M, words)]))
    return _update(entities)


def _ring(area: Area, corners_m: Floats) -> list[tuple[float, float]]:
    """Return the closed ring of corners (n, 2), in area metres, as longitude and latitude."""
    around = _lonlat(area, corners_m, 0.0)
    return [*around, around[0]]


def _lonlat(area: Area, xy_m: Floats, alt_rel_m: float) -> list[tuple[float, float]]:
    points = on_globe(area, xy_m, alt_rel_m)
    return [(round(p.lon_deg, 8), round(p.lat_deg, 8)) for p in points]  # 1 mm


def _at(x: float, y: float, z: float) -> object:
    return fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=fox.Quaternion(w=1.0))


def _line(points_m: Floats, colour: str, width: float, *, closed: bool = False) -> object:
    """A line through (n, 2 or 3) points; those of two numbers lie on the ground."""
    kinds, flat = fox.LinePrimitiveLineType, 3 - points_m.shape[1]
    points_m = np.pad(points_m, ((0, 0), (0, flat)))
    return fox.LinePrimitive(
        type=kinds.LineLoop if closed else kinds.LineStrip,
        thickness=width,
        scale_invariant=True,
        points=[fox.Point3(x=x, y=y, z=z) for x, y, z in points_m.tolist()],
        color=_colour(palette.rgb(colour), 0.9),
    )


def _label(x: float, y: float, z: float, text: str) -> object:
    return fox.TextPrimitive(
        pose=_at(x, y, z),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=_colour(palette.rgb(palette.FLOWN), 1.0),
        text=text,
    )


def _colour(rgb: palette.RGB, alpha: float) -> object:
    return fox.Color(r=rgb[0], g=rgb[1], b=rgb[2], a=alpha)


def _entity(t_ns: int, name: str, frame: str = FRAME, **parts: object) -> object:
    return fox.SceneEntity(timestamp=timestamp(t_ns), frame_id=frame, id=name, **parts)


def _update(entities: Sequence[object]) -> bytes:
    return encoded(fox.SceneUpdate(entities=list(entities)))


def layout(area: Area, communities: Sequence[str]) -> bytes:
    """The layout that fits our topics, in the JSON of Foxglove's SDK: scene, map, log; modes,
    learning, links, flight, estimator, battery.

    It goes into every log as an attachment; `aerofed log export FILE --to attachments` takes it
    out. What does not depend on the run stands in `foxglove-layout.json`. Without communities, as
    in a flight of a plan file, it has no learning and no links.
    """
    text = Template(files(__package__).joinpath(LAYOUT).read_text(encoding="utf-8"))
    document = json.loads(text.safe_substitute(planned=palette.PLANNED, flown=palette.FLOWN))
    seen, numbers = (item["content"]["items"] for item in document["content"]["items"])
    width, height = area.size_m
    seen[0]["content"]["config"]["cameraState"] |= {
        "distance": 1.3 * max(width, height),
        "targetOffset": [width / 2, height / 2, 0.0],
        "far": 20 * max(width, height),
    }
    seen[1]["content"]["items"][0]["content"]["config"]["zoomLevel"] = _zoom(area)
    learning = numbers[1]["content"]["config"]
    learning["paths"] = [
        _of_community(learning["paths"][0], name, palette.community_colour(index))
        for index, name in enumerate(communities)
    ]
    if not communities:
        del numbers[1:3]
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()


def _of_community(series: dict[str, str], name: str, colour: str) -> dict[str, str]:
    value = series["value"].replace("$name", name)
    return series | {"color": colour, "label": name, "value": value}


def _zoom(area: Area) -> int:
    """Zoom level of the map at which the area fits about the take-off point, its centre."""
    reach_m = max(
        max(home, size - home) for home, size in zip(area.home_m, area.size_m, strict=True)
    )
    parallel_m = _EQUATOR_M * math.cos(math.radians(area.home.lat_deg))
    zoom = math.log2(parallel_m / _WORLD_PX * _MAP_PX / (2 * reach_m))
    return min(max(math.floor(zoom), 0), 19)
