"""Devices that take time, in whole runs: recomputed from the tables alone, without code of ours."""

import itertools
import json
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from cutting import check_resumed
from drawing import outlined
from one_aircraft import one_path
from small_runs import rows

import aerofed
from mission.analysis.load import load_run
from mission.base.errors import InputError
from mission.cli import call
from mission.figures.maps import round_map
from mission.flight.missions.round_mission import FlightPlan, mission_items
from mission.flight.pilot.dialects import ARDUPILOT, PX4, as_dialect, raw_items
from mission.planner.flyable import SAME_PLACE_M, stops_of
from mission.planner.performance import Performance
from mission.planner.plan import RoundPlan

SMALL = {
    "mission.steps": 4,
    "mission.path_budget_m": 300.0,
    "vehicle.parameters.MPC_TKO_SPEED": 5.0,
    "vehicle.parameters.MPC_LAND_SPEED": 1.5,
    "planner.gap": 0.1,
    "planner.max_nodes": 20,
    "communities.0.devices": 4,
    "communities.1.devices": 3,
    "communities.0.subset": 0.2,
    "communities.1.subset": 0.2,
    "learning.local_epochs": 1,
}
SLOW = {
    "communities.0.compute_s": [1.0, 25.0],
    "communities.1.compute_s_per_sample": 0.006,
    "channel.upload_rate_bps": 2e6,
    "communities.1.upload_bits": 500_000,
}
UNFLOWN = {"mission.flight": "none"}
GAMBLE = {"mission.strategy": "gambling:make"}  # the planner itself makes nobody late


def fly(out: Path, *more: Mapping[str, object], rounds: int = 3) -> aerofed.Run:
    keys = {**SMALL, **SLOW, "mission.rounds": rounds}
    for item in more:
        keys |= item
    return aerofed.run("quickstart", keys, out=out)


def check_times(folder: Path, *, stale: bool) -> set[str]:
    """Retell who was late with what; gives what happened to updates, in words."""
    devices, rounds = rows(folder / "devices.csv"), rows(folder / "rounds.csv")
    compute_ns = [round(1e9 * float(row["compute_s"])) for row in devices]
    upload_s = [float(row["upload_s"]) for row in devices]
    begun, ready_ns = [0] * len(devices), [0] * len(devices)
    owes = [False] * len(devices)
    uplinks, seen = rows(folder / "uplinks.csv"), set()
    for record in rounds:
        number, start_ns = int(record["round"]), round(1e9 * float(record["start_t_s"]))
        for k in range(len(devices)):
            if not (stale and (owes[k] or ready_ns[k] > start_ns)):
                begun[k], ready_ns[k] = number, start_ns + compute_ns[k]
        turns = defaultdict(list)
        for row in (row for row in uplinks if int(row["round"]) == number):
            k, turn_ns = int(row["device"]), round(1e9 * float(row["slot_t_s"]))
            late = turn_ns < ready_ns[k]
            assert row["late"] == str(late).lower()
            assert float(row["ready_t_s"]) == ready_ns[k] / 1e9
            assert int(row["staleness"]) == number - begun[k]
            assert float(row["upload_s"]) == upload_s[k]
            if late:
                assert (row["true_per"], row["est_per"], row["delivered"]) == (
                    "1.0",
                    "1.0",
                    "false",
                )
            owes[k] = late
            turns[int(row["step"])].append((turn_ns, k))
            seen.add("late" if late else "stale" if begun[k] < number else "fresh")
        for served in turns.values():  # one after another, in the order of the devices
            for (first, k), (second, _) in itertools.pairwise(served):
                assert second - first == pytest.approx(1e9 * upload_s[k], abs=2)
        sent = [k for served in turns.values() for _, k in served]
        least_s = float(record["plan_path_m"]) / 20.0 + sum(upload_s[k] for k in sent)
        rounding_s = 2.0 * SAME_PLACE_M / 20.0  # waypoints nearer than that are one stop
        assert float(record["duration_s"]) > least_s - rounding_s
        if "flight.none" in str(folder):
            assert float(record["duration_s"]) == pytest.approx(least_s, abs=rounding_s)
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("late", ["missed", "stale"])
def test_who_is_late_follows_from_the_tables(tmp_path: Path, late: str) -> None:
    run = fly(tmp_path / "flight.none", UNFLOWN, GAMBLE, {"learning.late": late})
    seen = check_times(run.path, stale=late == "stale")
    assert seen == ({"late", "fresh", "stale"} if late == "stale" else {"late", "fresh"})
    bits = 500_000 / 2e6
    assert [float(row["upload_s"]) for row in rows(run.path / "devices.csv")[4:]] == [bits] * 3
    assert run.table("uplinks").equals(run.uplinks)
    assert (run.uplinks["late"] & run.uplinks["delivered"]).sum() == 0


