"""Experiments of several aircraft: begun together, recorded each, gone on with after a loss."""

import hashlib
import itertools
import json
import signal
from pathlib import Path

import numpy as np
import pytest
import small_runs
from described import charts
from forked import Forked
from mavsdk.exceptions import MavsdkError
from patience import until
from small_runs import rows

from mission.analysis.several import load_several
from mission.analysis.together import SEPARATIONS
from mission.base.errors import LinkLostError
from mission.cli import call
from mission.figures.run import fleet_pictures
from mission.figures.together import timetable
from mission.flight.flyers.built_in import BuiltInFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.pilot.pilot import Pilot
from mission.log.reader import read_log

pytestmark = pytest.mark.slow

NAMES = ["west", "middle", "east"]
# The second loses a motor on the way; both others are served what it leaves.
TABLES = """vehicles=[
{name="west", home_m=[300, 400], path_budget_m=250},
{name="middle", aircraft={faults=[{kind="motor_loss", at_s=38}]}},
{name="east", home_m=[500, 400], altitude_m=40}]""".replace("\n", "")
SEVERAL = (
    *(*small_runs.SMALL, "--set", "mission.strategy=one_after_another:make", "--set", TABLES),
    *("--set", "mission.steps=2", "--set", "mission.devices_per_step=1"),
)
BESIDE = (*SEVERAL, "--set", "mission.flight=none", "--set", "vehicles=3")


def play(out: Path, *words: str, rounds: int = 2) -> int:
    command = ["run", "--out", str(out), "--rounds", str(rounds)]
    return call([*command, *small_runs.last_counts(*words)])


def digests(folder: Path) -> dict[str, str]:
    files = [*folder.glob("*.csv"), *folder.glob("vehicle-*/flight.mcap"), *folder.glob("plans/*")]
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }


