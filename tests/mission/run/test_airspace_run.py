"""Runs around areas: the true track stays out, the vehicle has the fence, everything shows it."""

import json
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from small_runs import UP_AND_DOWN, digests

from mission.analysis.load import load_run
from mission.base.airspace import Airspace
from mission.cli import call
from mission.figures.run import run_pictures

# Home behind a wall: straight back would lead across it.
WORLD = """
name = "walled"
[area]
size_m = [600, 600]
home_m = [100, 300]
fence_m = [[-60, -60], [660, -60], [660, 660], [-60, 660]]
[[area.fences]]
center_m = [300, 300]
radius_m = 390
[[area.no_fly]]
name = "wall"
polygon_m = [[250, 120], [300, 120], [300, 600], [250, 600]]
[[area.no_fly]]
name = "below the flight"
polygon_m = [[400, 100], [500, 100], [500, 200], [400, 200]]
to_m = 40
[mission]
rounds = 2
steps = 5
path_budget_m = 700
[learning]
local_epochs = 1
[[communities]]
name = "a"
task = "digits"
partition = "iid"
subset = 0.2
positions_m = [[150, 150], [420, 400], [450, 150], [520, 450]]
"""
WALL = np.array([[250.0, 120], [300, 120], [300, 600], [250, 600]])

pytestmark = pytest.mark.slow


def fly(folder: Path, *more: str) -> Path:
    config = folder.parent / "walled.toml"
    config.write_text(WORLD)
    words = (*UP_AND_DOWN, *more)
    assert call(["run", str(config), "--out", str(folder), "--quiet", *words]) == 0
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(tmp_path_factory.mktemp("walled") / "run")


def test_the_true_track_keeps_out_all_the_way(run: Path) -> None:
    data = load_run(run).data
    track = data.truth.pos_m[:, :2]
    assert Airspace((WALL,)).allows(track).all()
    crossed = (track[:, 0] > 300).any()
    assert crossed, "the flight was on the other side, and came back"
    close = Airspace((WALL,), None, 10.0)
    assert close.clear(track[:-1], track[1:]).all(), "within 5 m of the margin of 15 m"
    kinds = {event.kind for event in data.events}
    assert "failsafe" not in kinds


def test_plans_lead_around_and_are_bounded(run: Path) -> None:
    data = load_run(run).data
    assert any(len(plan.route_m) > len(plan.waypoints_m) for plan in data.plans)
    for plan, record in zip(data.plans, data.rounds, strict=True):
        assert plan.path_m == pytest.approx(record.plan_path_m)
        assert record.plan_path_m <= 700 + 1e-3
        assert record.plan_objective <= record.upper_bound
        assert record.flown_path_m == pytest.approx(record.plan_path_m, rel=0.05)


def test_log_maps_and_plan_files_show_what_counts(run: Path, tmp_path: Path) -> None:
    loaded = load_run(run)
    inside = [zone for zone in loaded.data.fence if zone.keep_in]
    outside = [zone for zone in loaded.data.fence if not zone.keep_in]
    assert len(inside) == 1
    assert len(outside) == 1, "what ends at 40 m is flown over"
    fence = inside[0].outline_m  # in both areas to stay in: the square without its corners
    assert np.hypot(*(fence - 300).T).max() == pytest.approx(390, abs=0.01)
    assert np.abs(fence - 300).max() == pytest.approx(360, abs=0.01)
    np.testing.assert_allclose(outside[0].outline_m, WALL)
    for picture in run_pictures(loaded).values():
        if "learnt" not in str(picture["title"]):
            assert "no-fly area" in json.dumps(picture)
    plan = json.loads((run / "plans" / "round-001.plan").read_text())
    assert [p["inclusion"] for p in plan["geoFence"]["polygons"]] == [False, True]
    kml = tmp_path / "f.kml"
    assert call(["log", "export", str(run), str(kml), "--to", "kml"]) == 0
    names = [node.text for node in ET.parse(kml).iter("{http://www.opengis.net/kml/2.2}name")]
    assert "no-fly area" in names
    assert "no-fly area" in (run / "report.html").read_text()


def test_the_same_run_again_gives_the_same_bytes_and_resumes(run: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(run, again)
    summary = json.loads((again / "summary.json").read_text())
    (again / "summary.json").write_text(json.dumps({**summary, "status": "interrupted"}))
    assert call(["run", "--resume", str(again), "--quiet"]) == 0
    assert digests(again) == digests(run)


@pytest.mark.parametrize("strategy", ["barycenter", "rectangular"])
def test_the_baselines_keep_out_too(strategy: str, tmp_path: Path) -> None:
    folder = fly(tmp_path / "run", "--set", f"mission.strategy={strategy}", "mission.rounds=1")
    track = load_run(folder).data.truth.pos_m[:, :2]
    assert Airspace((WALL,), None, 8.0).clear(track[:-1], track[1:]).all()


def test_the_vehicle_itself_holds_the_fence(run: Path, tmp_path: Path) -> None:
    """A plan across the wall, flown with the fence that the run's plan files carry."""
    plan = json.loads((run / "plans" / "round-001.plan").read_text())
    home = plan["mission"]["plannedHomePosition"]
    item = plan["mission"]["items"][-1]
    first = plan["mission"]["items"][0]
    for place, (north_m, east_m) in ((first, (0.0, 0.0)), (item, (0.0, 350.0))):
        place["params"][4] = home[0] + north_m / 111_000
        place["params"][5] = home[1] + east_m / 80_600
    plan["mission"]["items"] = [first, item]
    for seq, entry in enumerate(plan["mission"]["items"]):
        entry["doJumpId"] = seq + 1
    across = tmp_path / "across.plan"
    across.write_text(json.dumps(plan))
    assert call(["fly", str(across), "--out", str(tmp_path / "f"), "--quiet"]) in (2, 4)
