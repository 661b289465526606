"""Rounds of several aircraft: how much of a joint plan is proven, at what cost, and against what.

Devices in 800 x 800 m, importance uniform in [0.2, 1], height 60 m, three places a step; all
aircraft start in the middle ("shared") or each in a corner ("own"). Layouts are drawn from seeds
that no constant of the planner was chosen on. CPU time is that of planning, with the channel's
tables at hand. "one by one" and "parts": what planning one aircraft after another, or the parts
of the best of five clusterings, falls short of the joint plan by, mean and worst. "climb": how
much more a hill climber finds within so many CPU seconds, worst. Run:

    python benchmarks/planner_fleet.py [--layouts 4] [--only 12-2 20-3] [--peers] [--climb 5]
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fl.radio.channel import CHANNEL_PRESETS
from mission.base.arrays import Floats
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.fleet.parts import improved_in_turn, masked
from mission.planner.fleet.team import partitions, team_of
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem, Start

FIRST_SEED = 7_000
CORNERS = ((150.0, 150.0), (650.0, 650.0), (650.0, 150.0), (150.0, 650.0))
MIDDLE = (400.0, 400.0)
# K, A, then (N, L) that are taken in turn.
SIZES = {
    "12-2": (12, 2, ((5, 400.0), (8, 400.0), (10, 800.0), (5, 800.0))),
    "12-3": (12, 3, ((5, 400.0), (8, 400.0), (10, 800.0))),
    "20-2": (20, 2, ((8, 400.0), (10, 800.0))),
    "20-3": (20, 3, ((8, 400.0), (10, 800.0))),
    "40-4": (40, 4, ((10, 400.0),)),
}
CHANNELS = ("suburban+10dB", "suburban")
CLUSTERINGS = 5


def drawn(
    seed: int, *, devices: int, aircraft: int, steps: int, metres: float, channel: str, own: bool
) -> RoundProblem:
    """A round drawn from a seed."""
    rng = np.random.default_rng(FIRST_SEED + seed)
    importance = rng.uniform(0.2, 1.0, devices)
    places = CORNERS[:aircraft] if own else [MIDDLE] * aircraft
    return RoundProblem(
        devices_m=rng.uniform(0.0, 800.0, (devices, 2)),
        importance=importance / importance.sum(),
        starts=tuple(Start(np.array(place), metres) for place in places),
        steps=steps,
        per_step=3,
        channel=CHANNEL_PRESETS[channel],
    )


def problems(size: str, layouts: int, channel: str, own: bool) -> Iterator[RoundProblem]:
    """Layouts of a size, for each of its steps and metres."""
    devices, aircraft, kinds = SIZES[size]
    for number, (steps, metres) in enumerate(kinds):
        for layout in range(layouts):
            yield drawn(
                100 * number + layout, devices=devices, aircraft=aircraft, steps=steps,
                metres=metres, channel=channel, own=own,
            )  # fmt: skip


def alone(problem: RoundProblem) -> list[RoundProblem]:
    """The problem of each aircraft by itself."""
    return [problem.alone(a) for a in range(len(problem.starts))]


def in_parts(problem: RoundProblem, whose: Sequence[Floats]) -> float:
    """The value of planning each aircraft by itself for some of the devices."""
    planner = make_planner(PlannerConfig())
    plans = [
        planner.plan(masked(each, mine)) for each, mine in zip(alone(problem), whose, strict=True)
    ]
    return sum(plan.value for plan in plans)


def one_by_one(problem: RoundProblem) -> float:
    """The value of planning one aircraft after another for what those before it leave."""
    planner, total = make_planner(PlannerConfig()), 0.0
    left = np.ones(len(problem.importance), dtype=np.bool_)
    for each in alone(problem):
        plan = planner.plan(masked(each, left))
        left &= ~plan.schedule.any(axis=(0, 1))
        total += plan.value
    return total


def clustered(problem: RoundProblem) -> float:
    """The best value of a few clusterings, each cluster planned by itself."""
    starts_m = np.stack([start.start_m for start in problem.starts])
    parts = list(partitions(problem.devices_m, problem.importance, starts_m))[-CLUSTERINGS:]
    aircraft = range(len(problem.starts))
    return max(in_parts(problem, [part == a for a in aircraft]) for part in parts)


def climbed(problem: RoundProblem, plan: RoundPlan, seconds: float) -> float:
    """The value that random changes and ascent find from a plan within so many CPU seconds."""
    begun, each, best, seed = time.process_time(), alone(problem), plan.value, 0
    team = team_of(each)
    parts = [
        replace(plan.alone(a), value=float(worth_of(problem.alone(a), plan.alone(a))))
        for a in range(len(each))
    ]
    while time.process_time() - begun < seconds:
        seed += 1
        tried = improved_in_turn(each, parts, 20_000, seed=seed)
        ways = [part.waypoints_m - one.start_m for part, one in zip(tried, each, strict=True)]
        best = max(best, sum(part.value for part in tried), team.plan_along(np.stack(ways)).value)
    return best


def worth_of(problem: RoundProblem, plan: RoundPlan) -> float:
    """What one aircraft's path and schedule are worth."""
    from mission.planner.evaluate import objective

    return objective(problem, plan.waypoints_m, plan.schedule[0])


