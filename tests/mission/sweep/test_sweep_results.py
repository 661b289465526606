"""Statistics, sampling and progress of a sweep, against closed forms and hand-made runs."""

import json
import math
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from rich.console import Console
from scipy.special import stdtrit

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder
from mission.base.tables import csv_lines
from mission.config.loading import builtin_config
from mission.log.records import UNKNOWN_ROUND, DeviceRecord, UplinkRecord, flat
from mission.run.budget import rounds_paid_for
from mission.scenario.limits import budget_of, foreseen_performance
from mission.sweep.execute.cluster import RayEngine
from mission.sweep.grid import Point, make_grid
from mission.sweep.outcome.curves import DISTANCE, ROUNDS, band, interval, pictures_of
from mission.sweep.outcome.view import final_table, over_seeds, percent
from mission.sweep.results import (
    Row,
    RunResult,
    at_equal,
    communities_of,
    jain,
    read_run,
    with_equals,
    write_results,
)


@pytest.mark.parametrize("count", [3, 4, 10])
def test_the_interval_is_students(count: int) -> None:
    values = np.random.default_rng(count).normal(0.4, 0.05, count)
    found = interval(list(values))
    error = values.std(ddof=1) / np.sqrt(count)
    low, high = values.mean() + stdtrit(count - 1, [0.025, 0.975]) * error
    assert found.mean - found.half == pytest.approx(low, rel=1e-12)
    assert found.mean + found.half == pytest.approx(high, rel=1e-12)


def test_one_or_two_runs_have_no_interval() -> None:
    found = interval([0.5])
    assert found.mean == 0.5
    assert math.isnan(found.half)
    assert percent(found) == "50.0"
    assert percent(interval([0.4, 0.6])) == "50.0"  # not ± 127.1: t(0.975, 1) = 12.706
    assert percent(interval([])) == "-"


def test_the_interval_covers_as_often_as_it_says() -> None:
    draws = np.random.default_rng(4).normal(1.0, 2.0, (3, 20_000))
    mean, half = band(draws)
    assert np.mean(np.abs(mean - 1.0) <= half) == pytest.approx(0.95, abs=0.005)


@pytest.mark.parametrize(
    ("values", "index"),
    [([0.5, 0.5], 1.0), ([1.0, 0.0], 0.5), ([0.0, 0.0], 1.0), ([1.0, 2.0, 3.0], 36 / 42)],
)
def test_jains_index(values: list[float], index: float) -> None:
    assert jain(values) == pytest.approx(index)


def result(seed: int, budget_m: list[float], accuracy: list[float]) -> RunResult:
    rows: tuple[Row, ...] = tuple(
        {"seed": seed, "round": k + 1, "budget_used_m": b, "accuracy_a": a}
        for k, (b, a) in enumerate(zip(budget_m, accuracy, strict=True))
    )
    return RunResult(Point("cov", seed, ()), {"seed": seed}, rows, {"fly": 1.0})


def test_over_distance_every_round_is_a_point() -> None:
    runs = [
        result(1, [1000.0, 2000.0, 3000.0], [0.1, 0.2, 0.3]),
        result(2, [500.0, 2500.0], [0.5, 0.7]),
    ]
    at_km, values = DISTANCE.sampled(runs, "accuracy_a")
    # At the mean of its ends, as far as every run has the round.
    assert at_km.tolist() == [0.75, 2.25]
    assert values.tolist() == [[0.1, 0.2], [0.5, 0.7]]
    rounds, values = ROUNDS.sampled(runs, "accuracy_a")
    assert rounds.tolist() == [1, 2]
    assert values.tolist() == [[0.1, 0.2], [0.5, 0.7]]
    runs = [replace(r, summary={**r.summary, "untrained_accuracy_a": 0.05}) for r in runs]
    rounds, values = ROUNDS.sampled(runs, "accuracy_a")
    assert rounds.tolist() == [0, 1, 2]
    assert values.tolist() == [[0.05, 0.1, 0.2], [0.05, 0.5, 0.7]]
    at_km, values = DISTANCE.sampled(runs, "accuracy_a")
    assert at_km.tolist() == [0.0, 0.75, 2.25]
    assert values.tolist() == [[0.05, 0.1, 0.2], [0.05, 0.5, 0.7]]


def test_tables_hold_settings_of_several_kinds(tmp_path: Path) -> None:
    runs = [
        RunResult(Point("cov", 1, (("k", value),)), {"k": value, "mixed": mixed}, (), {})
        for value, mixed in ((1, "a"), (0.5, 2.0))
    ]
    write_results(tmp_path, runs)
    assert (tmp_path / "runs.csv").read_text() == "k,mixed\n1,a\n0.5,2.0\n"


