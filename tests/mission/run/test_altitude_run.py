"""Runs whose rounds choose their altitude: flown there, resumed to the same bytes."""

import json
from pathlib import Path

import numpy as np
import pytest
import small_runs
from cutting import cut_after

from mission.analysis.load import load_run
from mission.cli import call
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import read_table

pytestmark = pytest.mark.slow

# An urban channel, which is best from higher up: the climb before the first round is a long one.
URBAN = ("--set", "mission.altitude_m=[40,120]", "--set", "channel.preset=urban")
SMALL = (*small_runs.SMALL, *URBAN)
UNFLOWN = ("--set", "mission.flight=none")


def fly(out: Path, *more: str, rounds: int = 2) -> int:
    words = small_runs.last_counts(*SMALL, *more)
    return call(["run", "--out", str(out), "--rounds", str(rounds), *words])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "first"
    assert fly(out) == 0
    return out


def planned_m(folder: Path) -> dict[int, float]:
    """The altitude of every round's plan in the log."""
    return {plan.round: plan.altitude_m for plan in load_run(folder).data.plans}


def test_every_round_is_flown_at_its_planned_altitude(run: Path) -> None:
    planned = planned_m(run)
    uplinks = read_table(run / "uplinks.csv", UplinkRecord)
    assert {uplink.round for uplink in uplinks} == {1, 2}
    for uplink in uplinks:
        assert 40.0 <= planned[uplink.round] <= 120.0
        assert planned[uplink.round] > 50.0, "not where it took off to"
        # Also the first step, which is served where the round before ended.
        assert uplink.est_alt_m == pytest.approx(planned[uplink.round], abs=1.5)
        assert uplink.true_alt_m == pytest.approx(planned[uplink.round], abs=3.0)
    rounds = read_table(run / "rounds.csv", RoundRecord)
    assert {r.round: r.plan_altitude_m for r in rounds} == planned


def test_the_climb_is_no_part_of_the_round(run: Path) -> None:
    data = load_run(run).data
    first = data.rounds[0]
    start_ns, end_ns = (
        round(1e9 * t) for t in (first.start_t_s, first.start_t_s + first.duration_s)
    )
    heights = data.belief.between(start_ns, end_ns).pos_m[:, 2]
    assert np.ptp(heights) < 3.0
    before = data.belief.between(0, start_ns).pos_m[:, 2]
    assert before.max() == pytest.approx(planned_m(run)[1], abs=1.5)


def test_plan_files_have_the_altitude(run: Path) -> None:
    for number, altitude_m in planned_m(run).items():
        plan = json.loads((run / "plans" / f"round-{number:03d}.plan").read_text())
        heights = {item["params"][6] for item in plan["mission"]["items"] if item["command"] == 16}
        assert list(heights) == [pytest.approx(altitude_m)]


def test_a_run_cut_short_is_resumed_to_the_same_bytes(tmp_path: Path) -> None:
    out, whole = tmp_path / "cut", tmp_path / "whole"
    assert fly(whole, *UNFLOWN) == 0
    with cut_after(1):
        assert fly(out, *UNFLOWN) != 0
    assert call(["run", "--resume", str(out), "--quiet"]) == 0
    assert small_runs.digests(out) == small_runs.digests(whole)


@pytest.mark.parametrize("strategy", ["barycenter", "rectangular", "no_cov"])
def test_every_strategy_chooses_an_altitude(tmp_path: Path, strategy: str) -> None:
    out = tmp_path / strategy
    assert fly(out, "--set", f"mission.strategy={strategy}", *UNFLOWN) == 0
    for uplink in read_table(out / "uplinks.csv", UplinkRecord):
        assert uplink.true_alt_m == pytest.approx(planned_m(out)[uplink.round])
        assert uplink.true_per == pytest.approx(uplink.plan_per, abs=1e-9)


def test_ideal_needs_none(tmp_path: Path) -> None:
    assert fly(tmp_path / "ideal", "--set", "mission.strategy=ideal") == 0
