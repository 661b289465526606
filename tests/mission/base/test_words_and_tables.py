"""Wrong keys in words, tables and cells, polylines and areas: small rules, by hand."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fl.radio.city import Building
from flightdyn.state import GeodeticPoint
from mission.base import polyline
from mission.base.airspace import FenceArea, circle
from mission.base.area import Area, Site, on_globe
from mission.base.errors import InputError
from mission.base.explain import Blame, explain, explained, refusal, shown, tables
from mission.base.run_folder import RunFolder
from mission.base.tables import count, csv_lines, dotted, number
from native.errors import SettingError


class Inner(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    speed_mps: float = Field(1.0, gt=0, le=9)
    name: str = "a"


class Outer(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    inner: Inner = Inner()
    many: tuple[Inner, ...] = ()
    kind: Literal["short", "long"] = "short"
    needed: int
    wind_mps: float = 0.0


def lines(
    data: Any, *, given: Mapping[str, str] | None = None, notation: Any = "TOML"
) -> list[str]:
    blame = Blame("run.toml", given or {})
    with pytest.raises(ValidationError) as refused:
        Outer.model_validate(data)
    return explain(refused.value, Outer, data, blame, notation=notation)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({}, ["run.toml: needed: missing, and it has no default"]),
        ({"needed": []}, ["run.toml: needed = []: must be a whole number"]),
        ({"needed": 1, "inner": {"speed_mps": 0}},
         ["run.toml: inner.speed_mps = 0: must be greater than 0"]),
        ({"needed": 1, "inner": {"speed_mps": 10}},
         ["run.toml: inner.speed_mps = 10: must be less than or equal to 9"]),
        ({"needed": 1, "many": [{}, {"speed_mps": -1}]},
         ["run.toml: many.1.speed_mps = -1: must be greater than 0"]),
        ({"needed": 1, "many": 5}, ["run.toml: many = 5: must be a list"]),
        ({"needed": 1, "inner": 5}, ["run.toml: inner = 5: must be a table"]),
        ({"needed": 1, "kind": "shrt"},
         ["run.toml: kind = 'shrt': must be 'short' or 'long'; did you mean short?"]),
        ({"needed": 1, "inner": {"other": 1}},
         ["run.toml: inner.other: unknown key (known: name, speed_mps)"]),
        ({"needed": 1, "inner": {"speed": 1}},
         ["run.toml: inner.speed: unknown key; did you mean speed_mps? (known: name, speed_mps)"]),
        ({"needed": 1, "speed_mps": 1},
         ["run.toml: speed_mps: unknown key; did you mean inner.speed_mps or many.0.speed_mps?"]),
        ({"needed": 1, "inner": {"needed": 1}},
         ["run.toml: inner.needed: unknown key; needed belongs to the top level, before the first "
          "table"]),
    ],
)  # fmt: skip
def test_a_wrong_key_is_one_line(data: Any, said: list[str]) -> None:
    assert lines(data) == said


def test_a_key_of_the_command_line_is_blamed_on_it() -> None:
    assert lines({"needed": []}, given={"needed": ""}) == [
        "command line: needed = []: must be a whole number"
    ]
    (line,) = lines({"needed": "x"}, given={"needed": "--count"})
    assert line.startswith("--count x: must be a whole number")
    assert lines({"needed": 1, "inner": {"needed": 1}}, given={"inner": ""}) == [
        "command line: inner.needed: unknown key; needed belongs to the top level"
    ]
    assert lines({"needed": 1, "inner": 5}, notation="JSON") == [
        "run.toml: inner = 5: must be an object"
    ]
    blame = Blame("run.toml", {"vehicle.speed": "", "area": "--area"})
    assert [blame.sets(name) for name in ("vehicle", "vehicle.speed", "vehicle.speed.x")] == [
        True
    ] * 3
    assert [blame.sets(name) for name in ("vehicle.sp", "area2", "are")] == [False] * 3
    assert (blame.on("vehicle"), blame.on("x")) == ("command line", "run.toml")
    assert blame == Blame("other")
    assert refusal("area", [1], "no", blame) == "--area: no"
    with pytest.raises(InputError, match=r"^run\.toml: a\.b = 5: too much$"), blame.named():
        raise SettingError("a.b", 5, "too much")
    with pytest.raises(InputError, match="needed: missing"), explained(Outer, {}, blame):
        Outer.model_validate({})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (False, "false"),
        (1, "1"),
        ("a", "'a'"),
        (np.array([[1, 2], [3, 4]]), "array([[1, 2], [3, 4]])"),
        ("/" + "a" * 57, "'/" + "a" * 57 + "'"),  # 60 characters
        ("/" + "b" * 55 + "cde", "'..." + "b" * 51 + "cde'"),
    ],
)
def test_a_value_is_shown_in_a_line(value: Any, text: str) -> None:
    assert shown(value) == text
    assert len(shown(value)) <= 60


def test_tables_of_a_model_are_found_with_their_paths() -> None:
    assert list(tables(Outer)) == [((), Outer), (("inner",), Inner), (("many", 0), Inner)]


def test_cells_are_text_that_reads_back() -> None:
    row = [True, False, None, 0.1, math.nan, np.float64(2.5), 3, "a,b", 'say "x"']
    assert csv_lines([row]) == 'true,false,,0.1,nan,2.5,3,"a,b","say ""x"""\n'
    assert (number(1.005, 1), number(2.0), number(math.nan)) == ("1.0", "2.00", "-")
    assert [count(n, "round of flight") for n in (0, 1, 2)] == [
        "0 rounds of flight", "1 round of flight", "2 rounds of flight",
    ]  # fmt: skip
    assert dotted({"a": {"b": [1, {"c": 2}]}, "d": 3}) == {"a.b.0": 1, "a.b.1.c": 2, "d": 3}