@pytest.mark.slow
def test_the_aircraft_hovers_until_all_have_sent(tmp_path: Path) -> None:
    run = fly(tmp_path / "flown", GAMBLE, {"learning.late": "stale"}, rounds=2)
    assert check_times(run.path, stale=True) >= {"late", "fresh"}
    assert len(run.uplinks) == run.rounds["scheduled"].sum() > 0
    for row in run.uplinks.itertuples():  # wherever in a turn it is, it is where it was planned
        away_m = np.hypot(row.true_x_m - row.plan_x_m, row.true_y_m - row.plan_y_m)
        assert away_m < 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "own",
    [
        {},
        {"learning.algorithm": "examples.late_updates:make"},
        {"learning.algorithm": "examples.fedbuff:make"},
        {
            "communities.0.network": "examples.batch_norm:Net",
            "communities.0.buffers": "local",
        },
    ],
    ids=["fedprox", "late_updates", "fedbuff", "buffers"],
)
def test_what_is_still_to_come_is_resumed_to_the_same_bytes(
    tmp_path: Path, own: dict[str, object]
) -> None:
    more = {**UNFLOWN, **GAMBLE, **own, "learning.late": "stale", "mission.rounds": 2}
    whole = check_resumed({**SMALL, **SLOW, **more}, tmp_path, after=1)
    late = whole.uplinks[(whole.uplinks["round"] > 1) & whole.uplinks["delivered"]]
    assert (late["round"] - late["staleness"] <= 1).any(), "nothing came across the cut"


@pytest.mark.slow
def test_whom_the_planner_serves_is_ready(tmp_path: Path) -> None:
    run = fly(tmp_path / "run", UNFLOWN)
    assert len(run.uplinks) > 8
    assert not run.uplinks["late"].any()


@pytest.mark.slow
def test_a_round_without_anybody_ready_waits_for_the_first(tmp_path: Path) -> None:
    slow = {"communities.0.compute_s": [50.0, 60.0], "communities.1.compute_s": 70.0}
    run = fly(tmp_path / "run", UNFLOWN, slow, {"learning.late": "stale"}, rounds=2)
    waited, flown = run.rounds.itertuples()
    first_s = min(float(row["compute_s"]) for row in rows(run.path / "devices.csv"))
    assert (waited.scheduled, waited.duration_s) == (0, pytest.approx(first_s))
    assert flown.delivered > 0


