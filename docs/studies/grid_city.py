"""Worlds of grids of cells, such as manhattan32 and urban50, as GeoJSON that Aerofed flies over.

    python docs/studies/grid_city.py uav_data_harvesting/res/manhattan32.png manhattan32

The picture has a pixel for each cell (Bayerlein, Theile, Caccamo, Gesbert 2021, whose repository
has two under the BSD licence; take a copy of yours): green is a building that may be flown over,
yellow one that may not, red what must not be flown, blue where one starts. Writes
NAME-buildings.geojson, NAME-no-fly.geojson and NAME.toml, for `aerofed run NAME.toml`. There a
building blocks every line over its cells; here it is a prism, so `--low` and `--high` say how high
it is. Needs Pillow.
"""

import argparse
from pathlib import Path

import numpy as np
import shapely
from district import geojson, polygon
from numpy.typing import NDArray

from mission.base.area import Area
from mission.config.area import AreaConfig

WORLD = """\
name = "{name}"
[area]
size_m = [{width}, {height}]
home_lat_deg = {area.home_lat_deg}
home_lon_deg = {area.home_lon_deg}
home_m = [{x}, {y}]
buildings_file = "{name}-buildings.geojson"
{no_fly}margin_m = 5.0
[mission]
altitude_m = {altitude}
rounds = 8
path_budget_m = {budget}
steps = 10
[radio]
truth = "buildings"
belief = "learned"
[[communities]]
name = "digits"
task = "digits"
devices = 10
[learning]
local_epochs = 5
"""


def outlines(cells: NDArray[np.bool_], cell_m: float) -> list[shapely.Polygon]:
    """Cells (Y, X), north first, that touch along an edge, as one polygon each; with holes."""
    rows = len(cells)
    squares = [
        shapely.box(x * cell_m, (rows - y - 1) * cell_m, (x + 1) * cell_m, (rows - y) * cell_m)
        for y, x in np.argwhere(cells).tolist()
    ]
    whole = shapely.union_all(squares).simplify(0.0)
    return list(getattr(whole, "geoms", [whole])) if squares else []


def write(name: str, pixels: NDArray[np.uint8], cell_m: float, low_m: float, high_m: float) -> None:
    """The three files of a picture (Y, X, 3).

    Raises:
        ValueError: no pixel is blue.
    """
    red, green, blue = np.moveaxis(pixels > 0, -1, 0)
    if not blue.any():
        raise ValueError("no pixel is blue: nowhere to start")
    rows, columns = blue.shape
    y, x = np.argwhere(blue)[0].tolist()
    home_m = ((x + 0.5) * cell_m, (rows - y - 0.5) * cell_m)
    config = AreaConfig(home_m=home_m)
    area: Area = config.build()
    kinds = ((green & ~red, {"building": "yes", "height": low_m}),
             (green & red, {"building": "yes", "height": high_m}),
             (red & ~green, {"name": "no-fly zone"}))  # fmt: skip
    found = [
        [polygon(area, rings_of(one), told) for one in outlines(cells, cell_m)]
        for cells, told in kinds
    ]
    geojson(Path(f"{name}-buildings.geojson"), [*found[0], *found[1]])
    geojson(Path(f"{name}-no-fly.geojson"), found[2])
    no_fly = f'no_fly_file = "{name}-no-fly.geojson"\n' if found[2] else ""
    text = WORLD.format(
        name=name, width=columns * cell_m, height=rows * cell_m, area=config, x=home_m[0],
        y=home_m[1], no_fly=no_fly, altitude=(low_m + high_m) / 2.0, budget=60.0 * cell_m,
    )  # fmt: skip
    Path(f"{name}.toml").write_text(text)
    print(f"{name}.toml, with what lies beside it: aerofed run {name}.toml")


def rings_of(one: shapely.Polygon) -> list[NDArray[np.float64]]:
    """Corners (n, 2) around it, and of its holes."""
    rings = (one.exterior, *one.interiors)
    return [shapely.get_coordinates(ring)[:-1] for ring in rings]


def main() -> None:
    """Read the picture, and write beside nothing else: into the working directory."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("picture", type=Path)
    parser.add_argument("name")
    parser.add_argument("--cell", type=float, default=10.0, help="side of a cell in metres")
    parser.add_argument("--low", type=float, default=40.0, help="height of a green cell, m")
    parser.add_argument("--high", type=float, default=80.0, help="height of a yellow cell, m")
    asked = parser.parse_args()
    from PIL import Image

    if not asked.picture.is_file():
        parser.error(f"{asked.picture}: no such file")
    pixels = np.array(Image.open(asked.picture).convert("RGB"))
    write(asked.name, pixels, asked.cell, asked.low, asked.high)


if __name__ == "__main__":
    main()
