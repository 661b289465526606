"""The screen of communities that live apart: its layouts, its rule, its statistics."""

from pathlib import Path

import apart
import apart_flown
import apart_gains
import apart_runs
import apart_shift
import numpy as np
import pandas as pd
import pytest
import study

EACH = apart.EACH


@pytest.mark.parametrize("layout", apart.LAYOUTS)
def test_a_layout_lies_in_the_area_and_shares_a_seeds_luck(layout: str) -> None:
    devices_m = apart.positions_m(layout, 101)
    assert devices_m.shape == (2 * EACH, 2)
    assert (devices_m >= 0.0).all()
    assert (devices_m <= apart.AREA_M).all()
    assert (devices_m == apart.positions_m(layout, 101)).all()
    assert not (devices_m == apart.positions_m(layout, 102)).any()


def test_communities_stand_where_the_plan_has_them() -> None:
    for seed in apart.SEEDS:
        halves, corners, rim, clusters = (
            apart.positions_m(layout, seed) for layout in ("halves", "corners", "rim", "clusters")
        )
        assert halves[:EACH, 0].max() <= 400.0 <= halves[EACH:, 0].min()
        assert corners[:EACH].max() <= 250.0
        assert corners[EACH:].min() >= 550.0
        edge_m = np.minimum(rim, apart.AREA_M - rim).min(axis=1)
        assert edge_m[:EACH].max() <= 100.0
        assert edge_m[EACH:].min() >= 200.0
        groups = clusters.reshape(4, 3, 2)
        assert np.ptp(groups, axis=1).max() <= 120.0


def test_the_grid_is_the_plans() -> None:
    settings = apart.grid()
    assert len(settings) == len(set(settings))
    assert sum(setting.ratio != 1.0 for setting in settings) == 165
    assert len({(s.steps, s.per_step) for s in settings}) == 20


def test_in_opposite_corners_weights_keep_the_aircraft_with_the_weightier() -> None:
    """Both corners are served by turns where all weigh alike, six of twelve devices a round."""
    alike, weighed = (
        apart.planned(apart.Setting("corners", ratio=ratio), 101) for ratio in (1.0, 3.0)
    )
    assert alike["participation_cifar10"] == pytest.approx(0.5, abs=0.02)
    assert alike["participation_mnist"] == pytest.approx(0.5, abs=0.02)
    assert weighed["participation_cifar10"] == pytest.approx(1.0, abs=0.02)
    assert weighed["participation_mnist"] == pytest.approx(0.0, abs=0.02)
    assert weighed["path_m"] < 0.3 * alike["path_m"]  # type: ignore[operator]


def rows(**cells: tuple[int, float, float]) -> pd.DataFrame:
    """Of each layout: N, and CIFAR-10's participation with ratio 1 and 3, in two draws."""
    return pd.DataFrame(
        [
            {
                "layout": layout, "steps": steps, "per_step": 3, "channel": "suburban",
                "planner": "certified", "path_budget_m": 800.0, "boost": 1.5, "ratio": ratio,
                "seed": seed, "participation_cifar10": share, "participation_mnist": 0.5,
                "path_m": 100.0,
            }
            for layout, (steps, *shares) in cells.items()
            for ratio, share in zip((1.0, 3.0), shares, strict=True)
            for seed in (101, 102)
        ]
    )  # fmt: skip


def test_what_goes_forward_has_shift_headroom_and_few_steps() -> None:
    made = rows(
        corners=(2, 0.5, 0.9), halves=(3, 0.5, 0.61), mixed=(2, 0.5, 0.59), rim=(2, 0.86, 0.99),
        clusters=(6, 0.5, 0.9),
    )  # fmt: skip
    found = apart_shift.shifts(made)
    assert found["shift"].tolist() == pytest.approx([40, 40, 11, 11, 9, 9, 13, 13, 40, 40])
    assert apart_shift.forward(found).layout.tolist() == ["corners", "halves"]


def test_holm_by_hand() -> None:
    # Sorted: 0.01 x 3, 0.03 x 2, and 0.04 x 1 raised to the one before.
    assert study.holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert study.holm([0.5, 0.9]) == [1.0, 1.0]
    assert study.holm([0.02]) == [0.02]


