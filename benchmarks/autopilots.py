"""The same plans, aircraft, sensors and weather under our autopilot, real PX4 and real ArduCopter.

    python benchmarks/autopilots.py --px4 .../bin/px4 --arducopter .../arducopter --out autopilots

Flies the quick start's rounds with each that is given, in wind and turbulence, and prints and
draws them side by side (`aerofed compare`). Times are those of this machine, one after the other.
"""

import argparse
import json
import sys
from pathlib import Path

from mission.cli import call

ROOT = Path(__file__).resolve().parents[1]
WEATHER = ("speed_mps=4", "turbulence_severity=3")


def fly(out: Path, rounds: int, seed: int, keys: list[str]) -> None:
    """One run into a new folder; ends the program where it fails."""
    every = [
        "mission.strategy=examples.same_plans:make",
        f"seed={seed}",
        *(f"vehicle.aircraft.wind.{key}" for key in WEATHER),
        *keys,
    ]
    words = [word for key in every for word in ("--set", key)]
    if code := call(["run", "--rounds", str(rounds), "--out", str(out), *words]):
        sys.exit(code)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--px4", type=Path)
    parser.add_argument("--arducopter", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))  # of the strategy, an example
    brains: dict[str, list[str]] = {"built-in": []}
    for autopilot, binary in (("px4", given.px4), ("ardupilot", given.arducopter)):
        if binary is not None:
            path = f"vehicle.firmware.path={binary.resolve()}"
            brains[autopilot] = [f"vehicle.autopilot={autopilot}", path]
    given.out.mkdir(parents=True, exist_ok=True)
    for name, keys in brains.items():
        fly(given.out / name, given.rounds, given.seed, keys)
    folders = [str(given.out / name) for name in brains]
    call(["compare", *folders, "--figure", str(given.out / "autopilots.png")])
    for name in brains:
        summary = json.loads((given.out / name / "summary.json").read_text())
        print(
            f"{name}: {summary['simulated_s']:.0f} simulated s, {summary['real_time_factor']:.1f}x"
        )


if __name__ == "__main__":
    main()
