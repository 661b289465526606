"""Radio maps: as files (NetCDF classic, as xarray, QGIS and MATLAB read it), and by ray tracing, of
Sionna RT over one of its scenes, or a scene file of the user's.
"""

import fcntl
import hashlib
import io
import math
from collections.abc import Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from fl.radio.place import RadioMap
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.base.user_files import cache_folder, check_regular, or_input_error, read_bytes
from mission.config.models import RunConfig
from mission.config.world import MOST_BYTES
from native.errors import SettingError, did_you_mean, first_line

_AXES = ("device", "height", "y", "x")
_HOME = "home_lat_deg", "home_lon_deg", "home_alt_msl_m", "home_x_m", "home_y_m"
_NAMED = {"height": "above home", "y": "north of the area's corner", "x": "east of it"}
NOTHING_DB = -250.0  # where no ray arrives: far below any threshold
_WRONG = (
    "no radio map: NetCDF (classic) is wanted with path_gain(device, height, y, x) in dB, and "
    "height, y, x, device_x, device_y in metres"
)


def home_of(config: RunConfig) -> dict[str, float]:
    """Where home is, on the globe and in the area (m): attributes of a map file."""
    area = config.area
    values = area.home_lat_deg, area.home_lon_deg, area.home_alt_msl_m, *area.home_m
    return dict(zip(_HOME, values, strict=True))


def origin_of(config: RunConfig, source: str) -> dict[str, str | float]:
    """Return the attributes of a run's map file: title, source, carrier, position of home."""
    return {
        "title": f"path gain over {config.name}",
        "source": f"{source}; aerofed {version('aerofed')}",
        "carrier_hz": config.radio.carrier_hz,
        **home_of(config),
    }


def write_map(path: Path, made: RadioMap, origin: Mapping[str, str | float]) -> None:
    """Write a map as NetCDF, the same bytes for the same map; `origin` as `origin_of` gives it.

    Raises:
        InputError: the file cannot be written.
    """
    from scipy.io import netcdf_file

    stream = io.BytesIO()
    file = netcdf_file(stream, "w", version=2)
    for name, value in {"Conventions": "CF-1.8", **origin}.items():
        # Python's own numbers SciPy keeps in single precision: half a metre of longitude.
        setattr(file, name, np.float64(value) if isinstance(value, float) else value)
    for name, size in zip(_AXES, made.path_gain_db.shape, strict=True):
        file.createDimension(name, size)
    columns: dict[str, tuple[tuple[str, ...], str, Floats, str]] = {
        **{
            name: ((name,), "m", values, f"{words}; middles of cells")
            for (name, words), values in zip(
                _NAMED.items(), (made.height_m, made.y_m, made.x_m), strict=True
            )
        },
        "device_x": (("device",), "m", made.devices_m[:, 0], "where the device stands, east"),
        "device_y": (("device",), "m", made.devices_m[:, 1], "where the device stands, north"),
        "path_gain": (_AXES, "dB", made.path_gain_db, "power received over power sent"),
    }
    for name, (axes, unit, values, words) in columns.items():
        kind = "f4" if name == "path_gain" else "f8"
        variable = file.createVariable(name, kind, axes)
        variable[:] = values
        variable.units, variable.long_name = unit, words
    file.flush()
    write_atomically(path, stream.getvalue())


