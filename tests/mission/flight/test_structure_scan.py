"""A structure scan of QGroundControl: the items that it makes of one, which the file leaves out."""

import json
from pathlib import Path

import pymap3d
import pytest
from pymavlink.dialects.v20 import common as mav
from test_planfile import simple

from mission.flight.missions.plan_file import read_plan_file

SOUTH, NORTH, WEST, EAST = 47.4005, 47.4008, 8.5, 8.5005


@pytest.mark.parametrize(("top", "heights_m"), [(False, (15.0, 25.0)), (True, (25.0, 15.0))])
def test_it_goes_round_a_building_once_a_layer(
    tmp_path: Path, top: bool, heights_m: tuple[float, float]
) -> None:
    scan = {
        "type": "ComplexItem", "complexItemType": "StructureScan", "version": 3,
        "CameraCalc": {
            "AdjustedFootprintFrontal": 10, "AdjustedFootprintSide": 12, "DistanceToSurface": 15,
            "CameraName": "Manual (no camera specs)", "DistanceMode": 1, "version": 2,
        },
        "EntranceAltitude": 40, "ScanBottomAlt": 10, "StructureHeight": 30, "StartFromTop": top,
        "Layers": 2, "GimbalPitch": -20,
        "polygon": [[SOUTH, WEST], [SOUTH, EAST], [NORTH, EAST], [NORTH, WEST]],
    }  # fmt: skip
    take_off = simple(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, None, 47.4, 8.5, 20)
    path = tmp_path / "scan.plan"
    path.write_text(json.dumps({
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl",
        "mission": {
            "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5,
            "plannedHomePosition": [47.4, 8.5, 400], "items": [take_off, scan],
        },
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
    }))  # fmt: skip
    items = read_plan_file(path).items[1:]
    place, trigger = mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST
    ring = [place, trigger, *[place] * 4, trigger]
    looks = mav.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET, mav.MAV_CMD_DO_SET_ROI_NONE
    assert [item.command for item in items] == [place, looks[0], *ring, *ring, looks[1], place]
    assert (*items[1].params[1:], items[1].x, items[1].y, items[1].z) == pytest.approx(
        (0, 0, 0, -20, 0, 90)
    )
    every = [item.params[0] for item in items if item.command == trigger]
    assert every == [12, 0, 12, 0]  # metres between pictures; 0: none any more
    flown = [item for item in items if item.command == place]
    low_m, high_m = heights_m
    assert [item.z for item in flown] == [40, *[low_m] * 5, *[high_m] * 5, 40]
    # 15 m outside of every wall, from the first corner round to it.
    corners = [(SOUTH, WEST), (SOUTH, EAST), (NORTH, EAST), (NORTH, WEST), (SOUTH, WEST)]
    away = [(-15, -15), (-15, 15), (15, 15), (15, -15), (-15, -15)]
    wanted = [away[0], *away, *away, away[0]]
    seen = [corners[0], *corners, *corners, corners[0]]
    for item, corner, offset in zip(flown, seen, wanted, strict=True):
        north_m, east_m, _ = pymap3d.geodetic2ned(item.x, item.y, 0.0, *corner, 0.0)
        assert (float(north_m), float(east_m)) == pytest.approx(offset, abs=0.05)
