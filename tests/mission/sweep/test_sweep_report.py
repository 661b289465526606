"""A sweep's report: complete by itself, right in its numbers, and working in a real browser."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from patience import HANG_S

from mission.report.sweep_page import sweep_html
from mission.sweep.grid import Point
from mission.sweep.results import Row, RunResult
from mission.sweep.state import Missing, SweepState

CHROMIUM = shutil.which("chromium")
SEEDS = (1, 2, 3)
# Final accuracy per seed; flying strategies first. Of "b" there are no runs of ideal.
FINAL = {
    ("cov", "a"): (0.44, 0.46, 0.42),
    ("cov", "b"): (0.90, 0.92, 0.94),
    ("no_cov", "a"): (0.40, 0.40, 0.40),
    ("no_cov", "b"): (0.91, 0.92, 0.93),
    ("ideal", "a"): (0.50, 0.52, 0.51),
}
ROUNDS = 8


def result(strategy: str, seed: int) -> RunResult:
    flies = strategy != "ideal"
    finals = {n: FINAL[strategy, n][seed - 1] for n in ("a", "b") if (strategy, n) in FINAL}
    point = Point(strategy, seed, ())
    rows: list[Row] = []
    for k in range(1, ROUNDS + 1):
        row: Row = {
            **point.keys,
            "round": k,
            "budget_used_m": 800.0 * k,
            "end_t_s": 60.0 * k * flies,
        }
        row |= {"participation": 0.75, "jain_communities": 0.9}
        row |= {"plan_per": 0.1, "true_per": 0.11} if flies else {}
        row |= {f"accuracy_{name}": value * k / ROUNDS for name, value in finals.items()}
        row |= {f"cov_{name}": 1.0 / k for name in finals}
        rows.append(row)
    summary: Row = {
        **point.keys, "run": f"{strategy}-seed{seed}", "rounds": ROUNDS, "flown_m": 6400.0 * flies,
        "simulated_s": 480.0 * flies, "scheduled": 40, "delivered": 30, "delivered_share": 0.75,
        "participation": 0.75, "plan_per": 0.1 if flies else float("nan"),
        "true_per": 0.11 if flies else float("nan"), "final_jain_communities": 0.9,
        **{f"final_accuracy_{name}": value for name, value in finals.items()},
        **{f"final_cov_{name}": 0.2 for name in finals},
        **{f"participation_{name}": 0.75 for name in finals},
    }  # fmt: skip
    return RunResult(point, summary, tuple(rows), {"fly": 60.0, "total": 120.0})


def state(*, missing: tuple[str, ...] = ()) -> SweepState:
    names = [name for name in ("cov", "no_cov", "ideal") if name not in missing]
    return SweepState(
        {"name": "a <b> & c"},
        tuple(result(name, seed) for name in names for seed in SEEDS),
        tuple(Missing(f"{name}-seed{k}", name, "not begun") for name in missing for k in SEEDS),
    )


@pytest.fixture(scope="module")
def page() -> str:
    return sweep_html(state())


def row(page: str, title: str, first: str) -> list[str]:
    start = page.index(f"<h2>{title}</h2>")
    table = page[start : page.index("</table>", start)]
    for line in re.findall(r"<tr>(.*?)</tr>", table):
        cells = re.findall(r"<td[^>]*>(.*?)</td>", line)
        if cells and cells[0] == first:
            return cells
    raise AssertionError(first)


def test_it_is_one_file_of_sound_drawings(page: str) -> None:
    assert not re.search(r"(src|href)=|url\(|@import|/tmp", page)
    drawings = re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL)
    # Ends, gains, accuracy, PER, participation, fairness.
    assert len(drawings) == 2 + 2 + 2 * 3 + 2 + 1 + 3
    for drawing in drawings:
        ET.fromstring(drawing)
    assert "nan" not in "".join(drawings)
    assert "a &lt;b&gt; &amp; c" in page
    assert ">finished</span>" in page


def test_the_tables_hold_what_is_worked_out_by_hand(page: str) -> None:
    # t(0.975, 2) = 4.3027; "a": s = 2 points, so 4.3027 * 2 / sqrt(3) = 4.97.
    assert row(page, "Outcome", "cov") == [
        "cov", "3", "44.0 ± 5.0", "92.0 ± 5.0", "0.20", "0.20", "0.900", "75.0 ± 0.0",
        "75.0 ± 0.0", "75.0 ± 0.0", "0.100", "0.110", "8", "6.4",
    ]  # fmt: skip
    assert row(page, "Outcome", "ideal")[2:6] == ["51.0 ± 2.5", "-", "0.20", "-"]
    assert row(page, "Seed by seed", "no_cov")[1:] == ["a", "+4.0 ± 5.0", "+10.0 %", "3 of 3"]
    assert row(page, "Every run", "ideal-seed2") == [
        "ideal-seed2", "2", "52.0", "-", "8", "0.0", "30/40", "0.0", "2.0",
    ]  # fmt: skip
    assert "<b>92.3 %</b><span>best flown, b: no_cov</span>" not in page
    assert "<b>44.0 %</b><span>best flown, a: cov</span>" in page


def test_bands_are_the_intervals(page: str) -> None:
    """The last point of the first chart's first band is the interval of the final accuracy."""
    start = page.index("<h3>a: validation accuracy (%)</h3>")
    chart = page[start : page.index("</svg>", start)]
    grid = {
        float(label): float(y) - 4
        for y, label in re.findall(r'y="([\d.]+)" text-anchor="end">([\d.]+)<', chart)
    }
    (low_v, low_y), (high_v, high_y) = min(grid.items()), max(grid.items())
    first = re.search(r'<path d="M([^"]*)Z" fill="#0072B2"', chart)
    assert first
    points = np.array([p.split() for p in first[1].split("L")], dtype=float)
    values = low_v + (points[:, 1] - low_y) * (high_v - low_v) / (high_y - low_y)
    half = 4.3027 * 2.0 / np.sqrt(3)
    np.testing.assert_allclose(
        values[ROUNDS - 1 : ROUNDS + 1], [44.0 + half, 44.0 - half], atol=0.2
    )


