"""Where maps end, where on them a place is, and which lines they have."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight
from described import described, layers, rows, tables

from fl.radio.city import Building
from fl.radio.per_grid import PerGrid
from mission.analysis.holes import LOW_M
from mission.figures.frame import (
    MapFrame,
    edges,
    named_areas,
    run_frame,
    run_lines,
)
from mission.figures.radio import beliefs
from mission.log.records import UNKNOWN_ROUND
from mission.log.values import Devices, FlightData, PlannedPlaces, Zone

SIZE_M = np.array([9.0, 9.0])


def square(side_m: float, at_m: float = 0.0) -> np.ndarray:
    return at_m + side_m * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_a_map_is_of_all_points_and_a_twenty_fifth_more_on_each_side() -> None:
    frame = MapFrame.around([np.array([[0.0, 50.0]]), np.array([[200.0, 150.0]])], [], 432.0)
    assert (frame.width, frame.height) == (432.0, pytest.approx(432.0 * 116 / 216))
    assert frame.pixel_m == pytest.approx(0.5)
    at_m = np.array([[-8.0, 158.0], [208.0, 42.0], [92.0, 100.0]])
    assert frame.pixels(at_m) == pytest.approx(np.array([[0.0, 0.0], [432.0, 232.0], [200, 116]]))
    assert frame.shows(at_m)
    for beside_m in ([-8.1, 100.0], [208.1, 100.0], [92.0, 41.9], [92.0, 158.1]):
        assert not frame.shows(np.array(beside_m))
        assert not frame.shows(np.array([[92.0, 100.0], beside_m]))
    # A place alone has a metre's share of air.
    alone = MapFrame.around([np.array([[5.0, 5.0]])], [], 100.0)
    assert alone.pixel_m == pytest.approx(0.08 / 100.0)


@pytest.mark.parametrize(("side_m", "shown"), [(219.0, True), (221.0, False)])
def test_a_fence_is_shown_that_leaves_the_rest_large_enough(side_m: float, shown: bool) -> None:
    frame = MapFrame.around([square(100.0)], [square(side_m), square(5.0, -20.0)], 100.0)
    assert frame.shows(square(side_m)) == shown
    assert frame.shows(square(5.0, -20.0))
    # Of a flight and a fence the longer side counts, whichever it is.
    for turned in (slice(None), slice(None, None, -1)):
        flown, fence = (square(100.0) * (1.0, 0.1))[:, turned], square(side_m) * (0.5, 1.0)
        assert MapFrame.around([flown], [fence], 100.0).shows(fence) == shown
        assert MapFrame.around([flown], [fence[:, ::-1]], 100.0).shows(fence[:, ::-1]) == shown


def test_outlines_are_closed() -> None:
    ring, hole = square(4.0), square(2.0, 1.0)
    found = edges([ring], [hole], (30.0, 20.0))
    assert [(kind, number) for kind, number, _ in found] == [
        ("area", 0), ("fence", 0), ("no-fly area", 0)
    ]  # fmt: skip
    assert found[0][2].tolist() == [[0, 0], [30, 0], [30, 20], [0, 20], [0, 0]]
    for line, points in zip(found[1:], (ring, hole), strict=True):
        assert line[2].tolist() == [*points.tolist(), points[0].tolist()]
    assert [kind for kind, *_ in edges([ring], [], None)] == ["fence"]


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        ({}, "pond from 0 m"), ({"from_m": 20.0}, "pond from 20 m"),
        ({"to_m": 40.0}, "pond up to 40 m"), ({"from_m": 20.0, "to_m": 40.5}, "pond 20 to 40.5 m"),
    ],
)  # fmt: skip
def test_an_area_that_is_passed_above_or_below_has_its_heights(heights: Any, words: str) -> None:
    zone = {"name": "pond", "polygon_m": square(4.0).tolist(), **heights}
    assert [of[1:] for of in named_areas([square(5.0)], [zone])] == [(words, True)]
    assert [of[1:] for of in named_areas([square(4.0)], [zone])] == [("pond", False)]


def flight(**more: Any) -> FlightData:
    """East at 1 m/s for 40 s, with the eighth to the twelfth second's turn 5 m to the north."""
    t_s = np.arange(0.0, 40.1, 0.1)
    north_m = np.interp(t_s, (8.0, 10.0, 12.0), (0.0, 5.0, 0.0))
    return replace(bare_flight(t_s, np.column_stack((t_s, north_m, 0 * t_s + LOW_M))), **more)


def drawn(run: FlightData) -> list[tuple[str, int, list[list[float]]]]:
    return [(kind, n, np.round(at, 3).tolist()) for kind, n, at in run_lines(run, run.plans)]


def test_a_flight_without_passes_is_one_line_and_broken_in_holes() -> None:
    planned = PlannedPlaces("a plan", {}, (), frozenset(), in_holes=False)
    way = [[0, 0], [8, 0], [10, 5], [12, 0], [40, 0]]
    assert drawn(flight(planned=planned)) == [("flown", 0, way)]
    run = flight(planned=planned)
    kept = (run.truth.t_ns <= 20 * 10**9) | (run.truth.t_ns >= 30 * 10**9)
    holed = replace(run, truth=run.truth.at(run.truth.t_ns[kept]))
    assert drawn(holed) == [("flown", 0, [*way[:4], [20, 0]]), ("flown", 0, [[30, 0], [40, 0]])]
    # A run has the outline of its area.
    assert [kind for kind, *_ in run_lines(flight(), [])] == ["area"]