def test_runs_that_end_apart_are_compared_where_the_thriftiest_ends() -> None:
    """The first takes 1 km a round, the second half: the last round names the wrong winner."""
    far, near = (
        replace(result(1, budget_m, accuracy), summary={"final_accuracy_a": accuracy[-1]})
        for budget_m, accuracy in (
            ([1000.0, 2000.0], [0.3, 0.6]),
            ([500.0, 1000.0, 1500.0, 2500.0], [0.2, 0.4, 0.5, 0.7]),
        )
    )
    assert at_equal((far, near), "rounds", "accuracy_a") == [0.6, 0.4]
    bare = [
        replace(
            run, rounds=tuple({k: row[k] for k in ("round", "accuracy_a")} for row in run.rounds)
        )
        for run in (far, near)
    ]
    assert at_equal(bare, "rounds", "accuracy_a") == [0.6, 0.4]
    assert at_equal((far, near), "metres", "accuracy_a") == [0.6, 0.6]
    assert all(map(math.isnan, at_equal((far, near), "energy", "accuracy_a")))
    one, other = (run.equal for run in with_equals((far, near)))
    assert one == {
        "equal_rounds_accuracy_a": 0.6, "equal_metres_accuracy_a": 0.6,
    }  # fmt: skip
    assert other == {
        "equal_rounds_accuracy_a": 0.4, "equal_metres_accuracy_a": 0.6,
    }  # fmt: skip
    assert with_equals((far, far)) == (far, far)


def test_what_is_equal_is_read_off_from_the_untrained_model_on() -> None:
    """The thriftiest ends in the middle of the other's first round; energy is summed up."""
    rows: list[list[Row]] = [
        [{"round": 1, "budget_used_m": 400.0, "energy_j": 90.0, "accuracy_a": 0.5},
         {"round": 2, "budget_used_m": 800.0, "energy_j": 30.0, "accuracy_a": 0.9}],
        [{"round": 1, "budget_used_m": 100.0, "energy_j": 60.0, "accuracy_a": 0.3}],
        [{"round": 1, "budget_used_m": 0.0, "energy_j": 0.0, "accuracy_a": 0.7}],
    ]  # fmt: skip
    start: Row = {"untrained_accuracy_a": 0.1}
    runs = [RunResult(Point("cov", n, ()), start, tuple(of), {}) for n, of in enumerate(rows)]
    nan = pytest.approx(math.nan, nan_ok=True)
    assert at_equal(runs, "rounds", "accuracy_a") == pytest.approx([0.5, 0.3, 0.7])
    assert at_equal(runs, "metres", "accuracy_a") == [pytest.approx(0.2), 0.3, nan]
    assert at_equal(runs, "energy", "accuracy_a") == [pytest.approx(0.1 + 0.4 * 2 / 3), 0.3, nan]
    later = [replace(runs[0], rounds=tuple(rows[0])), replace(runs[1], rounds=(
        {"round": 1, "budget_used_m": 600.0, "energy_j": 105.0, "accuracy_a": 0.3},
    ))]  # fmt: skip
    assert at_equal(later, "metres", "accuracy_a") == pytest.approx([0.7, 0.3])
    assert at_equal(later, "energy", "accuracy_a") == pytest.approx([0.7, 0.3])
    assert all(map(math.isnan, at_equal(runs, "metres", "accuracy_b")))


