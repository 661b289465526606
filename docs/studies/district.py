"""Makes configs/city-buildings.geojson, the made-up district that configs/city.toml flies over.

    python docs/studies/district.py [FILE]

Streets 22 m wide cut 800 x 800 m into blocks; a park lies in the south-west. Roofs rise towards the
middle; four towers are higher than flights at 60 m, which go around them.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mission.base.area import Area
from mission.config.area import AreaConfig

SIDE_M, STREET_M = 800.0, 22.0
BLOCKS, BUILDINGS = 9, 150
PARK_M = (80.0, 90.0, 330.0, 260.0)  # where nothing stands
TOWERS = {(3, 5): 84.0, (5, 3): 72.0, (6, 6): 91.0, (6, 2): 66.0}  # height by block


def rectangle(x: float, y: float, width: float, depth: float) -> np.ndarray:
    """(4, 2) corners, anticlockwise."""
    return np.array([[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]])


def buildings(rng: np.random.Generator) -> list[tuple[list[np.ndarray], float]]:
    """Outline, courtyards and height of each."""
    pitch = SIDE_M / BLOCKS
    room = pitch - STREET_M
    found: list[tuple[list[np.ndarray], float]] = []
    for column in range(BLOCKS):
        for row in range(BLOCKS):
            x, y = column * pitch + STREET_M / 2, row * pitch + STREET_M / 2
            middle = 1.0 - np.hypot(x - 370.0, y - 370.0) / 520.0
            height = float(np.round(9.0 + 34.0 * max(middle, 0.0) + rng.uniform(-4.0, 7.0), 1))
            if (column, row) in TOWERS:
                size = 26.0
                at = (x + (room - size) / 2, y + (room - size) / 2)
                found.append(([rectangle(*at, size, size)], TOWERS[column, row]))
            elif PARK_M[0] < x < PARK_M[2] and PARK_M[1] < y < PARK_M[3]:
                continue
            elif rng.random() < 0.02:  # a block around a courtyard
                court = rectangle(x + 14, y + 14, room - 28, room - 28)[::-1]
                found.append(([rectangle(x, y, room, room), court], height))
            else:
                wall = float(np.round(rng.uniform(22.0, room - 28.0), 1))
                other = float(np.round(height * rng.uniform(0.6, 1.2), 1))
                rest, turned = room - wall - 6.0, rng.random() < 0.5  # with a passage between
                one = rectangle(x, y, *((wall, room) if turned else (room, wall)))
                if turned:
                    two = rectangle(x + wall + 6.0, y, rest, room)
                else:
                    two = rectangle(x, y + wall + 6.0, room, rest)
                found += [([one], height), ([two], other)]
    for k in range(BUILDINGS - len(found)):  # pavilions in the park
        x, y = 105.0 + 33.0 * k, 112.0 if k % 2 else 228.0
        found.append(([rectangle(x, y, 9.0, 7.0)], 4.5))
    return found


def polygon(
    area: Area, rings: Sequence[np.ndarray], properties: Mapping[str, object]
) -> dict[str, object]:
    """An outline and its holes, (n, 2) in the area, as GeoJSON."""
    coordinates = []
    for ring in rings:
        places = [area.frame.to_geodetic(ned) for ned in area.to_ned(ring, 0.0)]
        corners = [[round(p.lon_deg, 7), round(p.lat_deg, 7)] for p in places]
        coordinates.append([*corners, corners[0]])
    return {
        "type": "Feature",
        "properties": dict(properties),
        "geometry": {"type": "Polygon", "coordinates": coordinates},
    }


def geojson(path: Path, features: Sequence[Mapping[str, object]]) -> None:
    """Write features, a line each."""
    lines = ",\n".join(map(json.dumps, features))
    path.write_text(f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n')


def main() -> None:
    """Write the file."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "configs/city-buildings.geojson")
    found = buildings(np.random.default_rng(5))
    print(len(found), "buildings")
    area = AreaConfig(home_m=(255.0, 175.0)).build()  # as in city.toml
    geojson(out, [polygon(area, rings, {"height": height_m}) for rings, height_m in found])


if __name__ == "__main__":
    main()
