"""The fence: from the autopilot's terms into the log, and onto every map."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pymap3d
import pytest
from described import charts, described, keys, tables
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pymavlink.dialects.v20 import common as mav
from synthetic_flight import AREA, fly_anew

from mission.analysis.load import load_run
from mission.figures.maps import overview
from mission.flight.missions.geofence import fence_of
from mission.log.export import export_kml
from mission.log.reader import read_log
from mission.log.values import Zone
from mission.report.page import write_report
from native.errors import InputError
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.parameters import Parameters

HOME = AREA.home
SQUARE = np.array([(100.0, 100.0), (300.0, 100.0), (300.0, 250.0), (100.0, 250.0)])  # x, y


def corner(seq: int, x: float, y: float, *, count: float = 4) -> MissionItem:
    lat, lon, _ = pymap3d.ned2geodetic(
        y - AREA.home_m[1], x - AREA.home_m[0], 0, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m
    )
    return MissionItem(
        seq, mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION, 3, (count, 0, 0, 0), float(lat),
        float(lon), 0.0, mav.MAV_MISSION_TYPE_FENCE, True,
    )  # fmt: skip


def parameters(**values: float) -> Parameters:
    found = Parameters()
    found.apply(values, "test")
    return found


def zones() -> tuple[Zone, ...]:
    items = [corner(seq, *xy) for seq, xy in enumerate(SQUARE.tolist())]
    return fence_of(items, parameters(GF_MAX_HOR_DIST=500), AREA)


def test_it_lies_where_the_autopilot_has_it() -> None:
    square, circle = zones()
    assert (square.keep_in, circle.keep_in) == (False, True)
    np.testing.assert_allclose(square.outline_m, SQUARE, atol=0.01)
    away = np.linalg.norm(circle.outline_m - AREA.home_m, axis=1)
    np.testing.assert_allclose(away, 500, atol=1e-6)


def test_without_one_or_switched_off_there_is_none() -> None:
    assert fence_of((), parameters(), AREA) == ()
    assert fence_of((), parameters(GF_MAX_HOR_DIST=500, GF_ACTION=0), AREA) == ()
    with pytest.raises(InputError, match="fence item 0: a polygon of 5 corners"):
        fence_of([corner(seq, *xy, count=5) for seq, xy in enumerate(SQUARE.tolist())],
                 parameters(), AREA)  # fmt: skip


@pytest.mark.slow
def test_log_scene_map_kml_report_and_figure_have_it(tmp_path: Path) -> None:
    made = fly_anew(tmp_path, rounds=1, fence=zones())
    found = read_log(made.log).fence
    assert [zone.keep_in for zone in found] == [True, False]
    np.testing.assert_allclose(found[1].outline_m, SQUARE, atol=0.01)
    seen = {}
    with made.log.open("rb") as stream:
        for _, channel, _, message in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages(["/scene/ground", "/plan/map"]):
            seen[channel.topic] = message
    loops = {e.id: e.lines[0] for e in seen["/scene/ground"].entities if e.id.startswith("fence")}
    assert [(p.x, p.y) for p in loops["fence 0"].points] == pytest.approx(SQUARE, abs=0.01)
    names = [f["properties"]["name"] for f in json.loads(seen["/plan/map"].geojson)["features"]]
    assert {"fence", "no-fly area"} <= set(names)
    kml = ET.parse(export_kml(made.log, tmp_path / "a.kml")).getroot()
    assert "no-fly area" in [node.text for node in kml.iter("{http://www.opengis.net/kml/2.2}name")]
    page = write_report(made.log).read_text(encoding="utf-8")
    shown = next(spec for title, spec in charts(page).items() if title.startswith("round 1"))
    kinds = {row["kind"] for table in tables(shown, "kind", "part") for row in table}
    assert {"fence", "no-fly area"} <= kinds
    assert keys(described(overview(load_run(made.log).data, "run")))["stroke"] == [
        "area", "fence", "no-fly area",
    ]  # fmt: skip
