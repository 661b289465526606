"""Every kind of page in a real browser, on a phone, on a desk and on paper."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from browser import Browser, browser, words_of
from made_up_logs import write_ulog
from one_world import head_on
from patience import until
from small_runs import LOW, SETTINGS, last_counts
from synthetic_flight import fly
from test_sweep_report import SEEDS, result, state

from mission.cli import call
from mission.report.page import write_report
from mission.report.sweep_page import sweep_html
from mission.sweep.grid import Point

PHONE, DESK = 390, 1280

WORLD = (
    *("quickstart", "--set", "area.size_m=[300, 200]", "--set", "area.home_m=[20, 20]", "--set"),
    "area.buildings=[{polygon_m=[[90, 90], [110, 90], [110, 110], [90, 110]], height_m=40}]",
)
# What is wrong with how a page looks: names of charts, words, elements.
LOOK = """(() => {
  const box = (element) => element.getBoundingClientRect();
  const outside = (at, other, by) => at.left < other.left - by || at.right > other.right + by
    || at.top < other.top - by || at.bottom > other.bottom + by;
  const texts = [...document.querySelectorAll("svg text")].filter((text) => box(text).height > 0);
  const charts = [...document.querySelectorAll(".chart")];
  return {
    blank: charts.filter((chart) => !chart.querySelector("svg .role-axis")).map((e) => e.ariaLabel),
    cut: texts.filter((text) => {
      const svg = text.ownerSVGElement, frame = svg.querySelector(".background");
      return outside(box(text), box(svg.closest(".card")), 0)
        || text.closest("[clip-path]") && outside(box(text), box(frame), 1);
    }).map((text) => text.textContent),
    small: texts.filter((text) => box(text).height < 8).map((text) => text.textContent),
    wide: [document.documentElement, ...document.querySelectorAll("h1, h2, h3, p, .tile, .card")]
      .filter((e) => e.scrollWidth > e.clientWidth && !e.matches(".scroll"))
      .map((e) => e.outerHTML.slice(0, 80)),
    alone: [...document.querySelectorAll(".tiles, .cards")].filter((grid) => {
      const last = grid.lastElementChild;
      const beside = [...grid.children].filter((e) => box(e).top === box(last).top);
      return beside.length === 1 && grid.childElementCount > 1 && grid.clientWidth > 500
        && last.style.gridColumn !== "1 / -1";
    }).map((grid) => grid.className),
  };
})()"""
FINE: dict[str, list[str]] = {"blank": [], "cut": [], "small": [], "wide": [], "alone": []}
# The columns of each table that need no scrolling.
# Of each table the columns that are in sight, and all.
SEEN = """[...document.querySelectorAll(".scroll")].map((card) => {
  const edge = card.getBoundingClientRect().right, heads = [...card.querySelectorAll("th")];
  return [heads.filter((head) => head.getBoundingClientRect().right <= edge), heads]
    .map((some) => some.map((head) => head.textContent.replace(/\\s/g, " ")));
})"""
WORDS = """[...document.querySelectorAll("h1, h2, h3, .tile b, .tile span, td, th, svg text")]
  .filter((e) => e.getBoundingClientRect().height > 0 && getComputedStyle(e).opacity !== "0")
  .flatMap((e) => [...e.childNodes].flatMap((part) => part.textContent.split(/\\s+/)))
  .filter((word) => word)"""


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as one:
        yield one


def run(folder: Path, *, serves: bool = True) -> Path:
    fly(folder, rounds=3, serves=serves)
    summary = {"status": "finished", "name": "r", "seed": 7, "wall_s": {"fly": 3.0, "learn": 5.0}}
    (folder / "summary.json").write_text(json.dumps(summary))
    return write_report(folder)


def nobody_served(folder: Path) -> Path:
    return run(folder, serves=False)


def plan_flown(folder: Path) -> Path:
    """A real one, in still air: without a spike."""
    items = [
        {
            "type": "SimpleItem", "command": command, "frame": 3, "autoContinue": True,
            "params": [0, 0, 0, None, 46.948, lon, 20],
        }
        for command, lon in ((22, 7.4474), (16, 7.4482), (16, 7.4490))
    ]  # fmt: skip
    home = [46.948, 7.4474, 550.0]
    mission = {"version": 2, "items": items, "plannedHomePosition": home, "cruiseSpeed": 10}
    plan = folder / "p.plan"
    plan.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}))
    assert call(["fly", str(plan), "--out", str(folder / "out"), "--quiet"]) == 0
    return folder / "out" / "report.html"


def foreign_log(folder: Path) -> Path:
    return write_report(write_ulog(folder / "f.ulg"))


def of_one_world(folder: Path) -> Path:
    return write_report(head_on(folder / "two"))


def sweep(folder: Path) -> Path:
    page = folder / "sweep.html"
    page.write_text(sweep_html(state()), encoding="utf-8")
    return page


def sweep_of_settings(folder: Path) -> Path:
    """Rows with long names."""
    points = [
        Point(name, seed, (("channel.extra_gain_db", gain), ("mission.path_budget_m", 800.0)))
        for name in ("cov", "no_cov")
        for gain in (0.0, -12.5)
        for seed in SEEDS
    ]
    results = tuple(replace(result("cov", point.seed), point=point) for point in points)
    page = folder / "settings.html"
    page.write_text(sweep_html(replace(state(), results=results)), encoding="utf-8")
    return page


def on_a_radio_map(folder: Path) -> Path:
    """A real run, which learns what it believes of the radio."""
    told = (
        "radio.truth=buildings",
        "radio.belief=learned",
        "mission.rounds=2",
        "radio.tx_power_dbm=0",
    )
    words = [*WORLD, *SETTINGS, *LOW, *(word for key in told for word in ("--set", key))]
    assert call(["run", *last_counts(*words), "--out", str(folder / "out"), "--quiet"]) == 0
    return folder / "out" / "report.html"


def radio_map_drawn(folder: Path) -> Path:
    figure = folder / "w.svg"
    words = ("--out", str(folder / "w.nc"), "--figure", str(figure), "--cell", "10")
    assert call(["radio-map", *WORLD, *words]) == 0
    return figure


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.parametrize(
    ("made", "charts"),
    [
        (run, 15), (nobody_served, 14), (plan_flown, 27), (foreign_log, 5),
        (of_one_world, 4), (sweep, 16), (sweep_of_settings, 16),
        (on_a_radio_map, 19), (radio_map_drawn, 0),
    ],
)  # fmt: skip
def test_it_can_be_read(
    chromium: Browser, tmp_path: Path, made: Callable[[Path], Path], charts: int
) -> None:
    """All charts drawn, nothing in the console, no text cut off; on paper every word."""
    page = made(tmp_path)
    for width in (PHONE, DESK):
        chromium.open(page, width)
        assert chromium.told == []
        assert chromium.run("document.querySelectorAll('.chart').length") == charts
        if page.suffix == ".html":
            assert chromium.run(LOOK) == FINE, width
            seen = chromium.run(SEEN)
            if width == DESK:
                assert all(some == every for some, every in seen)
            elif made is sweep:
                assert [some for some, _ in seen][:2] == [
                    ["strategy", "seeds", "a %", "b %", "CoV a", "CoV b", "Jain"],
                    ["cov against", "community", "points", "relative", "seeds better"],
                ]
    words = chromium.run(WORDS)
    printed = words_of(chromium.printed())
    assert max(right for _, right in printed) < 0.97
    assert set(words) - {word for word, _ in printed} == set()


@pytest.mark.slow
@pytest.mark.real
def test_slider_buttons_and_box_do_what_they_say(chromium: Browser, tmp_path: Path) -> None:
    """The next round is shown, then also the flown paths of all."""
    chromium.open(run(tmp_path), DESK)
    flown = """[...document.querySelectorAll("[aria-label='Planned and flown'] path")]
      .filter((e) => e.getAttribute("stroke") === "var(--flown)"
        && e.getAttribute("stroke-width") === "1.6" && e.getBBox().width > 40).length"""
    until(lambda: chromium.run(flown) == 1)
    chromium.run("document.getElementById('next').click()")
    assert chromium.run("document.getElementById('round-label').textContent") == "Round 2"
    shown = """[...document.querySelectorAll("div[data-round]")]
      .filter((e) => getComputedStyle(e).display !== "none").map((e) => e.dataset.round)"""
    assert chromium.run(shown) == ["2"]
    chromium.run("document.getElementById('everything').click()")
    until(lambda: chromium.run(flown) == 3)
    assert chromium.told == []


@pytest.mark.slow
@pytest.mark.real
def test_the_map_is_played(chromium: Browser, tmp_path: Path) -> None:
    """The slider of time, by keyboard too, leads the aircraft along the path that is drawn, and
    tells who is heard when; a round has its own times; on paper nothing of it is left."""
    made = fly(tmp_path, rounds=3)
    chromium.open(write_report(tmp_path), PHONE)
    places = """(() => {
      const numbers = (text) => text.match(/-?[\\d.]+/g).map(Number);
      const now = [...document.querySelectorAll(".now_marks path")]
        .map((e) => numbers(e.getAttribute("transform")).slice(0, 2));
      const flown = [...document.querySelectorAll(".chart path")].find((e) =>
        e.getAttribute("stroke") === "var(--flown)" && e.getBBox().width > 40);
      const along = numbers(flown.getAttribute("d"));
      return [now, [along.slice(0, 2), along.slice(-2)]];
    })()"""
    at = """((t) => { const clock = document.getElementById("clock"); clock.value = t;
      clock.dispatchEvent(new Event("input")); })"""
    said = "document.getElementById('now').textContent"

    def is_at(end: int) -> bool:
        now, ends = chromium.run(places)
        return len(now) > 0 and now[0] == pytest.approx(ends[end], abs=1.5)

    first, second = made.rounds[:2]
    until(lambda: is_at(0))
    assert chromium.run(said) == f"{first.start_t_s:.1f} s · 60 m high"
    chromium.run(f"{at}({first.start_t_s + first.duration_s})")
    until(lambda: is_at(1))
    sent = made.uplinks[0]
    chromium.run(f"{at}({math.ceil(sent.slot_t_s)})")
    word = "heard" if sent.delivered else "lost"
    assert f" · device {sent.device} {word}" in chromium.run(said)
    until(lambda: len(chromium.run(places)[0]) == 2)
    chromium.run("document.getElementById('next').click()")
    assert chromium.run(said).startswith(f"{second.start_t_s:.1f} s · ")
    chromium.run("document.getElementById('play').click()")
    until(lambda: float(chromium.run(said).split()[0]) > second.start_t_s + 1.0)
    chromium.run("document.getElementById('play').click()")
    assert chromium.run("document.getElementById('play').ariaLabel") == "play"
    before = float(chromium.run("document.getElementById('clock').value"))
    chromium.run("document.getElementById('clock').focus()")
    chromium.press("ArrowRight", 39)
    assert float(chromium.run("document.getElementById('clock').value")) == before + 1.0
    assert {"▶", "heard"}.isdisjoint(word for word, _ in words_of(chromium.printed()))
    assert chromium.told == []