def test_pictures_are_in_percent_kilometres_and_minutes() -> None:
    def run(strategy: str, flies: bool) -> RunResult:
        row: Row = {"round": 1, "budget_used_m": 2500.0, "end_t_s": 90.0 * flies}
        row |= {"accuracy_a": 0.5, "cov_a": 1.5, "jain_communities": 0.75, "participation": 0.25}
        row |= {"plan_per": 0.125, "true_per": 0.25} if flies else {}
        summary: Row = {"simulated_s": 90.0 * flies, "final_accuracy_a": 0.5}
        return RunResult(Point(strategy, 1, ()), summary, (row,), {})

    found = {
        (picture.name, panel.column): (
            {name: (of.x.tolist(), of.mean.tolist(), of.flown)
             for name, of in picture.curves(panel).items()},
            panel.most,
        )
        for picture in pictures_of([run("cov", True), run("ideal", False)])
        for panel in picture.panels
    }  # fmt: skip

    def both(value: float, most: float) -> object:
        return {"cov": ([1.0], [value], True), "ideal": ([1.0], [value], False)}, most

    def flown(at: float, value: float, most: float) -> object:
        return {"cov": ([at], [value], True)}, most

    assert found == {
        ("accuracy-rounds", "accuracy_a"): both(50.0, 100.0),
        ("accuracy-distance", "accuracy_a"): flown(2.5, 50.0, 100.0),
        ("accuracy-time", "accuracy_a"): flown(1.5, 50.0, 100.0),
        ("per", "plan_per"): flown(1.0, 0.125, 1.0), ("per", "true_per"): flown(1.0, 0.25, 1.0),
        ("participation", "participation"): both(25.0, 100.0),
        ("fairness", "jain_communities"): both(0.75, 1.0),
        ("fairness", "cov_a"): both(1.5, math.inf),
    }  # fmt: skip
    assert [p.name for p in pictures_of([run("ideal", False)])] == [
        "accuracy-rounds", "participation", "fairness"
    ]  # fmt: skip


def test_an_axis_is_cut_where_one_goes_on_for_more_than_twice_as_long() -> None:
    def run(strategy: str, count: int) -> RunResult:
        rows: list[Row] = [{"round": n + 1, "accuracy_a": 0.1 * n} for n in range(count)]
        summary: Row = {"simulated_s": 0.0, "final_accuracy_a": 0.5}
        return RunResult(Point(strategy, 1, ()), summary, tuple(rows), {})

    for counts, end, label in (
        ((4, 4, 8), None, "round"), ((4, 4, 9), 4.0, "round (c to 9)"),
        ((4, 9, 9), None, "round"), ((3, 4, 20), 4.0, "round (c to 20)"),
        ((4, 9), 4.0, "round (b to 9)"),
    ):  # fmt: skip
        runs = [run(name, count) for name, count in zip("abc", counts, strict=False)]
        picture = pictures_of(runs)[0]
        assert (picture.end, picture.x_label) == (end, label)
        curves = picture.curves(picture.panels[0])
        assert [len(of.x) for of in curves.values()] == [min(n, int(end or n)) for n in counts]
        assert picture.about == ""
    seeds = [replace(run("a", 4), point=Point("a", n, ())) for n in (1, 2, 3)]
    told = [pictures_of(seeds[:count])[0].about for count in (1, 2, 3)]
    assert told == ["", "mean over 2 seeds", "mean over 3 seeds, 95 % interval"]


def test_a_seed_without_a_number_leaves_the_others_theirs() -> None:
    """As a run that scheduled nobody has no PER; and a community may be called as a column is."""
    runs = [
        RunResult(
            Point("cov", seed, ()),
            {"true_per": per, "final_accuracy_final_accuracy_a": 0.5},
            (),
            {},
        )
        for seed, per in ((1, 0.1), (2, math.nan), (3, 0.3), (4, 0.2))
    ]
    found = over_seeds(runs, "true_per")
    assert found.mean == pytest.approx(0.2)
    assert communities_of(runs) == ["final_accuracy_a"]


@pytest.mark.parametrize("strategy", ["rectangular", "my_package.my_module:weighed_by_age"])
def test_a_narrow_terminal_cuts_no_number(strategy: str) -> None:
    summary: Row = {
        "final_accuracy_cifar10": 0.412, "final_accuracy_mnist": 0.987,
        "delivered_share": math.nan, "participation": 0.625, "flown_m": 39_876.5,
    }  # fmt: skip
    runs = [RunResult(Point(strategy, seed, ()), summary, ({},) * 20, {}) for seed in (1, 2, 3)]
    console = Console(width=80)
    with console.capture() as capture:
        console.print(final_table(runs))
    lines = capture.get().splitlines()
    (row,) = (line for line in lines if "41.2" in line)
    assert " ".join(row.split()).endswith(" 3 41.2 ± 0.0 98.7 ± 0.0 62.5 39.9")
    assert "delivered" not in capture.get()  # a column of dashes says nothing
    assert "…" not in capture.get()
    assert strategy in "".join(line[1:].partition(" ")[0] for line in lines)


def test_the_paper_s_sweep_ends_by_its_budget() -> None:
    strategies = ("cov", "no_cov", "barycenter", "rectangular", "ideal")
    grid = make_grid(builtin_config("paper-sweep.toml"), strategies=strategies, seeds=3)
    expected = {
        run.strategy: rounds_paid_for(budget_of(run.config, foreseen_performance(run.config)))
        for run in grid.runs
    }
    assert expected == {name: 400 if name == "barycenter" else 50 for name in strategies}
    assert len(grid.runs) == 15