@pytest.fixture(scope="module")
def lost(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "lost"
    assert play(out, *SEVERAL) == 0
    return out


@pytest.fixture(scope="module")
def unflown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "unflown"
    assert play(out, *BESIDE) == 0
    return out


@pytest.mark.parametrize("which", ["lost", "unflown"])
def test_tables_of_a_run_say_the_same_of_all_and_of_each(
    which: str, request: pytest.FixtureRequest
) -> None:
    run: Path = request.getfixturevalue(which)
    aircraft, uplinks = rows(run / "aircraft.csv"), rows(run / "uplinks.csv")
    for record in rows(run / "rounds.csv"):
        own = [row for row in aircraft if row["round"] == record["round"]]
        sent = [row for row in uplinks if row["round"] == record["round"]]
        assert len({row["device"] for row in sent}) == len(sent)  # each device once over all
        for row in own:
            its = [one for one in sent if one["aircraft"] == row["aircraft"]]
            assert int(row["scheduled"]) == len(its)
            assert int(row["delivered"]) == sum(one["delivered"] == "true" for one in its)
            assert row["start_t_s"] == record["start_t_s"]  # begun at one instant
            assert row["duration_s"] == record["duration_s"]  # who waits hovers
        for name in ("plan_path_m", "flown_path_m", "plan_energy_j", "energy_j"):
            whole = sum(float(row[name]) for row in own)
            assert whole == pytest.approx(float(record[name]), nan_ok=True)
        least = min(float(row["battery_remaining"]) for row in own)
        assert least == float(record["battery_remaining"])
        worth = sum(float(one["importance"]) * (1.0 - float(one["true_per"])) for one in sent)
        assert worth == pytest.approx(float(record["true_objective"]))


def test_each_keeps_to_what_is_its_own(lost: Path) -> None:
    first = [row for row in rows(lost / "aircraft.csv") if row["round"] == "1"]
    assert [row["aircraft"] for row in first] == NAMES
    assert float(first[0]["plan_path_m"]) <= 250.0 + 1e-6 < 300.0
    heights = {
        row["aircraft"]: float(row["true_alt_m"])
        for row in rows(lost / "uplinks.csv")
        if row["round"] == "1" and row["true_alt_m"] != "nan"
    }
    assert heights["west"] == pytest.approx(30.0, abs=3.0)
    assert heights["east"] == pytest.approx(40.0, abs=3.0)
    for name, x_m in (("west", 300.0), ("middle", 405.0), ("east", 500.0)):
        data = read_log(lost / f"vehicle-{name}" / "flight.mcap")
        assert data.area.home_m[0] == x_m
        assert data.events[0].text == "Ready for takeoff"
        assert data.truth.pos_m[0, :2] == pytest.approx((x_m, 400.0), abs=0.1)


def test_who_is_lost_leaves_its_devices_to_the_others(lost: Path) -> None:
    aircraft, uplinks = rows(lost / "aircraft.csv"), rows(lost / "uplinks.csv")
    assert [row["aircraft"] for row in aircraft if row["round"] == "2"] == ["west", "east"]
    missed = {
        row["device"]
        for row in uplinks
        if row["round"] == "1" and row["aircraft"] == "middle" and row["slot_t_s"] == "nan"
    }
    assert missed
    assert missed & {row["device"] for row in uplinks if row["round"] == "2"}
    note = read_log(lost / "vehicle-west" / "flight.mcap")
    assert json.loads((lost / "summary.json").read_text())["status"] == "finished"
    assert len(note.rounds) == 2


def test_a_loss_ends_the_run_where_that_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert play(out, *SEVERAL, "--set", "mission.when_lost=end", rounds=1) == 4
    small_runs.refused(capsys, "round 1", "middle: the aircraft is lost", "hit the ground")


def test_who_does_not_answer_in_time_is_not_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hovers, in the way of the others; on another machine it had answered."""

    async def late(flyer: BuiltInFlyer, plan: FlightPlan) -> None:  # noqa: ARG001
        raise await Pilot._refused(flyer.pilot, "start the mission", MavsdkError("TIMEOUT; start"))

    monkeypatch.setattr(BuiltInFlyer, "order", late)
    assert play(tmp_path / "run", *SEVERAL, rounds=1) == 4
    small_runs.refused(capsys, "round 1", "west: the vehicle did not start the mission: TIMEOUT")


@pytest.mark.parametrize("order", ["take_off", "order"])
def test_who_falls_silent_is_named(
    order: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def silent(flyer: BuiltInFlyer, *_: object) -> None:
        if flyer.area.home_m[0] == 500.0:
            raise LinkLostError("no sign of the vehicle for 30 s")

    monkeypatch.setattr(BuiltInFlyer, order, silent)
    assert play(tmp_path / "run", *SEVERAL, rounds=1) == 5
    small_runs.refused(capsys, "east: no sign of the vehicle for 30 s")


def test_killed_after_a_loss_it_goes_on_to_the_same_bytes(lost: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    words = small_runs.last_counts(*SEVERAL)
    process = Forked("run", "--out", str(out), "--rounds", "2", *words)

    def far_enough() -> bool:
        return (out / "rounds.csv").exists() and len(rows(out / "rounds.csv")) >= 1

    until(lambda: process.poll() is not None or far_enough(), poll_s=0.01)
    process.send_signal(signal.SIGKILL)
    process.ended()
    assert call(["run", "--resume", str(out), "--quiet"]) == 0
    assert digests(out) == digests(lost)
    assert not (out / "checkpoint" / "interrupted").exists()


def test_nearest_pairs_are_those_of_the_logs(lost: Path) -> None:
    """In each round, against the comparison of the vehicles' logs."""
    world = load_several((lost,)).together
    for row in rows(lost / "aircraft.csv"):
        begin_s = float(row["start_t_s"])
        end_s = begin_s + float(row["duration_s"])
        least = np.inf
        for pair in world.pairs:
            if f"vehicle-{row['aircraft']}" not in pair.name.split(" and "):
                continue
            apart = pair.flown
            here = (apart.t_s >= begin_s) & (apart.t_s <= end_s)
            away_m = np.linalg.norm(apart.away_m, axis=1)
            least = min(least, away_m[here].min(initial=np.inf))
        near = float(row["nearest_m"])
        assert near <= least + 0.1  # between the samples of the log it may be less
        assert near >= least - 1.0
    assert SEPARATIONS["separation_min_m"] == (0, 1, 2)


def test_planned_distances_are_those_of_paths_at_speed(unflown: Path) -> None:
    """Of those that are always at their speed, against a fine sampling of the planned routes."""
    for number in (1, 2):
        paths = []
        for name in ("uav1", "uav2", "uav3"):
            data = read_log(unflown / f"vehicle-{name}" / "flight.mcap")
            route = next(plan.route_m for plan in data.plans if plan.round == number)
            along = np.insert(np.cumsum(np.linalg.norm(np.diff(route, axis=0), axis=1)), 0, 0.0)
            metres = np.linspace(0.0, 300.0, 60_001)  # then it waits
            paths.append(np.column_stack([np.interp(metres, along, axis) for axis in route.T]))
        least = {
            pair: np.linalg.norm(paths[pair[0]] - paths[pair[1]], axis=1).min()
            for pair in itertools.combinations(range(3), 2)
        }
        own = [row for row in rows(unflown / "aircraft.csv") if row["round"] == str(number)]
        for n, row in enumerate(own):
            nearest = min(away for pair, away in least.items() if n in pair)
            assert float(row["nearest_m"]) == pytest.approx(nearest, abs=0.6)  # stops are merged
            assert float(row["plan_nearest_m"]) == pytest.approx(nearest, abs=0.6)
            assert float(row["idle_s"]) >= 0.0


def test_a_run_of_several_has_a_page_and_is_compared(
    unflown: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["report", str(unflown)]) == 0
    page = (unflown / "report.html").read_text()
    assert "vehicle-uav3" in page
    assert len(charts(page)) > 3
    pictures = ["map.png", "apart.png", "timetable.png", "learning.png"]
    assert [*fleet_pictures(unflown)] == pictures
    capsys.readouterr()
    assert call(["compare", str(unflown), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["flights"]) == 3
    assert len(found["pairs"]) == 3


def test_they_are_judged_and_drawn_in_the_area_of_the_tables(lost: Path) -> None:
    world = load_several((lost,)).together
    for name, track in zip(world.names, world.tracks, strict=True):
        served = [
            row
            for row in rows(lost / "uplinks.csv")
            if f"vehicle-{row['aircraft']}" == name and row["slot_t_s"] != "nan"
        ]
        assert served or name == "vehicle-middle"
        for row in served:
            at = track.at(np.array([round(float(row["slot_t_s"]) * 1e9)])).pos_m[0]
            true = [float(row[f"true_{axis}_m"]) for axis in ("x", "y", "alt")]
            assert at == pytest.approx(true, abs=0.5)
    devices = [(float(row["x_m"]), float(row["y_m"])) for row in rows(lost / "devices.csv")]
    on_map = world.on_map(world.flights[0].run.data.devices.pos_m)
    assert on_map == pytest.approx(np.array(devices))


def test_the_timetable_tells_who_waits_for_how_long(unflown: Path) -> None:
    chart = timetable(load_several((unflown,)).together)
    of_all = [row for values in chart["datasets"].values() for row in values]
    waits = [row for row in of_all if row.get("kind") == "wait"]
    for row in rows(unflown / "aircraft.csv"):
        begin_s = float(row["start_t_s"])
        end_s = begin_s + float(row["duration_s"])
        waited_s = sum(
            max(0.0, min(one["end"], end_s) - max(one["begin"], begin_s))
            for one in waits
            if one["vehicle"] == f"vehicle-{row['aircraft']}"
        )
        assert waited_s == pytest.approx(float(row["idle_s"]), abs=1.1)
    slots = [row for row in of_all if "at" in row]
    assert len(slots) == len(rows(unflown / "uplinks.csv"))


def test_lines_tell_each_aircraft_and_the_closest_pair(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [word for word in BESIDE if word != "--quiet"]
    assert play(tmp_path / "run", *words, "--set", "mission.separation_m=1000", rounds=1) == 0
    printed = capsys.readouterr().out
    for name in ("uav1", "uav2", "uav3"):
        assert f"\n  {name}  " in printed
    assert "closest" not in printed  # from homes 5 m apart none ever left the other by 1000 m
    (line,) = [line for line in printed.splitlines() if "before they were 1000 m apart: " in line]
    first, second = (
        read_log(tmp_path / "run" / f"vehicle-{name}" / "flight.mcap").truth
        for name in line.split(": ")[1].split(" ")[0].split("-")
    )
    t_ns = np.arange(first.t_ns[0], first.t_ns[-1], 10_000_000)
    least_m = np.linalg.norm(first.at(t_ns).pos_m - second.at(t_ns).pos_m, axis=1).min()
    assert float(line.split(" m at ")[0].rpartition(" ")[2]) == pytest.approx(least_m, abs=0.06)


def test_plans_of_a_strategy_of_one_s_own_keep_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From homes side by side, one after another to the same device; resumed, they wait again."""
    out, words = tmp_path / "run", [word for word in BESIDE if word != "--quiet"]
    assert play(out, *words, "--set", "mission.separation_m=30") == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "30 m are kept: " in line]
    assert said
    assert all(" the value changes by " in line for line in said)
    for row in rows(out / "aircraft.csv"):
        assert float(row["plan_nearest_m"]) >= 29.9
        assert float(row["nearest_m"]) >= 29.9
    before = digests(out)
    assert call(["run", "--resume", str(out), "--rounds", "2", "--quiet"]) == 0
    assert digests(out) == before


def test_one_vehicle_in_a_table_is_one_aircraft(tmp_path: Path) -> None:
    out, table = tmp_path / "one", 'vehicles=[{name="solo", home_m=[100, 100], altitude_m=80}]'
    assert play(out, *BESIDE, "--set", table, rounds=1) == 0
    assert (out / "flight.mcap").exists()
    assert not list(out.glob("vehicle-*"))
    (row,) = rows(out / "aircraft.csv")
    assert row["aircraft"] == "solo"
    assert "nearest" not in row
    data = read_log(out / "flight.mcap")
    assert data.area.home_m == (100.0, 100.0)
    assert data.plans[0].altitude_m == 80.0


def test_the_rest_of_all_is_planned_anew_where_somebody_is_not_heard(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With replan = "stop", in a radio that loses most; in the second round two would meet if they
    did not wait for each other. Resumed, the rests are those of before."""
    out = tmp_path / "run"
    keys = (
        *("channel.extra_gain_db=-13", "mission.steps=6", "mission.path_budget_m=500", "seed=12"),
        "mission.altitude_m=60",
        *("mission.strategy=cov", "mission.replan=stop", "mission.separation_m=30"),
    )
    anew = [word for key in keys for word in ("--set", key)]
    assert play(out, *(word for word in BESIDE if word != "--quiet"), *anew) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    told = [line[:2] for line in lines if line and line[0].startswith("uav")]
    assert told == [
        [row["aircraft"], f"{row['delivered']}/{row['scheduled']}"]
        for row in rows(out / "aircraft.csv")
    ]
    for whole in rows(out / "rounds.csv"):
        sent, aircraft = (
            [row for row in rows(out / f"{name}.csv") if row["round"] == whole["round"]]
            for name in ("uplinks", "aircraft")
        )
        heard = [row["device"] for row in sent if row["delivered"] == "true"]
        assert len(set(heard)) == len(heard) == int(whole["delivered"])  # nobody once he was heard
        asked = {row["device"] for row in sent}
        assert len(sent) > len(asked) == int(whole["scheduled"])
        for row in aircraft:
            assert float(row["flown_path_m"]) <= 500.0 + 1e-6
            moving_s = float(row["flown_path_m"]) / 20.0
            listened_s = float(row["duration_s"]) - moving_s - float(row["idle_s"])
            assert 0.0 <= listened_s + 0.01 <= 0.1 * len(sent) + 0.2  # at the stops
            assert float(row["nearest_m"]) >= 29.9
            # By plan, a pair from homes that are nearer counts 0.05 s earlier or later: 2 m.
            assert float(row["nearest_m"]) == pytest.approx(float(row["plan_nearest_m"]), abs=2.0)
    before = digests(out)
    (out / "summary.json").write_text('{"status": "running"}')
    assert call(["run", "--resume", str(out), "--quiet"]) == 0
    assert digests(out) == before
