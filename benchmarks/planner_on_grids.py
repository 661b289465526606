"""Plans with what is believed of each place: gaps, CPU time, and what a long climb adds.

First rounds of a configuration that believes in the truth, with importances drawn anew; after
planning, as many changes at random as take the given CPU seconds. For another city:

    aerofed radio-map quickstart --engine sionna --scene florence --out florence.nc
    python benchmarks/planner_on_grids.py quickstart --map florence.nc

Run:

    python benchmarks/planner_on_grids.py [CONFIG] [--map FILE] [--draws 5] [--climb 5]
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from mission.base.airspace import OPEN
from mission.config.loading import load_config
from mission.planner.factory import make_planner
from mission.planner.improving import varied
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.scenario.scenario import build_scenario

CHANGES = 20_000  # that are tried between two looks at the clock


def climbed(problem: RoundProblem, plan: RoundPlan, seconds: float) -> RoundPlan:
    """The best of several climbs from a plan."""
    best, begun, seed = plan, time.process_time(), 1
    while time.process_time() - begun < seconds:
        # From afar, then near.
        other = varied(problem, best, CHANGES, tolerance=0.01 * (seed % 3), seed=seed)
        best, seed = max(best, other, key=lambda found: found.value), seed + 1
    return best


def main() -> None:
    """Print a line for each draw."""
    parser = argparse.ArgumentParser()
    parser.add_argument("config", nargs="?", default="city")
    parser.add_argument("--map")
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--climb", type=float, default=5.0)
    asked = parser.parse_args()
    settings: dict[str, object] = {"radio.belief": "truth", "mission.steps": 10}
    settings["mission.path_budget_m"] = 800.0
    if asked.map:
        settings |= {"radio.truth": "map", "radio.map_file": asked.map}
    config = load_config(Path(asked.config), settings)
    first = build_scenario(config, data_dir=None).first_problem()
    planner = make_planner(config.planner)
    devices = len(first.devices_m)
    print(f"K = {devices}, N = {first.steps}, L = {first.path_budget_m:g} m")
    print("draw   CPU s  gap %  climbed %")
    for draw in range(asked.draws):
        rng = np.random.default_rng(draw)
        importance = rng.uniform(0.2, 1.0, devices)
        problem = replace(first.with_own(limits=None), importance=importance, airspace=OPEN)
        begun = time.process_time()
        plan = planner.plan(problem)
        seconds = time.process_time() - begun
        more = climbed(problem, plan, asked.climb).value / plan.value - 1.0
        print(f"{draw:4d} {seconds:7.2f} {100.0 * plan.gap:6.2f} {100.0 * more:10.2f}", flush=True)


if __name__ == "__main__":
    main()