def test_a_t_test_by_hand() -> None:
    # Mean 2, spread 1, three values: t = 2 sqrt(3) = 3.464 with two degrees of freedom.
    assert study.two_sided(np.array([1.0, 2.0, 3.0])) == pytest.approx(0.0742, abs=1e-4)


def test_budgets_pay_for_no_more_rounds_than_a_run_has() -> None:
    metres = pd.Series([800.0, 10.0])
    assert apart_shift.rounds_paid(metres, 40e3).tolist() == [50.0, 400.0]


def test_a_run_stands_where_its_layout_and_seed_have_it() -> None:
    task = apart_runs.Task(apart_runs.Cell("rim", 3, 2), "no_cov", 203)
    config = task.config()
    places = [place for c in config.communities for place in c.positions_m or ()]
    np.testing.assert_allclose(places, apart.positions_m("rim", 203), atol=1e-3)
    assert (config.mission.steps, config.mission.devices_per_step) == (3, 2)
    assert (config.seed, config.mission.flight) == (203, "none")


def test_the_cells_are_those_of_the_plan() -> None:
    """Twelve that go forward and two controls; the ideal once a seed, all else in every cell."""
    assert len(set(apart_runs.CELLS)) == 14
    names = [task.point.name for task in apart_runs.tasks(14)]
    assert len(names) == len(set(names)) == 16 * (14 * 3 + 1)


def run_of(accuracies: list[float], *, joules: float) -> pd.DataFrame:
    """A run with these accuracies on CIFAR-10, half of them on MNIST; each round takes as much."""
    values = np.array(accuracies)
    return pd.DataFrame(
        {
            "energy_used_j": joules * np.arange(1, len(values) + 1),
            "accuracy_cifar10": values,
            "accuracy_mnist": values / 2.0,
        }
    )


def test_a_gain_is_of_equal_metres_rounds_or_joules() -> None:
    """`cov` learns a point a round in twice the rounds at half the joules a round; `no_cov` two."""
    cov = run_of([0.01 * n for n in range(1, 41)], joules=1.0)
    no_cov = run_of([0.02 * n for n in range(1, 21)], joules=3.0)
    runs = {"cov": [cov] * 3, "no_cov": [no_cov] * 3}
    ahead = {way: apart_gains.gains(runs, "no_cov", "cifar10", way)[0] for way in apart_gains.WAYS}
    # Ten rounds up to 40 and 20: 35.5 and 31; up to 20 and 20; 40 joules are 40 and 13 rounds.
    assert ahead["metre"] == pytest.approx(35.5 - 31.0)
    assert ahead["round"] == pytest.approx(15.5 - 31.0)
    assert ahead["joule"] == pytest.approx(35.5 - 17.0)
    mnist, level = apart_gains.gains(runs, "no_cov", "mnist", "metre")
    assert mnist == pytest.approx((35.5 - 31.0) / 2.0)
    assert level == pytest.approx(15.5)


def test_no_factor_hides_behind_another() -> None:
    """Every two columns hold all four pairs equally often, and no factor is a product of two."""
    signs = 2 * np.array(apart_runs.treatments()) - 1
    np.testing.assert_array_equal(signs.T @ signs, 16 * np.eye(7))
    pairs = [signs[:, i] * signs[:, j] for i in range(7) for j in range(i)]
    assert not (np.array(pairs) @ signs).any()


def test_a_treatment_sets_what_it_says() -> None:
    tasks = list(apart_runs.factor_tasks())
    assert len({task.point.name for task in tasks}) == 256
    last = tasks[-1].config()
    assert (last.learning.importance_boost, last.learning.cov_period_rounds) == (3.0, 1)
    assert [community.coverage for community in last.communities] == [True, True]
    assert (last.learning.local_epochs, last.learning.cov_floor) == (5, 0.01)
    assert (last.learning.missed, last.learning.cov_unheard) == ("unscheduled", "zero")


