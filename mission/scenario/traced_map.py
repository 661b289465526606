"""Gains by ray tracing: Sionna RT over one of its cities, or a scene file of one's own."""

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from fl.errors import did_you_mean, first_line
from fl.radio.radio_map import RadioMap
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.user_files import check_regular

_NOTHING_DB = -250.0  # where no ray arrives: far below any threshold
_DEPTH = 3  # reflections
_RAYS = 10**6  # of a device
_MOST_BYTES = 1 << 28  # of a scene file


def traced_map(
    scene: str,
    devices_m: Floats,
    *,
    middle_m: tuple[float, float],
    size_m: tuple[float, float],
    height_m: Floats,
    cell_m: float,
    device_height_m: float,
    carrier_hz: float,
    seed: int,
) -> RadioMap:
    """The map of an area whose middle lies at a place (east, north) of a scene.

    A device sends, the aircraft hears; both have antennas that are alike in all directions. Rays
    are reflected three times at most, or diffracted. The last digits of two calls differ.

    Raises:
        InputError: Sionna is not installed or does not run here, or there is no such scene.
    """
    if find_spec("sionna") is None:
        raise InputError(
            "--engine sionna: needs sionna-rt, which is an extra and not installed: "
            "pip install 'aerofed[sionna]'"
        )
    low_m = [middle - side / 2.0 for middle, side in zip(middle_m, size_m, strict=True)]
    cells = [math.ceil(side / cell_m) for side in size_m]
    wide_m = [count * cell_m for count in cells]
    try:
        import sionna.rt as rt  # takes seconds

        world = rt.load_scene(_scene(scene, rt.scene))
        world.frequency = carrier_hz
        alike = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
        world.tx_array = world.rx_array = alike
        for index, (x, y) in enumerate((devices_m + low_m).tolist()):
            world.add(rt.Transmitter(f"device {index}", position=[x, y, device_height_m]))
        solve, gains = rt.RadioMapSolver(), []
        for height in height_m.tolist():
            found = solve(
                world,
                max_depth=_DEPTH,
                diffraction=True,
                cell_size=(cell_m, cell_m),
                center=[low_m[0] + wide_m[0] / 2.0, low_m[1] + wide_m[1] / 2.0, height],
                size=wide_m,
                orientation=[0.0, 0.0, 0.0],
                samples_per_tx=_RAYS,
                seed=seed % 2**32,
            )
            gains.append(np.array(found.path_gain, dtype=np.float64))
    except InputError:
        raise
    except Exception as error:  # whatever Mitsuba says of a scene, or Dr.Jit without LLVM
        raise InputError(
            f"--engine sionna --scene {scene}: {first_line(error)} (without a GPU it needs LLVM, "
            "best 19: DRJIT_LIBLLVM_PATH names its library)"
        ) from None
    with np.errstate(divide="ignore"):
        gain_db = np.maximum(10.0 * np.log10(np.stack(gains, axis=1)), _NOTHING_DB)
    x_m, y_m = (cell_m * np.arange(0.5, count, dtype=np.float64) for count in cells)
    return RadioMap(gain_db, height_m, y_m, x_m, devices_m)


def _scene(name: str, known: object) -> str:
    """The file of a scene that comes with Sionna, or a file of one's own."""
    if name.endswith(".xml"):
        check_regular(Path(name), most=_MOST_BYTES)
        return name
    scenes = {one: path for one, path in vars(known).items() if str(path).endswith(".xml")}
    if name not in scenes:
        listed = ", ".join(sorted(scenes))
        raise InputError(
            f"--scene {name}: must be one of {listed}, or a Mitsuba scene, FILE.xml"
            f"{did_you_mean(name, scenes)}"
        )
    return str(scenes[name])
