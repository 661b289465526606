"""Rounds that are decided at their stops: the lost are served again, within what the round has."""

import math
import shutil
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import small_runs
from cutting import cut_after
from drawing import outlined
from one_aircraft import round_problem
from serving import free_port, served
from small_runs import digests
from test_firmware_runs import REAL, real

from fl.radio.channel import CHANNEL_PRESETS
from fl.radio.per_grid import PerGrid
from mission.analysis.compare import compare_run
from mission.analysis.load import load_run
from mission.cli import call
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlightRecorder, FlownTrack, TrackPoint
from mission.log.contents import load
from mission.log.reader import read_log
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import read_table
from mission.log.topics import PLAN
from mission.planner.evaluate import finish
from mission.planner.flyable import Stop
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.problem import RoundProblem
from mission.run.course import Course, is_better

STOP = (
    *("--set", "mission.replan=stop", "--set", "planner.gap=0.1", "--set", "mission.steps=8"),
    *("--set", "mission.altitude_m=60"),  # high enough to lose somebody
)
LOSING = (  # a device that is two out of three times lost where the first round begins
    *("--set", "communities.0.devices=6", "--set", "communities.1.devices=6"),
    *("--set", "mission.steps=6", "--set", "mission.path_budget_m=500"),
)
UNFLOWN = ("--set", "mission.flight=none")
LIMITS = (
    *("--set", "mission.path_budget_m=900", "--set", "mission.round_deadline_s=40"),
    *("--set", "mission.round_energy_j=11000", "--set", "mission.total_deadline_s=100"),
    *("--set", "communities.0.devices=6", "--set", "communities.1.devices=6"),
    *("--set", "channel.extra_gain_db=-12", "--set", "seed=2"),  # some are lost, and asked again
)


def fly(out: Path, *more: str, rounds: int = 4) -> int:
    words = small_runs.last_counts(*small_runs.SMALL, *STOP, *more)
    return call(["run", "--out", str(out), "--rounds", str(rounds), *words])


def tables(out: Path) -> tuple[tuple[RoundRecord, ...], tuple[UplinkRecord, ...]]:
    return read_table(out / "rounds.csv", RoundRecord), read_table(
        out / "uplinks.csv", UplinkRecord
    )


