"""What flight costs of a plan: objective planned against flown, sensors perfect, air calm.

The whole chain flies (planner, MAVLink, autopilot, JSBSim), so that what is lost is what corners
cut and speeds built up cost. The mean loss is to stay below 1 % on every channel. Run:

    python benchmarks/planner_flown.py [--seeds 3] [--rounds 3] [CHANNEL ...]
"""

import argparse
import csv
import sys
import tempfile
from pathlib import Path

import numpy as np

from mission.cli import call

# Served radius at PER 1/2 from 50 m to 400 m, sharp and flat.
CHANNELS = ("suburban+10dB", "suburban", "suburban+30dB", "dense-urban", "high-rise")
ENOUGH = 0.01


def losses(channel: str, seed: int, rounds: int) -> list[float]:
    """(rounds,) share of the planned objective that each round's flight lost."""
    settings = {
        "seed": seed,
        "channel.preset": channel,
        "vehicle.aircraft.sensors.kind": "perfect",
        "vehicle.aircraft.wind.speed_mps": 0,
        "learning.local_epochs": 1,
    }
    given = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        code = call(["run", "--out", str(out), "--rounds", str(rounds), "--quiet", *given])
        if code != 0:
            sys.exit(code)
        with (out / "rounds.csv").open(newline="") as file:
            return [
                1.0 - float(row["true_objective"]) / float(row["plan_objective"])
                for row in csv.DictReader(file)
            ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("channels", nargs="*", default=CHANNELS)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    print(f"{'channel':16} {'rounds':>6} {'lost: mean':>10} {'worst':>7}")
    missed = False
    for name in arguments.channels:
        lost = [
            loss
            for seed in range(1, arguments.seeds + 1)
            for loss in losses(name, seed, arguments.rounds)
        ]
        missed |= float(np.mean(lost)) > ENOUGH
        print(f"{name:16} {len(lost):6d} {np.mean(lost):10.2%} {max(lost):7.2%}", flush=True)
    sys.exit(6 if missed else 0)
