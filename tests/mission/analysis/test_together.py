"""Flights judged together, against closed forms: two that fly straight come nearest where the line
between them is at right angles to how they move against each other."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pymap3d
import pytest
from again import again
from limits import no_file_larger_than
from mcap.reader import make_reader
from one_world import UNTIL_S, Floats, Way, head_on, straight, write_ours
from told_logs import HOME, WRITERS, made

import aerofed
from flightdyn.frames import LocalFrame
from mission.analysis.airborne import times_in_air
from mission.analysis.compare import compare_run
from mission.analysis.limits import every_verdict
from mission.analysis.load import load_run
from mission.analysis.several import load_several
from mission.analysis.together import Together, _moved, together
from mission.base.area import Area
from mission.base.errors import LimitsNotMetError
from mission.cli import call
from mission.figures.run import comparison_figure
from mission.flight.logs.ulog_export import export_ulog

UTC_S = 1.7e9
SECOND = np.arange(2.0)


def conflict(seed: int) -> tuple[float, float, Way, Way]:
    """The least distance, when, and the ways of two."""
    rng = np.random.default_rng(seed)
    away_m, at_s = rng.uniform(0.1, 20.0), rng.uniform(15.0, 40.0)
    here = np.append(rng.uniform(-200.0, 200.0, 2), -rng.uniform(120.0, 150.0))
    one, other = (np.append(rng.uniform(-12.0, 12.0, 2), rng.uniform(-1.0, 1.0)) for _ in range(2))
    across = np.cross(other - one, rng.normal(size=3))
    there = here + away_m * across / np.linalg.norm(across)
    return away_m, at_s, straight(at_s, here, one), straight(at_s, there, other)


def write(path: Path, way: Way, *, later_s: float = 0.0) -> Path:
    """A log of any kind, by its suffix; the clock of one of others begins `later_s` later."""
    if path.suffix == ".mcap":
        return write_ours(path, way)
    flight = made(path=lambda t_s: way(t_s + later_s), until_s=UNTIL_S - later_s)
    return WRITERS[path.suffix](path, replace(flight, utc_s=UTC_S + later_s))


def judged(*paths: Path, **offsets: float) -> Together:
    return together([compare_run(load_run(path)) for path in paths], offsets)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [".mcap", "exported .ulg", ".ulg", ".bin", ".tlog"])
@pytest.mark.parametrize("seeds", [range(3), *again([range(3, 8)])], ids=str)
def test_every_conflict_is_found(kind: str, seeds: range, tmp_path: Path) -> None:
    """To a centimetre, and in ArduPilot's and MAVLink's degrees (1e-7: 1.1 cm) to that of the
    roundings of both more."""
    noise_m = math.hypot(0.011, 0.008) if kind in (".bin", ".tlog") else 1e-3
    for seed in seeds:
        away_m, at_s, *ways = conflict(100 * len(kind) + seed)
        paths = [tmp_path / f"{n}-{seed}{kind[-5:].strip()}" for n in range(2)]
        for n, (path, way) in enumerate(zip(paths, ways, strict=True)):
            if kind == "exported .ulg":
                export_ulog(write_ours(path.with_suffix(".mcap"), way, east_m=5.0 * n), path)
            else:
                write(path, way, later_s=3.217 * n)
        (row,) = judged(*paths).rows
        assert row["separation_min_m"] == pytest.approx(away_m, abs=max(0.01, noise_m)), seed
        # So long before and after they are farther by no more than the roundings.
        apart_mps = float(np.linalg.norm(np.diff(ways[1](SECOND) - ways[0](SECOND), axis=0)))
        sure_s = 0.01 + math.sqrt(2 * away_m * noise_m) / apart_mps
        assert row["separation_min_t_s"] == pytest.approx(at_s, abs=sure_s), seed


def test_a_folder_of_one_world_is_judged_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """When, where (in degrees, by the frame of home) and how near; the exit code, and JUnit."""
    folder, junit = head_on(tmp_path / "w"), tmp_path / "v.xml"
    limits = ("--limit", "separation_min_m=5", "--limit", "separation_vertical_min_m=0")
    assert call(["compare", str(folder), *limits, "--junit", str(junit)]) == 6
    told = capsys.readouterr()
    where = LocalFrame(HOME).to_geodetic(np.array([1.5, 0.0, -50.0]))
    assert told.err == (
        "aerofed: vehicle-1 and vehicle-2: separation_min_m = 3: "
        f"must be at least 5; nearest, 20.0 s, {where.lat_deg:.7f}, {where.lon_deg:.7f}, "
        "50.0 m high\n"
    )
    assert "Who came how near to whom" in told.out
    suites = [(s.get("tests"), s.get("failures")) for s in ET.parse(junit).getroot()]
    assert suites == [("0", "0"), ("0", "0"), ("2", "1")]
    assert call(["compare", str(folder), "--limit", "separation_min_m=2.99"]) == 0
    assert "1 limit met by all" in capsys.readouterr().out
    assert call(["compare", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (pair,) = found["pairs"]
    assert len(found["flights"]) == 2
    assert pair["separation_horizontal_min_m"] == pytest.approx(3.0, abs=1e-3)
    assert pair["separation_vertical_min_m"] == pytest.approx(0.0, abs=1e-3)
    assert pair["plan_separation_min_m"] is None


def test_a_flight_that_is_lost_in_the_air_counts_to_its_end(tmp_path: Path) -> None:
    """Disarmed, as after a landing, but its last place is where it was hit."""
    data = load_run(write_ours(tmp_path / "a.mcap", straight(0.0, (0, 0, -50), (5, 0, 0)))).data
    end_ns = int(data.truth.t_ns[-1])
    disarmed = replace(data.events[0], t_ns=end_ns, text="disarmed")
    ((_, end_s),) = times_in_air("a", replace(data, events=(*data.events, disarmed)))
    assert end_s == pytest.approx(end_ns * 1e-9)


def test_horizontal_and_vertical_count_while_the_other_is_too_small(tmp_path: Path) -> None:
    """One sinks through the height of the other while it comes nearer."""
    level = straight(20.0, (0.0, 0.0, -100.0), (1.0, 0.0, 0.0))
    passing = straight(20.0, (10.0, 0.0, -100.0), (-1.0, 0.0, 0.5))  # beside nobody at 25 s
    paths = [
        write_ours(tmp_path / name / "flight.mcap", way)
        for name, way in (("vehicle-1", level), ("vehicle-2", passing))
    ]
    found = aerofed.compare(tmp_path)
    limits = {"separation_horizontal_min_m": 1.0, "separation_vertical_min_m": 2.0}
    assert all(item.met for item in found.check(**limits))  # 2.5 m high when it is 1 m beside
    limits = {"separation_horizontal_min_m": 9.0, "separation_vertical_min_m": 2.0}
    horizontal, vertical = every_verdict(found.several, limits)[-1]
    # Within 2 m of height from 16 to 24 s, where it is 18 to 2 m away; nearer than 9 m from 20.5 s.
    assert horizontal.value == pytest.approx(2.0, abs=1e-3)
    assert vertical.value == pytest.approx(0.25, abs=1e-3)
    with pytest.raises(LimitsNotMetError, match=r"separation_vertical_min_m = 0\.25: "):
        found.check(**limits)
    both = aerofed.compare(*paths, together=True).pairs.iloc[0]
    assert both["separation_horizontal_min_m"] == pytest.approx(0.0, abs=1e-3)


def test_a_log_that_cannot_be_read_makes_it_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What flew in it may have come as near as it likes; the page says that it is missing."""
    folder = head_on(tmp_path / "colons: none")
    other = folder / "vehicle-3" / "flight-0001.mcap"
    other.parent.mkdir()
    asked = ["compare", str(folder), "--limit", "separation_min_m=2.99"]
    assert call(asked) == 0  # nothing was flown by it, as far as anybody knows
    assert capsys.readouterr().out.endswith("1 limit met by all, but 1 log left out\n")
    (folder / "summary.json").write_text("{}")  # as of a flight of all, of which a log is gone
    assert call(asked) == 6
    capsys.readouterr()
    other.parent.rmdir()
    (folder / "summary.json").write_text('{"vehicles": ["vehicle-1", "vehicle-2", "vehicle-3"]}')
    assert call(asked) == 6
    gone = "separation_min_m = not known: must be at least 2.99; no such run folder or log file"
    assert capsys.readouterr().err == f"aerofed: {other.parent}: {gone}\n"
    (folder / "summary.json").unlink()
    other.parent.mkdir()
    other.write_bytes((folder / "vehicle-1" / other.name).read_bytes()[:-500])
    assert call(asked) == 6
    told = f"aerofed: {other}: separation_min_m = not known: must be at least 2.99; damaged at byte"
    assert capsys.readouterr().err.startswith(told)
    assert call([*asked, "--json", "--junit", str(tmp_path / "v.xml")]) == 6
    said = capsys.readouterr()
    assert said.err.startswith(f"left out: {other}: damaged at byte")
    lasted_s = [float(suite.get("time", "nan")) for suite in ET.parse(tmp_path / "v.xml").getroot()]
    assert lasted_s[:4] == [49.9, 49.9, 49.7, 0.0]  # two flights, a pair, and what is unread
    (its,) = json.loads(said.out)["unread"]
    assert its["unread"] == str(other)
    assert its["why"].startswith("damaged at byte")
    assert not its["limits_met"]
    assert call(["log", "export", str(folder), "--to", "kml"]) == 0
    assert capsys.readouterr().err.startswith(f"left out: {other}: damaged at byte")
    assert call(["report", str(folder)]) == 0
    assert f"left out: {other}: damaged at byte" in (folder / "together.html").read_text()
    (folder / "vehicle-2" / other.name).write_bytes(other.read_bytes())
    assert call(["report", str(folder)]) == 0
    page = (folder / "together.html").read_text()
    assert re.search(r"\b1 vehicle\b", page)
    assert not re.search("1 vehicles|All pairs", page)


