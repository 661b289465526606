"""Where the method wins over two swept settings: cells worked out by hand, and tables alone."""

import gzip
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import reproduction_tables
from described import axes, described, keys, layers, rows
from drawing import drawn
from reproduction_tables import (
    compared,
    gain_map,
    gain_maps,
    luck_rows,
    participation_map,
    seen_in_one_round,
    seen_with_seeds,
)

from mission.base.errors import InputError
from mission.report.sweep_page import sweep_html
from mission.sweep.folder import SweepState, read_sweep
from mission.sweep.grid import Axis, points
from mission.sweep.outcome.figures import sweep_pictures
from mission.sweep.outcome.view import gain_table, paired_gains
from mission.sweep.results import Row, RunResult, with_equals, write_results

AXES = [Axis("mission.steps", (2, 10)), Axis("channel.extra_gain_db", (-7.0, 0.0))]
# Of cov less no_cov by seed: mean 4 and interval 2.48, and mean 1 and interval 4.97.
SURE, OPEN = (0.03, 0.04, 0.05), (-0.01, 0.01, 0.03)
ROUNDS = 12


def results(*, axes: list[Axis] = AXES, longer: int = 0) -> tuple[RunResult, ...]:
    """`longer`: rounds that cov has more; it learns to 0.9 in them."""
    found = []
    for point in points(("cov", "no_cov"), (1, 2, 3), axes):
        cov = point.strategy == "cov"
        ahead = (SURE if point.settings[0][1] == 2 else OPEN)[point.seed - 1] if cov else 0.0
        final = 0.9 if cov and longer else 0.4 + ahead
        rounds = ROUNDS + longer * cov
        rows: tuple[Row, ...] = tuple(
            {**point.keys, "round": k, "budget_used_m": 800.0 * k, "end_t_s": 40.0 * k,
             "participation": 0.5, "plan_per": 0.1, "true_per": 0.1, "jain_communities": 1.0,
             "cov_a": 0.5, "accuracy_a": 0.4 + ahead if k <= ROUNDS else 0.9}
            for k in range(1, rounds + 1)
        )  # fmt: skip
        summary: Row = {
            **point.keys, "run": point.name, "rounds": rounds, "flown_m": 800.0 * rounds,
            "budget_used_m": 800.0 * rounds, "simulated_s": 40.0 * rounds, "scheduled": 6,
            "delivered": 5, "delivered_share": 5 / 6, "participation": 0.5, "plan_per": 0.1,
            "true_per": math.nan, "participation_a": 0.8 if cov else 0.6,
            "final_accuracy_a": final, "final_cov_a": 0.5, "final_jain_communities": 1.0,
        }  # fmt: skip
        found.append(RunResult(point, summary, rows, {"fly": 1.5, "total": 2.0}))
    return tuple(found)


def test_cells_hold_gain_and_interval_and_the_sure_ones_are_bold() -> None:
    assert compared(results()) == ["no_cov"]
    chart = described(gain_map(results(), "no_cov", "a"))
    (rows,) = chart["datasets"].values()
    assert [(r["down"], r["across"], r["words"], r["weight"]) for r in rows] == [
        ("2", "-7.0", "+4.0 ± 2.5", "bold"), ("2", "0.0", "+4.0 ± 2.5", "bold"),
        ("10", "-7.0", "+1.0 ± 5.0", "normal"), ("10", "0.0", "+1.0 ± 5.0", "normal"),
    ]  # fmt: skip
    cell = next(iter(layers(chart)))["encoding"]
    scale = cell["fillOpacity"]["scale"]
    assert scale["domain"] == pytest.approx([0.0, 4.0])  # zero has no colour
    assert cell["y"]["sort"] == ["2", "10"]


def test_axes_are_in_words_and_two_seeds_have_no_interval() -> None:
    chart = described(gain_map(results(), "no_cov", "a"))
    assert axes(chart) == {"steps", "extra_gain_db"}
    assert chart["title"]["subtitle"] == "bold: its 95 % interval leaves zero out"
    two = [item for item in results() if item.point.seed < 3]
    assert "subtitle" not in described(gain_map(two, "no_cov", "a"))["title"]


