"""The numbers of charts: where axes begin and end, and what is drawn of many values."""

import math
from typing import Any

import numpy as np
import pytest
from described import described, layers, rows, tables

from mission.figures.charts import DotRow, Series, bar_chart, dot_rows, envelope, line_chart, ticks
from mission.figures.style import Chart

NAN = math.nan


def domain(chart: Chart, axis: str) -> list[float]:
    """Of the first layer that has such an axis."""
    found = (layer["encoding"].get(axis, {}) for layer in layers(described(chart)))
    return [*next(one["scale"]["domain"] for one in found if "domain" in one.get("scale", {}))]


def line(y: list[float], **more: Any) -> Series:
    return Series("a", "#111111", [float(n) for n in range(len(y))], y, **more)


@pytest.mark.parametrize(
    ("series", "more", "ends"),
    [
        (line([1.0, 5.0]), {}, (0.0, 5.3)),
        (line([-2.0, 8.0]), {}, (-2.6, 8.6)),
        (line([-3.0, -1.0]), {}, (-3.12, -0.88)),
        (line([0.0, 0.0]), {}, (0.0, 0.5)),
        (line([NAN, NAN]), {}, (0.0, 1.06)),
        (line([NAN, 2.0, math.inf]), {}, (0.0, 2.12)),
        (line([1.0, 5.0]), {"most": 5.25}, (0.0, 5.25)),
        (line([1.0, 5.0]), {"most": 6.0}, (0.0, 5.3)),
        (line([1.0, 5.0]), {"gate": "limit", "gate_at": 10.0}, (0.0, 10.6)),
        (line([0.25, 0.5]), {"gate": "limit"}, (0.0, 1.06)),
        (line([1.0, 5.0]), {"gate_at": 10.0}, (0.0, 5.3)),
        (line([1.0, 5.0], low=[-1.0, 4.0], high=[2.0, 9.0]), {}, (-1.6, 9.6)),
        (line([1.0, 5.0]), {"marks": line([7.0])}, (0.0, 7.42)),
    ],
)
def test_an_upward_axis_holds_all_that_is_drawn_and_zero(
    series: Series, more: dict[str, Any], ends: tuple[float, float]
) -> None:
    assert domain(line_chart("t", [series], x="x", y="y", **more), "y") == pytest.approx(ends)


def test_an_axis_across_holds_what_is_known() -> None:
    one, other = Series("a", "#1", [3.0, NAN, 5.0], [0.0] * 3), Series("b", "#2", [7.0], [1.0])
    marks = Series("m", "#3", [2.0], [1.0])
    assert domain(line_chart("t", [one, other], x="x", y="y"), "x") == [3.0, 7.0]
    assert domain(line_chart("t", [one, other], x="x", y="y", marks=marks), "x") == [2.0, 7.0]
    assert domain(line_chart("t", [Series("a", "#1", [], [])], x="x", y="y"), "x") == [0.0, 1.0]


@pytest.mark.parametrize(("count", "opacity"), [(25, 1), (26, 0)])
def test_points_of_a_line_are_seen_where_they_are_few(count: int, opacity: int) -> None:
    made = described(line_chart("t", [line([1.0] * count), line([1.0])], x="x", y="y"))
    (points,) = (layer["mark"] for layer in layers(made) if layer["mark"]["type"] == "point")
    assert points["opacity"] == opacity


def test_a_chart_has_all_its_values_its_intervals_and_its_limit() -> None:
    first = Series("a", "#111111", [1.0, 2.0], [3.0, NAN], low=[2.0, 3.0], high=[4.0, 5.0])
    second = Series("b", "#222222", [1.5], [6.0], dashed=True)
    marks = Series("m", "#333333", [1.25], [2.5])
    made = described(line_chart("t", [first, second], x="x", y="y", gate="most", gate_at=5.5,
                                marks=marks, note="so", height=77.0))  # fmt: skip
    every = [[(r["series"], r["x"], r["y"]) for r in each] for each in tables(made, "series", "x")]
    assert sorted(every, key=len) == [
        [("m", 1.25, 2.5)], [("a", 1.0, 3.0), ("a", 2.0, None), ("b", 1.5, 6.0)]
    ]  # fmt: skip
    assert [(r["x"], r["low"], r["high"]) for r in rows(made, "low")] == [(1, 2, 4), (2, 3, 5)]
    assert rows(made, "name") == [{"y": 5.5, "name": "most"}]
    assert made["title"] == {"text": "t", "subtitle": "so"}
    assert made["height"] == 77.0
    # Two of one colour, and one that is dashed, are told apart.
    looks = [
        Series(name, "#1", [1.0], [1.0], dashed=dashed, again=again)
        for name, dashed, again in (
            ("a", False, False),
            ("b", False, True),
            ("c", True, False),
            ("d", True, True),
        )
    ]
    dashes = next(
        layer["encoding"]["strokeDash"]["scale"]["range"]
        for layer in layers(described(line_chart("t", looks, x="x", y="y")))
        if "strokeDash" in layer["encoding"]
    )
    assert dashes[0] == [1, 0]
    assert len({tuple(each) for each in dashes}) == 4