def test_a_hole_makes_it_unknown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = head_on(tmp_path / "w", hole_s=(18.0, 22.0))
    for limit, code in (("separation_min_m=5", 6), ("separation_min_m=25", 6)):
        assert call(["compare", str(folder), "--limit", limit]) == code
        told = capsys.readouterr()
        assert " / not known" in told.out
        # Outside it is at least 20.2 m: that breaks 25, and what is in it is not known.
        known = "= 20.22" if limit.endswith("25") else "= not known"
        assert f"separation_min_m {known}: must be at least" in told.err
    more = ("--limit", "gap_max_s=5")
    assert call(["compare", str(folder), "--limit", "separation_min_m=5", *more]) == 0
    assert "no positions of one of them at 18.0-22.0 s" in capsys.readouterr().out
    row = aerofed.compare(folder).pairs.iloc[0]
    assert math.isnan(row["separation_min_m"])


@pytest.mark.parametrize(("hole_s", "lost"), [((30, 60), "30.0-49.9"), ((-1, 20), "0.0-20.0")])
def test_positions_that_begin_or_end_in_the_air_make_it_unknown(
    hole_s: tuple[float, float], lost: str, tmp_path: Path
) -> None:
    """As it hovers, between a climb and a landing that the log does not show."""

    def hovers(t_s: Floats) -> Floats:
        up_m = np.interp(t_s, (5, 10, 40, 45), (0, 50, 50, 0))
        return np.column_stack((9.0 + 0 * t_s, np.interp(t_s, (24, 26), (0, 3)), -up_m))

    write_ours(tmp_path / "vehicle-1" / "flight-0001.mcap", hovers, hole_s=hole_s)
    level = straight(0.0, (0.0, 0.0, -50.0), (0.0, 0.5, 0.0))
    write_ours(tmp_path / "vehicle-2" / "flight-0001.mcap", level)
    row = aerofed.compare(tmp_path).pairs.iloc[0]
    assert math.isnan(row["separation_min_m"])
    with pytest.raises(LimitsNotMetError, match=f"no positions of one of them at {lost} s"):
        aerofed.compare(tmp_path).check(separation_min_m=1)


