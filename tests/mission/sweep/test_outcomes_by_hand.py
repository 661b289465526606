"""Tables, gains, intervals and curves of a sweep, worked out by hand."""

import math
from dataclasses import replace

import pytest
from described import described, tables
from rich.console import Console
from test_sweep_report import by_setting, one, state

from mission.sweep.grid import Point
from mission.sweep.outcome.curves import Interval, pictures_of
from mission.sweep.outcome.figures import final_chart, gain_charts
from mission.sweep.outcome.view import (
    ACCURACY,
    FAIRNESS,
    REST,
    final_table,
    outcome,
    paired_gains,
    percent,
    points,
)
from mission.sweep.results import Row, RunResult, with_equals


def test_the_table_of_outcomes_has_units_and_digits() -> None:
    runs = tuple(
        one(
            "cov", seed, {}, flown_m=flown_m, energy_j=energy_j, rounds=rounds,
            final_cov_a=cov, final_cov_b=2 * cov, final_jain_communities=jain,
            plan_per=0.0625, true_per=0.1875, delivered_share=0.5, participation_a=0.25,
            participation_b=0.125,
        )
        for seed, flown_m, energy_j, rounds, cov, jain in (
            (1, 1200.0, 40_000.0, 7, 0.25, 0.91), (2, 1500.0, 41_600.0, 8, 0.125, 0.9125),
        )
    )  # fmt: skip
    heads, (cells,) = outcome(
        with_equals(runs), (*ACCURACY, *FAIRNESS, *REST), seeds=lambda name: f"{name}: 2"
    )
    assert dict(zip(heads, cells, strict=True)) == {
        "strategy": "cov", "seeds": "cov: 2", "a %": "45.0", "b %": "91.0", "CoV a": "0.19",
        "CoV b": "0.38", "Jain": "0.911", "a arrived %": "25.0", "b arrived %": "12.5",
        "scheduled arrived %": "50.0", "PER planned": "0.062", "PER true": "0.188",
        "rounds": "8", "km of path": "1.4", "kJ flown": "41",
    }  # fmt: skip
    console = Console(width=200)
    with console.capture() as capture:
        console.print(final_table(runs))
    (line,) = (line for line in capture.get().splitlines() if line.lstrip().startswith("cov"))
    assert line.split() == ["cov", "2", "45.0", "91.0", "50.0", "75.0", "1.4", "41"]


@pytest.mark.parametrize(
    ("value", "signed", "said"),
    [
        *((0.0004, True, "0.0"), (-0.0004, True, "0.0"), (-0.0004, False, "0.0")),
        *((0.0006, True, "+0.1"), (0.0006, False, "0.1"), (-0.0006, True, "-0.1")),
        *((0.25, True, "+25.0"), (0.25, False, "25.0"), (-0.25, False, "-25.0")),
    ],
)
def test_shares_are_percent_and_have_a_sign_where_they_show_one(
    value: float, signed: bool, said: str
) -> None:
    assert points(value, signed=signed) == said
    assert percent(Interval(value, math.nan), signed=signed) == said
    assert percent(Interval(value, 0.0125), signed=signed) == f"{said} ± 1.2"
    assert percent(Interval(math.nan, 0.0125), signed=signed) == "-"


def test_gains_are_within_seeds_of_the_same_settings() -> None:
    def run(strategy: str, seed: int, setting: int, **finals: float) -> RunResult:
        summary = {f"final_accuracy_{name}": value for name, value in finals.items()}
        return RunResult(Point(strategy, seed, (("k", setting),)), dict(summary), (), {})

    gains = paired_gains(
        (
            run("other", 1, 1, a=0.5, b=0.0), run("other", 2, 1, a=0.4, b=0.0),
            run("other", 3, 1, a=0.9, b=0.9), run("cov", 1, 1, a=0.6, b=0.1),
            run("cov", 2, 1, a=0.4, b=0.2), run("cov", 1, 2, a=0.7, b=0.7),
            run("cov", 2, 2, a=0.8), run("other", 2, 2, a=0.9),
        )
    )  # fmt: skip
    found = [(g.other, g.settings, g.community, len(g.pairs), g.better) for g in gains]
    assert found == [
        ("other", "k = 1", "a", 2, 1),
        ("other", "k = 1", "b", 2, 2),
        ("other", "k = 2", "a", 1, 0),
    ]
    first, second, third = gains
    assert (first.label, third.label) == ("other, k = 1", "other, k = 2")
    assert first.finals == ((0.6, 0.5), (0.4, 0.4))
    assert first.differences == pytest.approx((0.1, 0.0))
    assert first.relative == pytest.approx(1.0 / 0.9 - 1.0)
    assert math.isnan(second.relative)
    assert third.relative == pytest.approx(0.8 / 0.9 - 1.0)
    assert (first.interval.mean, third.interval.mean) == pytest.approx((0.05, -0.1))


