"""The report: complete by itself, well formed, and working in a real browser."""

import itertools
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from patience import HANG_S
from synthetic_flight import AREA, devices, fly

from mission.analysis.compare import compare_run
from mission.analysis.load import load_run
from mission.base.errors import InputError
from mission.log.write.writer import FlightLog
from mission.report import svg
from mission.report.charts import radio_cards
from mission.report.maps import thin
from mission.report.page import write_report
from mission.report.svg import ticks

CHROMIUM = shutil.which("chromium")
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


def test_it_is_one_well_formed_file_that_fetches_nothing(page: str) -> None:
    parser = Balance()
    parser.feed(page)
    assert parser.open == []
    assert parser.links == []
    assert "url(" not in page
    assert "@import" not in page
    assert "default-src 'none'" in page
    drawings = re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL)
    assert len(drawings) > 8
    for drawing in drawings:
        ET.fromstring(drawing)
    assert "nan" not in "".join(drawings)


def test_it_says_what_the_run_was(page: str) -> None:
    assert "a &lt;b&gt; &amp; &quot;c&quot;" in page
    assert "strategy cov" in page
    assert "seed 7" in page
    assert "4.5 m/s, no turbulence, no gusts" in page
    assert "Wall time: 8.5 s" in page
    assert len(re.findall(r'<g class="round( on)?" data-round=', page)) == 3
    assert "/tmp" not in page  # nothing of the machine that wrote it


def test_it_shows_the_wind_and_what_the_estimator_refused(page: str) -> None:
    assert page.count("<h3>Wind at the aircraft</h3>") == 1
    for sensor, refused in (("GNSS position", 0), ("Baro", 0), ("Heading", 1)):
        start = page.index(f"<h3>{sensor} against the estimate</h3>")
        card = page[start : page.index("</section>", start)]
        assert f"still believed; {refused} refused" in card
        assert card.count("<title>refused at 30.0 s") == refused
    assert "GNSS velocity against" not in page  # nothing of it in this log


def test_every_error_rate_lies_on_its_chart(folder: Path) -> None:
    run = load_run(folder)
    comparison = compare_run(run)
    devices = tuple(
        replace(device, plan_per=0.9, est_per=0.5, true_per=0.1) for device in comparison.devices
    )
    _, card, _ = radio_cards(run.data, replace(comparison, devices=devices))
    across = [float(cx) for cx in re.findall(r'<circle cx="([\d.]+)"', card)]
    assert len(set(across)) == 3
    assert max(across) <= svg.WIDTH - svg.RIGHT


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
    with pytest.raises(InputError, match=r"summary\.json: cannot be read"):
        write_report(tmp_path)


@pytest.mark.real
@pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium in the PATH")
@pytest.mark.parametrize("width", [390, 1280])
def test_it_works_in_a_browser(tmp_path: Path, page: str, width: int) -> None:
    """Slider, buttons and check box do what they say; nothing sticks out; no console message."""
    probe = """<script>
      document.getElementById("next").click();
      document.getElementById("all").click();
      const seen = (s) => [...document.querySelectorAll(s)]
        .filter((e) => getComputedStyle(e).display !== "none").map((e) => e.dataset.round);
      document.documentElement.dataset.result = JSON.stringify({
        label: document.getElementById("round-label").textContent,
        facts: seen(".flight > section > div[data-round]"),
        along: seen(".cards g[data-round]"),
        map: seen("#map .round"),
        paths: [...document.querySelectorAll("#map .flown")]
          .filter((e) => e.getClientRects().length).length,
        overflow: document.documentElement.scrollWidth - window.innerWidth,
        text: Math.min(...[...document.querySelectorAll("svg text")]
          .map((e) => e.getBoundingClientRect().height).filter((h) => h > 0)),
      });
    </script></body>"""
    html, shot = tmp_path / "r.html", tmp_path / "r.png"
    html.write_text(page.replace("</body>", probe), encoding="utf-8")
    done = subprocess.run(
        [
            CHROMIUM or "", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}",
            f"--window-size={width},1500", f"--screenshot={shot}", "--dump-dom", html.as_uri(),
        ],
        check=True, capture_output=True, text=True, timeout=HANG_S,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr
    found = re.search(r'data-result="([^"]*)"', done.stdout)
    assert found
    result = json.loads(found[1].replace("&quot;", '"'))
    assert result["label"] == "Round 2"
    assert result["facts"] == result["along"] == ["2"]
    assert result["map"] == ["1", "2", "3"]  # all flown paths, the chosen round in full
    assert result["paths"] == 3
    assert result["overflow"] <= 0
    assert result["text"] >= 8.0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=2, max_size=60))
def test_thinning_stays_within_its_tolerance(points: list[tuple[float, float]]) -> None:
    path = np.array(points)
    kept = thin(path, 5.0)
    np.testing.assert_array_equal(kept[[0, -1]], path[[0, -1]])
    dense = np.vstack([np.linspace(a, b, 2001) for a, b in itertools.pairwise(kept)])
    for point in path:
        assert np.linalg.norm(dense - point, axis=1).min() < 5.0 + 0.5


def test_a_straight_track_thins_to_its_ends() -> None:
    line = np.column_stack((np.linspace(0, 100, 500), np.zeros(500)))
    assert len(thin(line, 0.1)) == 2


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_and_inside(low: float, span: float) -> None:
    high = low + span
    found = ticks(low, high)
    assert 1 <= len(found) <= 8
    assert all(low - 1e-6 * span <= value <= high + 1e-6 * span for value in found)