def by_device(uplinks: tuple[UplinkRecord, ...]) -> list[list[UplinkRecord]]:
    """The transmissions of each device in each round, in order."""
    found: dict[tuple[int, int], list[UplinkRecord]] = defaultdict(list)
    for uplink in uplinks:
        found[uplink.round, uplink.device].append(uplink)
    return list(found.values())


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flown by the built-in autopilot, over MAVSDK."""
    out = tmp_path_factory.mktemp("replan") / "run"
    with outlined():
        assert fly(out, rounds=2) == 0
    return out


@pytest.mark.slow
def test_whoever_was_lost_is_served_later_and_arrives(tmp_path: Path) -> None:
    assert fly(tmp_path / "run", *UNFLOWN) == 0
    rounds, uplinks = tables(tmp_path / "run")
    again = [tries for tries in by_device(uplinks) if len(tries) > 1]
    assert any(tries[-1].delivered for tries in again)
    for tries in again:
        assert not any(earlier.delivered for earlier in tries[:-1])
        steps, times = ([getattr(u, name) for u in tries] for name in ("step", "slot_t_s"))
        assert steps == sorted(set(steps))
        assert times == sorted(set(times))
    for record in rounds:
        mine = [u for u in uplinks if u.round == record.round]
        at_once = np.bincount([u.step for u in mine])
        assert len(at_once) <= 8
        assert at_once.max() <= 3
        assert record.plan_path_m <= 300.0 + 1e-3
        assert record.scheduled == len({u.device for u in mine})
        assert record.delivered == sum(u.delivered for u in mine)
        expected = sum(u.importance * (1.0 - u.true_per) for u in mine)
        assert record.true_objective == pytest.approx(expected)
        assert record.plan_objective <= record.upper_bound * 1.0001


@pytest.mark.slow
def test_each_time_has_draws_of_its_own_and_the_first_those_of_a_round(tmp_path: Path) -> None:
    """Who is asked again from the same place is not lost by the same luck."""
    first: dict[str, dict[tuple[int, float], bool]] = {}
    for replan in ("stop", "round"):
        more = (*UNFLOWN, *LOSING, "--set", f"mission.replan={replan}")
        assert fly(tmp_path / replan, *more, rounds=1) == 0
        tried = by_device(tables(tmp_path / replan)[1])
        first[replan] = {
            (tries[0].device, round(tries[0].true_per, 6)): tries[0].delivered for tries in tried
        }
        if replan == "stop":
            again = [tries[-2:] for tries in tried if len(tries) > 1 and tries[-1].delivered]
            assert any(math.isclose(a.true_per, b.true_per, abs_tol=1e-6) for a, b in again)
    both = first["stop"].keys() & first["round"].keys()
    assert not all(first["round"][key] for key in both)
    assert all(first["stop"][key] == first["round"][key] for key in both)


@pytest.mark.slow
@pytest.mark.parametrize("flight", ["none", "flown"])
def test_a_round_keeps_its_limits_with_all_that_is_planned_anew(
    tmp_path: Path, flight: str
) -> None:
    out, more = tmp_path / "run", ("--set", f"mission.flight={flight}")
    assert fly(out, *LIMITS, *more, rounds=2) == 0
    rounds, uplinks = tables(out)
    assert any(len(tries) > 1 for tries in by_device(uplinks))
    for record in rounds:
        assert record.duration_s <= 40.0 * (1.0 + 1e-6 if flight == "none" else 1.03)
        energy_j = record.plan_energy_j if flight == "none" else record.energy_j
        assert energy_j <= 11_000.0 * (1.0 + 1e-6 if flight == "none" else 1.05)
        assert record.plan_duration_s == pytest.approx(record.duration_s, rel=0.01)
    assert rounds[-1].time_used_s == pytest.approx(sum(r.duration_s for r in rounds))


@pytest.mark.slow
def test_a_resumed_run_has_the_same_bytes(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, cut, finished = (tmp_path / name for name in ("whole", "cut", "finished"))
    assert fly(whole, *UNFLOWN, rounds=2) == 0
    with cut_after(1):
        assert fly(cut, *UNFLOWN, rounds=2) == 4
    assert call(["run", "--resume", str(cut), "--quiet"]) == 0
    assert digests(cut) == digests(whole)
    shutil.copytree(run, finished)
    (finished / "summary.json").write_text('{"status": "running"}')
    with monkeypatch.context() as patch:
        # Rounds that were flown before are flown by what was planned then.
        patch.setattr("mission.scenario.strategies.Optimised.sortie", None)
        assert call(["run", "--resume", str(finished), "--quiet"]) == 0
    assert digests(finished) == digests(run)


@pytest.mark.slow
def test_a_round_of_many_stops_takes_as_long_as_foreseen_in_wind(tmp_path: Path) -> None:
    """Half a second at most in all, where a stop foreseen 0.25 s too long adds up to 1.5."""
    wind = ("--set", "vehicle.aircraft.wind.speed_mps=6")
    many = ("--set", "mission.steps=12", "--set", "mission.devices_per_step=1", *LOSING[:4])
    with outlined():
        assert fly(tmp_path / "run", *wind, *many, rounds=1) == 0
    (round_,), uplinks = tables(tmp_path / "run")
    assert len({uplink.step for uplink in uplinks}) >= 6
    assert round_.duration_s == pytest.approx(round_.plan_duration_s, abs=0.5)


@pytest.mark.slow
def test_asking_again_on_the_spot_is_foreseen(run: Path) -> None:
    """A hover of its own, which takes a second until it begins."""
    rounds, uplinks = tables(run)
    again = [
        first.round
        for first, other in pairwise(uplinks)
        if (first.round, first.device) == (other.round, other.device)
    ]
    assert again
    for record in rounds:
        assert record.duration_s == pytest.approx(record.plan_duration_s, abs=0.6)


@pytest.mark.slow
def test_log_and_comparison_take_the_plan_as_it_became(run: Path) -> None:
    rounds, uplinks = tables(run)
    assert any(len(tries) > 1 for tries in by_device(uplinks))
    assert len(load(run / "flight.mcap").messages[PLAN.name]) > len(rounds)
    data = read_log(run / "flight.mcap")
    assert [plan.round for plan in data.plans] == [record.round for record in rounds]
    for plan, record in zip(data.plans, rounds, strict=True):
        asked = [[u.step, u.device] for u in uplinks if u.round == plan.round]
        assert np.argwhere(plan.schedule).tolist() == sorted(asked)
        assert plan.path_m == record.plan_path_m
    total = compare_run(load_run(run)).total
    assert total.slots_missed == 0
    assert total.cross_track_max_m < 3.0
    assert total.slot_miss_max_m < 3.0
    assert total.duration_s == pytest.approx(total.plan_duration_s, rel=0.1)
    check_another_rest(run)


@pytest.mark.slow
def test_another_autopilot_is_given_the_rest_in_the_air(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "run"
    config = str(Path(__file__).parents[3] / "configs" / "quickstart.toml")
    with served(config, "--udp", str(port), "--speed", "8"):
        assert fly(out, "--vehicle", f"udpin://127.0.0.1:{port}", *LOSING, rounds=1) == 0
    check_another_rest(out)


@pytest.mark.real
@pytest.mark.parametrize("autopilot", sorted(REAL))
def test_a_real_firmware_is_given_the_rest_in_the_air(tmp_path: Path, autopilot: str) -> None:
    keys = (f"vehicle.autopilot={autopilot}", f"vehicle.firmware.path={real(autopilot)}")
    out, words = tmp_path / "run", [word for key in keys for word in ("--set", key)]
    assert fly(out, *words, *LOSING, rounds=2) == 0
    check_another_rest(out)


def check_another_rest(out: Path) -> None:
    """It took off once, served somebody twice, and flew the plan as it became."""
    _, uplinks = tables(out)
    assert any(len(tries) > 1 for tries in by_device(uplinks))
    for uplink in uplinks:
        away_m = math.hypot(uplink.true_x_m - uplink.plan_x_m, uplink.true_y_m - uplink.plan_y_m)
        assert away_m < 6.0
    events = [event.text for event in read_log(out / "flight.mcap").events if event.kind == "armed"]
    assert events == ["armed", "disarmed"]
    assert compare_run(load_run(out)).total.cross_track_max_m < 6.0


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (("mission.replan=leg",), "mission.replan = 'leg': must be 'round' or 'stop'"),
        (
            ("mission.strategy=barycenter", "mission.replan=stop"),
            "mission.replan = 'stop': the rest of a round is planned by mission.strategy = cov or "
            "no_cov, not by 'barycenter', which takes 'round'",
        ),
    ],
)
def test_a_wrong_key_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], keys: tuple[str, ...], said: str
) -> None:
    assert call(["run", "--out", str(tmp_path / "out"), *small_runs.SMALL, "--set", *keys]) == 2
    small_runs.refused(capsys, said)


def problem(**more: object) -> RoundProblem:
    values: dict[str, Any] = {
        "devices_m": [[100.0, 0.0], [200.0, 0.0]],
        "importance": [1.0, 1.0],
        "start_m": [0.0, 0.0],
        "steps": 3,
        "per_step": 1,
        "path_budget_m": 300.0,
        "channel": CHANNEL_PRESETS["suburban"],
    }
    return round_problem(**{**values, **more})


def course(whole: RoundProblem) -> Course:
    plan = finish(whole, [[0.0, 0.0], [100.0, 0.0], [200.0, 0.0]])
    return Course(whole, plan, whole, plan)


HEARD = np.array([False, True])
HERE = np.array([100.0, 3.0])


def test_the_rest_has_the_steps_and_metres_that_are_left() -> None:
    rest = course(problem()).ahead(2, HERE, heard=HEARD, elapsed_s=9.0, used_j=1.0)
    assert rest is not None
    assert rest.steps == 1
    assert rest.path_budget_m == pytest.approx(197.0)
    assert rest.importance.tolist() == [1.0, 0.0]
    assert rest.start_m.tolist() == [100.0, 3.0]


def test_the_rest_has_the_seconds_and_joules_that_are_left() -> None:
    limits = RoundLimits(Performance(20.0, 5.0, None), duration_s=20.0, energy_j=5000.0)
    whole = problem(limits=limits, ready_in_s=[12.0, 3.0])
    rest = course(whole).ahead(2, HERE, heard=HEARD, elapsed_s=9.0, used_j=1500.0)
    assert rest is not None
    assert rest.limits is not None
    assert (rest.limits.duration_s, rest.limits.energy_j) == (11.0, 3500.0)
    assert rest.ready_in_s is not None
    assert rest.ready_in_s.tolist() == [3.0, 0.0]


@pytest.mark.parametrize(
    ("step", "elapsed_s", "used_j"), [(3, 0.0, 0.0), (2, 19.9, 0.0), (2, 0.0, 4999.0)]
)
def test_nothing_is_planned_where_nothing_is_left(
    step: int, elapsed_s: float, used_j: float
) -> None:
    limits = RoundLimits(Performance(20.0, 5.0, None), duration_s=20.0, energy_j=5000.0)
    begun = course(problem(limits=limits))
    assert begun.ahead(step, HERE, heard=HEARD, elapsed_s=elapsed_s, used_j=used_j) is None


def test_another_rest_is_flown_where_it_is_worth_more() -> None:
    begun = course(problem(steps=3, devices_m=[[100.0, 0.0], [900.0, 900.0]]))
    rest = begun.ahead(2, HERE, heard=np.array([False, False]), elapsed_s=9.0, used_j=0.0)
    assert rest is not None
    plan = finish(rest, [HERE])
    assert is_better(plan, begun.as_planned(rest), begun.plan.value)
    onwards = begun.onwards(rest, plan, 2)
    assert onwards.plan.waypoints_m.tolist() == [[0.0, 0.0], [100.0, 0.0], [100.0, 3.0]]
    assert onwards.plan.schedule[0, 1:, 0].tolist() == [True, True]  # served once more
    assert math.isnan(onwards.plan.upper_bound)  # no plan that serves nobody twice has one
    assert [stop.steps for stop in onwards.flight(mission()).stops] == [(2,)]


def test_the_plan_as_it_became_is_valued_by_what_is_believed_now() -> None:
    """Else its rates as planned would be those of a belief that it was not planned with."""
    grid = PerGrid(np.full((2, 2, 2), 0.5), (0.0, 0.0), 300.0)
    begun = course(problem(per_grid=replace(grid, success=np.full((2, 2, 2), 0.1))))
    ahead = begun.ahead(2, HERE, heard=np.array([False, False]), elapsed_s=9.0, used_j=0.0)
    assert ahead is not None
    rest = replace(ahead, per_grid=grid, importance=np.array([9.0, 1.0]))
    onwards = begun.onwards(rest, finish(rest, [HERE]), 2)
    assert onwards.problem.per_grid is grid
    assert onwards.plan.value == pytest.approx(0.5 * onwards.plan.schedule.sum())


def test_another_rest_is_not_flown_where_going_on_is_better() -> None:
    begun = course(problem())
    rest = begun.ahead(2, HERE, heard=np.array([True, False]), elapsed_s=9.0, used_j=0.0)
    assert rest is not None
    assert not is_better(finish(rest, [HERE]), begun.as_planned(rest), begun.plan.value)


def mission():
    from mission.config.models import MissionConfig

    return MissionConfig()


def test_a_flight_is_cut_where_somebody_is_served() -> None:
    places = [np.array([100.0 * n, 0.0]) for n in range(4)]
    stops = tuple(Stop(at, (n,), 0.1, (0.0,)) for n, at in enumerate(places))
    plan = FlightPlan(stops, 60.0, 20.0, 5.0)
    parts = list(plan.parts(np.array([True, False, True, False])))
    assert [[stop.steps for stop in part.stops] for part in parts] == [
        [(0,)],
        [(), (1,), (2,)],
        [(), (3,)],
    ]
    assert [part.goes_on for part in parts] == [False, True, True]
    assert [part.waits for part in parts] == [True, False, False]
    assert parts[1].stops[0].hold_s == 0.0
    assert [len(part.stops) for part in plan.parts(np.zeros(4, dtype=bool))] == [4]


def test_parts_of_a_flight_are_one() -> None:
    def part(*t_s: float, energy_j: float) -> FlownTrack:
        track = np.array([[10.0 * t, 0.0, -60.0] for t in t_s])
        t_ns = np.array([round(1e9 * t) for t in t_s])
        return FlownTrack(t_ns, track, track, 1.0 - t_s[-1] / 100.0, energy_j=energy_j)

    whole = FlownTrack.joined(
        [part(0.0, 1.0, energy_j=5.0), part(1.0, energy_j=math.nan), part(1.0, 3.0, energy_j=7.0)]
    )
    assert whole.t_ns.tolist() == [0, 1_000_000_000, 3_000_000_000]
    assert (whole.duration_s, whole.flown_m, whole.energy_j) == (3.0, 30.0, 12.0)
    assert whole.battery_remaining == 0.97
    assert math.isnan(FlownTrack.joined([part(0.0, energy_j=math.nan)] * 2).energy_j)


def test_energy_between_two_parts_of_a_flight_counts() -> None:
    recorder = FlightRecorder()

    def sample(t_s: float) -> Any:
        moment = SimpleNamespace(pos_ned_m=np.zeros(3))
        battery = SimpleNamespace(consumed_mah=t_s, voltage_v=10.0)
        t_ns = round(1e9 * t_s)
        return SimpleNamespace(t_ns=t_ns, truth=moment, belief=moment, battery=battery)

    def here(t_s: float) -> TrackPoint:
        return TrackPoint(round(1e9 * t_s), np.zeros(3), np.zeros(3))

    def flown(begin_s: int, *, goes_on: bool) -> float:
        recorder.start(here(begin_s), goes_on=goes_on)
        for t_s in range(begin_s, begin_s + 3):
            recorder.sampled(sample(t_s))
        energy_j = recorder.finish(here(begin_s + 2), 1.0).energy_j
        recorder.sampled(sample(begin_s + 5))
        return energy_j

    recorder.sampled(sample(0))
    # 36 J a second: of 2 s from the start on; of these and 3 s before; of 5 s that are left out.
    assert flown(0, goes_on=False) == pytest.approx(72.0)
    assert flown(5, goes_on=True) == pytest.approx(36.0 * 5)
    assert flown(10, goes_on=False) == pytest.approx(72.0)
