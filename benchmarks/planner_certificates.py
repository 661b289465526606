"""How much of every plan is proven, and at what cost: gaps and CPU time by size and channel.

Problems of every kind that a plan may be asked for, from one free waypoint to a thousand devices:
steps N, places a step K_bar, devices K and channels are taken in turn, so that a run with more
layouts adds to those of a shorter one. Layouts are drawn from seeds that no constant of the
planner was chosen on (`benchmarks/planner.py`). CPU time is that of planning, with the channel's
tables at hand. Run:

    python benchmarks/planner_certificates.py [--layouts 1] [--nodes 60000] [--only scarce]
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from planner import layout, tabled, timed

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.certified import CertifiedPlanner
from mission.planner.problem import RoundProblem

CHANNELS = tuple(CHANNEL_PRESETS)
FIRST = 5_000  # seeds before belong to `planner.py`
PLACES = (1, 2, 3, 4, 5)

Case = tuple[str, RoundProblem]  # the row of the table that it counts for


def problem(seed: int, *, devices: int, steps: int, per_step: int, channel: str) -> RoundProblem:
    """A layout of `planner.py` with that many places a step."""
    made = layout(FIRST + seed, devices=devices, steps=steps, channel=channel, budget=800.0)
    return replace(made, per_step=per_step)


def issue(layouts: int) -> Iterator[Case]:
    """K = 12, K_bar = 3, N = 2 to 5 on three channels, four layouts each."""
    for steps in (2, 3, 4, 5):
        for channel in ("suburban+10dB", "suburban", "suburban+30dB"):
            for seed in range(4 * layouts):
                yield (
                    f"K=12 K_bar=3 N={steps}",
                    problem(seed, devices=12, steps=steps, per_step=3, channel=channel),
                )


def small(layouts: int) -> Iterator[Case]:
    """N = 2 to 12, K_bar = 1 to 5, every channel; K is 10, 12 or 15."""
    number = 0
    for seed in range(layouts):
        for steps in range(2, 13):
            for per_step in PLACES:
                channel = CHANNELS[(number + seed) % len(CHANNELS)]
                devices = (10, 12, 15)[(number + seed) % 3]
                number += 1
                yield (
                    f"K<=15 N={steps}",
                    problem(
                        100 + number,
                        devices=devices,
                        steps=steps,
                        per_step=per_step,
                        channel=channel,
                    ),
                )


def medium(layouts: int) -> Iterator[Case]:
    """K = 20 to 40, N = 3 to 12."""
    number = 0
    for seed in range(layouts):
        for devices in (20, 30, 40):
            for steps in (3, 5, 8, 12):
                channel = CHANNELS[(number + seed) % len(CHANNELS)]
                per_step = PLACES[number % len(PLACES)]
                number += 1
                yield (
                    f"K={devices}",
                    problem(
                        500 + number,
                        devices=devices,
                        steps=steps,
                        per_step=per_step,
                        channel=channel,
                    ),
                )


def large(layouts: int) -> Iterator[Case]:
    """K = 100 and 1000, N = 50, of `planner.py`'s growth and on two channels more."""
    for devices in (100, 1000):
        for channel in ("suburban+10dB", "suburban", "suburban+30dB"):
            for seed in range(1, 1 + layouts):
                yield (
                    f"K={devices} N=50",
                    layout(seed, devices=devices, steps=50, channel=channel, budget=800.0),
                )


def measure(cases: Iterable[Case], planner: CertifiedPlanner, *, verbose: bool) -> None:
    """Plan every case; a line a row of the table: gaps, CPU milliseconds, nodes."""
    rows: dict[str, list[tuple[float, float, int]]] = defaultdict(list)
    for row, case in cases:
        tabled(case)
        plan, spent = timed(planner, case)
        rows[row].append((plan.gap, spent, plan.nodes))
        if verbose:
            name = next(key for key, value in CHANNEL_PRESETS.items() if value == case.channel)
            print(
                f"  {row:18} {name:22} K={len(case.devices_m)} N={case.steps} "
                f"K_bar={case.per_step} value {plan.value:.6f} gap {plan.gap:.2%} {spent:.0f} ms "
                f"{plan.nodes} nodes",
                file=sys.stderr, flush=True,
            )  # fmt: skip
    for row, found in rows.items():
        gap, spent, nodes = (np.array(column) for column in zip(*found, strict=True))
        print(
            f"{row:18} {len(found):4d} {(gap > 0.0101).sum():6d} {np.median(gap):8.2%}"
            f" {gap.max():8.2%} {np.median(spent):9.1f} {spent.max():9.1f}"
            f" {np.median(nodes):8.0f} {nodes.max():8d}",
            flush=True,
        )


GROUPS = {"issue": issue, "small": small, "medium": medium, "large": large}

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--layouts", type=int, default=1)
    parser.add_argument("--nodes", type=int, default=60_000)
    parser.add_argument("--only", choices=GROUPS, nargs="*", default=list(GROUPS))
    parser.add_argument("--verbose", action="store_true", help="every problem, on stderr")
    arguments = parser.parse_args()
    print(
        f"{'problems':18} {'':>4} {'> 1 %':>6} {'gap: med':>8} {'worst':>8} {'ms: med':>9}"
        f" {'worst':>9} {'nodes:med':>8} {'worst':>8}"
    )
    for group in arguments.only:
        measure(
            GROUPS[group](arguments.layouts),
            CertifiedPlanner(max_nodes=arguments.nodes),
            verbose=arguments.verbose,
        )
