"""`aerofed radio-map`."""

import math
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.commands.options import Overrides, load

_STEP_M = 5.0  # between heights
_MOST_CELLS = 50_000_000


def radio_map(
    config: Path,
    *,
    out: Path,
    cell: float = 5.0,
    engine: Literal["buildings", "sionna"] = "buildings",
    scene: str = "munich",
    middle: Annotated[tuple[float, float], Parameter(negative=())] = (0.0, 0.0),
    figure: Path | None = None,
    device: int | None = None,
    set_: Overrides = (),
) -> int:
    """Write the gains of all paths from the devices to the places of the aircraft, as a file.

    Example: aerofed radio-map city --out city.nc

    Example: aerofed radio-map city --out city.nc --figure device8.png --device 8

    Example: aerofed radio-map quickstart --engine sionna --scene munich --out munich.nc

    Args:
        config: TOML file whose devices are mapped, at the mission's altitude; of two, at heights 5
            m apart between them.
        out: NetCDF file for the map: what radio.map_file takes, and xarray opens.
        cell: Side of a cell in metres.
        engine: buildings: those of the configuration; sionna: ray tracing, an extra.
        scene: sionna: munich, florence, san_francisco, etoile and others that come with it, or
            FILE.xml.
        middle: sionna: where in the scene the middle of the area lies, metres east and north.
        figure: Also draw the gains of one device, at the lowest height: FILE.png, .svg or .pdf.
        device: --figure: which one is drawn, from 0; the first by default.
        set_: Override any key: --set radio.environment=UMa
    """
    if out.exists():
        raise InputError(f"{out}: exists already; give another name")
    resolved = load(config, set_)
    size_m, (low_m, high_m) = resolved.area.size_m, resolved.heights_m
    if not 0.5 <= cell <= min(size_m):
        raise InputError(f"--cell {cell:g}: must be from 0.5 m to the area's {min(size_m):g} m")
    if figure is not None and figure.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"--figure {figure}: must end in .png, .svg or .pdf")
    if device is not None and figure is None:
        raise InputError(f"--device {device}: says what --figure draws; give one, or leave it out")
    if engine == "buildings" and not resolved.area.buildings:
        raise InputError(
            f"{config}: area.buildings: missing, as is area.buildings_file; a map is made of them"
        )
    from importlib.metadata import version

    import numpy as np

    from fl.radio.place import RadioMap
    from flightdyn.random import RandomStreams
    from mission.base.explain import Blame
    from mission.scenario.radio_maps import origin_of, traced_map, write_map
    from mission.scenario.radios import city_of
    from mission.scenario.scenario import device_places

    heights_m = np.arange(low_m, max(high_m, low_m + 0.5 * _STEP_M), _STEP_M)
    heights_m = np.unique(np.append(heights_m, high_m))
    streams, area = RandomStreams(resolved.seed), resolved.area.build()
    devices_m = device_places(resolved, area, streams)
    device = device or 0
    if not 0 <= device < len(devices_m):
        raise InputError(f"--device {device}: must be from 0 to {len(devices_m) - 1}")
    cells = len(devices_m) * len(heights_m) * math.prod(math.ceil(side / cell) for side in size_m)
    if cells > _MOST_CELLS:
        raise InputError(
            f"--cell {cell:g}: makes {cells} cells, {_MOST_CELLS} are allowed; take larger ones"
        )
    if engine == "buildings":
        with resolved.blame.named():
            city = city_of(resolved, area, devices_m, streams)
        made = RadioMap.of(city, devices_m, size_m=size_m, height_m=heights_m, cell_m=cell)
        source = (
            f"{len(area.buildings)} buildings, {resolved.radio.environment}, seed {resolved.seed}"
        )
    else:
        with Blame("command line", {"radio.scene": "--scene"}).named():
            made = traced_map(
                resolved, scene, devices_m, middle_m=middle, height_m=heights_m, cell_m=cell
            )
        x, y = middle
        source = f"{scene} about ({x:g}, {y:g}), Sionna RT {version('sionna-rt')}"
    write_map(out, made, origin_of(resolved, source))
    if figure is not None:
        from mission.figures.radio import gain_picture
        from mission.figures.render import save

        walls = area.buildings if engine == "buildings" else ()
        save(gain_picture(made, device, walls, about=source), figure)
    sizes = " x ".join(str(size) for size in made.path_gain_db.shape)
    Terminal(**PLAIN).print(f"{out}: path gain of {sizes} (device, height, north, east)")
    return 0