@pytest.mark.parametrize(("until_s", "rests"), [(36.9, True), (37.1, False), (40.0, False)])
def test_what_is_flown_after_the_last_place_counts_from_three_metres_on(until_s, rests) -> None:
    planned = PlannedPlaces("a plan", {}, (), frozenset(), in_holes=False)
    record = replace(UNKNOWN_ROUND, round=1, start_t_s=14.0, duration_s=until_s - 14.0)
    run = flight(planned=planned, rounds=(record,))
    expected = [("after the last place", 0, [[until_s, 0], [40, 0]])] if rests else []
    assert drawn(run) == expected


def test_buildings_are_the_darker_the_higher_and_open_in_their_courts() -> None:
    frame = MapFrame(np.zeros(2), np.full(2, 100.0), 100.0)
    rings = (square(30.0), square(5.0, 5.0), square(5.0, 15.0))
    house, hut = Building(rings, 30.0), Building((square(9.0, 50.0),), 6.0)
    spec = described(frame.finished(frame.buildings([house, hut]), {"text": ""}))
    high = rows(spec, "height")
    assert [(r["part"], r["height"]) for r in high] == [(0, 30.0)] * 5 + [(1, 6.0)] * 5
    courts = [r for table in tables(spec, "part") if "height" not in table[0] for r in table]
    assert [(r["part"], r["x"], r["y"]) for r in courts] == [
        (n, *at) for n, ring in enumerate(rings[1:]) for at in (*ring.tolist(), ring[0].tolist())
    ]
    opacity = next(layer["encoding"]["opacity"] for layer in layers(spec))["scale"]
    assert opacity["domain"] == [0.0, 30.0]
    assert opacity["range"][0] < opacity["range"][1]


def grid(seed: int, count: int = 4) -> PerGrid:
    success = np.random.default_rng(seed).uniform(0.0, 1.0, (2, count, count + 1))
    return PerGrid(success, (1.0, 2.0), 3.0)


def test_a_belief_is_of_the_device_that_it_changed_most_in_and_of_few_rounds() -> None:
    """Each is told before its round begins; of seven rounds those that are looked at."""
    records = [replace(UNKNOWN_ROUND, round=n, start_t_s=5.0 * n - 1.0, duration_s=4.0)
               for n in range(1, 8)]  # fmt: skip
    told = [grid(n) for n in range(7)]
    told[-1].success[1] = told[0].success[1]
    told[-1].success[0] = 1.0 - told[0].success[0]
    run = flight(
        rounds=tuple(records), devices=Devices(np.array([[2.0, 3.0], [4.0, 5.0]]), ("a", "a")),
        radio_true=grid(9), radio_believed=tuple((round((5 * n + 3.5) * 1e9), of)
                                                 for n, of in enumerate(told)),
    )  # fmt: skip
    panels = [described(panel) for panel in beliefs(run)]
    assert [panel["title"]["text"] for panel in panels] == [
        *(f"Device 0, believed as round {n} began" for n in (1, 2, 4, 7)), "Device 0, true"
    ]  # fmt: skip
    for panel, of in zip(panels, (told[0], told[1], told[3], told[6], run.radio_true), strict=True):
        assert of is not None
        cells = rows(panel, "per")
        assert [r["per"] for r in cells] == np.round(1.0 - of.success[0].ravel(), 2).tolist()
        corners = [(r["x"], r["y"]) for r in cells]
        assert corners == [
            (1 + 3 * (i - 0.5), 2 + 3 * (j - 0.5)) for j in range(4) for i in range(5)
        ]
        for r in cells:
            assert 3.0 < r["x2"] - r["x"] < 3.0 + 0.1
            assert 3.0 < r["y2"] - r["y"] < 3.0 + 0.1
        (mark,) = (t for t in tables(panel, "round", "x") if "kind" not in t[0])
        assert [(r["x"], r["y"]) for r in mark] == [(2.0, 3.0)]
    assert beliefs(replace(run, radio_true=None)) == []
    assert beliefs(replace(run, radio_believed=())) == []
    # Where cells are more than can be told apart, each so manieth is drawn, as large.
    many = grid(3, 83)
    (first, true) = map(
        described, beliefs(replace(run, radio_believed=((1, many),), radio_true=many))
    )
    assert [r["per"] for r in rows(first, "per")] == np.round(
        1.0 - many.success[0, ::3, ::3].ravel(), 2
    ).tolist()
    assert rows(true, "per")[1]["x"] == 1.0 + 9.0 * 0.5


def test_a_map_of_a_run_has_its_area_and_one_of_a_plan_its_home() -> None:
    run = flight(fence=(Zone(square(50.0, -3.0), keep_in=True),))
    for of, low_m, high_m in (
        (run, (-3.0, -3.0), (47.0, 47.0)),
        (replace(run, fence=()), (0.0, 0.0), (40.0, 9.0)),
        (replace(run, fence=(), planned=PlannedPlaces("", {}, (), frozenset(), in_holes=False)),
         (0.0, 0.0), (40.0, 5.0)),
    ):  # fmt: skip
        frame = run_frame(of, 100.0)
        air = 0.04 * max(np.subtract(high_m, low_m))
        corners = np.array([np.subtract(low_m, air), np.add(high_m, air)])
        assert frame.pixels(corners) == pytest.approx(
            np.array([[0.0, frame.height], [100.0, 0.0]]), abs=1e-6
        )
