"""Planning: value against the proven bound, and CPU time, by method, channel and size.

Every number of a line is measured in the same run. The optimum is bracketed by the certified
planner at a gap of 0.1 %; what the methods reach is given as a share of the value found there.
Layouts are drawn from seeds that no constant of the planner was chosen on. Run:

    python benchmarks/planner.py [--layouts 20] [--long 60] [--figures DIR]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fl.radio import CHANNEL_PRESETS
from mission.planner.certified import CertifiedPlanner
from mission.planner.commands import served_radius
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import check_plan
from mission.planner.factory import make_planner
from mission.planner.figure import draw_plan
from mission.planner.problem import Planner, RoundPlan, RoundProblem
from mission.planner.sqp import SqpPlanner

CHANNELS = ("suburban+10dB", "suburban", "suburban+30dB")
FURTHER = ("urban", "dense-urban", "high-rise", "literal-log-variance", "suburban-log-variance")
FIRST_SEED = 770_000


def layout(seed: int, *, devices: int, steps: int, channel: str, budget: float) -> RoundProblem:
    """Random positions in 800 x 800 m; ten communities of different weight."""
    rng = np.random.default_rng(FIRST_SEED + seed)
    community = rng.integers(0, 10, devices)
    weight = rng.uniform(0.5, 1.5, 10)[community] * rng.choice([1.0, 1.5], devices)
    return RoundProblem(
        devices_m=rng.uniform(0.0, 800.0, (devices, 2)),
        importance=weight / devices,
        start_m=rng.uniform(0.0, 800.0, 2),
        steps=steps,
        per_step=3,
        path_budget_m=budget,
        channel=CHANNEL_PRESETS[channel],
    )


def timed(planner: Planner, problem: RoundProblem) -> tuple[RoundPlan, float]:
    """A checked plan and its CPU milliseconds."""
    start = time.process_time()
    plan = planner.plan(problem)
    spent = (time.process_time() - start) * 1e3
    check_plan(problem, plan)
    return plan, spent


def small(layouts: int, channels: Sequence[str]) -> None:
    """K = 12, N in {8, 10}: every method on every layout."""
    methods: dict[str, Planner] = {
        "paper_literal": make_planner(PlannerConfig(kind="paper_literal")),
        "paper": make_planner(PlannerConfig(kind="paper")),
        "first plan": CertifiedPlanner(max_nodes=0),
        "sqp": SqpPlanner(),
        "certified": CertifiedPlanner(),
    }
    tight = CertifiedPlanner(gap=1e-3, max_nodes=100_000)
    print(f"K = 12, N = 8 and 10, L = 800 m, {layouts} layouts each; CPU ms")
    print(
        f"{'channel':22} {'method':14} {'of optimum: mean':>17} {'least':>7} {'gap: mean':>10}"
        f" {'worst':>7} {'ms: median':>11} {'worst':>7} {'nodes':>7} repeat"
    )
    for channel in channels:
        problems = [
            layout(seed, devices=12, steps=steps, channel=channel, budget=800.0)
            for steps in (8, 10)
            for seed in range(layouts)
        ]
        best = [tight.plan(problem) for problem in problems]
        for name, planner in methods.items():
            planner.plan(problems[0])  # compiles what there is to compile
            made = [timed(planner, problem) for problem in problems]
            for (plan, _), bracket in zip(made, best, strict=True):
                if plan.value > bracket.upper_bound * (1.0 + 1e-9):
                    raise AssertionError("a plan lies above a bound")
            share = [p.value / max(b.value, p.value) for (p, _), b in zip(made, best, strict=True)]
            gaps = [plan.gap for plan, _ in made]
            spent = [ms for _, ms in made]
            again = planner.plan(problems[-1])
            same = again.waypoints_m.tobytes() == made[-1][0].waypoints_m.tobytes()
            title = f"{channel} ({served_radius(CHANNEL_PRESETS[channel]):.0f} m)"
            print(
                f"{title:22} {name:14} {np.mean(share):17.4f} {min(share):7.4f}"
                f" {np.mean(gaps):10.2%} {max(gaps):7.2%} {np.median(spent):11.2f}"
                f" {max(spent):7.1f} {max(p.nodes for p, _ in made):7d} {same}",
                flush=True,
            )


def large(seconds: float) -> None:
    """K = 100 and 1000, N = 50, against a search of that many CPU seconds."""
    print(f"\nlarge instances, against {seconds:.0f} s of search; CPU ms")
    for devices, budget in ((100, 800.0), (100, 2400.0), (1000, 800.0)):
        for channel in CHANNELS:
            problem = layout(0, devices=devices, steps=50, channel=channel, budget=budget)
            plan, spent = timed(SqpPlanner(), problem)
            probe = timed(SqpPlanner(tries=40), problem)[1] - timed(SqpPlanner(tries=0), problem)[1]
            tries = max(40, int(40 * seconds * 1e3 / max(probe, 1.0)))
            long, took = timed(SqpPlanner(tries=tries), problem)
            print(
                f"K = {devices:5d}, N = 50, L = {budget:5.0f} m, {channel:14} {spent:7.0f} ms, "
                f"value {plan.value:.5f} = {plan.value / max(plan.value, long.value):.4f} of "
                f"{took / 1e3:.0f} s and {tries} tries",
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
import time
began = time.perf_counter()
import numpy as np
from fl.radio import CHANNEL_PRESETS
from mission.planner.certified import CertifiedPlanner
from mission.planner.problem import RoundProblem
rng = np.random.default_rng(1)
problem = RoundProblem(rng.uniform(0, 800, (12, 2)), rng.random(12), np.full(2, 400.0), 10, 3,
                       800.0, CHANNEL_PRESETS["suburban"])
CertifiedPlanner(max_nodes=0).plan(problem)
print(time.perf_counter() - began)
"""


def cold() -> None:
    """From the start of the interpreter to the first plan, without and with the cache."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        for name in ("first after installation", "second"):
            run = subprocess.run(
                [sys.executable, "-c", COLD], env=environment, capture_output=True, text=True,
                check=True,
            )  # fmt: skip
            print(f"cold start, {name}: {float(run.stdout):.2f} s to the first plan", flush=True)


def pictures(folder: Path) -> None:
    """Five plans as pictures, with their gaps."""
    for seed, channel in enumerate(("suburban+10dB", "suburban+10dB", *CHANNELS[1:], "suburban")):
        problem = layout(seed, devices=12, steps=10, channel=channel, budget=800.0)
        plan = CertifiedPlanner().plan(problem)
        draw_plan(problem, plan, folder / f"plan-{seed}.png", title=f"layout {seed}, {channel}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--layouts", type=int, default=20)
    parser.add_argument("--long", type=float, default=60.0)
    parser.add_argument("--figures", type=Path)
    arguments = parser.parse_args()
    cold()
    small(arguments.layouts, CHANNELS)
    small(max(arguments.layouts // 4, 1), FURTHER)
    large(arguments.long)
    growth()
    if arguments.figures is not None:
        pictures(arguments.figures)