def measure(size: str, channel: str, own: bool, arguments: argparse.Namespace) -> None:
    """Plan all layouts of a row of the table, and print it."""
    rows = []
    for problem in problems(size, arguments.layouts, channel, own):
        for each in alone(problem):
            team_of([each])  # tables
        begun = time.process_time()
        plan = make_planner(PlannerConfig()).plan(problem)
        spent = time.process_time() - begun
        check_plan(problem, plan)
        peers = [one_by_one(problem), clustered(problem)] if arguments.peers else [plan.value] * 2
        top = climbed(problem, plan, arguments.climb) if arguments.climb else plan.value
        rows.append(
            (spent, plan.gap, *(1.0 - peer / plan.value for peer in peers), top / plan.value - 1.0)
        )
        if top > plan.upper_bound * (1.0 + 1e-6):
            print(f"{plan.upper_bound=} is beaten by {top}", file=sys.stderr)
        if arguments.verbose:
            print(
                f"  N={problem.steps} L={problem.starts[0].path_budget_m:g}: {spent:.3f} s, "
                f"{plan.gap:.2%}, {plan.nodes} nodes, {plan.value:.4f} {plan.ended}",
                file=sys.stderr, flush=True,
            )  # fmt: skip
    spent_s, gap, first, parts, more = np.array(rows).T
    print(
        f"| {size} | {channel} | {'own' if own else 'shared'} | {len(rows)}"
        f" | {(gap <= 0.0101).sum()} | {np.median(spent_s):.3f} | {spent_s.max():.2f}"
        f" | {np.median(gap):.2%} | {gap.max():.2%}"
        f" | {first.mean():.1%}, {first.max():.1%} | {parts.mean():.1%}, {parts.max():.1%}"
        f" | {more.max():.2%} |",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--layouts", type=int, default=4)
    parser.add_argument("--only", choices=SIZES, nargs="*", default=list(SIZES))
    parser.add_argument("--channels", nargs="*", default=list(CHANNELS))
    parser.add_argument("--climb", type=float, default=0.0, help="CPU seconds of climbing")
    parser.add_argument("--peers", action="store_true", help="compare with single planning")
    parser.add_argument("--verbose", action="store_true", help="every problem, on stderr")
    given = parser.parse_args()
    print(
        "| K-A | channel | starts | problems | to 1 % | CPU s, median | worst | gap, median"
        " | worst | one by one | parts | climb |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for size in given.only:
        for channel in given.channels:
            for own in (False, True):
                measure(size, channel, own, given)
