"""What C counts of a flight, how limits weigh it, and what a limit of another kind takes."""

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import pytest
from one_aircraft import one_path, round_problem

from fl.radio.channel import CHANNEL_PRESETS
from mission.planner.flyable import foresee_round
from mission.planner.limits import LIMITS, Deadline, Energy, Limit, RoundLimits
from mission.planner.native.rounds import COUNTED
from mission.planner.performance import Foreseen, Performance

PAPER = Performance(20.0, 5.0, None)  # always at 20 m/s
# 300 m east, 400 m north (a quarter to the left), 500 m back (over by 180 - 53.13 degrees).
WAY = np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 400.0], [0.0, 0.0]])
TURNED_RAD = math.pi / 2 + math.pi - math.atan2(3.0, 4.0)
SENT_S = np.array([6.0, 10.0])


def test_what_is_counted_of_a_flight() -> None:
    found = PAPER.foresee(WAY, [0.0, 6.0, 10.0, 0.0], 5.0)
    assert found.duration_s == pytest.approx(1200.0 / 20.0 + 16.0)
    assert found.flown_m == pytest.approx(1200.0)
    assert found.hovered_s == 16.0
    assert found.turned_rad == pytest.approx(TURNED_RAD)
    alone = PAPER.foresee(WAY[:1], [3.0], 5.0)
    assert (alone.flown_m, alone.hovered_s, alone.turned_rad) == (0.0, 3.0, 0.0)


@pytest.mark.parametrize(
    ("weights", "taken"),
    [
        ({"flown_m": 1.0}, 1200.0),
        ({"hovered_s": 1.0}, 16.0),
        ({"turned_rad": 180.0 / math.pi}, math.degrees(TURNED_RAD)),
        ({"duration_s": 2.0, "flown_m": 0.5, "hovered_s": 3.0}, 152.0 + 600.0 + 48.0),
    ],
)
def test_a_limit_of_another_kind_is_weighed_in_c(
    weights: Mapping[str, float], taken: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Other(Limit):
        name, key, unit, digits = "duration_s", "other", "x", 1  # in the place of a deadline
        counted: ClassVar = weights

    monkeypatch.setattr("mission.planner.limits.LIMITS", (Other,))
    for most, fits in ((taken * 1.001, True), (taken * 0.999, False)):
        limits = RoundLimits(PAPER, most)
        given = round_problem(
            WAY[1:3], np.ones(2), WAY[0], 4, 1, 2000.0, CHANNEL_PRESETS["suburban"],
            limits=limits, upload_s=SENT_S,
        )  # fmt: skip
        plan = one_path(WAY, np.array([[0, 0], [1, 0], [0, 1], [0, 0]]), 1.0)
        share = given.as_judged.judged(plan.as_candidate).share
        assert share == pytest.approx(taken / most)
        flight = foresee_round(given, plan)
        assert limits.share(flight) == pytest.approx(share)
        assert limits.fits(flight) == fits
        assert limits.excess(flight) == (
            "" if fits else f"the flight takes {taken:.1f} x, allowed are {most:g}"
        )
        # What is left of it once half of the round is over.
        half = {name: amount / 2 for name, amount in vars(flight).items() if name != "arrived_s"}
        assert limits.less(half).duration_s == pytest.approx(most - taken / 2)


def test_the_limits_that_there_are() -> None:
    assert (Deadline, Energy) == LIMITS
    assert len({kind.name for kind in LIMITS}) == len({kind.key for kind in LIMITS}) == 2
    assert RoundLimits(PAPER).each == ()
    (joules,) = RoundLimits(PAPER, energy_j=5.0).each
    assert (joules.name, joules.most) == ("energy_j", 5.0)
    assert COUNTED == 5


def test_what_limits_count_and_what_is_left_of_them() -> None:
    assert Deadline.of({}) == Energy.of({"duration_s": 5.0}) == 0.0
    assert Energy.of({"duration_s": 5.0, "energy_j": 7.0}) == 7.0
    assert Deadline(10.0, PAPER).hover(3.0) == 3.0
    assert Energy(10.0, PAPER).hover(3.0) == pytest.approx(PAPER.hover_j(3.0))
    both = RoundLimits(PAPER, 10.0, 5e3)
    left = both.less({"duration_s": 3.0, "energy_j": 1e3, "flown_m": 9.0})
    assert (left.duration_s, left.energy_j) == (7.0, 4e3)
    assert RoundLimits(PAPER, 10.0).less({"energy_j": 1.0}) == RoundLimits(PAPER, 10.0)
    assert both.longest_s == min(10.0, 5e3 / PAPER.least_w)
    assert RoundLimits(PAPER, energy_j=500.0).longest_s == 500.0 / PAPER.least_w
    assert RoundLimits(PAPER).longest_s == RoundLimits(PAPER).longest_m() == math.inf
    assert both.longest_m() == 200.0
    assert RoundLimits(PAPER, 10.0, PAPER.least_j(90.0)).longest_m() == pytest.approx(90.0)


def test_limits_are_kept_to_a_billionth() -> None:
    limits = RoundLimits(PAPER, 10.0, 5e3)
    for seconds, joules, words in (
        (10.0 * (1.0 + 0.9e-9), 5e3 * (1.0 + 0.9e-9), ""),
        (10.0 * (1.0 + 1.1e-9), 4e3, "the flight takes 10.00 s, allowed are 10"),
        (9.0, 5001.0, "the flight takes 5001 J, allowed are 5000"),
    ):
        flight = Foreseen(np.zeros(1), seconds, joules)
        assert limits.excess(flight) == words
        assert limits.fits(flight) == (not words)
        assert limits.share(flight) == pytest.approx(max(seconds / 10.0, joules / 5e3), rel=1e-12)
    assert RoundLimits(PAPER).share(flight) == 0.0


def test_a_limit_of_which_no_more_is_said_bounds_nothing() -> None:
    class Other(Limit):
        name, key, unit, digits = "flown_m", "metres", "m", 1
        counted: ClassVar = {"flown_m": 1.0}

    other = Other(5.0, PAPER)
    assert (other.least(9.0), other.longest_m(3.0), other.longest_s) == (0.0, math.inf, math.inf)
    assert other.hover(3.0) == 0.0
    assert (other.budget, other.needs_power) == ("", False)
