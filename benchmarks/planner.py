"""Planning: value against the proven bound, and CPU time, by method, channel and size.

Every number of a line is measured in the same run, in CPU time. The optimum is bracketed by the
certified planner at a gap of 0.1 %: "optimum" is the share reached of the best value known, and
"short of bound" what is missing at most to the true optimum. Large instances are compared with
the planner's own exploration from hundreds of starts. Layouts are drawn from seeds that no constant
of the planner was chosen on.

Reward and bound need tables of the channel out to a reach, which a process makes once and then
keeps. Plans are timed with them at hand; what they cost has a line of its own by channel. Run:

    python benchmarks/planner.py [--quick] [--layouts 20] [--long 60] [--figures DIR]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fl.radio.channel import CHANNEL_PRESETS, served_radius_m
from mission.figures.plan import plan_picture
from mission.figures.render import save_all
from mission.planner.certified import CertifiedPlanner, ExploringPlanner, instance, relax
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.plan import Planner, RoundPlan
from mission.planner.problem import RoundProblem, Start
from mission.planner.reward import conjugates, reward_table
from mission.planner.sqp import SqpPlanner

CHANNELS = ("suburban+10dB", "suburban", "suburban+30dB")
FURTHER = ("urban", "dense-urban", "high-rise", "literal-log-variance", "suburban-log-variance")
FIRST_SEED = 990_000
SIZES = ((100, 800.0), (100, 2400.0), (1000, 800.0))  # K, L_max
KEYS = ("value", "upper_bound")


def layout(seed: int, *, devices: int, steps: int, channel: str, budget: float) -> RoundProblem:
    """Random positions in 800 x 800 m; ten communities of different weight."""
    rng = np.random.default_rng(FIRST_SEED + seed)
    community = rng.integers(0, 10, devices)
    weight = rng.uniform(0.5, 1.5, 10)[community] * rng.choice([1.0, 1.5], devices)
    return RoundProblem(
        devices_m=rng.uniform(0.0, 800.0, (devices, 2)),
        importance=weight / devices,
        starts=(Start(rng.uniform(0.0, 800.0, 2), budget),),
        steps=steps,
        per_step=3,
        channel=CHANNEL_PRESETS[channel],
    )


def timed(planner: Planner, problem: RoundProblem) -> tuple[RoundPlan, float]:
    """A checked plan and its CPU milliseconds."""
    start = time.process_time()
    plan = planner.plan(problem)
    spent = (time.process_time() - start) * 1e3
    check_plan(problem, plan)
    return plan, spent


def tabled(problem: RoundProblem) -> float:
    """CPU milliseconds of the channel's tables for a problem, as the first of a process has them.

    What its own devices cost on top is taken off.
    """
    for table in (reward_table, conjugates):
        table.cache_clear()
    spent = []
    for _ in range(2):  # to be made, at hand
        start = time.process_time()
        devices, _ = instance(problem)
        relax(problem, devices)
        spent.append((time.process_time() - start) * 1e3)
    return spent[0] - spent[1]


def small(layouts: int, channels: Sequence[str], *, max_nodes: int) -> None:
    """K = 12, N in {8, 10}: every method on every layout; every plan is checked to 1 mm."""
    methods: dict[str, Planner] = {
        "paper_literal": make_planner(PlannerConfig(kind="paper_literal")),
        "paper": make_planner(PlannerConfig(kind="paper")),
        "first plan": CertifiedPlanner(max_nodes=0),
        "sqp": SqpPlanner(),
        "certified": CertifiedPlanner(),
    }
    tight = CertifiedPlanner(gap=1e-3, max_nodes=max_nodes)
    print(f"K = 12, N = 8 and 10, L = 800 m, {layouts} layouts each; CPU ms")
    print(
        f"{'channel':30} {'method':14} {'value':>7} {'bound':>7} {'optimum: mean':>14} {'least':>7}"
        f" {'short of bound':>14} {'gap: mean':>10} {'worst':>7} {'ms: median':>11} {'worst':>7}"
        f" {'nodes':>6} repeat"
    )
    for channel in channels:
        problems = [
            layout(seed, devices=12, steps=steps, channel=channel, budget=800.0)
            for steps in (8, 10)
            for seed in range(layouts)
        ]
        title = f"{channel} ({served_radius_m(CHANNEL_PRESETS[channel]):.0f} m)"
        tables = [tabled(problem) for problem in problems]
        print(
            f"{title:30} {'tables, once a channel and reach':87} {np.median(tables):11.2f}"
            f" {max(tables):7.1f}",
            flush=True,
        )
        best = [tight.plan(problem) for problem in problems]
        for name, planner in methods.items():
            planner.plan(problems[0])  # what a first call makes and keeps
            made = [timed(planner, problem) for problem in problems]
            for (plan, _), bracket in zip(made, best, strict=True):
                if plan.value > bracket.upper_bound * (1.0 + 1e-9):
                    raise AssertionError("a plan lies above a bound")
            share = [p.value / max(b.value, p.value) for (p, _), b in zip(made, best, strict=True)]
            short = [1.0 - p.value / b.upper_bound for (p, _), b in zip(made, best, strict=True)]
            gaps = [plan.gap for plan, _ in made]
            value, bound = (np.mean([getattr(p, key) for p, _ in made]) for key in KEYS)
            spent = [ms for _, ms in made]
            again = planner.plan(problems[-1])
            same = all(
                getattr(again, key).tobytes() == getattr(made[-1][0], key).tobytes()
                for key in ("waypoints_m", "schedule")
            )
            print(
                f"{title:30} {name:14} {value:7.4f} {bound:7.4f} {np.mean(share):14.4f}"
                f" {min(share):7.4f} {np.mean(short):14.2%} {np.mean(gaps):10.2%} {max(gaps):7.2%}"
                f" {np.median(spent):11.2f} {max(spent):7.1f} {max(p.nodes for p, _ in made):6d}"
                f" {same}",
                flush=True,
            )


def longer(devices: int) -> None:
    """K = 15 and 20: certified in seconds?"""
    for channel in CHANNELS:
        spent, gaps = [], []
        for seed in range(4):
            problem = layout(seed, devices=devices, steps=10, channel=channel, budget=800.0)
            plan, ms = timed(CertifiedPlanner(max_nodes=100_000), problem)
            spent.append(ms / 1e3)
            gaps.append(plan.gap)
        print(
            f"K = {devices}, N = 10, {channel:14} median {np.median(spent):6.2f} s, "
            f"worst {max(spent):6.2f} s, worst gap {max(gaps):.2%}",
            flush=True,
        )


def long_search(problem: RoundProblem, seconds: float) -> tuple[float, float]:
    """(the best value found, CPU seconds)."""
    began = time.process_time()
    found, ms = timed(ExploringPlanner(starts=500, tries=500), problem)
    tries = int(500 * (seconds * 1e3 - ms) / ms)
    if tries > 500:
        again, _ = timed(ExploringPlanner(starts=500, tries=tries), problem)
        found = max(found, again, key=lambda one: one.value)
    return found.value, time.process_time() - began


def large(seconds: float, sizes: Sequence[tuple[int, float]]) -> None:
    """N = 50, against a search of that many CPU seconds."""
    print(f"\nN = 50, against {seconds:.0f} s of search; CPU ms")
    print(
        f"{'K':>5} {'L m':>6} {'channel':14} {'ms':>6} {'value':>8} {'search':>8}"
        f" {'CPU s':>6} {'of the best':>12}"
    )
    for devices, budget in sizes:
        for channel in CHANNELS:
            problem = layout(0, devices=devices, steps=50, channel=channel, budget=budget)
            plan, spent = timed(SqpPlanner(), problem)
            found, took = long_search(problem, seconds)
            best = max(plan.value, found)
            print(
                f"{devices:5d} {budget:6.0f} {channel:14} {spent:6.0f} {plan.value:8.5f}"
                f" {found:8.5f} {took:6.0f} {plan.value / best:12.4f}",
                flush=True,
            )


def growth() -> None:
    """CPU time over K."""
    print("\ngrowth, N = 50, L = 800 m, suburban; CPU ms")
    for devices in (12, 30, 100, 300, 1000, 3000):
        problem = layout(1, devices=devices, steps=50, channel="suburban", budget=800.0)
        _, fast = timed(SqpPlanner(), problem)
        plan, full = timed(CertifiedPlanner(max_nodes=2000), problem)
        print(
            f"K = {devices:5d}: sqp {fast:7.0f}, certified {full:7.0f}, gap {plan.gap:.1%}",
            flush=True,
        )


COLD = """
import sys, time
from mission.cli import call
from mission.planner.certified import CertifiedPlanner
plan = CertifiedPlanner.plan
def timed(self, problem):
    print(time.process_time())
    try:
        return plan(self, problem)
    finally:
        print(time.process_time())
