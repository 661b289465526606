"""Every number in the tables of a run, against a small flight worked out by hand.

The aircraft is believed to be a fiftieth farther from home than planned, and truly is a twentieth
farther, in height as well.
"""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from one_aircraft import one_path
from scipy.special import ndtr
from small_runs import rows

import aerofed
from fl.radio.channel import CHANNEL_PRESETS
from mission.flight.flyers.unflown import UnflownFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlownTrack, TrackPoint
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import read_table

CONFIG = """
[mission]
flight = "none"
rounds = 2
steps = 3
devices_per_step = 2
path_budget_m = 300
total_budget_m = 1000
total_deadline_s = 500
total_energy_j = 1e6
[area]
home_m = [200, 100]
[learning]
local_epochs = 1
[[communities]]
name = "near"
task = "digits"
positions_m = [[420, 190], [265, 105]]
labels_per_device = 5
[[communities]]
name = "far"
task = "digits"
positions_m = [[700, 700]]
labels_per_device = 10
"""
HOME_M = np.array([200.0, 100.0])
DEVICES_M = np.array([[420.0, 190.0], [265.0, 105.0], [700.0, 700.0]])
# By round: waypoints, (step, device) of who sends, what devices count.
WAYS_M = (np.array([[200.0, 100], [260, 180], [260, 100]]), np.array([[260.0, 100], [200, 100]]))
SENDS = ([(1, 0), (1, 2), (2, 1)], [(1, 1)])
IMPORTANCE = ([0.5, 0.3, 0.2], [0.1, 0.2, 0.7])
BELIEVED, TRUE = 1.02, 1.05  # times the planned distance from home
DRAWN_J = 2500.0  # of the battery, by a round's flight
CHANNEL = CHANNEL_PRESETS["suburban"]


def per(device: int, x_m: float, y_m: float, height_m: float) -> float:
    """q_bar of the paper."""
    c, away = CHANNEL, DEVICES_M[device] - (x_m, y_m)
    rho = 1.0 / (1.0 + math.exp(c.a2 - c.a1_per_rad * math.atan2(height_m, math.hypot(*away))))
    lost = 0.0
    for weight, beta_db, alpha, sigma in (
        (rho, c.beta_los_db, c.alpha_los, c.sigma_los),
        (1.0 - rho, c.beta_nlos_db, c.alpha_nlos, c.sigma_nlos),
    ):
        distance_m = math.hypot(*away, height_m)
        snr_db = c.tx_power_db + beta_db - 10.0 * alpha * math.log10(distance_m) - c.noise_db
        lacking_db = 10.0 * math.log10(c.snr_threshold) - snr_db
        lost += weight * ndtr(lacking_db * math.log(10.0) / 10.0 / sigma)
    return lost


def farther(times: float, x_m: float, y_m: float) -> tuple[float, float, float]:
    x, y = HOME_M + times * (np.array([x_m, y_m]) - HOME_M)
    return float(x), float(y), times * 60.0


class ByHand:
    """Flies the ways above."""

    fairness, approach_m = True, None

    def importance(self, info: aerofed.RoundInfo) -> np.ndarray:
        return np.array(IMPORTANCE[info.round - 1])

    def sortie(self, index: int, problem: aerofed.RoundProblem) -> aerofed.Sortie:
        way, schedule = WAYS_M[index], np.zeros((3, 3), dtype=bool)
        way = np.vstack((way, way[-1:]))[:3]
        schedule[tuple(np.transpose(SENDS[index]))] = True
        value = sum(
            problem.importance[device] * (1.0 - per(device, float(x_m), float(y_m), 60.0))
            for step, device in SENDS[index]
            for x_m, y_m in [way[step]]
        )
        return aerofed.Sortie(one_path(way, schedule, value, 1.25 * value))


async def _fly(self: UnflownFlyer, plan: FlightPlan) -> FlownTrack:
    flight = await FLY(self, plan)
    passages = [
        None if p is None else TrackPoint(p.t_ns, TRUE * p.true_ned_m, BELIEVED * p.est_ned_m)
        for p in flight.passages
    ]
    left = 0.9 - 1e-9 * int(flight.t_ns[-1]) / 100.0
    true_m, est_m = TRUE * flight.true_ned_m, BELIEVED * flight.est_ned_m
    return FlownTrack(flight.t_ns, true_m, est_m, left, tuple(passages), DRAWN_J)


