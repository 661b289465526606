"""The 300 round problems that planners can be compared by.

    python docs/studies/round_problems.py docs/data/problems/problems.json
    aerofed plan --problem docs/data/problems/problems.json --out docs/data/problems/plans.json

Twelve kinds of twenty-five. The same numbers on every machine: all is drawn from one seed a problem
and rounded to what the file holds.
"""

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import aerofed

Floats = NDArray[np.float64]
Entry = dict[str, object]

EACH, AREA_M, MARGIN_M = 25, 800.0, 10.0
CHANNELS = (
    ("suburban", 0.0), ("suburban", 10.0), ("urban", 0.0), ("dense-urban", 0.0),
    ("suburban-log-variance", 0.0),
)  # fmt: skip
LIMITS = {"deadline": (45.0, 75.0), "energy": (8100.0, 13500.0)}  # of rounds of 800 and of 1600 m
# What each kind has: devices, steps, and limits.
KINDS = {
    "plain-12x3": (12, 3, ""),
    "plain-12x10": (12, 10, ""),
    "plain-40x20": (40, 20, ""),
    "plain-100x20": (100, 20, ""),
    "areas-12x10": (12, 10, "areas"),
    "areas-40x20": (40, 20, "areas"),
    "deadline-12x10": (12, 10, "deadline"),
    "energy-12x10": (12, 10, "energy"),
    "altitude-12x10": (12, 10, "altitude"),
    "upload-12x10": (12, 10, "deadline upload"),
    "ready-12x10": (12, 10, "deadline ready"),
    "all-12x10": (12, 10, "areas deadline energy altitude upload ready"),
}


def places(rng: np.random.Generator, count: int) -> Floats:
    """(count, 2) all over the area, in a few clusters, or along its rim."""
    layout = rng.integers(3)
    anywhere = rng.uniform(0.0, AREA_M, (count, 2))
    if layout == 1:
        centres = rng.uniform(60.0, AREA_M - 60.0, (4, 2))
        return np.clip(
            centres[rng.integers(4, size=count)] + rng.normal(0.0, 50.0, (count, 2)), 0, AREA_M
        )
    if layout == 2:
        rim = rng.integers(2, size=count), rng.integers(2, size=count)
        anywhere[np.arange(count), rim[0]] = np.where(
            rim[1], AREA_M - rng.uniform(0.0, 120.0, count), rng.uniform(0.0, 120.0, count)
        )
    return anywhere


def areas(rng: np.random.Generator) -> list[list[list[float]]]:
    """Five rectangles, turned anyhow, none of them near the start or another."""
    found: list[Floats] = []
    middles: list[tuple[Floats, float]] = [(np.full(2, AREA_M / 2.0), 15.0)]
    while len(found) < 5:
        middle, half, turn = (
            rng.uniform(80.0, 720.0, 2),
            rng.uniform(15.0, 120.0, 2),
            rng.uniform(0.0, math.pi),
        )
        reach = float(np.hypot(*half))
        if any(np.hypot(*(middle - m)) < reach + r + 3.0 * MARGIN_M for m, r in middles):
            continue
        corners = half * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        spin = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        found.append(middle + corners @ spin.T)
        middles.append((middle, reach))
    return [ring.round(1).tolist() for ring in found]


def problem(kind: str, number: int) -> Entry:
    """A problem as `problems.json` has it."""
    devices, steps, named = KINDS[kind]
    limits, rng = named.split(), np.random.default_rng([33, list(KINDS).index(kind), number])
    preset, gain_db = CHANNELS[number % len(CHANNELS)]
    channel = aerofed.channel(preset, extra_gain_db=gain_db)
    large = steps > 10
    entry: Entry = {
        "id": f"{kind}-{number:02}",
        "devices": places(rng, devices).round(1).tolist(),
        "importance": rng.uniform(0.1, 1.0, devices).round(3).tolist(),
        "start": [AREA_M / 2.0, AREA_M / 2.0],
        "steps": steps,
        "per_step": 3,
        "path_budget_m": 1600.0 if large else 800.0,
        "channel": asdict(channel),
    }
    if "areas" in limits:
        entry |= {"areas": areas(rng), "margin_m": MARGIN_M}
    entry |= {
        f"{name}_{unit}": LIMITS[name][large]
        for name, unit in (("deadline", "s"), ("energy", "j"))
        if name in limits
    }
    if "altitude" in limits:
        entry["altitudes_m"] = [40.0, 120.0]
    if "upload" in limits:
        entry["upload_s"] = rng.uniform(0.5, 6.0, devices).round(2).tolist()
    if "ready" in limits:
        entry["ready_in_s"] = rng.uniform(0.0, 40.0, devices).round(2).tolist()
    return entry


def problems() -> list[Entry]:
    """All of them."""
    return [problem(kind, number) for kind in KINDS for number in range(EACH)]


def main() -> None:
    """Write the problems, one a line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("target", type=Path, metavar="problems.json")
    lines = ",\n".join(json.dumps(entry) for entry in problems())
    parser.parse_args().target.write_text(f"[{lines}]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