@pytest.mark.slow
def test_late_devices_are_told_wherever_a_run_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with outlined():
        run = fly(tmp_path / "run", UNFLOWN, GAMBLE)
    late = int(run.uplinks["late"].sum())
    assert late > 0
    assert call(["compare", str(run.path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    whole = told[0] if isinstance(told, list) else told.get("runs", [told])[0]
    assert whole["total"]["unready"] == late
    assert sum(device["late"] for device in whole["devices"]) == late
    sent = run.uplinks[~run.uplinks["late"]]
    assert whole["total"]["true_per_mean"] == pytest.approx(sent["true_per"].mean())
    assert call(["compare", str(run.path)]) == 0
    assert "late" in capsys.readouterr().out
    assert call(["report", str(run.path)]) == 0
    assert "devices late" in (run.path / "report.html").read_text()
    data = load_run(run.path).data
    words = json.dumps(round_map(data, data.plans[:1]))
    assert '["delivered", "lost", "late", "not served"]' in words


def test_nobody_is_slow_unless_it_is_configured(tmp_path: Path) -> None:
    keys = {**SMALL, **UNFLOWN, "mission.rounds": 1}
    run = aerofed.run("quickstart", keys, out=tmp_path / "run")
    assert list(run.uplinks.columns)[-1] == "delivered"
    assert "compute_s" not in rows(run.path / "devices.csv")[0]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"communities.0.compute_s": -1}, ["communities.0.compute_s = -1", "equal to 0"]),
        ({"communities.0.compute_s": [60, 5]}, ["[60, 5] is [from, to]", "not be above"]),
        ({"communities.0.compute_s": [1, 2, 3]}, ["communities.0.compute_s", "at most 2 items"]),
        ({"communities.0.compute_s_per_sample": -1}, ["compute_s_per_sample = -1", "equal to 0"]),
        ({"communities.0.compute_times_s": [1, 2]}, ["compute_times_s has 2", "6 devices"]),
        (
            {"communities.0.compute_s": 1, "communities.0.compute_times_s": [1] * 6},
            ["compute_s and compute_times_s", "one of them"],
        ),
        ({"channel.upload_rate_bps": 0}, ["channel.upload_rate_bps = 0", "greater than 0"]),
        ({"communities.0.upload_bits": 0}, ["upload_bits = 0", "equal to 1"]),
        ({"communities.0.upload_bits": 7}, ["upload_bits = 7", "needs channel.upload_rate_bps"]),
        ({"learning.late": "never"}, ["learning.late = 'never'", "'missed' or 'stale'"]),
    ],
)
def test_times_that_make_no_sense_are_one_line(
    tmp_path: Path, keys: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        aerofed.run("quickstart", keys, out=tmp_path / "run")
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_compute_times_are_as_many_as_the_places_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "places.csv").write_text("x,y\n100,100\n200,200\n300,100\n")
    (tmp_path / "c.toml").write_text(
        '[[communities]]\nname = "digits"\ntask = "digits"\npositions_file = "places.csv"\n'
        "compute_times_s = [1, 2]\n"
    )
    with pytest.raises(InputError, match="3 places, but 2 compute_times_s"):
        aerofed.run(tmp_path / "c.toml", {}, out=tmp_path / "run")


def two_stops() -> RoundPlan:
    """Steps 0 and 1 at the start, 2 apart; devices 0 and 2 at 1, device 1 at 2."""
    schedule = np.array([[False] * 3, [True, False, True], [False, True, False]])
    return one_path(np.array([[0.0, 0.0], [0.0, 0.0], [100.0, 0.0]]), schedule, 1.0)


def test_a_stop_lasts_until_its_devices_have_sent() -> None:
    upload_s = np.array([1.5, 0.25, 2.0])
    first, second = stops_of(two_stops(), upload_s=upload_s)
    assert (first.hold_s, first.slots_s) == (3.5, (0.0, 0.0))
    assert (second.hold_s, second.slots_s) == (0.25, (0.0,))
    hovering = stops_of(two_stops(), hold_s=5.0, upload_s=upload_s)
    assert [stop.hold_s for stop in hovering] == [3.5, 5.0]
    plan = FlightPlan((first, second), 60.0, 20.0, 5.0)
    at_speed = plan.foreseen(Performance(20.0, 5.0, guidance=None))
    assert plan.slot_s(at_speed) == [0.0, 0.0, 3.5 + 5.0]


def test_an_autopilot_of_whole_seconds_hovers_long_enough() -> None:
    stops = stops_of(two_stops(), upload_s=np.array([1.5, 0.25, 2.0]))
    plan = FlightPlan(stops, 60.0, 20.0, 5.0)
    area = aerofed.config("quickstart").area.build()
    items = raw_items(mission_items(plan, area))
    assert [i.param1 for i in as_dialect(items, PX4) if i.command == 16] == [3.5, 0.25]
    assert [i.param1 for i in as_dialect(items, ARDUPILOT) if i.command == 16] == [0.0, 4.0, 1.0]


def test_a_rate_at_which_nobody_could_hover_long_enough_is_refused(tmp_path: Path) -> None:
    wanted = r"channel.upload_rate_bps = 1.0: .* 3600 s at most are allowed, so at least 1112 bits"
    sizes = {"communities.0.upload_bits": 1000, "communities.1.upload_bits": 4_000_000}
    with pytest.raises(InputError, match=wanted):
        fly(tmp_path / "none", {"channel.upload_rate_bps": 1.0, **sizes})
    with pytest.raises(InputError, match=r"upload_rate_bps = 1111\.0:"):
        fly(tmp_path / "none", {"channel.upload_rate_bps": 1111.0, **sizes})
    assert not (tmp_path / "none").exists()