def test_alone_nothing_is_met(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nor are flights of one folder that are side by side, as they were at different times."""
    first = write_ours(tmp_path / "a.mcap", straight(0.0, (0.0, 0.0, -50.0), (5.0, 0.0, 0.0)))
    assert call(["compare", str(first), "--limit", "separation_min_m=5"]) == 6
    assert "of flights that are judged together (--together)" in capsys.readouterr().err


def test_on_the_ground_beside_each_other_nobody_is_too_near(tmp_path: Path) -> None:
    """They stand 1 m apart, and jump 20 m aside each as they leave the ground."""

    def up(east_m: float) -> Way:
        def way(t_s: Floats) -> Floats:
            gone_s = np.clip(t_s - 15.0, 0.0, None)
            away_m = np.where(gone_s > 0, 20.0 * np.sign(east_m - 0.5), 0.0)
            return np.column_stack((0 * t_s, east_m + away_m, -10.0 * gone_s - 10.0 * (gone_s > 0)))

        return way

    world = judged(*(write_ours(tmp_path / f"{e}.mcap", up(float(e))) for e in (0, 1)))
    assert world.rows[0]["separation_min_m"] == pytest.approx(41.0, abs=0.1)


@pytest.mark.parametrize(("north_deg", "east_deg"), [(0.02, 0.3), (-0.3, 0.05)])
def test_a_place_far_off_is_the_same_in_the_area_of_another(
    north_deg: float, east_deg: float
) -> None:
    homes = (
        HOME,
        replace(HOME, lat_deg=HOME.lat_deg + 0.05, lon_deg=HOME.lon_deg - 0.05, alt_msl_m=0),
    )
    place = HOME.lat_deg + north_deg, HOME.lon_deg + east_deg, 700.0
    seen = []
    for home in homes:
        north_m, east_m, _ = pymap3d.geodetic2ned(
            *place, home.lat_deg, home.lon_deg, home.alt_msl_m
        )
        seen.append([east_m + 100.0, north_m + 50.0, 700.0 - home.alt_msl_m])
    areas = [Area.at((1e3, 1e3), (100.0, 50.0), home) for home in homes]
    for here, there in ((0, 1), (1, 0)):
        moved = _moved(np.array([seen[here]]), areas[here], areas[there])
        assert moved == pytest.approx(np.array([seen[there]]), abs=0.01)


PAST = straight(20.0, (0.0, 0.0, -50.0), (0.0, 5.0, 0.0))


@pytest.mark.parametrize(
    ("kinds", "way", "later_s", "options", "said"),
    [
        (
            (".ulg", ".bin"), straight(20.0, (9000.0, 0.0, -50.0), (0.0, 5.0, 0.0)), 0.0, (),
            "b.bin: 9.0 km from a.ulg: flights of other places; leave --together out to see them "
            "side by side",
        ),
        (
            (".ulg", ".tlog"), PAST, 900.0, (),
            "a.ulg: in the air when none of the others is; leave --together out to see them side "
            "by side, or --offset a.ulg=SECONDS says what to add to its times",
        ),
        (
            (".mcap", ".bin"), PAST, 0.0, (),
            "b.bin: its clock cannot be aligned with that of a.mcap: not both tell UTC or GPS "
            "time; --offset b.bin=SECONDS says what to add to its times",
        ),
        ((".ulg", ".bin"), PAST, 0.0, ("--offset", "c.bin=1"), "--offset c.bin: no such log "
         "(there are: a.ulg, b.bin)"),
        ((".ulg", ".bin"), PAST, 0.0, ("--offset", "b.bin=nan"), "--offset b.bin=nan: must be a "
         "number of seconds"),
        ((".ulg", ".bin"), PAST, 0.0, ("--offset", "b.bin"), "--offset b.bin: must be LOG=SECONDS, "
         "as b.ulg=12.5"),
    ],
)  # fmt: skip
def test_what_cannot_be_judged_together_is_refused_in_a_line(
    kinds: tuple[str, str],
    way: Way,
    later_s: float,
    options: tuple[str, ...],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = write(tmp_path / f"a{kinds[0]}", PAST)
    moved: Way = lambda t_s: way(t_s - later_s)  # noqa: E731
    flight = replace(made(path=moved, until_s=UNTIL_S), utc_s=UTC_S + later_s)
    other = WRITERS[kinds[1]](tmp_path / f"b{kinds[1]}", flight)
    assert call(["compare", str(first), str(other), "--together", *options]) == 2
    assert capsys.readouterr().err == f"aerofed: {said}\n"


def test_clocks_are_aligned_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By UTC of the receiver, of the ground station, or as is told; three logs of three kinds."""
    paths = [
        write(tmp_path / f"{n}{kind}", straight(20.0, (4.0 * n, 0.0, -50.0), (0.0, 5.0, 0.0)),
              later_s=2.5 * n)
        for n, kind in enumerate((".ulg", ".bin", ".tlog"))
    ]  # fmt: skip
    names = list(map(str, paths))
    assert call(["compare", *names, "--together", "--limit", "separation_min_m=3.9"]) == 0
    told = capsys.readouterr().out
    assert "1.bin: +2.500 s on the clock of 0.ulg, by UTC" in told
    assert "2.tlog: +5.000 s on the clock of 0.ulg, by UTC" in told
    # With another clock the middle one is 5 m/s * 10 s behind the others.
    found = aerofed.compare(*paths, offsets={"1.bin": 12.5}).pairs
    assert found["separation_min_m"].tolist() == pytest.approx(
        [math.hypot(4.0, 50.0), 8.0, math.hypot(4.0, 50.0)], abs=0.1
    )


def test_flights_of_different_times_stay_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for n, from_s in enumerate((0.0, 1000.0), start=1):
        write_ours(tmp_path / f"vehicle-{n}" / "flight-0001.mcap", PAST, from_s=from_s)
    assert call(["compare", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "Runs side by side" in told
    assert "Who came" not in told
    assert call(["compare", str(tmp_path), "--limit", "separation_min_m=1"]) == 6


def test_files_for_maps_have_all_vehicles_and_where_they_were_nearest(tmp_path: Path) -> None:
    """GeoJSON, KML (by its namespace) and an MCAP that the library mcap reads."""
    folder = head_on(tmp_path)
    for form in ("geojson", "kml", "mcap"):
        assert call(["log", "export", str(folder), "--to", form]) == 0
        assert call(["log", "export", str(folder), "--to", form]) == 2  # it is there
    where = LocalFrame(HOME).to_geodetic(np.array([1.5, 0.0, -50.0]))
    middle = [where.lon_deg, where.lat_deg, HOME.alt_msl_m + 50.0]
    features = json.loads((folder / "together.geojson").read_text())["features"]
    kinds = [f["properties"].get("vehicle", f["properties"]["kind"]) for f in features]
    assert kinds == ["vehicle-1", "vehicle-2", "nearest"]
    assert features[2]["geometry"]["coordinates"] == pytest.approx(middle, rel=1e-5)
    assert features[2]["geometry"]["coordinates"][1] == pytest.approx(middle[1], abs=2e-8)
    assert len(features[0]["properties"]["t_s"]) == len(features[0]["geometry"]["coordinates"])
    root = ET.parse(folder / "together.kml").getroot()
    (point,) = root.findall(".//{*}Point/{*}coordinates")
    assert list(map(float, str(point.text).split(","))) == pytest.approx(middle, rel=1e-5)
    with (folder / "together.mcap").open("rb") as file:
        seen: dict[str, list[Any]] = {}
        for _, channel, message in make_reader(file).iter_messages():
            seen.setdefault(channel.topic, []).append(message)
    assert set(seen) == {
        "/scene/world", "/tf", "/vehicle-1/location", "/vehicle-2/location",
        "/separation/vehicle-1_and_vehicle-2",
    }  # fmt: skip
    distances = [json.loads(m.data)["away_m"] for m in seen["/separation/vehicle-1_and_vehicle-2"]]
    assert min(distances) == pytest.approx(3.0, abs=1e-3)
    assert b"vehicle-1 and vehicle-2: 3.00 m at 20.0 s" in seen["/scene/world"][0].data


@pytest.mark.parametrize("form", ["geojson", "kml", "mcap"])
def test_a_file_for_maps_that_finds_no_room_leaves_nothing(form: str, tmp_path: Path) -> None:
    folder = head_on(tmp_path / "w")
    to = ("--to", form, "--out", str(tmp_path / f"all.{form}"))
    with no_file_larger_than(1000):
        assert call(["log", "export", str(folder), *to]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["w"]
    assert call(["log", "export", str(folder), *to]) == 0


def test_the_picture_has_the_limit(tmp_path: Path) -> None:
    folder = head_on(tmp_path / "w")
    flights = load_several([folder])
    chart = comparison_figure(flights.flights, flights.together, {"separation_min_m": 5.0})
    texts = json.dumps(chart["datasets"])
    assert "limit 5 m" in texts
    assert "3.00 m" in texts
    ways = [
        rows for rows in chart["datasets"].values() if rows and {"kind", "part"} <= set(rows[0])
    ]
    assert {row["kind"] for rows in ways for row in rows} >= {"vehicle-1", "vehicle-2"}


@pytest.mark.slow
def test_planned_is_when_each_was_to_be_where(tmp_path: Path) -> None:
    """Two plans, mirrored, lead past each other 12 m apart after a climb and 100 m of the way each:
    planned and flown they are nearest at one time, by symmetry when each is half way."""
    frame = LocalFrame(HOME)
    for name, north_m, east_m in (("1", -100.0, 0.0), ("2", 100.0, 12.0)):
        ends = [(north_m, east_m), (-north_m, east_m)]
        at = [frame.to_geodetic(np.array([*end, 0.0])) for end in ends]
        items = [
            {
                "type": "SimpleItem", "command": command, "frame": 3, "autoContinue": True,
                "params": [0, 0, 0, None, place.lat_deg, place.lon_deg, 20],
            }
            for command, place in zip((22, 16, 21), (*at, at[1]), strict=True)
        ]  # fmt: skip
        home = [at[0].lat_deg, at[0].lon_deg, HOME.alt_msl_m]
        mission = {"version": 2, "items": items, "plannedHomePosition": home, "cruiseSpeed": 10}
        plan = tmp_path / f"{name}.plan"
        plan.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}))
        out = ("--out", str(tmp_path / f"vehicle-{name}"), "--no-report", "--no-figures")
        assert call(["fly", str(plan), *out, "--quiet"]) == 0
    found = aerofed.compare(tmp_path)
    row = found.pairs.iloc[0]
    assert row["plan_separation_min_m"] == pytest.approx(12.0, abs=0.1)
    assert row["separation_min_m"] == pytest.approx(12.0, abs=2.0)
    assert row["separation_min_t_s"] == pytest.approx(row["plan_separation_min_t_s"], abs=1.0)
    legs = found.flights[0].legs[1]
    half_s = (legs.start_s + legs.end_s) / 2
    assert row["separation_min_t_s"] == pytest.approx(half_s, abs=1.0)