def test_bands_end_where_the_quantity_does(page: str) -> None:
    """b's interval reaches over 100 % (94 + 5); no band or axis does."""
    start = page.index("<h3>b: validation accuracy (%)</h3>")
    chart = page[start : page.index("</svg>", start)]
    labels = [float(v) for v in re.findall(r'text-anchor="end">([\d.]+)<', chart)]
    assert max(labels) == 100.0
    top = min(float(y) for y in re.findall(r"[ML][\d.]+ ([\d.]+)", chart))
    assert top >= 12.0  # where the plot begins


def test_a_sweep_that_goes_on_says_how_far_it_is_and_what_is_missing() -> None:
    text = sweep_html(state(missing=("no_cov", "ideal")))
    assert ">3 of 9 runs</span>" in text
    assert "What cov gains" not in text
    assert row(text, "Not done", "no_cov-seed2") == ["no_cov-seed2", "not begun"]
    assert "Not done" not in sweep_html(state())


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium in the PATH")
@pytest.mark.parametrize("width", [390, 1280])
def test_it_works_in_a_browser(tmp_path: Path, page: str, width: int) -> None:
    """Nothing sticks out, all text can be read, and the console stays empty."""
    probe = """<script>
      document.documentElement.dataset.result = JSON.stringify({
        overflow: document.documentElement.scrollWidth - window.innerWidth,
        text: Math.min(...[...document.querySelectorAll("svg text")]
          .map((e) => e.getBoundingClientRect().height).filter((h) => h > 0)),
      });
    </script></body>"""
    html = tmp_path / "r.html"
    html.write_text(page.replace("</body>", probe), encoding="utf-8")
    done = subprocess.run(
        [
            CHROMIUM or "", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            "--disable-background-networking", "--no-first-run", "--enable-logging=stderr",
            f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},1500",
            "--dump-dom", html.as_uri(),
        ],
        check=True, capture_output=True, text=True, timeout=HANG_S,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr
    found = re.search(r'data-result="([^"]*)"', done.stdout)
    assert found
    shown = json.loads(found[1].replace("&quot;", '"'))
    assert shown["overflow"] <= 0
    assert shown["text"] >= 8.0
