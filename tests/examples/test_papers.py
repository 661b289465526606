"""Later papers as plug-ins: each flies, and does what it says it takes from the paper."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import aerofed
from examples.papers import energy_2508_03171 as energy
from examples.papers import latency_2412_07428 as latency
from examples.papers import markov_age_2505_05099 as markov
from mission.planner.check import check_plan

PAPERS = sorted((Path(__file__).parents[2] / "examples" / "papers").glob("*.py"))
SMALL = {
    "mission.flight": "none",
    "mission.rounds": 6,
    "mission.steps": 6,
    "planner.gap": 0.1,
    "communities.0.subset": 0.2,
    "communities.1.subset": 0.2,
    "learning.local_epochs": 1,
}


def fly(out: Path, strategy: str, **more: Any) -> aerofed.Run:
    settings = {**SMALL, "mission.strategy": f"examples.papers.{strategy}", **more}
    return aerofed.run("quickstart", settings, out=out)


@pytest.fixture(scope="module")
def problem() -> aerofed.RoundProblem:
    return aerofed.first_problem("quickstart", {"mission.steps": 6})


class Planner:
    def plan(self, problem: aerofed.RoundProblem) -> aerofed.RoundPlan:
        return aerofed.plan(problem, gap=0.05)


@pytest.mark.parametrize("path", PAPERS, ids=lambda path: path.name)
def test_a_paper_is_short_and_says_what_it_reproduces(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) < 150
    assert "What is here" in text
    assert "What is not" in text
    assert "arXiv" in text


def test_propulsion_of_a_rotary_wing() -> None:
    """Its power at hover, at the speed of longest endurance, and of longest range."""
    speed = np.arange(0.0, 30.0, 0.1)
    power = np.array([energy.propulsion_w(v) for v in speed])
    assert power[0] == pytest.approx(79.86 + 88.63)
    assert speed[power.argmin()] == pytest.approx(10.2, abs=0.2)
    assert speed[1:][(power[1:] / speed[1:]).argmin()] == pytest.approx(18.3, abs=0.3)


def test_the_cheapest_round_has_enough_arrivals(problem: aerofed.RoundProblem) -> None:
    alike = replace(problem, importance=np.ones(len(problem.devices_m)))
    eco, longest = energy.Eco(Planner(), 20.0), Planner().plan(alike)
    plan = eco.sortie(0, alike).plan
    check_plan(alike, plan)
    target = energy.SHARE * len(alike.devices_m)
    assert longest.value > target
    assert plan.value >= target - 1e-9
    assert eco.energy_j(plan) < 0.75 * eco.energy_j(longest)
    # One device less would not be enough.
    steps, devices = np.nonzero(plan.schedule[0])
    offset = plan.waypoints_m[steps] - alike.devices_m[devices]
    arrives = 1.0 - alike.channel.per(np.hypot(*offset.T))
    assert plan.value - arrives.min() < target


def test_volunteers_by_age_are_spread_evenly() -> None:
    """Var[X] = f (1 - f), against (n/k)^2 - n/k for k of n drawn each round."""
    rng, mean = np.random.default_rng(1), 2.4
    age, gaps = np.ones(2000, dtype=np.int64), []
    for _ in range(200):
        chosen = rng.random(2000) < markov.chance(age, mean)
        gaps += age[chosen].tolist()
        age = np.where(chosen, 1, age + 1)
    assert np.mean(gaps) == pytest.approx(mean, rel=0.01)
    assert np.var(gaps) == pytest.approx(0.4 * 0.6, rel=0.02)
    assert np.var(gaps) < 0.1 * (mean**2 - mean)


def test_the_least_latency_keeps_its_share(problem: aerofed.RoundProblem) -> None:
    plan, longest = latency.LeastLatency(Planner()).sortie(0, problem).plan, Planner().plan(problem)
    assert plan.value >= latency.SHARE * longest.value
    assert plan.path_m < longest.path_m


@pytest.mark.slow
def test_the_ring_is_a_ring(tmp_path: Path) -> None:
    run = fly(tmp_path / "ring", "latency_2412_07428:make_ring")
    places = run.table("plans")[["x_m", "y_m"]].to_numpy()
    assert np.hypot(*(places - 400.0).T) == pytest.approx(240.0, abs=1.0)
    assert run.rounds["plan_path_m"].max() <= 800.0


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["energy_2508_03171:make", "markov_age_2505_05099:make"])
def test_a_paper_flies_and_resumes(strategy: str, tmp_path: Path) -> None:
    run = fly(tmp_path / "out", strategy)
    assert run.uplinks["delivered"].sum() > 0
    heard = run.uplinks.groupby("round")["device"].nunique()
    assert heard.max() < 12  # participation is the point of both
    if strategy.startswith("markov"):
        weights = run.table("plans").groupby("round").size()
        assert len(weights) == 6
        assert run.uplinks["device"].nunique() == 12  # and everybody's turn comes
