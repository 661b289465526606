"""What choosing the altitude costs, and what it brings: against plans for a fixed 60 m.

    python benchmarks/planner_altitudes.py [--problems 20]

Prints a table for docs/planner.md: for every channel, K = 12 devices, K_bar = 3, L_max = 800 m and
N = 3 or 10 steps, the CPU time of a plan at 60 m and of one between 40 and 120 m, one after the
other; the tables of the channel are made before, as in all rounds of a mission but the first.
"""

import argparse

import numpy as np
from planner import timed

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.altitudes import CertifiedAltitudes
from mission.planner.certified import CertifiedPlanner
from mission.planner.problem import RoundProblem, Start

LIMITS = (40.0, 120.0)
HEADING = (
    "channel", "N", "ms at 60 m, median", "worst", "ms, 40 to 120 m", "worst", "times as long",
    "with new tables, ms", "worst gap", "objective", "altitude, m",
)  # fmt: skip


def problem(channel: str, steps: int, seed: int) -> RoundProblem:
    """Devices and importance at random."""
    rng = np.random.default_rng([steps, seed])
    return RoundProblem(
        devices_m=rng.uniform(0.0, 800.0, (12, 2)),
        importance=rng.uniform(0.2, 1.0, 12),
        starts=(Start(np.array([400.0, 400.0]), 800.0),),
        steps=steps,
        per_step=3,
        channel=CHANNEL_PRESETS[channel],
    )


def row(channel: str, steps: int, count: int) -> list[str]:
    """One line of the table."""
    fixed, open_to = CertifiedPlanner(), CertifiedAltitudes(CertifiedPlanner())
    found: list[tuple[float, ...]] = []
    for seed in range(count):
        given = problem(channel, steps, seed)
        limited = given.with_own(altitudes_m=LIMITS)
        fixed.plan(given)
        _, new_ms = timed(open_to, limited)
        one, one_ms = timed(fixed, given)
        best, best_ms = timed(open_to, limited)
        assert best.altitude_m is not None
        gain = best.value / one.value if one.value > 0.0 else np.inf
        found.append((one_ms, best_ms, new_ms, best.gap, gain, best.altitude_m))
    one_ms, best_ms, new_ms, gap, gain, height = np.array(found).T
    return [
        f"`{channel}`",
        f"{steps}",
        f"{np.median(one_ms):.0f}",
        f"{one_ms.max():.0f}",
        f"{np.median(best_ms):.0f}",
        f"{best_ms.max():.0f}",
        f"{np.median(best_ms / one_ms):.1f} ({best_ms.sum() / one_ms.sum():.1f} in all)",
        f"{np.median(new_ms):.0f}",
        f"{100 * gap.max():.2f}%",
        f"{100 * (np.median(gain) - 1):+.1f}%",
        f"{height.min():.0f} to {height.max():.0f}",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=20)
    count = parser.parse_args().problems
    for cells in (HEADING, ["---"] * len(HEADING)):
        print("| " + " | ".join(cells) + " |")
    for steps in (10, 3):
        for channel in CHANNEL_PRESETS:
            print("| " + " | ".join(row(channel, steps, count)) + " |", flush=True)


if __name__ == "__main__":
    main()
