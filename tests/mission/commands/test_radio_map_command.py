"""`aerofed radio-map`, and runs on what it writes."""

import hashlib
import io
import json
import math
import sys
import threading
import tomllib
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.io import netcdf_file

from fl.radio.place import RadioMap
from mission.cli import call
from mission.config.loading import load_config
from mission.scenario import radio_maps
from mission.scenario.radio_maps import NOTHING_DB, read_map, write_map

HALL = "[{polygon_m = [[90, 90], [110, 90], [110, 110], [90, 110]], height_m = 40}]"
WORLD = f"""
[area]
size_m = [300, 200]
home_m = [20, 20]
buildings = {HALL}
[mission]
flight = "none"
rounds = 1
steps = 3
path_budget_m = 400
[radio]
tx_power_dbm = 0.0
[[communities]]
name = "a"
task = "digits"
partition = "iid"
subset = 0.1
positions_m = [[80, 100], [200, 150]]
"""


@pytest.fixture(autouse=True)
def _world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("w.toml").write_text(WORLD)


def mapped(*more: str) -> Path:
    Path("w.nc").unlink(missing_ok=True)
    more = more if any(one.startswith("--cell") for one in more) else ("--cell=10", *more)
    assert call(["radio-map", "w.toml", "--out", "w.nc", *more]) == 0
    return Path("w.nc")


def uplinks(name: str, *more: str) -> str:
    assert call(["run", "w.toml", "--out", name, "--quiet", "--no-report", *more]) == 0
    return Path(name, "uplinks.csv").read_text()


ON_MAP = ("--set=radio.truth=map", "--set=radio.map_file=w.nc")


def test_the_map_says_what_it_is_of_and_what_it_is_in(capsys) -> None:
    content = mapped().read_bytes()
    told = capsys.readouterr().out
    assert told == "w.nc: path gain of 2 x 1 x 20 x 30 (device, height, north, east)\n"
    file = netcdf_file(io.BytesIO(content), mmap=False)
    gain = file.variables["path_gain"]
    assert (gain.dimensions, gain.units) == (("device", "height", "y", "x"), b"dB")
    assert file.variables["height"][:].tolist() == [60.0]
    assert file.variables["device_x"][:].tolist() == [80.0, 200.0]
    assert file.source.startswith(b"1 buildings, UMi, seed 1; aerofed ")
    assert file.home_lat_deg == pytest.approx(43.6145)
    assert mapped().read_bytes() == content
    mapped("--set=mission.altitude_m=[50,62]")
    assert netcdf_file("w.nc", mmap=False).variables["height"][:].tolist() == [50, 55, 60, 62]


def test_the_gains_of_a_device_are_drawn() -> None:
    mapped("--figure=w.svg", "--device=1")
    drawn = Path("w.svg").read_text()
    assert "Path gain from device 1 to places 60 m above home" in drawn
    assert "1 buildings, UMi, seed 1" in drawn


def test_xarray_opens_it() -> None:
    xarray = pytest.importorskip("xarray")
    found = xarray.open_dataset(mapped(), engine="scipy").path_gain
    assert found.sel(x=85.0, y=105.0, device=0) > found.sel(x=295.0, y=5.0, device=0)


def test_a_run_on_the_map_is_nearly_one_among_the_buildings() -> None:
    mapped()
    told = [
        np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, usecols=15)
        for text in (uplinks("a", *ON_MAP), uplinks("b", "--set=radio.truth=buildings"))
    ]
    assert np.abs(told[0] - told[1]).max() < 0.2
    assert uplinks("c", "--set=radio.truth=channel") not in (uplinks("d", *ON_MAP),)


def test_a_run_is_repeated_with_the_same_map_only(capsys) -> None:
    mapped()
    first = uplinks("a", *ON_MAP)
    assert call(["run", "a/config.toml", "--out", "b", "--quiet", "--no-report"]) == 0
    assert Path("b/uplinks.csv").read_text() == first
    mapped("--set=seed=2")
    assert call(["run", "a/config.toml", "--out", "c", "--quiet", "--no-report"]) == 2
    line = capsys.readouterr().err.strip()
    assert "radio.map_sha256" in line
    assert "it is another map; put the map of radio.map_sha256 back there, or begin a new" in line
    of_another = "--set=radio.map_file=w.nc"
    assert call(["run", "a/config.toml", of_another, "--out", "c", "--quiet", "--no-report"]) == 0
    Path("w.nc").unlink()
    Path("a/summary.json").unlink()
    assert call(["run", "--resume", "a", "--quiet"]) == 2
    line = capsys.readouterr().err.strip()
    assert (
        "w.nc: cannot be read: No such file or directory; put the map of radio.map_sha256" in line
    )
    assert "\n" not in line


