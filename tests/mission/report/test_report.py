"""The report: complete by itself, well formed, and right in what it says."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from described import charts, rows
from synthetic_flight import AREA, devices, fly

from mission.base.errors import InputError
from mission.log.writer import FlightLog
from mission.report.page import write_report

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