@pytest.mark.parametrize(
    ("values", "ends", "zero", "reach"),
    [
        ((1.0, 2.0, 4.0), (-10.0, 20.0), False, (-2.0, 7.0)),
        ((1.0, 2.0, 4.0), (0.5, 4.5), False, (0.5, 4.5)),
        ((1.0, 2.0, 4.0), (1.5, 3.5), False, (1.0, 4.0)),
        ((1.0, 2.0, 4.0), (1.5, 3.5), True, (0.0, 4.0)),
        ((-4.0, -2.0), (-5.0, -1.0), True, (-5.0, 0.0)),
        ((1.0, 2.0, 4.0), None, False, (-2.0, 7.0)),
        ((3.0,), (-9.0, 9.0), False, (1.0, 5.0)),
    ],
)
def test_intervals_are_drawn_as_far_as_the_seeds_reach_thrice(
    values: tuple[float, ...], ends: Any, zero: bool, reach: tuple[float, float]
) -> None:
    made = dot_rows("t", [DotRow("a", "#111111", values, 2.0, ends)], x="x", zero=zero)
    air = 0.05 * (reach[1] - reach[0])
    assert domain(made, "x") == pytest.approx((reach[0] - air, reach[1] + air))
    spec = described(made)
    assert [row["x"] for row in tables(spec, "row", "x")[-2]] == list(values)
    assert [row["x"] for row in tables(spec, "row", "x")[-1]] == [2.0]
    bars = [(row["x"], row["high"]) for table in tables(spec, "high") for row in table]
    assert bars == ([ends] if ends else [])


def test_bars_stand_at_whole_numbers_that_are_labelled_round() -> None:
    bars = [Series("a", "#1", range(1, 31), [2.0] * 30), Series("b", "#2", [31], [3.0])]
    made = described(bar_chart("t", bars, x="x", y="y"))
    assert [(r["series"], r["x"], r["y"]) for r in rows(made, "series")][-2:] == [
        ("a", 30, 2), ("b", 31, 3)
    ]  # fmt: skip
    (layer,) = layers(made)
    assert layer["encoding"]["x"]["axis"]["values"] == [1, 5, 10, 15, 20, 25, 30]


@pytest.mark.parametrize(
    ("numbers", "labelled"),
    [
        (range(1, 13), [*range(1, 13)]),
        (range(1, 14), [1, 2, 4, 6, 8, 10, 12]),
        (range(24), [*range(0, 24, 2)]),
        (range(25), [0, 5, 10, 15, 20]),
        (range(3, 63), [3, *range(5, 63, 5)]),
        (range(61), [0, 10, 20, 30, 40, 50, 60]),
        (range(121), [0, 20, 40, 60, 80, 100, 120]),
        (range(7, 900), [7, *range(100, 900, 100)]),
    ],
)
def test_twelve_numbers_at_most_are_labelled(numbers: range, labelled: list[int]) -> None:
    assert ticks(numbers) == labelled
    assert ticks(range(10), 2) == [0, 5]


def test_of_many_values_the_least_and_the_greatest_of_each_time_are_drawn() -> None:
    t_s = np.arange(40_000) / 100.0
    values = np.random.default_rng(1).normal(size=len(t_s))
    x, y = envelope(t_s, values)
    assert 780 <= len(x) <= 803
    assert (np.diff(x) >= 0.0).all()
    at = np.searchsorted(t_s, x[:-1] - 1e-9)
    np.testing.assert_array_equal(values[at], y[:-1])
    assert x[-1] == t_s[-1]
    assert math.isnan(y[-1])
    hundreds = np.array_split(np.arange(len(t_s)), 401)
    ends = [part[pick(values[part])] for part in hundreds for pick in (np.argmin, np.argmax)]
    assert at.tolist() == sorted(map(int, ends))


@pytest.mark.parametrize(
    ("step_s", "gap_s", "parts"), [(0.125, 1.0, 1), (0.125, 1.125, 2), (1.0, 5.0, 1), (1.0, 5.5, 2)]
)
def test_a_line_is_broken_where_nothing_is_told(step_s: float, gap_s: float, parts: int) -> None:
    first = step_s * np.arange(20)
    t_s = np.concatenate((first, first + first[-1] + gap_s))
    x, y = envelope(t_s, np.ones(40))
    assert int(np.isnan(y).sum()) == parts
    assert x[np.isnan(y)][0] == pytest.approx(first[-1] if parts == 2 else t_s[-1])
    assert len(x) == 40 + parts


def test_of_times_in_which_nothing_is_known_a_gap_is_drawn() -> None:
    values = np.array([1.0, NAN, 3.0])
    x, y = envelope(np.arange(3.0), values)
    assert x.tolist() == [0.0, 1.0, 2.0, 2.0]
    np.testing.assert_array_equal(y, [1.0, NAN, 3.0, NAN])
    assert envelope(np.array([4.0]), np.array([2.0]))[0].tolist() == [4.0, 4.0]