def read_map(path: Path) -> RadioMap:
    """Read a radio map from a NetCDF file.

    Raises:
        InputError: it cannot be read, or holds no map.
    """
    from scipy.io import netcdf_file

    content = read_bytes(path, most=MOST_BYTES)
    try:
        file = netcdf_file(io.BytesIO(content), "r", mmap=False, maskandscale=True)  # as packed
        every = {name: np.ma.asarray(v[:], dtype=np.float64) for name, v in file.variables.items()}
        found = {
            name: values.filled(NOTHING_DB if name == "path_gain" else np.nan)
            for name, values in every.items()
        }
        axes = file.variables["path_gain"].dimensions
        home = {name: float(value) for name, value in vars(file).items() if name in _HOME}
    except Exception as error:  # whatever the reader of a damaged file raises
        raise InputError(f"{path}: {_WRONG} ({type(error).__name__})") from None
    names = ("path_gain", "height", "y", "x", "device_x", "device_y")
    if axes != _AXES or not found.keys() >= set(names):
        raise InputError(f"{path}: {_WRONG}")
    gain, *lines = (found[name] for name in names)
    sizes = dict(zip(_AXES, gain.shape, strict=True))
    wanted = [sizes[axis] for axis in ("height", "y", "x", "device", "device")]
    if 0 in gain.shape or [line.shape for line in lines] != [(size,) for size in wanted]:
        raise InputError(f"{path}: {_WRONG}")
    for name, values in zip(names, (gain, *lines), strict=True):
        if not np.isfinite(values).all():
            raise InputError(f"{path}: {name} holds a number that is not finite")
    if gain.max() > 0.0:
        raise InputError(
            f"{path}: path_gain holds {gain.max():g}: must be 0 or less: power received over power "
            "sent, in dB (10 log10 of the linear gain)"
        )
    for name, line in zip(names[1:4], lines, strict=False):
        if (np.diff(line) <= 0.0).any():
            raise InputError(f"{path}: {name} must ascend")
    height, y, x, device_x, device_y = lines
    return RadioMap(gain, height, y, x, np.column_stack((device_x, device_y)), home)


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
    heights_m = np.unique(config.heights_m)
    radio = config.radio.model_dump(mode="json", include={"carrier_hz", "device_height_m"})
    place = f"{config.area.size_m} {heights_m} {devices_m.tolist()}"
    about = f"{radio} {home_of(config)} {place} {config.seed} {_CELL_M} {_DEPTH} {_RAYS}"
    digest = hashlib.sha256(about.encode()).hexdigest()[:16]
    path = cache_folder("maps") / f"{scene}-{digest}.nc"
    # Runs of a sweep begin at once, and maps that two of them trace differ in their last digits.
    with or_input_error(path, "cannot be kept"), path.with_suffix(".lock").open("a") as alone:
        fcntl.flock(alone, fcntl.LOCK_EX)
        if not path.exists():
            made = traced_map(
                config, scene, devices_m, middle_m=(0, 0), height_m=heights_m, cell_m=_CELL_M
            )
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
        lacks = (
            "needs sionna-rt, which is an extra and not installed: pip install 'aerofed[sionna]'"
        )
        raise SettingError("radio.scene", scene, lacks)
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
            paths = solve(
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
            gains.append(np.array(paths.path_gain, dtype=np.float64))
    except InputError:
        raise
    except Exception as error:  # whatever Mitsuba says of a scene, or Dr.Jit without LLVM
        reason = "(without a GPU it needs LLVM, best 19: DRJIT_LIBLLVM_PATH names its library)"
        raise SettingError("radio.scene", scene, f"{first_line(error)} {reason}") from None
    with np.errstate(divide="ignore"):
        gain_db = np.maximum(10.0 * np.log10(np.stack(gains, axis=1)), NOTHING_DB)
    x_m, y_m = (cell_m * np.arange(0.5, count, dtype=np.float64) for count in cells)
    return RadioMap(gain_db, height_m, y_m, x_m, devices_m)


def _scene(name: str, known: object) -> str:
    """Return the file of a scene by its name in Sionna; a path of an .xml file as it is."""
    if name.endswith(".xml"):
        try:
            check_regular(Path(name), most=_MOST_BYTES)
        except InputError as error:
            raise SettingError("radio.scene", name, str(error)) from None
        return name
    scenes = {one: path for one, path in vars(known).items() if str(path).endswith(".xml")}
    if name not in scenes:
        listed = ", ".join(sorted(scenes))
        reason = f"must be one of {listed}, or a Mitsuba scene, FILE.xml"
        raise SettingError("radio.scene", name, f"{reason}{did_you_mean(name, scenes)}")
    return str(scenes[name])
