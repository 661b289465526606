"""Holes in logs: what flew there is not known, and no limit is met by it."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import made_up_logs
import numpy as np
import pytest
from described import tables
from made_up_logs import HOME, write_dataflash, write_tlog, write_ulog
from synthetic_flight import fly

from flightdyn.frames import LocalFrame
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.limits import verdicts
from mission.analysis.load import load_run
from mission.analysis.spikes import events
from mission.base.errors import LIMITS_NOT_MET
from mission.cli import call
from mission.figures.flight import profile_charts
from mission.figures.frame import run_frame, run_lines
from mission.figures.maps import places
from mission.log.values import Track

Write = Callable[..., Path]
KINDS: dict[str, Write] = {".ulg": write_ulog, ".bin": write_dataflash, ".tlog": write_tlog}
EXCURSION = (38.45, 41.55)  # s: 25 m to the side in the middle of the second leg
CORNER = (43.0, 52.0)  # around the corner of the second and the third leg


def write(
    monkeypatch: pytest.MonkeyPatch, log: Path, *holes: tuple[float, float], off_m: float = 0.0
) -> Path:
    """A log of which all is lost in some stretches of time."""
    whole = made_up_logs.samples
    with monkeypatch.context() as patch:
        patch.setattr(
            made_up_logs,
            "samples",
            lambda **how: [s for s in whole(**how) if not any(a < s.t_s < b for a, b in holes)],
        )
        return KINDS[log.suffix](log, off_m=off_m)


def compared(log: Path) -> RunComparison:
    loaded = load_run(log)
    assert loaded.judged is not None, loaded.unjudged
    return compare_run(loaded)


def values(found: RunComparison, **limits: float) -> dict[str, float | None]:
    """Values by limit, None where not known; those that are met are 0."""
    return {
        item.name: 0.0 if item.met else None if math.isnan(item.value) else round(item.value, 1)
        for item in verdicts(found, limits)
    }


@pytest.mark.parametrize("end", KINDS)
def test_what_flew_in_a_hole_meets_no_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    found = compared(write(monkeypatch, tmp_path / f"x{end}", EXCURSION, off_m=25.0))
    (hole,) = found.holes
    assert (hole.start_s, hole.end_s) == pytest.approx(EXCURSION, abs=0.06)
    assert hole.leg == 3
    frame = LocalFrame(HOME)
    north = [frame.to_ned(*place, HOME.alt_msl_m)[0] for place in (hole.from_deg, hole.to_deg)]
    assert north == pytest.approx([48.0, 72.0], abs=1.7)
    assert found.total.gap_max_s == pytest.approx(3.1, abs=0.15)
    # On the known part it kept to the plan; a limit that holds there may be broken in the hole.
    hidden = {
        "cross_track_max_m": 3, "cross_track_rms_m": 3, "straight_max_m": 3, "corner_cut_max_m": 3,
        "height_max_m": 3, "speed_max_mps": 12, "slot_miss_max_m": 9, "slots_missed": 0,
        "failsafes": 0, "mode_changes": 9, "flown_path_m": 999, "duration_s": 999,
    }  # fmt: skip
    assert values(found, **hidden) == dict.fromkeys(hidden)
    # What is known already breaks these, and those have nothing to do with the track.
    assert values(found, flown_path_m=100, speed_max_mps=2, plan_path_m=999, slots=9) == {
        "flown_path_m": pytest.approx(380.0, abs=3.0),
        "speed_max_mps": pytest.approx(8.0, abs=0.3),
        "plan_path_m": 0.0,
        "slots": 0.0,
    }
    assert values(found, gap_max_s=4, cross_track_max_m=3) == {
        "gap_max_s": 0.0,
        "cross_track_max_m": 0.0,
    }
    few = values(found, gap_max_s=2, cross_track_max_m=3)
    assert few == {"gap_max_s": pytest.approx(3.1, abs=0.15), "cross_track_max_m": None}


@pytest.mark.parametrize("end", KINDS)
def test_nothing_is_measured_across_a_hole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    """A straight line over it would cut the corner by 24 m, and miss its place by as much."""
    found = compared(write(monkeypatch, tmp_path / f"x{end}", CORNER))
    assert found.total.cross_track_max_m < 0.05
    assert found.total.corner_cut_max_m < 0.05
    assert found.total.slot_miss_max_m < 0.9
    assert found.total.speed_max_mps < 8.3
    assert found.total.slots_missed == 0
    assert [hole.leg for hole in found.holes] == [3]
    (told,) = [e for e in events(found.run.data, 0.0, 99.0) if e.text.startswith("no positions")]
    assert (told.start_s, told.end_s) == pytest.approx(CORNER, abs=0.11)


def test_no_line_is_drawn_across_a_hole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = compared(write(monkeypatch, tmp_path / "whole.ulg"))
    found = compared(write(monkeypatch, tmp_path / "x.ulg", CORNER))
    paths = [
        [part for kind, _, part in run_lines(each.run.data, each.run.data.plans) if kind == "flown"]
        for each in (whole, found)
    ]
    assert [len(parts) for parts in paths] == [1, 2]
    # By CORNER's times at 8 m/s: where the one part ends and the other begins.
    away_m = np.linalg.norm(paths[1][1][0] - paths[1][0][-1])
    assert 40.0 < away_m < 72.0
    for each, holes in ((whole, 0), (found, 1)):
        for chart in profile_charts([each]):
            (lines, *_) = tables(chart, "series", "x", "y")
            assert not any("pass" in row["series"] for row in lines)  # there is one
            flown = [row["y"] for row in lines if row["series"] == lines[0]["series"]]
            # The line ends once more: at the hole; a return has no distance to be drawn.
            ends = [a is None and b is not None for a, b in pairwise(flown)]
            assert sum(ends) == holes, chart["title"]


def test_the_map_does_not_say_that_what_may_have_been_passed_in_a_hole_was_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for holes, words in (
        ([], "not reached"),
        ([(0.0, 2.5)], "not reached"),  # before the mission
        ([CORNER], "not reached outside holes"),
    ):
        data = compared(write(monkeypatch, tmp_path / f"{len(words)}{holes}.ulg", *holes)).run.data
        assert data.planned is not None
        (layer,) = places(run_frame(data, 400), replace(data.planned, reached=frozenset()))
        (rows,) = tables(run_frame(data, 400).finished([layer], {"text": "x"}), "kind", "item")
        assert {row["kind"] for row in rows} == {words}


@pytest.mark.parametrize("end", KINDS)
def test_holes_outside_the_mission_hide_only_what_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    """On the ground, in the hover after it, and one of half a second, which is none."""
    holes = (1.0, 3.0), (70.0, 72.5), (30.0, 30.6)
    found = compared(write(monkeypatch, tmp_path / f"x{end}", *holes))
    assert [(hole.leg, round(hole.start_s)) for hole in found.holes] == [(None, 1), (None, 70)]
    assert found.holes[0].words.startswith("at 1.0-3.0 s no positions for 2.0 s, outside the plan,")
    assert found.total.gap_max_s == pytest.approx(2.6, abs=0.15)
    assert values(found, cross_track_max_m=1, slots_missed=0, failsafes=0) == {
        "cross_track_max_m": 0.0, "slots_missed": 0.0, "failsafes": None
    }  # fmt: skip
    assert values(found, gap_max_s=3, failsafes=0) == {"gap_max_s": 0.0, "failsafes": 0.0}
    assert values(found, gap_max_s=2.2, failsafes=0)["failsafes"] is None


@pytest.mark.parametrize("end", KINDS)
def test_a_mission_that_may_have_begun_in_a_hole_is_not_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    """What the log tells of it begins after take-off and most of the first leg."""
    found = compared(write(monkeypatch, tmp_path / f"x{end}", (4.0, 30.0)))
    assert [round(hole.end_s) for hole in found.holes] == [30]
    assert values(found, slots_missed=0, cross_track_max_m=3) == {
        "slots_missed": None,
        "cross_track_max_m": None,
    }


def test_a_log_of_slow_positions_has_no_holes_but_longer_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A position every 1.5 s: 5 s are none, 9 s are a hole."""
    slow = [(a + 0.05, a + 1.45) for a in np.arange(0.0, 75.0, 1.5)]
    found = compared(write(monkeypatch, tmp_path / "x.tlog", *slow, (36.1, 40.4)))
    assert not found.holes
    found = compared(write(monkeypatch, tmp_path / "x.tlog", *slow, (36.1, 44.9)))
    assert [round(h.end_s - h.start_s) for h in found.holes] == [9]


