"""Files of radio maps, and what a ray tracer is asked for, by hand."""

import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.io import netcdf_file

from fl.radio.place import RadioMap
from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.scenario import radio_maps
from mission.scenario.radio_maps import (
    home_of,
    origin_of,
    read_map,
    traced_map,
    with_traced_map,
    write_map,
)

DEVICES_M = np.array([[0.0, 5.0], [90.0, 50.0]])
MADE = RadioMap(
    -np.arange(24.0).reshape(2, 2, 2, 3), np.array([40.0, 60.0]), np.array([5.0, 15.0]),
    np.array([1.0, 3.0, 7.0]), DEVICES_M,
)  # fmt: skip


def config(**more: Any) -> RunConfig:
    area = {
        "size_m": (95.0, 52.0), "home_m": (10.0, 12.0), "home_lat_deg": 43.25,
        "home_lon_deg": 7.1234567, "home_alt_msl_m": 3.5, **more.pop("area", {}),
    }  # fmt: skip
    radio = {"carrier_hz": 2.5e9, "device_height_m": 2.0, **more.pop("radio", {})}
    community = {"name": "a", "task": "digits", "devices": 2, "partition": "iid"}
    return RunConfig.model_validate(
        {"name": "here", "area": area, "radio": radio, "communities": [community], **more}
    )


def test_what_a_file_holds(tmp_path: Path) -> None:
    origin = origin_of(config(), "somebody")
    path = tmp_path / "m.nc"
    write_map(path, MADE, origin)
    assert path.read_bytes()[:4] == b"CDF\x02"  # with 64 bits for places in the file
    home = {
        "home_lat_deg": 43.25, "home_lon_deg": 7.1234567, "home_alt_msl_m": 3.5,
        "home_x_m": 10.0, "home_y_m": 12.0,
    }  # fmt: skip
    assert home_of(config()) == home
    with netcdf_file(path, mmap=False) as file:
        told = {name: getattr(file, name) for name in (*home, "carrier_hz")}
        assert told == {**home, "carrier_hz": 2.5e9}
        assert (file.Conventions, file.title) == (b"CF-1.8", b"path gain over here")
        assert file.source.startswith(b"somebody; aerofed ")
        assert file.dimensions == {"device": 2, "height": 2, "y": 2, "x": 3}
        kinds = {name: (v.data.dtype.str, v.units) for name, v in file.variables.items()}
        assert kinds.pop("path_gain") == (">f4", b"dB")
        assert kinds == dict.fromkeys(["height", "y", "x", "device_x", "device_y"], (">f8", b"m"))
        assert file.variables["path_gain"].dimensions == ("device", "height", "y", "x")
        assert file.variables["device_x"][:].tolist() == [0.0, 90.0]
        assert file.variables["device_y"][:].tolist() == [5.0, 50.0]
    found = read_map(path)
    for name in ("path_gain_db", "height_m", "y_m", "x_m", "devices_m"):
        assert getattr(found, name).tolist() == getattr(MADE, name).tolist()
    assert found.home == home


AXES = ("device", "height", "y", "x")
LINES = {
    "height": (("height",), [40.0]),
    "y": (("y",), [5.0, 15.0]),
    "x": (("x",), [1.0, 1.5, 7.0]),
    "device_x": (("device",), [1.0, 0.0]),
    "device_y": (("device",), [0.0, 1.0]),
}
NO_MAP = "no radio map: NetCDF"


def written(path: Path, **changed: Any) -> None:
    """A file with these variables; one that is None is left out."""
    every = {"path_gain": (AXES, np.zeros((2, 1, 2, 3))), **LINES, **changed}
    with netcdf_file(path, "w") as file:
        for name, size in zip(AXES, (2, 1, 2, 3), strict=True):
            file.createDimension(name, size)
        for name, (axes, values) in ((n, v) for n, v in every.items() if v is not None):
            file.createVariable(name, "d", axes)[:] = values


@pytest.mark.parametrize("name", [*LINES, "path_gain"])
def test_each_variable_is_needed_and_finite(tmp_path: Path, name: str) -> None:
    path = tmp_path / "m.nc"
    written(path)
    assert read_map(path).path_gain_db.max() == 0.0  # nothing is lost: that can still be
    written(path, **{name: None})
    with pytest.raises(InputError, match=NO_MAP):
        read_map(path)
    for wrong in (np.nan, np.inf, -np.inf):
        axes, values = LINES.get(name, (AXES, np.zeros((2, 1, 2, 3))))
        values = np.array(values)
        values.flat[-1] = wrong
        written(path, **{name: (axes, values)})
        with pytest.raises(InputError, match=f"m.nc: {name} holds a number that is not finite"):
            read_map(path)


