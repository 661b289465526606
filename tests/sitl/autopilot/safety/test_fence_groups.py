"""Areas to stay in by group, and areas that are none.

common.xml: "Vehicle must be inside ALL inclusion zones in a single group, vehicle must be inside at
least one group, must be the same for all points in each polygon".
"""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.fence import Fence, compile_fence

VERTEX = {
    True: mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    False: mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
}
CIRCLE = {
    True: mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    False: mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
}
FRAME = LocalFrame(HOME)

Points = Sequence[tuple[float, float]]  # metres north and east
WEST: Points = ((-50, -50), (150, -50), (150, 50), (-50, 50))
EAST: Points = ((-50, -20), (150, -20), (150, 120), (-50, 120))
BOTH, WEST_ALONE, EAST_ALONE, NEITHER = (60.0, 0.0), (60.0, -40.0), (60.0, 90.0), (60.0, 200.0)


def fence_item(command: int, at: tuple[float, float], *params: float) -> MissionItem:
    place = FRAME.to_geodetic(np.array([*at, 0.0]))
    four = (*params, *[0.0] * (4 - len(params)))
    return MissionItem(
        0, command, mav.MAV_FRAME_GLOBAL, (four[0], four[1], four[2], four[3]),
        round(place.lat_deg, 7), round(place.lon_deg, 7), 0.0, mav.MAV_MISSION_TYPE_FENCE,
    )  # fmt: skip


def polygon(corners: Points, group: float = 0.0, *, inside: bool = True) -> list[MissionItem]:
    return [fence_item(VERTEX[inside], at, len(corners), group) for at in corners]


def upload(desk: Desk, *items: MissionItem) -> int | None:
    """Send a list of items; their places are theirs, and they are counted anew."""
    sent = [
        mav.MAVLink_mission_item_int_message(
            1, 1, seq, i.frame, i.command, 0, 1, *i.params, round(i.x * 1e7), round(i.y * 1e7),
            i.z, i.mission_type,
        )
        for seq, i in enumerate(items)
    ]  # fmt: skip
    return desk.upload(sent, mav.MAV_MISSION_TYPE_FENCE)


def forbidden(desk: Desk, at: tuple[float, float]) -> str:
    return desk.vehicle.autopilot.flight.guard.forbidden(np.array([*at, -30.0]))


@pytest.mark.parametrize(
    ("groups", "allowed"),
    [
        ((0, 0), {BOTH}),
        ((3, 3), {BOTH}),
        ((0, 1), {BOTH, WEST_ALONE, EAST_ALONE}),
        ((0, math.nan), {BOTH}),  # left open
    ],
)
def test_areas_are_all_of_a_group_or_those_of_another(
    groups: tuple[float, float], allowed: set[tuple[float, float]]
) -> None:
    desk = Desk()
    items = [*polygon(WEST, groups[0]), *polygon(EAST, groups[1])]
    assert upload(desk, *items) == mav.MAV_MISSION_ACCEPTED
    found = {at for at in (BOTH, WEST_ALONE, EAST_ALONE, NEITHER) if forbidden(desk, at) == ""}
    assert found == allowed


def test_circles_and_polygons_of_a_group_are_one() -> None:
    desk = Desk()
    circle = fence_item(CIRCLE[True], (60, 35), 60, 1)
    assert upload(desk, *polygon(WEST, 1), circle, *polygon(EAST, 2)) == 0
    assert forbidden(desk, (60, -40)) == "outside the fence"
    assert forbidden(desk, (60, -24)) == ""
    assert forbidden(desk, (60, 94)) == ""
    alone = fence_item(CIRCLE[False], (60, 0), 5)
    assert upload(desk, circle, alone, *polygon(WEST, 1)) == mav.MAV_MISSION_ACCEPTED
    assert forbidden(desk, (60, 0)) == "inside an excluded area"
    assert forbidden(desk, (60, 94)) == "outside the fence"


def test_who_leaves_one_area_of_the_group_is_held() -> None:
    desk = Desk()
    assert upload(desk, *polygon(WEST), *polygon(EAST)) == mav.MAV_MISSION_ACCEPTED
    desk.take_off(30.0)
    desk.upload([item(0, mav.MAV_CMD_NAV_WAYPOINT, north=60.0, east=90.0)])
    assert desk.vehicle.autopilot.flight.fly_mission() == "the mission leads outside the fence"


