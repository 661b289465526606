"""How near the vehicles of a world came to each other, for tables and files."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from mission.base.area import Area
from mission.base.run_folder import write_atomically
from sitl.world import World

SEPARATION = "separation.json"


class Pair(NamedTuple):
    """The least distance of a pair, and where the middle of the two was, about the first home."""

    one: str
    two: str
    least_m: float
    horizontal_m: float
    vertical_m: float
    t_s: float
    x_m: float
    y_m: float
    height_m: float


def pairs_of(world: World) -> list[Pair]:
    """The least distance of each pair of which one has flown."""
    found = []
    for each in world.least:
        if not math.isnan(each.distance_m):
            north, east, down = ((each.places_ned_m[0] + each.places_ned_m[1]) / 2.0).tolist()
            one, two = (world.names[i] for i in each.pair)
            found.append(
                Pair(
                    one, two, each.distance_m, each.horizontal_m, each.vertical_m,
                    each.t_ns * 1e-9, east, north, -down,
                )
            )  # fmt: skip
    return found


def write_separation(folder: Path, world: World, areas: Mapping[str, Area]) -> None:
    """Write `separation.json` into a folder."""
    found = separation_file(world, areas)
    write_atomically(folder / SEPARATION, json.dumps(found, indent=2) + "\n")


def in_words(world: World) -> list[str]:
    """A sentence for each pair, for people."""
    return [
        f"{one.one} and {one.two}: {one.least_m:.2f} m apart at {one.t_s:.1f} s "
        f"({one.horizontal_m:.2f} m level, {one.vertical_m:.2f} m upright)"
        for one in pairs_of(world)
    ]


def separation_file(world: World, areas: Mapping[str, Area]) -> dict[str, object]:
    """What `separation.json` holds: homes, the least distances of pairs, collisions."""
    homes = {name: area.home for name, area in areas.items()}
    pairs = (each._asdict() for each in pairs_of(world))
    return {
        "clock": "simulated time, in seconds",
        "frame": "metres east (x) and north (y) of the first home, and above it",
        "homes": {
            name: [home.lat_deg, home.lon_deg, home.alt_msl_m] for name, home in homes.items()
        },
        "pairs": [{"pair": [each.pop("one"), each.pop("two")], **each} for each in pairs],
        "collisions": [
            {"t_s": t_ns * 1e-9, "pair": [world.names[one], world.names[two]]}
            for t_ns, one, two in world.collisions
        ],
    }