@pytest.mark.parametrize(
    "changed",
    [
        {"path_gain": (("device", "height", "x", "y"), np.zeros((2, 1, 3, 2)))},
        {"path_gain": (("height", "y", "x"), np.zeros((1, 2, 3)))},
        {"height": (("y",), [1.0, 2.0])},
        {"y": (("x",), [1.0, 2.0, 3.0])},
        {"x": (("y",), [1.0, 2.0])},
        {"x": (("y", "x"), np.ones((2, 3)))},
        {"device_x": (("height",), [1.0])},
        {"device_y": (("x",), [1.0, 2.0, 3.0])},
    ],
)
def test_a_variable_over_other_axes(tmp_path: Path, changed: dict[str, Any]) -> None:
    written(tmp_path / "m.nc", **changed)
    with pytest.raises(InputError, match=NO_MAP):
        read_map(tmp_path / "m.nc")


def test_gains_above_nothing_lost_and_a_file_that_is_too_large(tmp_path: Path) -> None:
    written(tmp_path / "m.nc", path_gain=(AXES, np.full((2, 1, 2, 3), 0.001)))
    with pytest.raises(InputError, match=r"m.nc: path_gain holds 0\.001: must be 0 or less"):
        read_map(tmp_path / "m.nc")
    with (tmp_path / "m.nc").open("wb") as file:
        file.truncate(2**30 + 1)
    with pytest.raises(InputError, match="1073741825 bytes, 1073741824 are allowed"):
        read_map(tmp_path / "m.nc")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[dict[str, Any]]:
    """What the tracer was asked, a row for each height, with the world as it was then."""
    rows: list[dict[str, Any]] = []

    def load_scene(path: str) -> SimpleNamespace:
        senders: list[Any] = []
        return SimpleNamespace(path=path, senders=senders, add=senders.append)

    def solve(world: SimpleNamespace, **how: Any) -> SimpleNamespace:
        x, y = (
            round(side / step) for side, step in zip(how["size"], how["cell_size"], strict=True)
        )
        gain = np.full((len(world.senders), y, x), 1e-6)
        gain[1] = 10.0 ** -(len(rows) + 7.0)
        gain[:, 0, 0] = 0.0, 1e-30
        rows.append({**how, **vars(world)})
        return SimpleNamespace(path_gain=gain)

    sionna = SimpleNamespace(
        scene=SimpleNamespace(munich="/s/munich.xml", etoile="/s/etoile.xml", NAMES="no scene"),
        load_scene=load_scene,
        PlanarArray=lambda **how: how,
        Transmitter=lambda name, position: (name, position),
        RadioMapSolver=lambda: solve,
    )
    package = ModuleType("sionna")
    package.rt = sionna  # type: ignore[attr-defined]  # a stand-in
    monkeypatch.setattr(radio_maps, "find_spec", lambda name: name)
    monkeypatch.setitem(sys.modules, "sionna", package)
    monkeypatch.setitem(sys.modules, "sionna.rt", sionna)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return rows


HOW = {
    "path": "/s/munich.xml",
    "frequency": 2.5e9,
    "max_depth": 3,
    "diffraction": True,
    "orientation": [0.0, 0.0, 0.0],
    "samples_per_tx": 1_000_000,
}


def test_what_the_tracer_is_asked(asked: list[dict[str, Any]]) -> None:
    """95 m x 52 m about (1000, -500) begin at (952.5, -526); 24 m x 18 m make 4 x 3 cells."""
    made = traced_map(
        config(seed=2**32 + 7), "munich", DEVICES_M, middle_m=(1000.0, -500.0),
        height_m=np.array([50.0, 62.0]), cell_m=24.0,
    )  # fmt: skip
    alike = {"num_rows": 1, "num_cols": 1, "pattern": "iso", "polarization": "V"}
    senders = [("device 0", [952.5, -521.0, 2.0]), ("device 1", [1042.5, -476.0, 2.0])]
    for row, height in zip(asked, (50.0, 62.0), strict=True):
        assert row.items() >= HOW.items()
        assert (row["cell_size"], row["size"]) == ((24.0, 24.0), [96.0, 72.0])
        assert row["center"] == [1000.5, -490.0, height]
        assert row["seed"] == 7
        assert row["tx_array"] == row["rx_array"] == alike
        assert row["senders"] == senders
    assert made.path_gain_db.shape == (2, 2, 3, 4)
    assert made.path_gain_db[0, :, 1, 1] == pytest.approx([-60.0, -60.0])
    assert made.path_gain_db[1, :, 1, 1] == pytest.approx([-70.0, -80.0])
    assert made.path_gain_db[:, :, 0, 0].tolist() == [[-250.0, -250.0]] * 2
    assert made.y_m.tolist() == [12.0, 36.0, 60.0]
    assert made.x_m.tolist() == [12.0, 36.0, 60.0, 84.0]
    assert made.height_m.tolist() == [50.0, 62.0]
    assert made.devices_m is DEVICES_M


