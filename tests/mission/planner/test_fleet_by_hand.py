"""Parts of joint plans, shares of devices and owners, by numbers of their own."""

from typing import Any

import numpy as np
import pytest
from test_joint_plans import alone, drawn

from fl.radio.channel import CHANNEL_PRESETS, average_per
from mission.planner.evaluate import finish
from mission.planner.fleet.parts import brought, masked, one_of_each, part_along, served, taken
from mission.planner.fleet.parts import total as total_of
from mission.planner.fleet.team import owners, partitions, team_of
from mission.planner.fleet.within import best_of, completed
from mission.planner.native.library import Found
from mission.planner.problem import RoundProblem, Start

DEVICES = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 300.0], [100.0, 300.0], [60.0, 300.0]])
WORTH = np.array([1.0, 0.8, 0.6, 0.4, 0.2])


def two() -> RoundProblem:
    """Starts at 0 and 300 m to the east, from which 100 m to the north may be flown; a device each
    at both ends, and one on the way, of two steps with a place each."""
    starts = tuple(Start(np.array([0.0, east_m]), 100.0) for east_m in (0.0, 300.0))
    return RoundProblem(
        devices_m=DEVICES, importance=WORTH, starts=starts, steps=2, per_step=1,
        channel=CHANNEL_PRESETS["suburban+10dB"],
    )  # fmt: skip


def sides(part: Any) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(part == a).tolist()) for a in set(part.tolist())}


@pytest.mark.parametrize(
    ("worth", "aircraft", "expected"),
    [
        # From each twelfth of a turn on; the bearings are 10, 100, 190 and 280 degrees.
        ((1, 1, 1, 1), 2, [
            "01 23", *["12 30"] * 3, *["01 23"] * 3, *["12 30"] * 3, *["01 23"] * 2,
        ]),
        # Of 6: whose middle lies in the first half.
        ((3, 1, 1, 1), 2, [
            "0 123", *["123 0"] * 3, *["23 01"] * 3, *["30 12"] * 3, *["0 123"] * 2,
        ]),
        ((1, 1, 1, 1), 3, [
            "0 12 3", *["1 23 0"] * 3, *["2 30 1"] * 3, *["3 01 2"] * 3, *["0 12 3"] * 2,
        ]),
    ],
)  # fmt: skip
def test_sectors_are_equal_shares_from_each_twelfth_of_a_turn_on(
    worth: tuple[float, ...], aircraft: int, expected: list[str]
) -> None:
    bearings = np.radians([10.0, 100.0, 190.0, 280.0])
    about_m = np.array([200.0, -100.0])
    devices_m = about_m + 50.0 * np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
    found = list(
        partitions(devices_m, np.array(worth, dtype=float), np.tile(about_m, (aircraft, 1)))
    )
    assert len(found) == 12 + 8
    said = [{frozenset(map(int, group)) for group in words.split()} for words in expected]
    assert [sides(part) for part in found[:12]] == said


def test_owners_are_numbered_by_steps() -> None:
    assigned = np.array([-1, 0, 5, 6, 11, 12])
    found = Found(1.0, np.zeros((3, 6, 2)), assigned, 2.0)
    assert owners(found, 6).tolist() == [-1, 0, 0, 1, 1, 2]


def test_what_a_team_is_promised_bounds_what_it_is_brought() -> None:
    problem = drawn(steps=2, per_step=1, metres=0.0)
    team = team_of(alone(problem))
    far = [np.hypot(*(problem.devices_m - start.start_m).T) for start in problem.starts]
    worth = problem.importance * (1.0 - np.array([average_per(problem.channel, m) for m in far]))
    np.testing.assert_allclose(team.promise, worth, rtol=0.02, atol=1e-3)
    np.testing.assert_array_equal(team.delta, problem.importance)
    best = sorted(team.promise.max(axis=0).tolist())[-4:]  # two aircraft, two steps, a place each
    assert team.first_bound == pytest.approx(sum(best))
    plan = team.plan_along(np.zeros((2, 2, 2)))
    given = team.brought(plan)
    assert plan.bound == team.first_bound
    assert given.sum() == pytest.approx(plan.value, rel=1e-6)
    assert ((given > 0.0).sum(axis=0) <= 1).all()
    np.testing.assert_allclose(given[given > 0.0], worth[given > 0.0], rtol=1e-3)


def test_parts_serve_what_the_others_leave() -> None:
    problem = two()
    one, other = alone(problem)
    north = np.array([100.0, 0.0])
    parts = [
        finish(masked(one, np.arange(5) == 1), np.stack((one.start_m, one.start_m + north))),
        finish(masked(other, np.arange(5) > 2), np.stack((other.start_m, other.start_m + north))),
    ]
    assert [served(part).tolist() for part in parts] == [
        [False, True, False, False, False], [False, False, False, True, True]
    ]  # fmt: skip
    assert taken(parts, 0).tolist() == served(parts[1]).tolist()
    assert taken(parts, 1).tolist() == served(parts[0]).tolist()
    chance = 1.0 - average_per(problem.channel, np.array([0.0, 60.0]))
    np.testing.assert_allclose(brought(one, parts[0]), [0.0, 0.8 * chance[0], 0, 0, 0], rtol=1e-9)
    np.testing.assert_allclose(
        brought(other, parts[1]), [0, 0, 0, 0.4 * chance[0], 0.2 * chance[1]], rtol=1e-9
    )
    assert total_of(parts) == pytest.approx(1.2 * chance[0] + 0.2 * chance[1])
    assert one_of_each(parts) == parts
    assert one_of_each([parts[0], None]) is None
    whole = completed([one, other], parts)  # a start may serve as well; 2 is worth more than 4
    assert [np.flatnonzero(served(part)).tolist() for part in whole] == [[0, 1], [2, 3]]
    assert [part.value > before.value for part, before in zip(whole, parts, strict=True)] == [
        True
    ] * 2
    again = part_along(one, parts[0].waypoints_m, np.ones(5, dtype=bool))
    assert again is not None
    assert np.flatnonzero(served(again)).tolist() == [0, 1]
    assert best_of([parts, whole, whole], 2) == [whole, parts]
    assert best_of([parts, whole], 1) == [whole]


def test_aircraft_hear_alike_at_one_altitude_only() -> None:
    """A search of all together then promises each what the best of them is."""
    one, other = alone(drawn())
    alike = team_of([one, other])
    assert alike.one_radio
    for case in alike.joint:
        np.testing.assert_array_equal(case.relaxation.promise[:, 0], alike.promise.max(axis=0))
    assert not team_of([one, other.at(one.channel.altitude_m + 40.0)]).one_radio