BAD_MAPS = {
    "area.size_m=[600,200]": "covers x from 5 to 295 m; the area has 0 to 600",
    "communities.0.positions_m=[[80,100]]": "is of 2 devices; the run has 1",
    "communities.0.positions_m=[[80,100],[200,50]]": "has device 1 100 m from where it stands",
    "area.home_lat_deg=43.615": "is of another home: home_lat_deg = 43.6145; the run has 43.615",
    "area.home_lon_deg=-7.0715": "is of another home: home_lon_deg = 7.0715; the run has -7.0715",
    "area.home_alt_msl_m=2": "is of another home: home_alt_msl_m = ",
    "area.home_m=[20,22]": "is of another home: home_y_m = ",
    "mission.altitude_m=80": "is of 60 m above home; mission.altitude_m is not within 5 m",
}


@pytest.mark.parametrize("change", BAD_MAPS)
def test_a_map_of_something_else_is_refused(capsys, change: str) -> None:
    mapped()
    assert call(["run", "w.toml", *ON_MAP, "--set", change, "--out=x", "--quiet"]) == 2
    line = capsys.readouterr().err
    assert BAD_MAPS[change] in line
    assert line.count("\n") == 1


def test_a_map_that_is_packed_into_whole_numbers_is_the_same() -> None:
    """As xarray and NCO pack it: with a factor, and a number for what is not known."""
    plain = read_map(mapped())
    with netcdf_file("w.nc", mmap=False) as file, netcdf_file("packed.nc", "w") as packed:
        for name, size in file.dimensions.items():
            packed.createDimension(name, size)
        for name, of in file.variables.items():
            is_gain = name == "path_gain"
            variable = packed.createVariable(name, "h" if is_gain else "d", of.dimensions)
            variable[:] = np.round(of[:] / 0.01) if is_gain else of[:]
            if is_gain:
                variable.scale_factor, variable._FillValue = 0.01, -32768
    found = read_map(Path("packed.nc"))
    np.testing.assert_allclose(found.path_gain_db, plain.path_gain_db, atol=0.0051)
    with netcdf_file("packed.nc", "a") as packed:
        packed.variables["path_gain"][0, 0, 0, 0] = -32768
    assert (
        read_map(Path("packed.nc")).path_gain_db.min() == NOTHING_DB
    )  # nothing is known to arrive


@pytest.mark.parametrize("content", [b"", b"CDF\x02", b"PK\x03\x04" * 50])
def test_what_is_no_map_is_refused(capsys, content: bytes) -> None:
    Path("w.nc").write_bytes(content)
    assert call(["run", "w.toml", *ON_MAP, "--out=x", "--quiet"]) == 2
    assert (
        "w.nc: no radio map: NetCDF (classic) is wanted with path_gain" in capsys.readouterr().err
    )


def test_cut_and_damaged_maps_never_end_in_a_traceback(capsys) -> None:
    whole, rng = mapped().read_bytes(), np.random.default_rng(1)
    for _ in range(30):
        wrong = bytearray(whole[: rng.integers(4, len(whole))])
        for at in rng.integers(0, min(len(wrong), 900), 3):
            wrong[at] = rng.integers(256)
        Path("w.nc").write_bytes(wrong)
        assert call(["run", "w.toml", *ON_MAP, "--out=x", "--quiet", "--no-report"]) in (0, 2)
        assert "Traceback" not in capsys.readouterr().err