def test_a_log_that_goes_on_without_positions_ends_with_a_hole(tmp_path: Path) -> None:
    """And so it begins with one, if the mission had begun before the first position."""
    places = [(s.t_s, s.lat_deg, s.lon_deg, s.alt_msl_m) for s in made_up_logs.samples()]
    fields = "double lat;double lon;float alt"
    for keeps, gap in (
        (lambda t_s: t_s < 40.0, (40.0, 67.6)),
        (lambda t_s: t_s > 27.0, (0.0, 27.0)),
    ):
        rows = [row for row in places if keeps(row[0])]
        topic = {"vehicle_global_position": (fields, "ddf", rows)}
        found = compared(write_ulog(tmp_path / "x.ulg", instead=topic))
        (hole,) = found.holes
        assert (hole.start_s, hole.end_s) == pytest.approx(gap, abs=0.2)
        assert values(found, cross_track_max_m=1, slots_missed=0) == {
            "cross_track_max_m": None,
            "slots_missed": None,
        }


def test_positions_of_a_true_track_that_are_missing_are_a_hole(tmp_path: Path) -> None:
    """Where the estimate goes on: it is not what is compared."""
    rows = [
        (s.t_s, s.lat_deg, s.lon_deg, s.alt_msl_m)
        for s in made_up_logs.samples(off_m=25.0)
        if not EXCURSION[0] < s.t_s < EXCURSION[1]
    ]
    truth = ("double lat;double lon;float alt", "ddf", rows)
    log = write_ulog(tmp_path / "x.ulg", instead={"vehicle_global_position_groundtruth": truth})
    found = compared(log)
    assert found.run.data.source.only is None
    (hole,) = found.holes
    assert (hole.start_s, hole.end_s) == pytest.approx(EXCURSION, abs=0.06)
    assert values(found, cross_track_max_m=3) == {"cross_track_max_m": None}