def test_a_run_s_rows_are_what_its_tables_add_up_to(tmp_path: Path) -> None:
    """Two rounds of three devices: 0 and 1 of `a`, 2 of `b`."""
    kept = RunFolder(tmp_path)
    rounds = [
        replace(
            UNKNOWN_ROUND, round=k, start_t_s=start_s, duration_s=10.0, energy_j=joules,
            scheduled=scheduled, delivered=delivered, accuracy={"a": a, "b": b},
            cov={"a": 0.5 * k, "b": 2.0},
        )
        for k, start_s, joules, scheduled, delivered, a, b in (
            (1, 100.0, 900.0, 3, 1, 0.2, 0.4), (2, 112.5, 800.0, 1, 1, 0.6, 0.3),
        )
    ]  # fmt: skip
    nowhere = (math.nan,) * 7
    uplinks = [
        UplinkRecord(k, device, name, 1, 5.0, 0.0, *nowhere, plan, math.nan, true, 1.0, arrived)
        for k, device, name, plan, true, arrived in (
            (1, 0, "a", 0.1, 0.2, True), (1, 1, "a", 0.3, 0.4, False), (1, 2, "b", 0.5, 0.9, False),
            (2, 2, "b", 0.1, 0.0, True),
        )
    ]  # fmt: skip
    losses = {(1, 0): 2.0, (2, 2): 1.0}
    learnt = [
        DeviceRecord(k, device, name, 0.1, math.nan, losses.get((k, device), math.nan))
        for k in (0, 1, 2) for device, name in enumerate("aab")
    ]  # fmt: skip
    for path, records in ((kept.rounds, rounds), (kept.uplinks, uplinks), (kept.learning, learnt)):
        rows = [flat(record) for record in records]
        path.write_text(csv_lines([rows[0], *(row.values() for row in rows)]))
    kept.devices.write_text("device\n0\n1\n2\n")
    told: dict[str, object] = {
        "flown_in_rounds_m": 1500.5,
        "budget_used_m": 1400.0,
        "simulated_s": 130.0,
    }
    told |= {"untrained_accuracy": {"a": 0.1, "b": 0.05}, "wall_s": {"fly": 3.0, "total": 5.0}}
    kept.summary.write_text(json.dumps(told))
    found = read_run(kept, Point("cov", 7, (("k", 2),)))
    assert found.summary == {
        "strategy": "cov", "seed": 7, "k": 2, "run": tmp_path.name, "rounds": 2,
        "flown_m": 1500.5, "budget_used_m": 1400.0, "simulated_s": 130.0, "energy_j": 1700.0,
        "scheduled": 4, "delivered": 2, "delivered_share": 0.5,
        "participation": pytest.approx(2 / 6),
        "plan_per": pytest.approx(0.25), "true_per": pytest.approx(1.5 / 4),
        "participation_a": 0.25, "participation_b": 0.5,
        "untrained_accuracy_a": 0.1, "untrained_accuracy_b": 0.05,
        "final_accuracy_a": 0.6, "final_accuracy_b": 0.3, "final_cov_a": 1.0, "final_cov_b": 2.0,
        "final_jain_communities": pytest.approx(0.9**2 / (2 * 0.45)),
    }  # fmt: skip
    assert found.wall_s == {"fly": 3.0, "total": 5.0}
    columns = ("round", "end_t_s", "participation", "plan_per", "true_per", "jain_communities")
    assert [[row[name] for name in columns] for row in found.rounds] == [
        pytest.approx([1, 110.0, 1 / 3, 0.3, 0.5, 0.6**2 / (2 * 0.2)]),
        pytest.approx([2, 122.5, 1 / 3, 0.1, 0.0, 0.9**2 / (2 * 0.45)]),
    ]
    assert [(row["strategy"], row["seed"], row["k"]) for row in found.rounds] == 2 * [("cov", 7, 2)]
    assert found.rounds[0]["energy_j"] == 900.0


def test_another_version_on_a_machine_of_a_cluster_is_named() -> None:
    engine = Mock(_versions={"aerofed": "0.2.0", "numpy": "2.4.6"})
    versions = {"aerofed": "0.0.1", "numpy": "2.4.6"}
    with pytest.raises(InputError, match=r"machine far has .*: aerofed 0\.0\.1 \(here 0\.2\.0\);"):
        RayEngine._refuse(engine, machine="far", versions=versions)