def test_a_picture_of_an_own_strategy_has_a_name_for_every_file_system() -> None:
    own = [
        replace(item, point=replace(item.point, strategy="examples.staleness:make"))
        if item.point.strategy == "no_cov"
        else item
        for item in results()
    ]
    assert "gain-map-examples.staleness-make.png" in gain_maps("s", own)


@pytest.mark.parametrize(("gains", "charts"), [((0,), 1), ((0, 3), 4)])
def test_many_groups_have_a_chart_for_each_setting(gains: tuple[int, ...], charts: int) -> None:
    swept = [AXES[0], Axis("channel.extra_gain_db", gains)]
    spec = described(sweep_pictures("s", results(axes=swept))["accuracy-rounds.png"])
    blocks = [block.get("concat", [block]) for block in spec["vconcat"]]
    titles = [chart["title"]["text"] for block in blocks for chart in block]
    assert len(titles) == charts
    if charts > 1:
        assert keys(spec)["color"] == ["cov", "no_cov"]
        assert titles[1] == "a: accuracy, steps = 2, extra_gain_db = 3"
        assert {row["series"] for row in rows(spec, "series")} == {"cov", "no_cov"}


def test_participation_stands_beside_it() -> None:
    (rows,) = described(participation_map(results(), "no_cov", "a"))["datasets"].values()
    assert {row["words"] for row in rows} == {"60 → 80"}


def test_a_setting_that_only_one_of_them_has_flown_has_no_cell() -> None:
    some = [r for r in results() if r.point.strategy == "cov" or r.point.settings[0][1] == 2]
    for chart in (gain_map, participation_map):
        (rows,) = described(chart(some, "no_cov", "a"))["datasets"].values()
        assert [row["down"] for row in rows] == ["2", "2"]


def test_it_is_drawn_of_two_settings_only() -> None:
    assert "gain-map-no_cov.png" in gain_maps("s", results())
    assert compared(results(axes=AXES[:1])) == []


def test_curves_that_nobody_could_tell_apart_are_left_out() -> None:
    many = results(axes=[AXES[0], Axis("channel.extra_gain_db", (0, 1, 2, 3))])
    assert set(sweep_pictures("s", many)) == {"final.png", "gains.png"}
    assert "Accuracy by round" not in sweep_html(SweepState({"name": "s"}, many, ()))


def test_rounds_that_only_one_run_could_pay_for_are_told_apart() -> None:
    heads, rows = gain_table(paired_gains(results(longer=20)))
    assert heads[-2:] == ["points at equal rounds", "points at equal metres"]
    sure, open_ = ("+50.0 ± 0.0", "+4.0 ± 2.5"), ("+50.0 ± 0.0", "+1.0 ± 5.0")
    assert [(row[3], row[-1]) for row in rows] == [sure, sure, open_, open_]
    heads, _ = gain_table(paired_gains(results()))
    assert heads[-1] == "seeds better"


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    """What is left of a sweep whose runs' folders are gone."""
    axes = {"strategy": ["cov", "no_cov"], "seed": [1, 2, 3]}
    axes |= {axis.key: list(axis.values) for axis in AXES}
    manifest = {"format": 1, "config": {"name": "s"}, "data_dir": None, "axes": axes}
    (tmp_path / "sweep.json").write_text(json.dumps(manifest))
    write_results(tmp_path, results(longer=3))
    return tmp_path


def test_the_tables_alone_are_a_sweep(tables: Path) -> None:
    for packed in ([], ["rounds"], ["runs", "timings"]):
        for name in packed:
            table = tables / f"{name}.csv"
            table.with_name(f"{name}.csv.gz").write_bytes(gzip.compress(table.read_bytes()))
            table.unlink()
        state = read_sweep(tables)
        assert not state.missing
        assert [r.wall_s for r in state.results] == [r.wall_s for r in results()]
        assert [r.rounds for r in state.results] == [r.rounds for r in results(longer=3)]
        for found, written in zip(state.results, results(longer=3), strict=True):
            assert found.point == written.point
            assert found.summary == pytest.approx(written.summary, nan_ok=True)