def test_lengths_and_feet_of_polylines() -> None:
    points = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]])
    assert polyline.legs(points).tolist() == [5.0, 6.0]
    assert polyline.length(points) == 11.0
    assert polyline.along(points).tolist() == [0.0, 5.0, 11.0]
    at = polyline.at(np.array([2.5, 99.0]), polyline.along(points), points)
    assert at.tolist() == [[1.5, 2.0], [3.0, 10.0]]
    start = np.array([[0.0, 0], [0, 0], [0, 0], [5, 5]])
    end = np.array([[10.0, 0], [10, 0], [10, 0], [5, 5]])
    away, share = polyline.to_segments(np.array([[4.0, 3], [-3, 4], [14, -3], [6, 7]]), start, end)
    assert away.tolist() == [[0.0, 3.0], [-3.0, 4.0], [4.0, -3.0], [1.0, 2.0]]
    assert share.tolist() == [0.4, 0.0, 1.0, 0.0]


HOME = GeodeticPoint(47.0, 8.0, 500.0)


def test_an_area_turns_places_about_its_corner_into_the_vehicles_and_back() -> None:
    area = Area.at((400.0, 300.0), (100.0, 50.0), HOME)
    ned = area.to_ned(np.array([[130.0, 90.0], [0.0, 0.0]]), np.array([5.0, -2.0]))
    assert ned.tolist() == [[40.0, 30.0, -5.0], [-50.0, -100.0, 2.0]]
    assert area.to_ned(np.array([130.0, 90.0]), 5.0).tolist() == [40.0, 30.0, -5.0]
    assert area.from_ned(ned).tolist() == [[130.0, 90.0], [0.0, 0.0]]
    assert area.xyz(ned).tolist() == [[130.0, 90.0, 5.0], [0.0, 0.0, -2.0]]
    around = Area.around(HOME, np.array([[10.0, 20, 0], [-30, 60, -9]]), margin_m=7.0)
    assert (around.size_m, around.home_m) == ((54.0, 54.0), (-13.0, 37.0))
    (place,) = on_globe(area, np.array([[100.0, 50_050.0]]), 20.0)
    assert place.alt_msl_m == 520.0  # not 196 m higher, as the plane is there
    assert place.lat_deg == pytest.approx(47.0 + 50_000 / 111_172, abs=1e-4)


def test_a_site_has_other_homes_and_buildings_seen_from_them() -> None:
    hall = Building((np.array([[90.0, 90.0], [110.0, 90.0], [110.0, 120.0]]),), 12.0)
    site = Site((400.0, 300.0), (100.0, 50.0), HOME, buildings=(hall,))
    area = site.from_home((130.0, 90.0))
    assert area.home_m == (130.0, 90.0)
    assert area.home.alt_msl_m == 500.0
    ned = Area.at((1, 1), (0, 0), HOME).frame.to_ned(area.home.lat_deg, area.home.lon_deg, 500.0)
    np.testing.assert_allclose(ned[:2], [40.0, 30.0], atol=1e-3)
    assert (area.size_m, area.buildings) == ((400.0, 300.0), (hall,))
    assert Site((1, 1), (0, 0), HOME).from_home((0, 0)).obstacles is None
    assert area.obstacles is not None


def test_an_area_to_keep_to_is_a_polygon_or_a_circle() -> None:
    ring = circle(np.array([10.0, 20.0]), 5.0)
    assert len(ring) == 72
    np.testing.assert_allclose(np.hypot(*(ring - [10.0, 20.0]).T), 5.0)
    assert ring[0].tolist() == [15.0, 20.0]
    made = FenceArea(center_m=(10.0, 20.0), radius_m=5.0)
    np.testing.assert_array_equal(made.outline_m, ring)
    corners = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0))
    assert FenceArea(polygon_m=corners, group=255).outline_m.tolist() == [list(c) for c in corners]
    assert FenceArea(polygon_m=corners).group == 0
    largest = ((-100_000.0, -100_000.0), (100_000.0, -100_000.0), (0.0, 100_000.0))
    assert FenceArea(polygon_m=largest)
    assert FenceArea(center_m=(0.0, 0.0), radius_m=100_000.0)
    wrong: list[dict[str, Any]] = [
        {}, {"center_m": (0.0, 0.0)}, {"radius_m": 5.0}, {"polygon_m": corners, "radius_m": 5.0},
        {"polygon_m": corners, "center_m": (0.0, 0.0)},
        {"polygon_m": corners, "center_m": (0.0, 0.0), "radius_m": 5.0},
        {"polygon_m": corners[:2]}, {"polygon_m": corners, "group": 256},
        {"polygon_m": corners, "group": -1}, {"center_m": (0.0, 0.0), "radius_m": 0.0},
        {"center_m": (0.0, 0.0), "radius_m": 100_000.1},
        {"center_m": (0.0, 100_000.1), "radius_m": 1.0},
        {"center_m": (0.0, -100_000.1), "radius_m": 1.0},
        {"polygon_m": ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0))},
    ]  # fmt: skip
    for values in wrong:
        with pytest.raises(ValidationError):
            FenceArea(**values)