def test_a_linear_map_a_map_that_is_gone_and_one_that_is_there(capsys) -> None:
    made = read_map(mapped())
    Path("w.nc").unlink()
    assert call(["run", "w.toml", *ON_MAP, "--out=x", "--quiet"]) == 2
    assert "radio.map_file: " in (line := capsys.readouterr().err)
    assert "w.nc: cannot be read: No such file or directory" in line
    write_map(Path("w.nc"), replace(made, path_gain_db=10.0 ** (made.path_gain_db / 10.0)), {})
    assert call(["run", "w.toml", *ON_MAP, "--out=x", "--quiet"]) == 2
    assert "must be 0 or less: power received over power sent, in dB" in capsys.readouterr().err
    made.y_m[3] = np.nan
    write_map(Path("w.nc"), made, {})
    assert call(["run", "w.toml", *ON_MAP, "--out=x", "--quiet"]) == 2
    assert "w.nc: y holds a number that is not finite" in capsys.readouterr().err
    assert call(["radio-map", "w.toml", "--out=w.toml"]) == 2
    assert "w.toml: exists already; give another name" in capsys.readouterr().err
    assert Path("w.toml").read_text() == WORLD


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--cell=0.1"], "--cell 0.1: must be from 0.5 m to the area's 200 m"),
        (["--set=area.buildings=[]"], "area.buildings: missing, as is area.buildings_file; a map"),
        (["--device=2", "--figure=w.svg"], "--device 2: must be from 0 to 1"),
        (["--device=1"], "--device 1: says what --figure draws; give one, or leave it out"),
        (["--figure=w.gif"], "--figure w.gif: must end in .png, .svg or .pdf"),
        (["none/w.nc"], "none/w.nc: cannot write: No such file or directory"),
        (["--cell=0.5", "--set=area.size_m=[9e4,9e4]"], "50000000 are allowed; take larger ones"),
    ],
)
def test_what_cannot_be_mapped_is_refused(capsys, more, words: str) -> None:
    *more, out = more if more[-1].endswith(".nc") else [*more, "w.nc"]
    assert call(["radio-map", "w.toml", "--out", out, *more]) == 2
    assert words in capsys.readouterr().err


def test_a_map_needs_a_file_and_a_file_its_use(capsys) -> None:
    for alone in (ON_MAP[0], "--set=radio.map_file=w.nc"):
        assert call(["run", "w.toml", alone, "--out=x", "--quiet"]) == 2
        assert "'map' as radio.truth, .belief or .prior, need each other" in capsys.readouterr().err


def test_what_is_no_building_is_counted_for_the_user(capsys) -> None:
    corners = [[7.0726, 43.6146], [7.0727, 43.6146], [7.0727, 43.6147], [7.0726, 43.6146]]
    features = [
        {"type": "Feature", "properties": told, "geometry": {"type": kind, "coordinates": at}}
        for told, kind, at in (
            ({"building": "yes", "height": 9}, "Polygon", [corners]),
            ({"leisure": "park"}, "Polygon", [corners]),
            ({"natural": "tree", "height": 7}, "Point", corners[0]),
        )
    ]
    document = {"type": "FeatureCollection", "features": features}
    Path("b.geojson").write_text(json.dumps(document))
    Path("w.toml").write_text(WORLD.replace(f"buildings = {HALL}", "buildings_file = 'b.geojson'"))
    assert call(["run", "w.toml", "--out=a", "--no-report"]) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if "passed over" in line]
    assert told == [
        "warning: b.geojson: 2 features passed over that say neither building, height nor "
        "building:levels, or are no polygons"
    ]


class TracedRadio:
    """What of Sionna RT is called; its gains say where they are of."""

    scene = SimpleNamespace(munich="/scenes/munich.xml", NAMES="no scene")
    PlanarArray = Transmitter = staticmethod(lambda *name, **known: (name, known))

    @staticmethod
    def load_scene(path: str) -> SimpleNamespace:
        assert path == "/scenes/munich.xml"
        senders: list[Any] = []
        return SimpleNamespace(senders=senders, add=senders.append)

    class RadioMapSolver:
        def __call__(self, world, *, cell_size, center, size, **_: object) -> SimpleNamespace:
            x, y = (
                middle - side / 2.0 + step * np.arange(0.5, round(side / step))
                for middle, side, step in zip(center, size, cell_size, strict=False)
            )
            gain = np.zeros((len(world.senders), len(y), len(x)))
            for device, (_, known) in enumerate(world.senders):
                away = np.hypot(y[:, None] - known["position"][1], x - known["position"][0])
                gain[device] = np.where(away < 200.0, 10.0 ** (-away / 10.0), 0.0)
            return SimpleNamespace(path_gain=gain)


@pytest.fixture
def _sionna(monkeypatch: pytest.MonkeyPatch) -> None:
    package = ModuleType("sionna")
    package.rt = TracedRadio  # type: ignore[attr-defined]
    monkeypatch.setattr(radio_maps, "find_spec", lambda name: name)
    monkeypatch.setitem(sys.modules, "sionna", package)
    monkeypatch.setitem(sys.modules, "sionna.rt", TracedRadio)


TRACED = ("--engine=sionna", "--scene=munich", "--middle", "1000", "-500")


