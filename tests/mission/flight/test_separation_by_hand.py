"""What `separation.json` and its sentences say of a world, by hand."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from mission.flight.serve import separation
from sitl.nearness import Nearest

# 3 m north, 4 m east and 12 m down of each other; the third pair has not flown.
LEAST = [
    Nearest((0, 2), 2_500_000_000, 13.0, (np.array([7.0, 1, -10]), np.array([4.0, 5, -22]))),
    Nearest((1, 0), 0, 2.0, (np.array([1.0, 0, -3]), np.array([-1.0, 0, -3]))),
    Nearest((1, 2), 0, math.nan, (np.full(3, np.nan), np.full(3, np.nan))),
]
WORLD: Any = SimpleNamespace(
    names=("a", "b", "c"), least=LEAST, collisions=[(3_250_000_000, 2, 1), (4_000_000_000, 0, 1)]
)
PAIRS = [
    ("a", "c", 13.0, 5.0, 12.0, 2.5, 3.0, 5.5, 16.0),
    ("b", "a", 2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0),
]


def test_pairs_and_their_sentences() -> None:
    assert separation.pairs_of(WORLD) == PAIRS
    assert separation.in_words(WORLD) == [
        "a and c: 13.00 m apart at 2.5 s (5.00 m level, 12.00 m upright)",
        "b and a: 2.00 m apart at 0.0 s (2.00 m level, 0.00 m upright)",
    ]


def test_the_file(tmp_path: Path) -> None:
    homes = {"a": (43.0, 7.0, 3.0), "b": (43.5, 7.25, 4.0)}
    areas: Any = {
        name: SimpleNamespace(home=SimpleNamespace(lat_deg=lat, lon_deg=lon, alt_msl_m=height))
        for name, (lat, lon, height) in homes.items()
    }
    separation.write_separation(tmp_path, WORLD, areas)
    text = (tmp_path / "separation.json").read_text()
    assert text.startswith('{\n  "clock"')
    assert text.endswith("}\n")
    told = json.loads(text)
    keys = ("least_m", "horizontal_m", "vertical_m", "t_s", "x_m", "y_m", "height_m")
    assert told["pairs"] == [
        {"pair": [one, two], **dict(zip(keys, numbers, strict=True))}
        for one, two, *numbers in PAIRS
    ]
    assert told["homes"] == {name: list(home) for name, home in homes.items()}
    assert told["collisions"] == [
        {"t_s": 3.25, "pair": ["c", "b"]},
        {"t_s": 4.0, "pair": ["a", "b"]},
    ]