CertifiedPlanner.plan = timed
call(["plan", "--problem", sys.argv[1], "--out", sys.argv[2]])
"""


def as_entry(problem: RoundProblem) -> dict[str, object]:
    """The problem as an entry of a problem file."""
    return {
        "id": "cold",
        "devices": problem.devices_m.tolist(),
        "importance": problem.importance.tolist(),
        "start": problem.start_m.tolist(),
        "steps": problem.steps,
        "per_step": problem.per_step,
        "path_budget_m": problem.path_budget_m,
        "channel": asdict(problem.channel),
    }


def cold() -> None:
    """CPU seconds from the interpreter to planning, and to the plan: the least of five."""
    with tempfile.TemporaryDirectory() as folder:
        given = layout(0, devices=12, steps=10, channel="suburban", budget=800.0)
        problem = Path(folder, "problem.json")
        problem.write_text(json.dumps([as_entry(given)]))
        times = []
        for number in range(5):
            run = subprocess.run(
                [sys.executable, "-c", COLD, str(problem), f"{folder}/{number}.json"],
                capture_output=True, text=True, check=True,
            )  # fmt: skip
            times.append([float(line) for line in run.stderr.split()])
        begins, ends = min(times, key=lambda pair: pair[1])
        print(
            f"`aerofed plan --problem`: planning begins after {begins:.2f} s of CPU, planned after "
            f"{ends:.2f} s",
            flush=True,
        )
    print()


def pictures(folder: Path) -> None:
    """Five plans as pictures, with their gaps."""
    drawn = {}
    for seed, channel in enumerate(("suburban+10dB", "suburban+10dB", *CHANNELS[1:], "suburban")):
        problem = layout(seed, devices=12, steps=10, channel=channel, budget=800.0)
        plan = CertifiedPlanner().plan(problem)
        title = f"layout {seed}, {channel}"
        drawn[f"plan-{seed}.png"] = plan_picture(problem, plan, title=title)
    save_all(drawn, folder)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="a look within a minute or two")
    parser.add_argument("--layouts", type=int, default=20)
    parser.add_argument("--long", type=float, default=60.0)
    parser.add_argument("--figures", type=Path)
    arguments = parser.parse_args()
    layouts, seconds = (3, 6.0) if arguments.quick else (arguments.layouts, arguments.long)
    cold()
    small(layouts, CHANNELS, max_nodes=100_000)
    small(max(layouts // 4, 1), FURTHER, max_nodes=20_000)
    print()
    for count in (15,) if arguments.quick else (15, 20):
        longer(count)
    large(seconds, SIZES[:1] if arguments.quick else SIZES)
    growth()
    if arguments.figures is not None:
        pictures(arguments.figures)