@pytest.mark.usefixtures("_sionna")
def test_a_traced_map_lies_where_the_area_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "version", lambda name: f"1 of {name}")
    made = read_map(mapped(*TRACED))
    away = np.hypot(made.y_m[:, None] - 150.0, made.x_m - 200.0)
    expected = np.where(away < 200.0, -away, -250.0)
    assert made.path_gain_db[1, 0] == pytest.approx(expected, abs=1e-4)
    assert netcdf_file("w.nc", mmap=False).source.startswith(
        b"munich about (1000, -500), Sionna RT"
    )


SCENES = {
    "munch": "--scene munch: must be one of munich, or a Mitsuba scene, FILE.xml; did you mean mun",
    "none.xml": "--scene none.xml: none.xml: cannot be read: No such file or directory",
    "w.xml": "--scene w.xml: AssertionError: ",
}


@pytest.mark.usefixtures("_sionna")
@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_that_is_none_is_refused(capsys, scene: str) -> None:
    Path("w.xml").write_text("<scene")
    assert call(["radio-map", "w.toml", "--out=w.nc", "--engine=sionna", "--scene", scene]) == 2
    assert SCENES[scene] in capsys.readouterr().err


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(radio_maps, "find_spec", lambda _: None)
    assert call(["radio-map", "w.toml", "--out=w.nc", *TRACED]) == 2
    assert "an extra and not installed: pip install 'aerofed[sionna]'" in capsys.readouterr().err


OF_A_SCENE = ("--set=radio.truth=map", "--set=radio.scene=munich")


@pytest.mark.usefixtures("_sionna")
def test_the_map_of_a_scene_is_made_once_for_each_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    first = uplinks("a", *OF_A_SCENE, "--set=seed=7")
    (kept,) = Path("cache/aerofed/maps").glob("munich-*.nc")
    made = read_map(kept)
    assert made.path_gain_db[0, 0, 10, 20] == pytest.approx(-math.hypot(125.0, 5.0))
    assert made.x_m[0] == 5.0
    config = tomllib.loads(Path("a/config.toml").read_text())["radio"]
    assert config["map_sha256"] == hashlib.sha256(kept.read_bytes()).hexdigest()
    assert Path(config["map_file"]) == kept.resolve()
    with monkeypatch.context() as without:
        without.setattr(radio_maps, "find_spec", lambda _: None)
        assert uplinks("b", *OF_A_SCENE, "--set=seed=7") == first
    uplinks("c", *OF_A_SCENE, "--set=seed=8")
    assert len(list(kept.parent.glob("*.nc"))) == 2


@pytest.mark.usefixtures("_sionna")
def test_runs_that_begin_at_once_share_the_map_of_a_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    config = load_config(Path("w.toml"), {"radio.truth": "map", "radio.scene": "munich"})
    trace, traced, found = radio_maps.traced_map, [], []

    def run() -> None:
        known = radio_maps.with_traced_map(config, np.array([[50.0, 50.0]]))
        found.append(known.radio.map_sha256)

    other = threading.Thread(target=run)

    def tracing(*given: Any, **more: Any) -> RadioMap:
        traced.append(given)
        if len(traced) == 1:
            other.start()
            other.join(0.5)  # it waits for the map; where it does not, it has traced one by then
        return trace(*given, **more)

    monkeypatch.setattr(radio_maps, "traced_map", tracing)
    run()
    other.join()
    assert len(traced) == 1
    assert found[0] == found[1]


@pytest.mark.parametrize("scene", ["town.xml", "../munich"])
def test_the_scene_of_a_run_is_no_file(scene: str, capsys) -> None:
    assert (
        call(["run", "w.toml", "--out=x", "--set=radio.truth=map", f"--set=radio.scene={scene}"])
        == 2
    )
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert (
        f"radio.scene = '{scene}': must be a scene that comes with Sionna RT; aerofed radio-map"
        in line
    )
    assert not Path("x").exists()


def test_a_scene_without_the_extra_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setattr(radio_maps, "find_spec", lambda _: None)
    assert call(["run", "munich", "--out=x"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "munich.toml: radio.scene = 'munich': needs sionna-rt, which is an extra" in line


def test_sionna_itself_traces_a_map() -> None:
    pytest.importorskip("sionna", reason="needs sionna-rt: pip install 'aerofed[sionna]', and LLVM")
    made = read_map(mapped("--engine=sionna", "--scene=simple_street_canyon", "--cell=50"))
    assert made.path_gain_db.max() < -40.0
    assert made.path_gain_db.max() > made.path_gain_db.min()