def test_what_a_factor_adds_is_found() -> None:
    """A gain of 3 points, to which epochs add 2; seed 203 misses a run and does not count."""
    rows = []
    for task in apart_runs.factor_tasks():
        if task.seed > 203 or (task.seed == 203 and task == lacking()):
            continue
        gain = 0.03 + 0.02 * (task.levels or ())[2] if task.strategy == "cov" else 0.0
        rows.append(
            {"strategy": task.strategy, "seed": task.seed}
            | apart_runs.factors(task.levels)
            | {"energy_used_j": 1.0, "accuracy_cifar10": 0.2 + gain, "accuracy_mnist": 0.5}
        )
    ahead = apart_gains.factor_gains(pd.DataFrame(rows), "cifar10", "metre")
    assert ahead.shape == (2, 16)
    np.testing.assert_allclose(apart_gains.effects(ahead), [[0, 0, 2, 0, 0, 0, 0]] * 2, atol=1e-9)


def test_weights_are_held_against_both() -> None:
    accuracies = dict.fromkeys(apart_runs.WEIGHTS, 0.4) | {"cov": 0.3, "no_cov": 0.2}
    rows = [
        {"strategy": strategy, "seed": seed, "layout": "corners", "N": 2, "K_bar": 3}
        | {"energy_used_j": 1.0, "accuracy_cifar10": accuracy, "accuracy_mnist": 0.5}
        | {"participation_cifar10": 0.5, "participation_mnist": 0.5}
        for seed in (201, 202, 203)
        for strategy, accuracy in accuracies.items()
    ]
    less_no_cov, less_cov = apart_gains.weight_tables(pd.DataFrame(rows)).split("## Points")[1:]
    assert "| `per_metre` | CIFAR-10 | +20.0 ± 0.0 (+100 %, 3 of 3) |" in less_no_cov
    assert "| `per_metre` | CIFAR-10 | +10.0 ± 0.0 (+33 %, 3 of 3) |" in less_cov
    with pytest.raises(SystemExit, match="2 of 16 seeds are whole"):
        apart_gains.weight_tables(pd.DataFrame(rows[:-1]))


def test_runs_of_a_table_are_known(tmp_path: Path) -> None:
    task, other = list(apart_runs.factor_tasks())[5:7]
    plain = apart_runs.Task(apart_runs.CELLS[0], "cov", 203)
    for name, one in (("factors", task), ("cells", plain)):
        keys = [*apart_runs.KEYS, *apart_runs.factors(one.levels)]
        rows = pd.DataFrame([one.values] * 2, columns=keys).assign(round=[1, 2])
        rows.to_csv(tmp_path / f"{name}.csv.gz", index=False)
    done = apart_runs.known([tmp_path / "factors.csv.gz", tmp_path / "cells.csv.gz"])
    assert (task.values in done, plain.values in done, other.values in done) == (True, True, False)


def lacking() -> apart_runs.Task:
    return apart_runs.Task(apart_runs.CELLS[0], "no_cov", 203, apart_runs.treatments()[5])


def test_a_run_in_a_folder_and_a_table_counts_once(tmp_path: Path) -> None:
    made = pd.DataFrame({"strategy": "cov", "seed": 201, "round": [1, 2], "accuracy": [0.1, 0.2]})
    (tmp_path / "runs").mkdir()
    made.to_csv(tmp_path / "runs" / "one.csv", index=False)
    made.to_csv(tmp_path / "table.csv.gz", index=False)
    found = apart_gains.collected([tmp_path / "runs", tmp_path / "table.csv.gz"])
    assert found.equals(made)


def test_what_judges_is_flown_on_all_data_and_seeds_that_chose_nothing() -> None:
    tasks = list(apart_runs.judging_tasks())
    assert len(tasks) == len({task.values for task in tasks}) == 12 * (2 * 4 + 1 + 2)
    assert {task.seed for task in tasks}.isdisjoint({*apart.SEEDS, *apart_runs.SEEDS})
    paper = next(task for task in tasks if task.planner == "paper").config()
    assert (paper.planner.kind, paper.mission.flight, paper.communities[0].subset) == (
        "paper", "flown", 1.0,
    )  # fmt: skip