def test_the_map_of_a_run(asked: list[dict[str, Any]], tmp_path: Path) -> None:
    """Cells of 10 m, at each altitude once, about the middle of the scene."""
    known = with_traced_map(config(radio={"truth": "map", "scene": "munich"}), DEVICES_M)
    (row,) = asked
    assert (row["cell_size"], row["size"]) == ((10.0, 10.0), [100.0, 60.0])
    assert row["center"] == [2.5, 4.0, known.heights_m[0]]
    assert row["seed"] == known.seed
    (kept,) = (tmp_path / "cache" / "aerofed" / "maps").glob("*.nc")
    assert re.fullmatch(r"munich-[0-9a-f]{16}\.nc", kept.name)
    assert known.radio.map_file == kept
    with netcdf_file(kept, mmap=False) as file:
        assert file.source.startswith(b"munich, Sionna RT; aerofed")
        assert file.variables["height"].shape == (1,)
    assert with_traced_map(known, DEVICES_M) is known
    plain = config()
    assert with_traced_map(plain, DEVICES_M) is plain
    assert len(asked) == 1
    two = config(radio={"truth": "map", "scene": "etoile"}, mission={"altitude_m": [50.0, 62.0]})
    named = with_traced_map(two, DEVICES_M).radio.map_file
    assert named is not None
    assert named.name.startswith("etoile-")
    assert [each["center"][2] for each in asked[1:]] == [50.0, 62.0]


def test_which_runs_share_a_map(asked: list[dict[str, Any]]) -> None:
    """Whatever the map hangs on tells it from others; power, noise and rounds do not."""
    scene = {"truth": "map", "scene": "munich"}

    def traced(devices_m: Any = DEVICES_M, **more: Any) -> int:
        with_traced_map(config(**{"radio": scene, **more}), np.asarray(devices_m))
        return len(asked)

    assert traced() == 1
    assert traced(radio={**scene, "tx_power_dbm": 3.0}) == 1
    changes: list[dict[str, Any]] = [
            {"seed": 9}, {"devices_m": DEVICES_M[::-1]}, {"radio": {**scene, "carrier_hz": 2.6e9}},
            {"radio": {**scene, "device_height_m": 3.0}}, {"area": {"size_m": (96.0, 52.0)}},
            {"area": {"home_m": (10.0, 13.0)}}, {"area": {"home_lat_deg": 43.26}},
            {"area": {"home_lon_deg": 7.2}}, {"area": {"home_alt_msl_m": 4.5}},
            {"mission": {"altitude_m": 75.0}}, {"radio": {**scene, "scene": "etoile"}},
    ]  # fmt: skip
    for count, more in enumerate(changes, start=2):
        assert traced(**more) == traced(**more) == count


def test_a_scene_file_of_just_as_much_as_is_read(
    asked: list[dict[str, Any]], tmp_path: Path
) -> None:
    path = tmp_path / "s.xml"
    path.touch()

    def trace() -> None:
        traced_map(config(), str(path), DEVICES_M, middle_m=(0.0, 0.0),
                   height_m=np.array([50.0]), cell_m=10.0)  # fmt: skip

    with path.open("r+b") as file:
        file.truncate(2**28)
        trace()
        assert asked[0]["path"] == str(path)
        file.truncate(2**28 + 1)
        with pytest.raises(InputError, match="268435457 bytes, 268435456 are allowed"):
            trace()
    with pytest.raises(InputError, match="must be one of etoile, munich, or a Mitsuba scene"):
        traced_map(config(), "NAMES", DEVICES_M, middle_m=(0.0, 0.0),
                   height_m=np.array([50.0]), cell_m=10.0)  # fmt: skip
