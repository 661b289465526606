"""Heights are above home on the globe, however far from it: the plane that touches the globe there
is 5 m higher at 8 km."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pymap3d
import pytest
from made_up_logs import HOME as PX4_HOME
from made_up_logs import write_ulog
from one_aircraft import one_path, round_problem
from synthetic_flight import AREA, CHANNEL, HOME
from test_compare import WORLD, record, vehicle

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from mission.analysis.compare import compare_run
from mission.analysis.load import load_run
from mission.cli import call
from mission.commands.options import load
from mission.flight.flyers.unflown import UnflownFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.log.reader import read_log
from mission.log.writer import FlightLog
from mission.planner.flyable import Stop
from sitl.observer import VehicleObserver, VehicleSample

HEIGHT_M, FAR_M = 60.0, 8000.0


@pytest.fixture(scope="module")
def far(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a round due north-east, 60 m above home's height on the ellipsoid all the way."""
    path = tmp_path_factory.mktemp("far") / "flight.mcap"
    shares = np.linspace(0.0, 1.0, 401)
    waypoints = np.array([AREA.home_m, np.add(AREA.home_m, FAR_M / np.sqrt(2))])
    problem = round_problem(WORLD.pos_m, np.array([0.5, 0.25]), waypoints[0], 2, 1, 9e3, CHANNEL)
    with FlightLog(path, area=AREA, devices=WORLD) as log:
        plan = one_path(waypoints, np.zeros((2, 2), dtype=bool), 0.0, 0.0)
        log.plan(0, 0, problem, plan, speed_mps=20.0)
        for share in shares:
            away_m = share * FAR_M / np.sqrt(2)
            lat, lon, _ = pymap3d.ned2geodetic(
                away_m, away_m, 0.0, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m
            )
            ned = np.array(
                pymap3d.geodetic2ned(
                    lat, lon, HOME.alt_msl_m + HEIGHT_M,
                    HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m,
                )
            )  # fmt: skip
            log.sampled(vehicle(round(share * FAR_M / 20.0 * 1e9), ned, ned))
        log.round(replace(record(), start_t_s=0.0, duration_s=FAR_M / 20.0))
    return path


def test_a_perfect_flight_far_away_keeps_its_height(far: Path) -> None:
    total = compare_run(load_run(far)).total
    assert total.height_max_m < 0.01
    assert total.cross_track_max_m < 0.1


@pytest.mark.parametrize(("north_m", "east_m"), [(8e3, 0.0), (0.0, 8e3), (-9e3, 4e3)])
@pytest.mark.parametrize("lat_deg", [0.0, 43.6, -80.0])
def test_the_plane_lies_above_the_globe_as_far_as_geodesy_says(
    lat_deg: float, north_m: float, east_m: float
) -> None:
    frame = LocalFrame(GeodeticPoint(lat_deg, 7.0, 130.0))
    *_, height_m = pymap3d.ned2geodetic(north_m, east_m, 0.0, lat_deg, 7.0, 130.0)
    drop_m = frame.drop_m(np.array([north_m]), np.array([east_m]))
    assert drop_m == pytest.approx([height_m - 130.0], abs=0.001)


def test_what_is_exported_has_the_same_heights(far: Path, tmp_path: Path) -> None:
    for form, end in (("geojson", "geojson"), ("ulog", "ulg")):
        out = tmp_path / f"x.{end}"
        assert call(["log", "export", str(far), "--to", form, "--out", str(out)]) == 0
    features = json.loads((tmp_path / "x.geojson").read_text())["features"]
    flown = [f for f in features if f["geometry"]["type"] == "LineString"]
    heights = [row[2] for f in flown for row in f["geometry"]["coordinates"] if len(row) == 3]
    assert heights
    assert heights == pytest.approx([HOME.alt_msl_m + HEIGHT_M] * len(heights), abs=0.02)
    ulog = load_run(tmp_path / "x.ulg").data
    np.testing.assert_allclose(ulog.belief.pos_m[:, 2], HEIGHT_M, atol=0.02)
    np.testing.assert_allclose(read_log(far).belief.pos_m[:, 2], HEIGHT_M, atol=0.01)


def test_a_foreign_log_is_exported_as_high_as_it_says(tmp_path: Path) -> None:
    """Positions at home's altitude and 30 m, from home to 8 km north of it."""
    frame, rows = LocalFrame(PX4_HOME), []
    for step in range(400):
        at = frame.to_geodetic(np.array([20.0 * step, 0.0, 0.0]))
        rows.append((0.1 * step, at.lat_deg, at.lon_deg, PX4_HOME.alt_msl_m + 30.0))
    topic = {"vehicle_global_position": ("double lat;double lon;float alt", "ddf", rows)}
    log = write_ulog(tmp_path / "x.ulg", instead=topic)
    assert call(["log", "export", str(log), "--to", "geojson"]) == 0
    found = json.loads((tmp_path / "x.geojson").read_text())["features"]
    (line,) = [f for f in found if f["properties"]["kind"] == "believed"]
    heights = [row[2] for row in line["geometry"]["coordinates"]]
    assert heights == pytest.approx([PX4_HOME.alt_msl_m + 30.0] * len(heights), abs=0.01)


def test_who_flies_nothing_is_at_the_same_heights() -> None:
    """Places of the plan are met exactly, and observers hear of them where they are."""
    heard: list[VehicleSample] = []
    observer = SimpleNamespace(sampled=heard.append)
    mission = load(None, ()).mission
    flyer = UnflownFlyer(AREA, mission, [cast("VehicleObserver", observer)])
    far_m = np.add(AREA.home_m, (6e3, -5e3))
    plan = FlightPlan((Stop(far_m, (1,)),), HEIGHT_M, 20.0, 5.0)
    flight = asyncio.run(flyer.fly(plan))
    (passage,) = flight.passages
    assert passage is not None
    assert AREA.xyz(passage.true_ned_m) == pytest.approx([*far_m, HEIGHT_M], abs=1e-9)
    for state in (heard[-1].truth, heard[-1].belief):
        where = HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m
        *_, alt_m = pymap3d.ned2geodetic(*state.pos_ned_m, *where)
        assert alt_m - HOME.alt_msl_m == pytest.approx(HEIGHT_M, abs=0.01)
