"""Radio maps as files: NetCDF (classic), as xarray, QGIS and MATLAB read it."""

import io
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import numpy as np

from fl.radio.radio_map import RadioMap
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.base.user_files import read_bytes
from mission.config.models import RunConfig
from mission.config.world import MOST_BYTES

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
        setattr(file, name, value)
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