FLY = UnflownFlyer.fly


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rows")
    (out / "config.toml").write_text(CONFIG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(UnflownFlyer, "fly", _fly)
        aerofed.run(out / "config.toml", strategy=lambda _: ByHand(), out=out / "run")
    return out / "run"


def numbers(record: UplinkRecord | RoundRecord) -> dict[str, float]:
    return {key: value for key, value in asdict(record).items() if isinstance(value, float | int)}


def test_each_uplink(folder: Path) -> None:
    # Round, device, community, step, seconds at 20 m/s: 100 m and 80 m, then 60 m.
    expected = [
        (1, 0, "near", 1, 5.0), (1, 2, "far", 1, 5.0), (1, 1, "near", 2, 9.0),
        (2, 1, "near", 1, 12.0),
    ]  # fmt: skip
    found = read_table(folder / "uplinks.csv", UplinkRecord)
    for uplink, (number, device, community, step, t_s) in zip(found, expected, strict=True):
        x_m, y_m = WAYS_M[number - 1][step].tolist()
        est_m, true_m = (farther(times, x_m, y_m) for times in (BELIEVED, TRUE))
        by_hand = UplinkRecord(
            number, device, uplink.community, step, t_s, x_m, y_m, *est_m, *true_m,
            per(device, x_m, y_m, 60.0), per(device, *est_m), per(device, *true_m),
            IMPORTANCE[number - 1][device],
            delivered=device == 1 or (device == 0 and uplink.delivered),
        )  # fmt: skip
        assert uplink.community == community
        assert numbers(uplink) == pytest.approx(numbers(by_hand), rel=1e-9, abs=1e-12)
    # Of one that is nearly sure, one that is as good as lost, and one that is neither.
    assert [uplink.true_per > 0.999 for uplink in found] == [False, True, False, False]
    assert [uplink.true_per < 0.001 for uplink in found] == [False, False, True, True]


def test_each_round(folder: Path) -> None:
    uplinks = read_table(folder / "uplinks.csv", UplinkRecord)
    learning = rows(folder / "learning.csv")
    found = read_table(folder / "rounds.csv", RoundRecord)
    # Joules that were foreseen: 285 W at 20 m/s at sea level, less in the air up there.
    for record, (start_s, duration_s, path_m, foreseen_j) in zip(
        found, ((0.0, 9.0, 180.0, 9.0 * 285.0), (9.0, 3.0, 60.0, 3.0 * 285.0)), strict=True
    ):
        sent = [u for u in uplinks if u.round == record.round]
        planned, believed, true = (
            sum(u.importance * (1.0 - getattr(u, f"{which}_per")) for u in sent)
            for which in ("plan", "est", "true")
        )
        end_s = start_s + duration_s
        by_hand = RoundRecord(
            round=record.round,
            start_t_s=start_s,
            duration_s=duration_s,
            plan_objective=planned,
            est_objective=believed,
            true_objective=true,
            upper_bound=1.25 * planned,
            plan_path_m=path_m,
            flown_path_m=TRUE * path_m,
            budget_used_m=TRUE * (path_m if record.round == 1 else 240.0),
            scheduled=len(sent),
            delivered=sum(u.delivered for u in sent),
            battery_remaining=0.9 - end_s / 100.0,
            accuracy={},
            cov={},
            plan_altitude_m=math.nan,
            plan_duration_s=duration_s,
            plan_energy_j=record.plan_energy_j,
            energy_j=DRAWN_J,
            time_used_s=end_s,
            energy_used_j=DRAWN_J * record.round,
        )
        assert numbers(record) == pytest.approx(numbers(by_hand), rel=1e-9, nan_ok=True)
        assert record.plan_energy_j == pytest.approx(foreseen_j, rel=0.02)
        assert record.cov == {"near": 1.0, "far": 1.0}  # of rounds before its first period is over
        mine = [row for row in learning if row["round"] == f"{record.round}"]
        assert [row["device"] for row in mine] == ["0", "1", "2"]
        assert [row["community"] for row in mine] == ["near", "near", "far"]
        heard = {f"{u.device}" for u in sent if u.delivered}
        assert {row["device"] for row in mine if row["loss"] != "nan"} == heard
        assert {*record.accuracy} == {"near", "far"}
    first = found[0]
    assert first.true_objective > 1.005 * first.est_objective > 1.01 * first.plan_objective


def test_each_round_of_the_aircraft(folder: Path) -> None:
    (first, second), sent = rows(folder / "aircraft.csv"), rows(folder / "uplinks.csv")
    for row, (start_s, duration_s, path_m) in ((first, (0, 9, 180)), (second, (9, 3, 60))):
        mine = [uplink for uplink in sent if uplink["round"] == row["round"]]
        assert row["aircraft"] == "uav1"
        assert float(row["start_t_s"]) == start_s
        assert float(row["duration_s"]) == float(row["plan_duration_s"]) == duration_s
        assert float(row["plan_path_m"]) == pytest.approx(path_m)
        assert float(row["flown_path_m"]) == pytest.approx(TRUE * path_m)
        assert float(row["energy_j"]) == DRAWN_J
        assert float(row["battery_remaining"]) == pytest.approx(0.9 - (start_s + duration_s) / 100)
        assert int(row["scheduled"]) == len(mine)
        assert int(row["delivered"]) == sum(uplink["delivered"] == "true" for uplink in mine)
        assert row["plan_altitude_m"] == "nan"


def test_each_device(folder: Path) -> None:
    found = rows(folder / "devices.csv")
    assert [row["community"] for row in found] == ["near", "near", "far"]
    assert [(float(row["x_m"]), float(row["y_m"])) for row in found] == list(map(tuple, DEVICES_M))
    samples = np.array([int(row["samples"]) for row in found])
    classes = [[pair.split(":") for pair in row["labels"].split()] for row in found]
    assert [sum(int(count) for _, count in of) for of in classes] == samples.tolist()
    assert [len(of) for of in classes] == [5, 5, 10]
    assert samples[2] == 1438  # all of the bundled digits that are for training
    p = samples / [*[samples[:2].sum()] * 2, samples[2]]
    assert [float(row["p"]) for row in found] == pytest.approx(p)


def test_what_the_summary_adds_up(folder: Path) -> None:
    told = json.loads((folder / "summary.json").read_text())
    found = read_table(folder / "rounds.csv", RoundRecord)
    assert {key: told[key] for key in ("rounds", "scheduled", "battery_changes")} == {
        "rounds": 2, "scheduled": 4, "battery_changes": 0,
    }  # fmt: skip
    assert told["delivered"] == sum(record.delivered for record in found)
    assert told["flown_in_rounds_m"] == told["budget_used_m"] == pytest.approx(TRUE * 240.0)
    assert told["time_used_s"] == told["simulated_s"] == 12.0
    assert told["energy_used_j"] == 2 * DRAWN_J
    assert told["accuracy"] == found[-1].accuracy
    assert {*told["untrained_accuracy"]} == {"near", "far"}


def test_a_round_of_the_ideal(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text(CONFIG)
    aerofed.run(tmp_path / "config.toml", {"mission.strategy": "ideal"}, out=tmp_path / "run")
    first, second = read_table(tmp_path / "run" / "rounds.csv", RoundRecord)
    # p of each community adds up to 1; who has not been heard weighs half as much again.
    for record, worth in ((first, 1.5 * 2.0), (second, 2.0)):
        assert record.plan_objective == pytest.approx(worth)
        assert record.est_objective == record.true_objective == record.plan_objective
        assert record.upper_bound == record.plan_objective
        assert (record.scheduled, record.delivered) == (3, 3)
        assert (record.start_t_s, record.duration_s, record.battery_remaining) == (0.0, 0.0, 1.0)
        assert (record.plan_path_m, record.flown_path_m) == (0.0, 0.0)
        assert record.budget_used_m == record.round * 300.0
        assert record.time_used_s == pytest.approx(record.round * 300.0 / 20.0)
        assert record.energy_used_j == pytest.approx(record.round * 285.0 * 15.0, rel=0.02)
        assert math.isnan(record.energy_j)
        assert record.cov == {"near": 1.0, "far": 1.0}
    uplinks = rows(tmp_path / "run" / "uplinks.csv")
    assert uplinks == []
