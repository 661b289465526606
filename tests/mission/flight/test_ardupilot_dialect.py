"""The experiment in ArduPilot's dialect, towards a stand-in that insists on it."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ardupilot_double import GUIDED, RTL, ArduPilotDouble
from serving import free_port
from small_runs import QUIET, refused, rows
from test_external import SMALL
from test_plan_flight import written
from test_planfile import simple

from mission.analysis.load import load_run
from mission.cli import call
from mission.flight.pilot import connection
from mission.flight.pilot.feed import TelemetryFeed

pytestmark = pytest.mark.slow

HOME = (43.6145, 7.0715)
NORTH = HOME[0] + 200 / 111_110.0


@contextmanager
def flying(**how: float) -> Iterator[tuple[ArduPilotDouble, str]]:
    port = free_port()
    double = ArduPilotDouble(port, lat=HOME[0], lon=HOME[1], **how)
    double.start()
    try:
        yield double, f"udpin://127.0.0.1:{port}"
    finally:
        double.stop()


def test_two_rounds_in_ardupilot_s_dialect(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with flying() as (double, url):
        assert call(["run", "--vehicle", url, "--out", str(out), "--rounds", "2", *SMALL]) == 0
    assert (double.uploads, double.refusals) == (2, [])
    assert (double.mode, double.armed, double.flown) == (RTL, False, True)
    assert double.armed_in == [GUIDED]
    rounds, uplinks = rows(out / "rounds.csv"), rows(out / "uplinks.csv")
    for row in rounds:
        plan_m = float(row["plan_path_m"])
        assert abs(float(row["flown_path_m"]) - plan_m) < 0.03 * plan_m + 2
    for uplink in uplinks:
        assert math.isfinite(float(uplink["slot_t_s"]))
        x, y = (float(uplink[f"true_{axis}_m"]) - float(uplink[f"plan_{axis}_m"]) for axis in "xy")
        assert math.hypot(x, y) < 2.0
    events = load_run(out).data.events
    texts = [event.text for event in events if event.kind == "status"]
    assert texts.count("Mission: 1 WP") == 2
    assert "parameter WPNAV_RADIUS = 1000" in texts
    assert "estimator: complete" in texts
    assert [event.text for event in events if event.kind == "armed"] == ["armed", "disarmed"]
    # A round begins with its mission: the vehicle is at its first item then.
    for plan in load_run(out).data.plans:
        starts = [e.t_ns for e in events if e.text == "Mission: 1 WP" and e.t_ns >= plan.t_ns]
        assert min(starts) - plan.t_ns < 10e9


def test_a_vehicle_is_waited_for_until_it_knows_where_it_is_and_set_where_it_may_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    talking = [word for word in SMALL if word != "--quiet"]
    words = ["run", "--vehicle", "", "--out", str(out), "--rounds", "1", *talking]
    with flying(located_s=60.0) as (double, words[2]):
        assert call([*words, "--set", "link.set_parameters=true"]) == 0
    assert double.armed_in == [GUIDED]
    assert "waiting for the vehicle's position (no 3D GPS fix" in capsys.readouterr().out
    # It cuts corners by 10 m where 5 are allowed.
    assert double.set_to == [("WPNAV_RADIUS", 500.0), ("WPNAV_RADIUS", 1000.0)]


def test_a_vehicle_that_never_knows_is_given_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    short = ("--set", "link.ready_timeout_s=0.1")
    locate = connection._locate

    heard = "no 3D GPS fix, estimator "

    async def once_heard(feed: TelemetryFeed, *args: Any, **options: Any) -> None:
        """Give up only after it has said what it lacks, however slow the machine is."""
        await connection.until(lambda: feed.readiness.missing.startswith(heard))
        await locate(feed, *args, **options)

    monkeypatch.setattr(connection, "_locate", once_heard)
    with flying(located_s=math.inf) as (double, url):
        assert call(["run", "--vehicle", url, "--out", str(out), *SMALL, *short]) == 4
    assert not double.armed_in
    refused(capsys, "link.ready_timeout_s", "no 3D GPS fix, estimator without")
    assert not out.exists()


def test_the_reserve_is_kept_and_the_battery_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    talking = [word for word in SMALL if word != "--quiet"]
    # Take-off and a round take 40 s.
    with flying(drain=0.03) as (double, url):
        assert call(["run", "--vehicle", url, "--out", str(out), "--rounds", "2", *talking]) == 0
    changes = json.loads((out / "summary.json").read_text())["battery_changes"]
    assert changes >= 1
    assert len(double.armed_in) == changes + 1
    assert "the vehicle returns, lands and waits for a charged one" in capsys.readouterr().out


def test_an_empty_battery_that_nobody_charges_keeps_the_vehicle_down(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    reserve = ("--set", "mission.battery_reserve=0.9", "--set", "link.battery_timeout_s=2")
    with flying() as (double, url):
        assert call(["run", "--vehicle", url, "--out", str(out), *SMALL, *reserve]) == 4
    assert not double.armed_in
    refused(capsys, "the battery reads 80 % after 2 s on the ground (link.battery_timeout_s)")


@pytest.mark.parametrize("takes_off", [True, False])
def test_a_plan_file_is_flown(tmp_path: Path, *, takes_off: bool) -> None:
    out = tmp_path / "out"
    items = [
        *([simple(22, 15, 0, 0, None, *HOME, 50)] if takes_off else []),
        simple(16, 0, 3, 0, None, NORTH, HOME[1], 50),
        simple(178, 1, 15, -1, 0, 0, 0, 0, frame=2),
        simple(16, 0, 3, 0, None, *HOME, 60),
        simple(20, 0, 0, 0, 0, 0, 0, 0, frame=2),
    ]
    plan = written(tmp_path, *items, name="there.plan")
    document = json.loads(plan.read_text())
    document["mission"]["plannedHomePosition"] = [*HOME, 130]
    plan.write_text(json.dumps(document))
    with flying() as (double, url):
        assert call(["fly", str(plan), "--vehicle", url, "--out", str(out), *QUIET]) == 0
    assert (double.mode, double.armed, double.refusals) == (RTL, False, [])
    summary = json.loads((out / "summary.json").read_text())
    found = summary["planned_and_flown"]
    assert (found["slots"], found["slots_missed"]) == (3 + takes_off, 0)
    assert found["flown_path_m"] == pytest.approx(400, abs=8)
    assert found["cross_track_max_m"] < 2
    assert found["slot_miss_max_m"] < 2
    # 200 m at its own 5 m/s, 200 m at 15 m/s, and up.
    assert found["plan_duration_s"] > 200 / 5 + 200 / 15
    assert "telemetry" in summary["position_source"]
    assert call(["compare", str(out)]) == 0