def test_ends_of_intervals_stop_where_the_quantity_does() -> None:
    def run(strategy: str, seed: int, final: float) -> RunResult:
        return RunResult(Point(strategy, seed, ()), {"final_accuracy_a": final}, (), {})

    low, high = (0.0, 0.02, 0.1), (1.0, 0.98, 0.9)
    runs = [run(name, k, of[k]) for name, of in (("cov", high), ("x", low)) for k in range(3)]
    # t(0.975, 2) = 4.3027; s = sqrt((16 + 4 + 36) / 2) points about 4 and 96.
    half = 4.302653 * 28.0**0.5 / 3.0**0.5
    (bars,) = tables(described(final_chart(runs, "a")), "x", "high")
    ends = {bar["row"]: (bar["x"], bar["high"]) for bar in bars}
    assert ends == {
        "cov": pytest.approx((96.0 - half, 100.0), abs=1e-3),
        "x": pytest.approx((0.0, 4.0 + half), abs=1e-3),
    }
    (gain,) = gain_charts(runs)
    ((bar,),) = tables(described(gain), "x", "high")
    # Differences of 100, 96 and 80 points.
    half = 4.302653 * 112.0**0.5 / 3.0**0.5
    assert (bar["x"], bar["high"]) == pytest.approx((92.0 - half, 100.0), abs=1e-3)
    (less,) = gain_charts(
        [
            replace(r, point=replace(r.point, strategy={"cov": "x", "x": "cov"}[r.point.strategy]))
            for r in runs
        ]
    )
    ((bar,),) = tables(described(less), "x", "high")
    assert (bar["x"], bar["high"]) == pytest.approx((-100.0, -92.0 + half), abs=1e-3)


def test_curves_are_drawn_of_fourteen_groups_and_apart_from_eight() -> None:
    assert len(pictures_of(by_setting(2, 7))) == len(pictures_of(state().results)) == 6
    assert pictures_of(by_setting(3, 5)) == ()
    (seven, *_), (eight, *_) = (pictures_of(by_setting(*of)) for of in ((1, 7), (2, 4)))
    assert (seven.apart, len(seven.order)) == ((), 7)
    assert eight.apart == tuple(f"extra_gain_db = {k}.0" for k in range(4))
    assert eight.order == ("s0", "s1")
    only = pictures_of(by_setting(8, 1))[0]
    assert (only.apart, len(only.order)) == ((), 8)


def test_bands_end_at_nothing_and_at_all() -> None:
    def run(strategy: str, seed: int, share: float) -> RunResult:
        row: Row = {"round": 1, "accuracy_a": share, "participation": share, "cov_a": 100 * share}
        summary: Row = {"final_accuracy_a": share, "simulated_s": 0.0}
        return RunResult(Point(strategy, seed, ()), summary, (row,), {})

    low, high = (0.0, 0.02, 0.1), (1.0, 0.98, 0.9)
    runs = [run(name, k, of[k]) for name, of in (("x", low), ("y", high)) for k in range(3)]
    half = 4.302653 * 28.0**0.5 / 3.0**0.5
    pictures = pictures_of(runs)
    panels = {panel.column: (one, panel) for one in pictures for panel in one.panels}
    for column, most in (("accuracy_a", 100.0), ("participation", 100.0), ("cov_a", 96.0 + half)):
        picture, panel = panels[column]
        bands = {
            name: (of.mean.tolist(), of.low.tolist(), of.high.tolist())
            for name, of in picture.curves(panel).items()
        }
        assert bands == {
            "x": tuple(pytest.approx([v], abs=1e-4) for v in (4.0, 0.0, 4.0 + half)),
            "y": tuple(pytest.approx([v], abs=1e-4) for v in (96.0, 96.0 - half, most)),
        }