@pytest.mark.parametrize(("end", "after_s"), [(0, 3), (1, -4), (0, -2), (1, -2)])
def test_a_hole_in_a_round_hides_what_was_flown_but_not_what_arrived(
    tmp_path: Path, end: int, after_s: float
) -> None:
    """Within it, and over its begin and its end."""
    fly(tmp_path)
    loaded = load_run(tmp_path / "flight.mcap")
    whole, data = compare_run(loaded), loaded.data
    at_ns = data.truth.t_ns
    record = data.rounds[0]
    start_ns = round(1e9 * (record.start_t_s + end * record.duration_s + after_s))
    kept = (at_ns <= start_ns) | (at_ns >= start_ns + 4_000_000_000)
    holed = replace(
        data,
        truth=Track(at_ns[kept], data.truth.pos_m[kept]),
        belief=Track(at_ns[kept], data.belief.pos_m[kept]),
    )
    found = compare_run(replace(loaded, data=holed))
    (hole,) = found.holes
    assert (hole.leg is None, round(hole.end_s - hole.start_s)) == (False, 4)
    limits = {"cross_track_max_m": 1e3, "estimate_max_m": 1e3, "slot_miss_max_m": 1e3,
              "slots_missed": 99, "true_per_mean": 1, "delivered": 0}  # fmt: skip
    assert set(values(whole, **limits).values()) == {0.0}
    known = "true_per_mean", "delivered"
    assert values(found, **limits) == {name: 0.0 if name in known else None for name in limits}


def test_a_hole_is_told_wherever_a_comparison_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write(monkeypatch, tmp_path / "x.bin", EXCURSION, off_m=25.0)
    xml, page = tmp_path / "verdict.xml", tmp_path / "page.html"
    limits = ["--limit", "cross_track_max_m=3", "--junit", str(xml)]
    assert call(["compare", str(log), *limits]) == LIMITS_NOT_MET
    said = capsys.readouterr()
    told = "at 38.4-41.6 s no positions for 3.2 s, leg 3, 47.3981"
    assert f"\n{told}" in said.out
    assert said.err.startswith("aerofed: x.bin: cross_track_max_m = not known: must be at most 3; ")
    assert told in said.err
    (suite,) = ET.parse(xml).getroot()
    assert told in suite[0][0].attrib["message"]
    assert call(["compare", str(log), *limits, "--limit", "gap_max_s=3.5"]) == 0
    assert call(["compare", str(log), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out.partition("met\n")[2])
    assert [round(hole["end_s"] - hole["start_s"], 1) for hole in found["holes"]] == [3.2]
    assert call(["report", str(log), "--out", str(page)]) == 0
    assert told in page.read_text()