def random_areas(rng: np.random.Generator) -> list[tuple[bool, int, list[MissionItem]]]:
    """Up to six areas: whether to keep inside, the group, its items."""
    areas = []
    for _ in range(rng.integers(1, 7)):
        middle, inside, group = rng.uniform(-30, 30, 2), rng.random() < 0.8, int(rng.integers(3))
        if rng.random() < 0.4:
            radius_m = float(np.float32(rng.uniform(5, 60)))
            at = (float(middle[0]), float(middle[1]))
            items = [fence_item(CIRCLE[inside], at, radius_m, group * inside)]
        else:
            turn = np.sort(rng.uniform(0, math.tau, 7))
            rays = rng.uniform(5, 70, 7)[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
            if not shapely.Polygon(rays).is_valid:
                continue
            corners = [(float(n), float(e)) for n, e in middle + rays]
            items = polygon(corners, group * inside, inside=inside)
        areas.append((inside, group, items))
    return areas


def shape_of(items: list[MissionItem]) -> shapely.Geometry:
    corners = [FRAME.to_ned(i.x, i.y, HOME.alt_msl_m)[:2] for i in items]
    if len(items) == 1:
        return shapely.Point(corners[0]).buffer(items[0].params[0], quad_segs=200)
    return shapely.Polygon(corners)


def test_breaches_are_those_of_set_operations() -> None:
    """Intersection within groups, union of groups, without what is excluded."""
    seen = Counter[str]()
    for seed in range(150):
        rng = np.random.default_rng(seed)
        areas = random_areas(rng)
        fence = compile_fence([item for *_, items in areas for item in items], FRAME)
        groups: dict[int, list[shapely.Geometry]] = {}
        without: list[shapely.Geometry] = []
        for inside, group, items in areas:
            (groups.setdefault(group, []) if inside else without).append(shape_of(items))
        free = shapely.box(-500, -500, 500, 500)
        if groups:
            free = shapely.union_all([shapely.intersection_all(each) for each in groups.values()])
        free = free.difference(shapely.union_all(without))
        edges = shapely.union_all([shape_of(items).boundary for *_, items in areas])
        for point in rng.uniform(-80, 80, (40, 2)):
            if edges.distance(shapely.Point(point)) < 0.05:  # of a circle's corners
                continue
            breach = fence.breach(np.array([*point, -10.0]))
            assert (breach == "") == free.contains(shapely.Point(point)), (seed, point)
            seen[breach] += 1
        seen["several groups"] += len(groups) > 1
    assert seen["several groups"] > 50
    assert min(seen[text] for text in ("", "outside the fence", "inside an excluded area")) > 100


def test_of_many_points_one_is_enough() -> None:
    fence = Fence((np.array(WEST, dtype=float), np.array(EAST, dtype=float)), groups=(1, 0))
    way = np.array([(*WEST_ALONE, 0.0), (*EAST_ALONE, 0.0)])
    assert fence.breach(way) == ""
    assert fence.breach(np.vstack((way, [(*NEITHER, 0.0)]))) == "outside the fence"


BOW: Points = (WEST[0], WEST[2], WEST[1], WEST[3])
FLAT: Points = ((0, 0), (0, 40), (0, 90))
INVALID = mav.MAV_MISSION_INVALID


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize(
    ("corners", "text"),
    [
        (BOW, "fence area 1 (points 4 to 7) crosses itself: its edges 4-5 and 6-7 meet"),
        ((WEST[0], WEST[0], WEST[0]), "fence area 1 (points 4 to 6) has no area"),
    ],
)
def test_what_is_no_area_is_refused(corners: Points, text: str, *, inside: bool) -> None:
    desk = Desk()
    assert upload(desk, *polygon(EAST)) == mav.MAV_MISSION_ACCEPTED
    assert upload(desk, *polygon(EAST), *polygon(corners, inside=inside)) == INVALID
    assert text in "".join(desk.texts())
    assert forbidden(desk, EAST_ALONE) == ""
    assert forbidden(desk, NEITHER) == "outside the fence", "the fence before stays"


@pytest.mark.parametrize("lon_deg", [HOME.lon_deg, 179.9999])
def test_corners_on_one_parallel_are_no_area(lon_deg: float) -> None:
    """In metres they lie on a curve; across longitude 180 they are beside each other."""
    wide = [
        MissionItem(
            seq, VERTEX[True], 0, (3.0, 0.0, 0.0, 0.0), HOME.lat_deg,
            (lon_deg + d + 180) % 360 - 180, 0.0, 1,
        )
        for seq, d in enumerate((0.0, 0.01, 0.02))
    ]  # fmt: skip
    desk = Desk()
    assert upload(desk, *wide) == INVALID
    assert "its corners lie on one line" in "".join(desk.texts())


def test_a_corner_named_twice_is_one() -> None:
    desk = Desk()
    assert upload(desk, *polygon((*WEST, WEST[3], WEST[0]))) == mav.MAV_MISSION_ACCEPTED
    assert [bool(forbidden(desk, at)) for at in (BOTH, EAST_ALONE)] == [False, True]


def test_a_polygon_has_one_group() -> None:
    desk = Desk()
    items = [*polygon(WEST)[:3], *polygon(WEST, 1)[3:]]
    assert upload(desk, *items) == mav.MAV_MISSION_INVALID_PARAM2
    assert "fence area 0 (points 0 to 3) has points of several groups" in "".join(desk.texts())


@pytest.mark.parametrize("other", [mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION, None])
def test_a_polygons_points_agree(other: int | None) -> None:
    desk = Desk()
    stray = fence_item(other or VERTEX[True], WEST[3], 4.0 if other else 5.0)
    assert upload(desk, *polygon(WEST)[:3], stray) == mav.MAV_MISSION_INVALID_PARAM1
    assert "fence item 0: a polygon of 4 corners is needed" in "".join(desk.texts())


@pytest.mark.parametrize("group", [-1.0, 0.5, 256.0, math.inf])
@pytest.mark.parametrize("command", [VERTEX[True], CIRCLE[True]])
def test_a_group_is_a_whole_number(command: int, group: float) -> None:
    assert upload(Desk(), fence_item(command, WEST[0], 4.0, group)) == (
        mav.MAV_MISSION_INVALID_PARAM2
    )


@pytest.mark.parametrize("command", [VERTEX[False], CIRCLE[False]])
def test_what_is_excluded_has_no_group(command: int) -> None:
    assert upload(Desk(), fence_item(command, WEST[0], 4.0, 1.0)) == mav.MAV_MISSION_INVALID_PARAM2


@pytest.mark.parametrize("radius_m", [0.0, -5.0, math.nan, math.inf])
@pytest.mark.parametrize("inside", [True, False])
def test_a_circle_has_a_radius(radius_m: float, *, inside: bool) -> None:
    item = fence_item(CIRCLE[inside], WEST[0], radius_m)
    assert upload(Desk(), item) == mav.MAV_MISSION_INVALID_PARAM1
