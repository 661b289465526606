"""What the C code must not be given is refused before it is."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fl.native import library as learning
from fl.radio.per_grid import PerGrid
from flightdyn.native.ticks import Gauges
from mission.planner.native import library as planner
from mission.planner.native.crews import MOST_AIRCRAFT, Crew, polished, search_orders
from native.loading import address

NET = learning.Network((6, 6, 1), (2,), (3,), (1,), (4,))
WEIGHTS = np.zeros(NET.parameters, np.float32)


def images(count=5, **changes):
    given = {
        "pixels": np.zeros((count, 6, 6, 1), np.uint8),
        "labels": np.zeros(count, np.int64),
        "scale": np.ones(1, np.float32),
        "shift": np.zeros(1, np.float32),
    }
    return learning.Images(**{**given, **changes})


@pytest.mark.parametrize(
    ("array", "dtype", "shape", "written"),
    [
        (np.zeros(3, np.float32), np.float64, (3,), False),
        (np.zeros(3), np.float64, (4,), False),
        (np.zeros(6)[::2], np.float64, (3,), False),
        (np.zeros((3, 2)).T, np.float64, (2, 3), False),
        (np.frombuffer(bytes(24)), np.float64, (3,), True),
    ],
)
def test_an_array_that_is_not_what_it_should_be(array, dtype, shape, written):
    with pytest.raises(ValueError, match="the native code takes a contiguous array of"):
        address(array, dtype, shape, written=written)


@pytest.mark.parametrize(
    "changes",
    [
        {"pixels": np.zeros((5, 6, 7, 1), np.uint8)},
        {"pixels": np.zeros((5, 6, 6, 1))},
        {"labels": np.array([0, 1, 2, 3, 4])},
        {"labels": np.array([0, 1, 2, 3, -1])},
        {"labels": np.zeros(4, np.int64)},
        {"scale": np.ones(2, np.float32)},
    ],
)
def test_images_that_do_not_fit(changes):
    with pytest.raises(ValueError, match=r"labels must be|the native code takes"):
        learning.count_correct(NET, images(**changes), WEIGHTS)


@pytest.mark.parametrize("order", [[[5]], [[-1]], np.empty((0, 1))])
def test_an_order_of_images_that_are_not_there(order):
    with pytest.raises(ValueError, match="every step needs images"):
        learning.train(
            NET, images(), np.array(order, np.int64), WEIGHTS, correction=None,
            rates=(0.1, 0.9, 0.0),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("image", "channels", "kernels", "pools", "hidden"),
    [
        ((6, 6, 1), (2,), (4,), (1,), (4,)),
        ((6, 6, 1), (2,), (3,), (3,), (4,)),
        ((6, 6, 1), (2, 2), (3,), (1,), (4,)),
        ((6, 6, 1), (2,) * 9, (3,) * 9, (1,) * 9, (4,)),
        ((6, 6, 1), (2,), (3,), (1,), ()),
        ((2, 2, 1), (2,), (5,), (0,), (4,)),
    ],
)
def test_a_network_that_the_code_cannot_do(image, channels, kernels, pools, hidden):
    with pytest.raises(ValueError, match=r"blocks and|each block|not a network"):
        learning.Network(image, channels, kernels, pools, hidden)


def test_a_network_counts_its_parameters_right():
    assert NET.parameters == 2 * 10 + 4 * 19


def devices(count):
    return planner.Devices(np.zeros((count, 2)), np.ones(count), np.zeros((3, 3)))


def test_problems_that_the_search_cannot_take():
    unread: Any = None  # refused before the relaxation is looked at
    limits = planner.PathLimits(3, 1, 100.0)
    plan = planner.Found(1.0, np.zeros((3, 2)), np.zeros(41, np.int64), 2.0)
    goal = planner.Goal(0.1, 1)
    with pytest.raises(ValueError, match="41 devices: a search takes at most 40"):
        search_orders([Crew(devices(41), limits, unread)], plan=plan, goal=goal)
    wrong: dict[str, Any] = {"way": np.zeros((2, 2)), "assigned": np.full(41, 3), "value": 0.0}
    for what, value in wrong.items():
        with pytest.raises(ValueError, match=r"must be from|takes a contiguous|nothing to"):
            planner.search_places(
                devices(41), limits, plan=replace(plan, **{what: value}), goal=goal
            )
    for gap, nodes, most_open in ((1.0, 1, 1), (0.1, -1, 1), (0.1, 1, 0)):
        with pytest.raises(ValueError, match="nothing to search for"):
            planner.Goal(gap, nodes, max_open=most_open)
    for bad in (
        planner.PathLimits(1, 1, 1.0),
        planner.PathLimits(2, 0, 1.0),
        planner.PathLimits(2, 1, 0.0),
    ):
        with pytest.raises(ValueError, match="nothing to move for"):
            planner.explore(devices(2), bad, starts=1, tries=1)
    with pytest.raises(ValueError, match="no device"):
        planner.explore(devices(0), limits, starts=1, tries=1)
    with pytest.raises(ValueError, match="must be finite"):
        planner.assign(np.array([[np.nan]]), np.ones(1), 1)


def test_tables_that_the_search_cannot_take():
    right = {
        "radii_m": np.array([0.0, 50.0, 90.0]), "coefficients": np.ones((3, 4)),
        "spacing": np.ones(3), "ends": np.array([[0, 1], [0, 2], [1, 2]]),
        "row": np.array([[-1, 0, 1], [-1, -1, 2], [-1, -1, -1]]), "ladder": np.array([1, 2, 2]),
        "promise": np.ones((2, 3)),
    }  # fmt: skip
    planner.Relaxation(**right).as_c(2)
    for wrong, words in (
        ({"coefficients": np.ones((3, 3))}, "splines of 3 coefficients between 3 radii"),
        ({"radii_m": np.arange(128.0)}, "splines of 4 coefficients between 128 radii"),
        ({"ends": right["ends"] + 1}, "ends must be from 0 to 2"),
        ({"ends": right["ends"] - 1}, "ends must be from 0 to 2"),
        ({"ladder": right["ladder"] + 1}, "ladder must be from 0 to 2"),
        ({"row": right["row"] + 1}, "row must be from 0 to 2"),
        ({"row": right["row"] - 1}, "row must be from 0 to 2"),
        ({"promise": np.ones((3, 3))}, "takes a contiguous array of float64"),
    ):
        with pytest.raises(ValueError, match=words):
            planner.Relaxation(**{**right, **wrong}).as_c(2)
    for cell_m, places in ((0.0, (2, 2)), (10.0, (1, 2)), (10.0, (2, 1))):
        grid = PerGrid(np.ones((2, *places)), (0.0, 0.0), cell_m)
        with pytest.raises(ValueError, match=f"no grid: {places[0]} x {places[1]} places every"):
            replace(devices(2), grid=grid).as_c()
    replace(devices(2), grid=PerGrid(np.ones((2, 2, 2)), (0.0, 0.0), 0.1)).as_c()
    crew = Crew(devices(2), planner.PathLimits(3, 1, 100.0), planner.Relaxation(**right))
    other = replace(crew, limits=planner.PathLimits(4, 1, 100.0))
    for crews in (
        [crew, other],
        [crew] * (MOST_AIRCRAFT + 1),
        [crew, replace(crew, devices=devices(3))],
    ):
        with pytest.raises(
            ValueError, match=f"1 to {MOST_AIRCRAFT} aircraft with the same devices"
        ):
            polished(crews, np.zeros((len(crews), 3, 2)))
    assert polished([crew] * MOST_AIRCRAFT, np.zeros((MOST_AIRCRAFT, 3, 2)))[0] == 0.0


def test_a_goal_is_met_at_its_gap_or_slack_and_leaves_nodes():
    plan = planner.Found(0.9, np.zeros((3, 2)), np.zeros(2, np.int64), 1.0, nodes=10)
    assert plan.gap == pytest.approx(0.1)
    assert replace(plan, bound=0.0).gap == 0.0
    assert planner.Goal(0.1, 30).met_by(plan)
    assert not planner.Goal(0.0999, 30).met_by(plan)
    assert planner.Goal(0.0, 30, slack=0.1).met_by(plan)
    assert not planner.Goal(0.0, 30, slack=0.0999).met_by(plan)
    goal = planner.Goal(0.05, 30)
    assert goal.left(plan, 30) == planner.Goal(0.05, 20, max_open=80)  # 4 for each node
    assert goal.left(plan, 15) == planner.Goal(0.05, 5, max_open=20)
    assert goal.left(plan, 11) == planner.Goal(0.05, 1, max_open=4)
    assert goal.left(plan, 10) is None
    assert planner.Goal(0.1, 30).left(plan, 30) is None
    nothing = replace(plan, value=0.0)
    assert goal.left(nothing, 30) is None
    assert planner.Goal(0.05, 30, scale=1.0).left(nothing, 30) is not None
    few = planner.Goal(0.05, 30, max_open=7)
    for aircraft, most_open in ((1, 7), (2, 3), (8, 1)):
        assert few.left(plan, 30, aircraft) == planner.Goal(0.05, 20, max_open=most_open)


def test_a_gauge_that_shows_no_number_is_an_error():
    gauges = Gauges([(lambda: -1.0, 0.0, 1.0), (lambda: "high", 0.0, 1.0)])  # type: ignore[list-item,return-value]
    with pytest.raises(TypeError, match="must be real number, not str"):
        gauges.read()
    gauges.bind([lambda: -1.0, lambda: 2.0])
    assert gauges.read() == [-1.0, 2.0]
