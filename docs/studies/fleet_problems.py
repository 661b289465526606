"""The 60 round problems of several aircraft that planners can be compared by.

    python docs/studies/fleet_problems.py docs/data/problems/fleet-problems.json
    aerofed plan --problem docs/data/problems/fleet-problems.json --out new.json

Six kinds of ten. Aircraft start in a row at home 5 m apart, 25 m apart, or each in a corner; they
keep 20 m from each other at all times.
"""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from round_problems import AREA_M, CHANNELS, MARGIN_M, Entry, areas, places

import aerofed

EACH, SEPARATION_M, STEPS = 10, 20.0, 10
CORNERS = ((150.0, 150.0), (650.0, 650.0), (650.0, 150.0), (150.0, 650.0))
# Aircraft, devices, metres each, and limits.
KINDS = {
    "two-12": (2, 12, 400.0, ""),
    "three-12": (3, 12, 400.0, ""),
    "three-20": (3, 20, 600.0, ""),
    "four-40": (4, 40, 400.0, ""),
    "areas-12": (3, 12, 600.0, "areas deadline"),
    "all-12": (3, 12, 600.0, "areas deadline energy altitude upload ready"),
}


def problem(kind: str, number: int) -> Entry:
    """A problem as `fleet-problems.json` has it."""
    aircraft, devices, metres, named = KINDS[kind]
    limits, rng = named.split(), np.random.default_rng([58, list(KINDS).index(kind), number])
    preset, gain_db = CHANNELS[number % len(CHANNELS)]
    apart_m = 25.0 if number % 3 == 1 and not named else 5.0
    row = [
        [AREA_M / 2.0 + apart_m * (a - (aircraft - 1) / 2.0), AREA_M / 2.0] for a in range(aircraft)
    ]
    starts = row if number % 3 < 2 or named else [list(at) for at in CORNERS[:aircraft]]
    vehicles: list[Entry] = [{"start": start} for start in starts]
    if number % 2:  # with batteries of several ages
        for a, vehicle in enumerate(vehicles):
            vehicle["path_budget_m"] = metres - 50.0 * a
    entry: Entry = {
        "id": f"{kind}-{number}",
        "devices": places(rng, devices).round(1).tolist(),
        "importance": rng.uniform(0.1, 1.0, devices).round(3).tolist(),
        "vehicles": vehicles,
        "steps": STEPS,
        "per_step": 3,
        "path_budget_m": metres,
        "separation_m": SEPARATION_M,
        "channel": asdict(aerofed.channel(preset, extra_gain_db=gain_db)),
    }
    if "areas" in limits:
        entry |= {"areas": areas(rng), "margin_m": MARGIN_M}
    if "deadline" in limits:
        entry["deadline_s"] = 35.0
    if "energy" in limits:
        entry["energy_j"] = 6500.0
    if "altitude" in limits:
        entry["altitudes_m"] = [40.0, 120.0]
    if "upload" in limits:
        entry["upload_s"] = rng.uniform(0.5, 6.0, devices).round(2).tolist()
    if "ready" in limits:
        entry["ready_in_s"] = rng.uniform(0.0, 30.0, devices).round(2).tolist()
    return entry


def problems() -> list[Entry]:
    """All of them."""
    return [problem(kind, number) for kind in KINDS for number in range(EACH)]


def main() -> None:
    """Write the problems, one a line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("target", type=Path, metavar="fleet-problems.json")
    lines = ",\n".join(json.dumps(entry) for entry in problems())
    parser.parse_args().target.write_text(f"[{lines}]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
