"""A sweep's report: complete by itself, and right in its numbers."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from described import axes, charts, described, keys, layers, tables
from drawing import in_svg

from mission.report.sweep_page import sweep_html
from mission.sweep.folder import Missing, SweepState
from mission.sweep.grid import Point
from mission.sweep.outcome.curves import pictures_of
from mission.sweep.outcome.figures import sweep_pictures
from mission.sweep.results import Row, RunResult

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
    page = page.replace("\xa0", " ")
    start = page.index(f"<h2>{title}</h2>")
    table = page[start : page.index("</table>", start)]
    for line in re.findall(r"<tr>(.*?)</tr>", table):
        cells = re.findall(r"<td[^>]*>(.*?)</td>", line)
        if cells and cells[0] == first:
            return cells
    raise AssertionError(first)


def test_it_is_one_file_with_every_chart(page: str) -> None:
    markup = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"(src|href)=|url\(|@import|/tmp", markup)
    # Ends, gains, accuracy, PER, participation, fairness.
    assert page.count('<div class="chart"') == 2 + 2 + 2 * 3 + 2 + 1 + 3
    assert "a &lt;b&gt; &amp; c" in page
    assert ">finished</span>" in page
    assert len(page.encode()) < 2_000_000


@pytest.mark.slow
def test_every_picture_says_which_sweep_and_seeds_it_shows() -> None:
    pictures = sweep_pictures("s", state().results)
    assert set(pictures) == {
        "accuracy-rounds.png", "accuracy-distance.png", "accuracy-time.png", "per.png",
        "participation.png", "fairness.png", "final.png", "gains.png",
    }  # fmt: skip
    for picture in pictures.values():
        spec = described(picture)
        assert spec["title"]["subtitle"].startswith("s · seeds 1, 2, 3")
        assert all(panel["title"]["text"] for panel in spec["vconcat"])
    assert axes(described(pictures["accuracy-time.png"])) == {
        "simulated time (min), mean over seeds", "accuracy (%)",
    }  # fmt: skip
    assert keys(described(pictures["fairness.png"]))["color"] == ["cov", "no_cov", "ideal"]


def by_setting(strategies: int, settings: int) -> tuple[RunResult, ...]:
    """What so many strategies make of so many settings, alike."""
    points = [
        Point(f"s{strategy}", seed, (("channel.extra_gain_db", float(setting)),))
        for strategy in range(strategies)
        for setting in range(settings)
        for seed in SEEDS
    ]
    return tuple(replace(result("cov", point.seed), point=point) for point in points)


@pytest.mark.slow
@pytest.mark.parametrize(("strategies", "settings"), [(3, 3), (4, 12)])
def test_pictures_of_many_settings_fit_a_screen(strategies: int, settings: int) -> None:
    """No chart is alone in its row, where it has others beside it elsewhere."""
    pictures = sweep_pictures("s", by_setting(strategies, settings))
    for name, svg in zip(pictures, in_svg(pictures.values()), strict=True):
        size = re.search(r'width="(\d+)" height="(\d+)"', svg)
        assert size is not None
        assert int(size[2]) < 2.0 * int(size[1]), name
    for picture in pictures.values():
        for block in described(picture)["vconcat"]:
            if "concat" in block:
                assert len(block["concat"]) % block["columns"] != 1


@pytest.mark.slow
def test_each_panel_begins_a_row_and_all_have_one_key() -> None:
    spec = described(sweep_pictures("s", by_setting(2, 7))["accuracy-rounds.png"])
    titles = [[chart["title"]["text"] for chart in block["concat"]] for block in spec["vconcat"]]
    assert titles == [[f"{n}: accuracy, extra_gain_db = {k}.0" for k in range(7)] for n in "ab"]
    for block in (spec, *spec["vconcat"]):
        assert "resolve" not in block, "scales are shared where nothing else is said"
    few = described(sweep_pictures("s", by_setting(3, 1))["accuracy-rounds.png"])
    assert ["layer" in chart for chart in few["vconcat"]] == [True, True]


@pytest.mark.slow
def test_a_community_that_only_some_settings_have_leaves_room() -> None:
    def renamed(row: Row) -> Row:
        return {re.sub("_a$", "_c", key): value for key, value in row.items()}

    results = [
        replace(one, summary=renamed(one.summary), rounds=tuple(map(renamed, one.rounds)))
        if one.point.settings[0][1]
        else one
        for one in by_setting(4, 2)
    ]
    pictures = sweep_pictures("s", results)
    spec = described(pictures["accuracy-rounds.png"])
    panels = [chart for block in spec["vconcat"] for chart in block.get("concat", [block])]
    titles = [chart["title"]["text"].partition(",")[0] for chart in panels]
    assert titles == [f"{name}: accuracy" for name in ("a", "a", "b", "b", "c", "c")]
    assert all(svg.startswith("<svg") for svg in in_svg(pictures.values()))


@pytest.mark.parametrize(("groups", "dotted"), [(7, False), (8, True)])
def test_lines_of_one_colour_differ_in_their_dashes(groups: int, dotted: bool) -> None:
    one = result("cov", 1)
    results = tuple(
        replace(one, point=replace(one.point, strategy=f"s{index}")) for index in range(groups)
    )
    spec = described(sweep_pictures("s", results)["accuracy-rounds.png"])
    assert ("[2, 3]" in json.dumps(spec)) is dotted


def test_a_cut_axis_names_how_far_the_longest_seed_goes_on() -> None:
    short, usual, long = result("cov", 1), result("no_cov", 1), result("no_cov", 2)
    usual = replace(usual, rounds=usual.rounds * 2)
    long = replace(long, rounds=long.rounds * 2 + long.rounds[:1])
    found = next(p for p in pictures_of((short, usual, long)) if p.name == "accuracy-rounds")
    assert found.x_label == f"round (no_cov to {len(long.rounds)})"


@pytest.mark.slow
def test_fewer_than_three_seeds_have_no_interval() -> None:
    two = tuple(item for item in state().results if item.point.seed < 3)
    curves = described(sweep_pictures("s", two)["accuracy-rounds.png"])
    assert "interval" not in curves["title"]["subtitle"]
    assert not any(layer["mark"]["type"] == "area" for layer in layers(curves))
    ends = described(sweep_pictures("s", two)["final.png"])
    assert not any(layer["mark"]["type"] == "rule" for layer in layers(ends))
    page = sweep_html(replace(state(), results=two))
    assert row(page, "Outcome", "cov")[2] == "45.0"
    assert "95 %" not in row(page, "Seed by seed", "no_cov")[2]
    three = described(sweep_pictures("s", state().results)["accuracy-rounds.png"])
    assert any(layer["mark"]["type"] == "area" for layer in layers(three))


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
    assert "<b>44.0 ± 5.0 %</b><span>highest mean (ideal apart), a: cov</span>" in page
    assert "flown, a" not in page


def test_bands_are_the_intervals_as_far_as_the_quantity_goes(page: str) -> None:
    """The last is that of the final accuracy; none reaches over 100 %, nor does an axis."""
    half = 4.3027 * 2.0 / np.sqrt(3)
    ends = [
        (band[-1]["low"], band[-1]["high"])
        for band in tables(charts(page)["a: accuracy"], "low", "high")
    ]
    assert pytest.approx((44.0 - half, 44.0 + half), rel=1e-4) in ends
    spec = charts(page)["b: accuracy"]
    bands = tables(spec, "low", "high")
    assert max(row["high"] for band in bands for row in band) <= 100.0
    line = next(layer for layer in layers(spec) if layer["mark"]["type"] == "line")
    assert line["encoding"]["y"]["scale"]["domain"][1] <= 100.0


def test_a_sweep_that_goes_on_says_how_far_it_is_and_what_is_missing() -> None:
    text = sweep_html(state(missing=("no_cov", "ideal")))
    assert ">3 of 9 runs</span>" in text
    assert "What cov gains" not in text
    assert row(text, "Not done", "no_cov-seed2") == ["no_cov-seed2", "not begun"]
    assert "Not done" not in sweep_html(state())


def one(strategy: str, seed: int, wall_s: dict[str, float], **numbers: float) -> RunResult:
    """A run of 8 rounds with numbers of its own."""
    made = result(strategy, seed)
    return replace(made, summary={**made.summary, **numbers}, wall_s=wall_s)


def tiles(page: str) -> list[tuple[str, str]]:
    return re.findall(
        r'<div class="tile"><b>(.*?)</b><span>(.*?)</span>', page.replace("&#39;", "'")
    )


def test_tiles_are_sums_in_kilometres_and_hours() -> None:
    runs = (
        one("cov", 1, {"fly": 10.0, "total": 1.8e6}, flown_m=12.3e6, simulated_s=4.5e6),
        one("cov", 2, {"fly": 20.0}, flown_m=8.2e6, simulated_s=1e6),
        one("no_cov", 1, {"fly": 5.0, "total": 1.08e6}, flown_m=180.0, simulated_s=1.7e6),
    )
    page = sweep_html(SweepState({"name": "n"}, runs, ()))
    assert tiles(page) == [
        ("3", "runs"),
        ("45.0 %", "highest mean, a: cov"),  # of 44 and 46
        ("91.0 %", "highest mean, b: cov"),  # of 90 and 92, as no_cov, which comes later
        ("20500.2 km", "of path, all rounds"),
        ("2000.0 h", "simulated"),
        ("800.00 h", "of one core's wall time"),
    ]
    assert '<p class="sub">sweep · 2 strategies · 2 seeds</p>' in page
    cells = row(page, "Every run", "cov-seed1")
    assert cells[-5:] == ["8", "12300.0", "30/40", "75000.0", "30000.0"]
    assert row(page, "Every run", "no_cov-seed1")[1:] == [
        *("1", "40.0", "91.0", "8", "0.2", "30/40", "28333.3", "18000.0"),
    ]  # fmt: skip
    # Two of cov, one of no_cov: means without an interval.
    assert row(page, "Outcome", "cov")[:4] == ["cov", "2", "45.0", "91.0"]
    assert row(page, "Outcome", "cov")[-2:] == ["8", "10250.0"]
    alone = sweep_html(SweepState({"name": "n"}, runs[2:], ()))
    assert tiles(alone)[:2] == [("1", "run"), ("40.0 %", "highest mean, a: no_cov")]
    assert '<p class="sub">sweep · 1 strategy · 1 seed</p>' in alone
    assert "What cov gains" not in alone
    swept = sweep_html(SweepState({"name": "n"}, by_setting(2, 3), ()))
    assert '<p class="sub">sweep · 2 strategies · 3 settings · 3 seeds</p>' in swept
    only = sweep_html(SweepState({"name": "n"}, (result("ideal", 1),), ()))
    assert [what for _, what in tiles(only)] == [
        *("run", "of path, all rounds", "simulated", "of one core's wall time"),
    ]  # fmt: skip
