"""What scales, legends and tables of pictures hold to."""

import math
from typing import Any

import numpy as np
import pytest
from described import described, keys, layers, rows, tables
from one_aircraft import round_problem

from fl.radio.channel import CHANNEL_PRESETS
from mission.figures.plan import plan_picture
from mission.figures.render import card, stacked
from mission.figures.style import Chart, dot_radii, importance_size, per_key, per_scale, table
from mission.planner.evaluate import success
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem


@pytest.mark.parametrize("count", [2, 60, 61, 200])
def test_dots_are_as_large_as_their_key_says(count: int) -> None:
    importance = np.linspace(0.0, 0.5, count)
    areas = math.pi * dot_radii(importance, 0.5) ** 2
    size: Any = importance_size(0.5, count).to_dict()
    low, high = size["scale"]["range"]
    assert size["scale"]["domain"] == [0.0, 0.5]
    assert areas == pytest.approx(low + (high - low) * importance / 0.5)
    assert 0.0 < 3 * low < high
    # Where nobody matters, all are as small.
    assert dot_radii(0.0 * importance, 0.0) == pytest.approx(math.sqrt(low / math.pi))
    none: Any = importance_size(0.0, count).to_dict()
    assert none["scale"]["domain"] == [0.0, 1.0]


def test_in_a_crowd_dots_are_smaller() -> None:
    few, many = (dot_radii(np.full(count, 1.0), 1.0)[0] for count in (60, 61))
    assert many < few


def test_rates_are_coloured_from_0_to_1_and_so_is_their_key() -> None:
    scale: Any = per_scale().to_dict()
    assert (scale["domain"][0], scale["domain"][-1], scale["clamp"]) == (0.0, 1.0, True)
    assert scale["domain"] == sorted(scale["domain"])
    assert len(scale["range"]) == len(scale["domain"]) == len(set(scale["range"]))
    key: Any = per_key().to_dict()
    assert key["values"] == [0.0, 0.5, 1.0]


def test_tables_have_six_digits_and_nothing_for_what_is_no_number() -> None:
    found = table(x=[1 / 3, 1234567.8, math.nan, -math.inf], n=[1, 2, 3, 4], s=list("abcd"))
    assert found["values"] == [
        {"x": 0.333333, "n": 1, "s": "a"}, {"x": 1234570.0, "n": 2, "s": "b"},
        {"x": None, "n": 3, "s": "c"}, {"x": None, "n": 4, "s": "d"},
    ]  # fmt: skip


def two_of(problem: RoundProblem) -> RoundPlan:
    """The first stop serves the first device, the next one the third."""
    waypoints = np.array([[0.0, 0.0], [100.0, 50.0], [300.0, 60.0]])
    schedule = np.zeros((3, len(problem.devices_m)), dtype=bool)
    schedule[1, 0] = schedule[2, 2] = True
    return RoundPlan((PlannedPath(waypoints, altitude_m=80.0),), schedule[None], 0.75, 1.0)


def test_a_picture_of_a_plan_tells_its_numbers_and_who_is_served_how_well() -> None:
    devices_m = np.array([[120.0, 70.0], [200.0, 200.0], [320.0, 40.0]])
    channel = CHANNEL_PRESETS["suburban"]
    problem = round_problem(
        devices_m, np.array([0.5, 0.25, 1.0]), np.zeros(2), 3, 1, 400.0, channel
    )
    plan = two_of(problem)
    spec = described(plan_picture(problem, plan, title="t", about="whose"))
    length_m = math.hypot(100, 50) + math.hypot(200, 10)
    told, whose = spec["title"]["subtitle"]
    assert told == (
        f"value 0.75, gap {plan.gap:.2%}; 2 of 3 devices served (filled); {length_m:.0f} of 400 m, "
        "80.0 m above home"
    )
    assert whose == "whose"
    per = 1.0 - success(problem.alone(0).at(80.0), plan.waypoints_m)
    links = [(r["device"], r["step"], r["x"], r["y"], r["x2"], r["y2"]) for r in rows(spec, "x2")]
    assert links == [(0, 1, 100, 50, 120, 70), (2, 2, 300, 60, 320, 40)]
    assert [r["per"] for r in rows(spec, "x2")] == pytest.approx([per[1, 0], per[2, 2]], rel=1e-5)
    marks = [(r["device"], r["outcome"], r["importance"]) for r in rows(spec, "device", "outcome")]
    assert marks == [(0, "served", 0.5), (1, "not served", 0.25), (2, "served", 1.0)]
    stops = [(r["waypoint"], r["x"], r["y"]) for r in rows(spec, "waypoint")]
    assert stops == [(0, 0, 0), (1, 100, 50), (2, 300, 60)]
    assert keys(spec)["shape"] == ["served", "not served"]
    east = next(layers(spec))["encoding"]["x"]["scale"]["domain"]
    assert east == pytest.approx([-0.04 * 320, 1.04 * 320])
    words = {r["word"]: (r["x"], r["y"]) for each in tables(spec, "word") for r in each}
    assert words == {
        "start": (0, 0), "0": (120, 70), "1": (200, 200), "2": (320, 40)
    }  # fmt: skip


