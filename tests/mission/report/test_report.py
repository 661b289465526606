"""The report: complete by itself, well formed, and right in what it says."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from described import charts, rows
from made_up_logs import write_ulog
from one_world import head_on
from synthetic_flight import AREA, devices, fly

from mission.analysis.compare import compare_run
from mission.analysis.load import LoadedRun, load_run
from mission.base.errors import InputError
from mission.log.writer import FlightLog
from mission.report import page as report_page
from mission.report.page import about, report_html, write_report

VOID = {"meta", "input", "br", "i"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    fly(path, rounds=3)
    summary = {
        "status": "finished", "name": 'a <b> & "c"', "strategy": "cov", "seed": 7,
        "real_time_factor": 98.2, "wall_s": {"fly": 3.0, "learn": 5.0, "total": 8.5},
        "libraries": {"mcap": "1.6.0"},
    }  # fmt: skip
    (path / "summary.json").write_text(json.dumps(summary))
    return path


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return write_report(folder).read_text(encoding="utf-8")


class Balance(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.links += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


@pytest.mark.slow
def test_it_is_one_well_formed_file_that_fetches_nothing(page: str) -> None:
    parser = Balance()
    parser.feed(page)
    assert parser.open == []
    assert parser.links == []
    markup = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert "url(" not in markup
    assert "@import" not in markup
    assert "default-src 'none'" in page
    assert "unsafe-eval" not in page
    assert len(page.encode()) < 2_000_000
    assert len(charts(page)) > 12


def test_the_same_run_gets_the_same_bytes(folder: Path, page: str, tmp_path: Path) -> None:
    assert write_report(folder, tmp_path / "r.html").read_text(encoding="utf-8") == page


def test_it_says_what_the_run_was(page: str) -> None:
    assert "a &lt;b&gt; &amp; &#34;c&#34;" in page
    assert "strategy cov" in page
    assert "seed 7" in page
    assert "4.5 m/s, no turbulence, no gusts" in page
    assert "Slots later than planned" in page
    assert "Wall time: 8.5 s" in page
    assert re.findall(r'data-round="(\d)"', page) == ["1", "2", "3"]
    assert {row["round"] for row in rows(charts(page)["Planned and flown"], "outcome")} == {1, 2, 3}
    assert "/tmp" not in page  # nothing of the machine that wrote it


@pytest.mark.parametrize(
    ("wind", "words"),
    [
        ({}, "no steady wind, no turbulence, no gusts"),
        ({"speed_mps": 0.0, "from_deg": 90}, "no steady wind, no turbulence, no gusts"),
        ({"speed_mps": 3.5}, "3.5 m/s, no turbulence, no gusts"),
        (
            {"speed_mps": 8.0, "from_deg": 0.0, "turbulence_severity": 1, "gusts": [1]},
            "8 m/s from north (0\u00b0), turbulence of severity 1 of 7, 1 gust",
        ),
        (
            {"speed_mps": 8.0, "from_deg": 22.6, "turbulence_severity": 7, "gusts": [1, 2]},
            "8 m/s from north-east (22.6\u00b0), turbulence of severity 7 of 7, 2 gusts",
        ),
        *(
            (
                {"speed_mps": 1.0, "from_deg": degrees},
                f"1 m/s from {name} ({degrees}\u00b0), no turbulence, no gusts",
            )
            for degrees, name in (
                *((22, "north"), (45, "north-east"), (67, "north-east"), (68, "east")),
                *((135, "south-east"), (180, "south"), (225, "south-west"), (270, "west")),
                *((315, "north-west"), (337, "north-west"), (338, "north"), (359, "north")),
            )
        ),
    ],
)
def test_the_wind_is_in_words(wind: dict[str, object], words: str) -> None:
    config = {"vehicle": {"aircraft": {"wind": wind}}}
    assert told({}, config)["conditions"] == [("wind", words)]


def told(summary: dict[str, object], config: Mapping[str, object]) -> dict[str, Any]:
    attachments = {"config.toml": b"seed = 7\xff"}
    run: Any = SimpleNamespace(
        summary=summary, data=SimpleNamespace(attachments=attachments, config=config)
    )
    return about(run)


def test_times_conditions_and_versions_stand_at_the_end() -> None:
    summary: dict[str, object] = {
        "wall_s": {"fly": 3.0, "learn": 5.0, "total": 8.5}, "seed": 7, "ended_by": "rounds",
        "simulated_s": 1234.56, "battery_changes": 0, "python": "3.11", "cpus": 4,
        "libraries": {"mcap": "1.6.0"}, "strategy": "cov",
    }  # fmt: skip
    assert told(summary, {}) == {
        "wall_s": [("fly", 3.0), ("learn", 5.0)], "total_s": 8.5,
        "conditions": [
            ("ended by", "rounds"), ("seed", "7"), ("simulated s", "1235"), ("battery changes", "0")
        ],
        "versions": "python         3.11\ncpus           4\nmcap           1.6.0",
        "config": "seed = 7\ufffd",
    }  # fmt: skip
    summary["wall_s"] = {"fly": 3.0, "learn": 5.0}
    assert told(summary, {})["total_s"] == 8.0
    assert told({"wall_s": 3.0}, {})["total_s"] == 0


def tiles(loaded: LoadedRun, **other: Any) -> list[tuple[str, str]]:
    """The tiles of a run with other numbers of the whole flight."""
    made = compare_run(loaded)
    changed = replace(made, total=replace(made.total, **other))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report_page, "compare_run", lambda _: changed)
        patch.setattr(report_page, "card", lambda *_, **__: None)
        patch.setattr(report_page, "page", lambda _, *, tiles, **__: tiles)
        found: Any = report_html(loaded)  # the tiles alone: pictures take a second
        return list(found)


def tiles_of(page: str) -> list[tuple[str, str]]:
    return re.findall(r'<div class="tile"><b>(.*?)</b><span>(.*?)</span>', page)


MEASURED = {
    "flown_path_m": 12_345_000.0, "straight_rms_m": 1.234, "tracking_rms_m": 3.456,
    "height_tracking_max_m": 4.567, "battery_remaining": 0.991, "corner_cut_max_m": 2.345,
    "slots": 7, "slots_missed": 2,
}  # fmt: skip
UNMEASURED = {name: math.nan for name in MEASURED if not name.startswith("slots")}


def test_tiles_are_percent_kilometres_and_sums(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    loaded = load_run(tmp_path)
    rounds = tuple(
        replace(
            record, scheduled=4 + k, delivered=2 + k,
            accuracy={"digits": 0.25 * (k + 1), "colour-shapes": 0.5 - 0.1 * k},
        )
        for k, record in enumerate(loaded.data.rounds)
    )  # fmt: skip
    loaded = replace(loaded, data=replace(loaded.data, rounds=rounds))
    learnt = [
        *(("2", "rounds"), ("50.0 %", "accuracy digits"), ("40.0 %", "accuracy colour-shapes")),
        ("5 / 9", "updates delivered"),
    ]
    last = [("99 %", "battery left"), ("2.35 m", "deepest corner cut")]
    straight = ("1.23 m", "cross-track rms on straights")
    assert tiles(loaded, **MEASURED) == [
        *(*learnt, ("12345.00 km", "flown in rounds"), straight, *last),
    ]  # fmt: skip
    assert tiles(loaded, **UNMEASURED) == learnt
    planned = load_run(write_ulog(tmp_path / "a.ulg"))
    along = ("12345.00 km", "flown along the plan")
    assert tiles(planned, **MEASURED) == [("5 / 7", "places reached"), along, straight, *last]


def test_tiles_of_flights_that_are_told_and_of_two_together(tmp_path: Path) -> None:
    folder = head_on(tmp_path)
    alone = load_run(folder / "vehicle-1" / "flight-0001.mcap")
    assert tiles(alone, **MEASURED) == [
        *(("12345.00 km", "flown"), ("3.46 m", "off its setpoint, rms")),
        *(("4.57 m", "height off, max"), ("99 %", "battery left")),
        ("2.35 m", "deepest corner cut"),
    ]
    assert tiles(alone, **UNMEASURED) == []
    page = write_report(folder).read_text(encoding="utf-8")
    assert tiles_of(page) == [
        *(("2", "vehicles"), ("3.00 m", "nearest: vehicle-1 and vehicle-2")),
        ("20.0 s", "when they were nearest"),
    ]


def test_the_film_of_a_flight_lasts_as_long_as_its_rounds_or_as_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class SeenError(Exception):
        """What the film was asked for; the rest of a page takes a second."""

    def seen(_: object, spans_s: object) -> None:
        raise SeenError(spans_s)

    def spans(path: Path) -> Any:
        with pytest.raises(SeenError) as found:
            report_html(load_run(path))
        return found.value.args[0]

    monkeypatch.setattr(report_page, "film", seen)
    (two := tmp_path / "two").mkdir()
    fly(two, rounds=2)
    assert spans(two) == {1: pytest.approx((15.4, 71.5)), 2: pytest.approx((71.5, 115.9))}
    (one := tmp_path / "one").mkdir()
    last_s = fly(one, rounds=1).samples[-1].t_ns / 1e9
    assert spans(one) == {0: (0.0, last_s)}
    log = head_on(tmp_path) / "vehicle-1" / "flight-0001.mcap"
    assert spans(log) == {0: pytest.approx((0.0, 49.9), abs=0.2)}


def test_it_shows_the_wind_and_what_the_estimator_refused(page: str) -> None:
    assert page.count("<h3>Wind at the aircraft</h3>") == 1
    for sensor, refused in (("GNSS position", 0), ("Baro", 0), ("Heading", 1)):
        start = page.index(f"<h3>{sensor} against the estimate</h3>")
        assert f"{refused} refused</p>" in page[start : start + 300]
        spec = charts(page)[f"{sensor} against the estimate"]
        marked = [
            row
            for table in spec["datasets"].values()
            for row in zip(table.get("series", ()), table.get("x", ()), strict=False)
            if row[0] == "refused"
        ]
        assert marked == [("refused", 30.0)] * refused
    assert "GNSS velocity against" not in page  # nothing of it in this log


def test_a_bare_log_gets_a_report_too(tmp_path: Path) -> None:
    made = fly(tmp_path, rounds=1)
    written = write_report(made.log)
    assert written == tmp_path / "flight.html"
    assert "Planned and flown" in written.read_text(encoding="utf-8")


def test_what_cannot_be_reported_is_refused(tmp_path: Path) -> None:
    world = devices(np.random.default_rng(1))
    with FlightLog(tmp_path / "e.mcap", area=AREA, devices=world):
        pass
    with pytest.raises(InputError, match="no round was finished"):
        write_report(tmp_path / "e.mcap")
    made = fly(tmp_path, rounds=1)
    with pytest.raises(InputError, match="cannot write"):
        write_report(made.log, tmp_path / "no" / "r.html")
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(InputError, match=r"summary\.json: not valid JSON"):
        write_report(tmp_path)