def test_tables_of_a_sweep_that_is_not_over_say_so(tables: Path) -> None:
    part = results(longer=3)[:-1]
    write_results(tables, part)
    state = read_sweep(tables)
    assert [item.why for item in state.missing] == ["not in the tables"]
    assert [run.equal for run in state.results] == [run.equal for run in with_equals(part)]


def test_the_script_makes_its_figures_and_tables_anew(
    tables: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    figures = tmp_path / "figures"
    monkeypatch.setattr("sys.argv", ["tables", str(tables), "--figures", str(figures)])
    monkeypatch.setattr(reproduction_tables, "draw_sweep", lambda *_: None)  # tested elsewhere
    with drawn():
        reproduction_tables.main()
    assert (figures / "gain-map-no_cov.png").stat().st_size > 5000  # more than a dot
    assert "| no_cov | steps = 2, extra_gain_db = -7.0 | a |" in capsys.readouterr().out


def test_damaged_tables_are_named(tables: Path) -> None:
    whole = (tables / "rounds.csv").read_text()
    (tables / "rounds.csv").write_text("\n".join(whole.splitlines()[:-2]) + "\n")
    with pytest.raises(InputError, match=r"runs.csv, rounds.csv and timings.csv are not of the sa"):
        read_sweep(tables)
    (tables / "rounds.csv").unlink()
    with pytest.raises(InputError, match=r"rounds.csv: cannot read the table: .*No such file"):
        read_sweep(tables)
    (tables / "rounds.csv.gz").write_bytes(gzip.compress(whole.encode())[:-9])
    with pytest.raises(InputError, match=r"rounds.csv.gz: cannot read the table"):
        read_sweep(tables)
    (tables / "rounds.csv").write_text(whole)
    runs = (tables / "runs.csv").read_text()
    (tables / "runs.csv").write_text(runs.replace("cov-steps=2", '"cov"-steps=2'))
    with pytest.raises(InputError, match=r"runs.csv: cannot read the table: .*expected after"):
        read_sweep(tables)
    (tables / "runs.csv").write_text(runs.replace("cov-steps=2", "cov-steps=5"))
    with pytest.raises(InputError, match=r"steps=5-extra_gain_db=-7.0-seed1: no run of this sweep"):
        read_sweep(tables)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (
            "runs",
            "no_cov-steps=2-extra_gain_db=-7.0-seed1,12",
            "no_cov-steps=2-extra_gain_db=-7.0-seed1,x",
        ),
        ("timings", ",1.5,", ",soon,"),
        ("timings", ",1.5,", ",1.5,7,"),
    ],
)
def test_cells_that_are_no_numbers_are_damage(tables: Path, name: str, old: str, new: str) -> None:
    path = tables / f"{name}.csv"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match="its tables are damaged"):
        read_sweep(tables)


def test_how_often_a_gain_is_read_off_by_luck() -> None:
    sure, wide = paired_gains(results())[0], paired_gains(results())[2]
    # Relative gains of the seeds: 7.5, 10 and 12.5 % in every round; -2.5, 2.5 and 7.5 %.
    assert [seen_with_seeds(sure, 0.09, n) for n in (1, 2, 3)] == [2 / 3, 2 / 3, 1.0]
    assert seen_in_one_round(sure, 0.09) == pytest.approx(2 / 3)
    assert seen_with_seeds(wide, 0.05, 1) == pytest.approx(1 / 3)
    assert math.isnan(seen_with_seeds(sure, 0.09, 4))
    heads, rows = luck_rows([(sure, sure)], 0.09)
    assert heads[0] == "against"
    assert rows == [["no_cov, steps = 2, extra_gain_db = -7.0", "a", "67 %", "67 %", "100 %"]]


def test_rounds_that_one_run_has_more_are_not_read_off() -> None:
    sure = paired_gains(results(longer=20))[0]
    assert seen_in_one_round(sure, 0.5) == 0.0
    assert seen_with_seeds(sure, 0.5, 1) == 1.0
