"""Radio maps by ray tracing: Sionna RT over one of its scenes, or a scene file of the user's."""

import fcntl
import hashlib
import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from aerofed_errors import SettingError, did_you_mean, first_line
from fl.radio.radio_map import RadioMap
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.user_files import cache_folder, check_regular, or_input_error
from mission.config.models import RunConfig
from mission.scenario.radio_maps import NOTHING_DB, home_of, origin_of, write_map

_DEPTH = 3  # reflections
_RAYS = 10**6  # of a device; in smaller cells than these most of those far away are hit by none
_CELL_M = 10.0
_MOST_BYTES = 1 << 28  # of a scene file


def with_traced_map(config: RunConfig, devices_m: Floats) -> RunConfig:
    """Return the configuration with the radio map of its scene, where it names a scene and no map;
    traced on first use, then cached, for devices at places (K, 2).

    Raises:
        InputError: as `traced_map`, or the map cannot be kept.
    """
    scene = config.radio.scene
    if scene is None or config.radio.map_file is not None:
        return config
    if not scene.isidentifier():  # a file may be changed, and the kept map would be another's
        words = "must be a scene that comes with Sionna RT; aerofed radio-map makes a map of a file"
        raise SettingError("radio.scene", scene, f"{words}, for radio.map_file")
    heights_m = np.unique(config.mission.heights_m)
    radio = config.radio.model_dump(mode="json", include={"carrier_hz", "device_height_m"})
    place = f"{config.area.size_m} {heights_m} {devices_m.tolist()}"
    about = f"{radio} {home_of(config)} {place} {config.seed} {_CELL_M} {_DEPTH} {_RAYS}"
    digest = hashlib.sha256(about.encode()).hexdigest()[:16]
    path = cache_folder("maps") / f"{scene}-{digest}.nc"
    # Runs of a sweep begin at once, and maps that two of them trace differ in their last digits.
    with or_input_error(path, "cannot be kept"), path.with_suffix(".lock").open("a") as alone:
        fcntl.flock(alone, fcntl.LOCK_EX)
        if not path.exists():
            try:
                made = traced_map(
                    config, scene, devices_m, middle_m=(0, 0), height_m=heights_m, cell_m=_CELL_M
                )
            except InputError as error:
                raise SettingError("radio.scene", scene, str(error)) from None
            write_map(path, made, origin_of(config, f"{scene}, Sionna RT"))
    known = {"map_file": path, "map_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    return config.model_copy(update={"radio": config.radio.model_copy(update=known)})


def traced_map(
    config: RunConfig,
    scene: str,
    devices_m: Floats,
    *,
    middle_m: tuple[float, float],
    height_m: Floats,
    cell_m: float,
) -> RadioMap:
    """Trace the radio map of a run's area, whose middle is at `middle_m` (east, north) of a scene.

    A device sends, the aircraft hears; both have antennas that are alike in all directions. Rays
    are reflected three times at most, or diffracted. The last digits of two calls differ.

    Raises:
        InputError: Sionna is not installed or does not run here, or there is no such scene.
    """
    if find_spec("sionna") is None:
        raise InputError(
            "needs sionna-rt, which is an extra and not installed: pip install 'aerofed[sionna]'"
        )
    radio, size_m = config.radio, config.area.size_m
    low_m = [middle - side / 2.0 for middle, side in zip(middle_m, size_m, strict=True)]
    cells = [math.ceil(side / cell_m) for side in size_m]
    wide_m = [count * cell_m for count in cells]
    try:
        import sionna.rt as rt  # takes seconds

        world = rt.load_scene(_scene(scene, rt.scene))
        world.frequency = radio.carrier_hz
        alike = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
        world.tx_array = world.rx_array = alike
        for index, (x, y) in enumerate((devices_m + low_m).tolist()):
            world.add(rt.Transmitter(f"device {index}", position=[x, y, radio.device_height_m]))
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
                seed=config.seed % 2**32,
            )
            gains.append(np.array(found.path_gain, dtype=np.float64))
    except InputError:
        raise
    except Exception as error:  # whatever Mitsuba says of a scene, or Dr.Jit without LLVM
        raise InputError(
            f"{first_line(error)} (without a GPU it needs LLVM, best 19: DRJIT_LIBLLVM_PATH names "
            "its library)"
        ) from None
    with np.errstate(divide="ignore"):
        gain_db = np.maximum(10.0 * np.log10(np.stack(gains, axis=1)), NOTHING_DB)
    x_m, y_m = (cell_m * np.arange(0.5, count, dtype=np.float64) for count in cells)
    return RadioMap(gain_db, height_m, y_m, x_m, devices_m)


def _scene(name: str, known: object) -> str:
    """Return the file of a scene by its name in Sionna; a path of an .xml file as it is."""
    if name.endswith(".xml"):
        check_regular(Path(name), most=_MOST_BYTES)
        return name
    scenes = {one: path for one, path in vars(known).items() if str(path).endswith(".xml")}
    if name not in scenes:
        listed = ", ".join(sorted(scenes))
        raise InputError(
            f"must be one of {listed}, or a Mitsuba scene, FILE.xml{did_you_mean(name, scenes)}"
        )
    return str(scenes[name])