def test_what_was_flown_is_judged_in_the_plans_words() -> None:
    """Of 30 %, 14 % are 4.2 points: here `cov` is 6 ahead, and costs MNIST nothing."""
    lucky = {301: 0.0, 302: 0.001, 303: 0.002}
    rows = [
        {"strategy": task.strategy, "seed": task.seed, "planner": task.planner}
        | {"layout": task.cell.layout, "N": task.cell.steps, "K_bar": task.cell.per_step}
        | {"energy_used_j": 1.0, "accuracy_mnist": 0.5 + lucky[task.seed]}
        | {"accuracy_cifar10": 0.3 + (0.06 + lucky[task.seed]) * (task.strategy == "cov")}
        | {"participation_cifar10": 0.5, "participation_mnist": 0.5}
        for task in apart_runs.judging_tasks()
        if task.seed in lucky
    ]
    made = apart_flown.tables(pd.DataFrame(rows))
    assert "3 of 12 seeds are whole" in made
    paper, asked = (line for line in made.splitlines() if "H19" in line)
    assert "+6.1 ± 0.2 (+20 %, 3 of 3)" in paper
    assert paper.endswith("| +0.0 ± 0.0 (+0 %, 0 of 3) | the claim holds |")
    assert asked.endswith("| yes (+1.9 ± 0.2) | +0.0: yes | +3.0 ± 0.1 |")
    with pytest.raises(SystemExit, match="2 of 12 seeds are whole"):
        apart_flown.tables(pd.DataFrame(rows[:-1]))


@pytest.mark.parametrize(
    ("ahead", "mnist", "p", "word"),
    [
        ((6.0, 6.2, 5.8), (-1.0, 1.0, 0.0), 0.01, "the claim holds"),
        ((6.0, 6.2, 5.8), (9.0, 9.1, 9.2), 0.01, "the claim holds"),
        ((6.0, 6.2, 5.8), (-3.0, -3.1, -2.9), 0.01, "at a price"),
        ((4.0, 4.4, 3.6), (0.0, 0.1, 0.2), 0.01, "ahead"),
        ((6.0, 12.0, 0.0), (0.0, 0.1, 0.2), 0.2, "not shown"),
        ((2.0, 2.1, 1.9), (0.0, 0.1, 0.2), 0.01, "ahead; 14 % refused"),
        ((-1.0, -1.1, -1.2), (0.0, 0.1, 0.2), 0.01, "not shown; 14 % refused"),
    ],
)  # fmt: skip
def test_words_are_the_plans(
    ahead: tuple[float, ...], mnist: tuple[float, ...], p: float, word: str
) -> None:
    level = np.full(3, 30.0)
    assert apart_flown.verdict_of(np.array(ahead), level, np.array(mnist), p) == word


def test_a_reviewer_is_told_how_much_at_least_and_at_whose_cost() -> None:
    """Two seeds, of which a bootstrap draws each pair in a quarter of cases and both in half."""
    ahead, level = np.array([2.0, 4.0]), np.array([20.0, 20.0])
    assert apart_flown.relative(ahead, level) == pytest.approx((15.0, 10.0, 20.0))
    # Of three seeds: 14 % of 20 are 2.8, Student's factor 4.30, so 4.0 +- 2.5 - 2.8 is open.
    ahead, level, mnist = np.array([3.0, 4.0, 5.0]), np.full(3, 20.0), np.array([-1.1, -1.0, -0.9])
    share, most, least, both = apart_flown.reviewed(ahead, level, mnist)
    assert share == "+20.0 (+15.0 to +25.0)"
    assert most == "open (+1.2 ± 2.5)"
    assert least == "-1.2: yes"
    assert both == "+1.5 ± 1.4"
    _, most, least, _ = apart_flown.reviewed(2.0 * ahead, level, 2.0 * mnist)
    assert (most, least) == ("yes (+5.2 ± 5.0)", "-2.5: no")
    assert apart_flown.reviewed(ahead / 4.0, level, mnist)[1] == "no (-1.8 ± 0.6)"