def used(folder: RunFolder, *names: str) -> None:
    for name in names:
        path = folder.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{}")


@pytest.mark.parametrize(
    ("names", "still"),
    [
        (("checkpoint/.lock",), True),
        (("checkpoint/.lock", "config.toml"), True),
        (("checkpoint/.lock", "x.partial"), True),
        (("checkpoint/.lock", "rounds.csv"), False),
        (("config.toml",), False),
        (("checkpoint/.lock", "checkpoint/rounds.json"), False),
    ],
)
def test_remains_of_a_run_that_never_began_are_taken_over(
    tmp_path: Path, names: tuple[str, ...], still: bool
) -> None:
    folder = RunFolder(tmp_path / "run")
    used(folder, *names)
    assert folder.stillborn is still
    if still:
        folder.check()
    else:
        with pytest.raises(InputError, match="already used; give a new or empty one"):
            folder.check()


@pytest.mark.parametrize(
    ("checkpoint", "summary", "hint"),
    [(True, {}, True), (True, {"status": "interrupted"}, True),
     (True, {"status": "finished"}, False), (False, {"status": "failed"}, False),
     (True, {"status": "failed", "resumable": False}, False)],
)  # fmt: skip
def test_a_used_folder_says_whether_its_run_goes_on(
    tmp_path: Path, checkpoint: bool, summary: dict[str, Any], hint: bool
) -> None:
    folder = RunFolder(tmp_path / "run")
    used(folder, "x", *(["checkpoint/rounds.json"] if checkpoint else []))
    folder.write_summary(summary)
    with pytest.raises(InputError) as refused:
        folder.check()
    assert ("aerofed run --resume" in str(refused.value)) is hint
    assert folder.status() == (str(summary.get("status")) if summary else None)
    folder.summary.write_text("[]")
    assert folder.read_summary() == {}
    assert folder.status() is None


def test_files_of_a_finished_run_are_as_it_left_them(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.check_unchanged()  # nothing is said of any
    used(folder, "config.toml", "rounds.csv", "uplinks.csv", "other.csv")
    now = folder.digests()
    assert set(now) == {"config.toml", "rounds.csv", "uplinks.csv"}
    folder.write_summary({"sha256": now})
    folder.check_unchanged()
    assert json.loads(folder.summary.read_text())["sha256"] == now
    folder.uplinks.write_text("{ }")
    with pytest.raises(InputError, match=r"uplinks\.csv: altered since the run ended"):
        folder.check_unchanged()
    folder.uplinks.unlink()
    with pytest.raises(InputError, match=r"uplinks\.csv: gone since the run ended"):
        folder.check_unchanged()


def test_old_files_are_set_aside_once_and_all_discarded(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    used(folder, "flight.mcap", "rounds.csv", "vehicle-a/flight.mcap", "other.csv")
    folder.set_aside()
    kept = [path.relative_to(folder.kept) for path in folder.kept.rglob("*") if path.is_file()]
    assert sorted(map(str, kept)) == [
        "flight.mcap", "rounds.csv", "vehicle-a/flight.mcap",
    ]  # fmt: skip
    assert not folder.rounds.exists()
    folder.rounds.write_text("new")
    folder.set_aside()  # those of an earlier flight stay
    assert (folder.kept / "rounds.csv").read_text() == "{}"
    assert folder.rounds.read_text() == "new"
    folder.discard_kept()
    folder.discard_kept()
    assert list(folder.checkpoint.iterdir()) == []
    assert folder.of_vehicle("a").log == tmp_path / "vehicle-a" / "flight.mcap"


def test_a_folder_is_taken_by_one_and_left_without_its_lock(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    with folder.taken():
        assert (folder.checkpoint / ".lock").exists()
        folder.config.touch()
    assert sorted(p.name for p in folder.path.iterdir()) == ["config.toml"]
    kept = RunFolder(tmp_path / "kept")
    with kept.taken():
        used(kept, "checkpoint/rounds.json")
    assert (kept.checkpoint / ".lock").exists()
    failed = RunFolder(tmp_path / "failed")

    def fail() -> None:
        used(failed, "config.toml")
        raise ValueError("x")

    with pytest.raises(ValueError, match="x"), failed.taken():
        fail()
    assert (failed.checkpoint / ".lock").exists()