def chart(name: str, **more: Any) -> Chart:
    rows = [{"x": 1.0, "y": 2.0}, {"x": 3.0, "y": None}]
    usual = {"width": 440, "height": 210, "layer": [{"mark": "point"}], "datasets": {name: rows}}
    return {"title": {"text": name}, **usual, **more}


@pytest.mark.parametrize(
    ("count", "together", "columns"),
    [  # so many are 1.7 times as high as wide at most, and none is left alone in a row
        (3, 3, 1), (4, 4, 2), (6, 6, 2), (7, 7, 4), (5, 5, 3), (9, 3, 3), (2, 2, 1), (8, 1, 1),
        (13, 13, 5),
    ],
)  # fmt: skip
def test_charts_stand_in_as_few_columns_as_fit_a_screen(count, together, columns) -> None:
    made = stacked([chart(str(n)) for n in range(count)], title="t", about="a", together=together)
    assert set(made["datasets"]) == {str(n) for n in range(count)}
    assert (made["title"]["text"], made["title"]["subtitle"]) == ("t", "a")
    groups = [part.get("concat") for part in made["vconcat"]]
    if columns == 1:
        assert groups == [None] * count
        return
    assert [len(group) for group in groups] == [together] * (count // together)
    assert {part["columns"] for part in made["vconcat"]} == {columns}
    assert [one["title"]["text"] for group in groups for one in group] == [
        str(n) for n in range(count)
    ]


def test_a_picture_has_one_key_or_each_chart_its_own() -> None:
    own = stacked([chart("a"), chart("b")], title="t", about="")["resolve"]["scale"]
    assert set(own.values()) == {"independent"}
    assert {"color", "strokeDash"} <= set(own)
    assert "resolve" not in stacked([chart("a")], title="t", about="", one_key=True)


def test_a_card_is_as_wide_as_its_place_and_zooms_where_there_are_numbers() -> None:
    named_x, of_numbers = ({"mark": "bar", "encoding": {"x": {"type": kind}}}
                           for kind in ("ordinal", "quantitative"))  # fmt: skip
    both = chart("a", layer=[named_x, of_numbers, of_numbers], height=110)
    for is_map, aspect, ways in ((False, None, ["x"]), (True, 0.25, ["x", "y"])):
        made: Any = card({**both, "title": {"text": "a", "subtitle": "so"}}, is_map=is_map)
        assert (made["title"], made["note"], made["aspect"]) == ("a", "so", aspect)
        spec = made["spec"]
        assert "title" not in spec
        assert (spec["description"], spec["width"]) == ("a", "container")
        assert spec["datasets"] == {"a": {"x": [1.0, 3.0], "y": [2.0, None]}}
        zooms = ["params" in layer for layer in spec["layer"]]
        assert zooms == [False, True, False]
        assert spec["layer"][1]["params"][0]["select"]["encodings"] == ways
    still: Any = card(chart("a", datasets={"a": []}))
    assert not any("params" in layer for layer in still["spec"]["layer"])
    assert still["spec"]["datasets"] == {"a": {}}
    assert still["note"] == ""
