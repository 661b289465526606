"""Aircraft of a round keep apart at all times of their flights as foreseen."""

import dataclasses
import json
import math
import re
from typing import Any

import numpy as np
import pytest

from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base.errors import InfeasiblePlanError, PlanInputError
from mission.config.vehicles import MOST
from mission.planner.apart import STEP_S, nearest, nearest_of, too_near, tracks_of
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import check_problem
from mission.planner.factory import make_planner
from mission.planner.files import NamedPlan, plans_as_json, problems_of
from mission.planner.fleet import mending
from mission.planner.fleet.mending import kept_apart
from mission.planner.fleet.parts import alone_of
from mission.planner.flyable import foresee_round, stops_of
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem, Start

GUIDED, RIGID = Performance(20.0, 5.0, LimitsConfig()), Performance(20.0, 5.0, None)


def drawn(seed: int, *, apart_m: float = 25.0, aircraft: int = 3, **own: Any) -> RoundProblem:
    """Aircraft that start in a row in the middle."""
    rng = np.random.default_rng(seed)
    usual = {"path_budget_m": 400.0, "limits": RoundLimits(GUIDED)}
    return RoundProblem(
        devices_m=rng.uniform(0, 800, (12, 2)), importance=rng.uniform(0.2, 1.0, 12),
        starts=tuple(
            Start(np.array([400.0 + apart_m * a, 400.0]), **{**usual, **own})
            for a in range(aircraft)
        ),
        steps=6, per_step=3, channel=CHANNEL_PRESETS["suburban+10dB"], separation_m=20.0,
    )  # fmt: skip


def planned(problem: RoundProblem) -> RoundPlan:
    made = make_planner(PlannerConfig(gap=0.03)).plan(problem)
    check_plan(problem, made)
    return made


def along(problem: RoundProblem, *ways: Any, **own: Any) -> RoundPlan:
    """A plan along waypoints of each, which serves nobody."""
    paths = tuple(PlannedPath(np.array(way, dtype=np.float64), **own) for way in ways)
    empty = np.zeros((len(ways), problem.steps, len(problem.devices_m)), dtype=np.bool_)
    return RoundPlan(paths, empty, 0.0)


def crossing(performance: Performance = RIGID, **more: Any) -> RoundProblem:
    """Two aircraft that start 200 m apart in either direction from a crossing."""
    starts = [(-200.0, 0.0), (0.0, -200.0)]
    usual = {
        "devices_m": np.array([[0.0, 0.0]]), "importance": np.ones(1), "steps": 2, "per_step": 1,
        "channel": CHANNEL_PRESETS["suburban"], "separation_m": 20.0,
    }  # fmt: skip
    own = tuple(Start(np.array(at), 500.0, RoundLimits(performance)) for at in starts)
    return RoundProblem(**{**usual, "starts": own, **more})


@pytest.mark.parametrize("performance", [RIGID, GUIDED])
def test_nobody_flies_through_one_that_waits_beside_its_home(performance: Performance) -> None:
    """A pair that starts nearer than it is to keep comes no nearer before it has parted."""
    near = tuple(Start(np.array([5.0 * a, 0.0]), 500.0, RoundLimits(performance)) for a in range(2))
    problem = crossing(starts=near, devices_m=np.array([[150.0, 0.0], [0.0, 150.0]]),
                       importance=np.ones(2))  # fmt: skip
    through, aside = [[0.0, 0.0], [150.0, 0.0]], [[5.0, 0.0], [0.0, 150.0]]
    plan = along(problem, through, aside)
    waits = dataclasses.replace(plan.paths[1], wait_s=3.0)
    plan = dataclasses.replace(plan, paths=(plan.paths[0], waits))
    found = too_near(problem, plan)
    assert found is not None
    assert found.away_m < 0.01
    made = kept_apart(problem, plan)
    assert "m are kept: " in made.mended
    assert "no other" not in made.mended
    assert too_near(problem, made) is None


@pytest.mark.parametrize("behind_m", [0.0, 14.0, 40.0])
def test_the_least_distance_is_that_of_closed_form(behind_m: float) -> None:
    """At equal speeds across each other, one `behind_m` later: behind / sqrt(2)."""
    problem = crossing()
    begin, end = [0.0, -200.0 - behind_m], [0.0, 200.0 - behind_m]
    starts = (problem.starts[0], dataclasses.replace(problem.starts[1], start_m=np.array(begin)))
    problem = dataclasses.replace(problem, starts=starts)
    plan = along(problem, [[-200, 0], [200, 0]], [begin, end])
    found = nearest(problem, plan)
    assert found is not None
    assert found.away_m == pytest.approx(behind_m / math.sqrt(2.0), abs=1e-6)
    assert found.t_s == pytest.approx((200.0 + behind_m / 2.0) / 20.0, abs=1e-6)
    assert (too_near(problem, plan) is None) == (behind_m == 40.0)


@pytest.mark.parametrize(("behind_m", "least_m"), [(40.0, 20.0), (10.0, 0.0), (-30.0, 10.0)])
def test_one_may_be_later_than_the_other(behind_m: float, least_m: float) -> None:
    """By up to a second at 20 m/s: 20 m of what one is behind the other are not relied on."""
    problem = crossing(late_s=1.0)
    begin, end = [0.0, -200.0 - behind_m], [0.0, 200.0 - behind_m]
    starts = (problem.starts[0], dataclasses.replace(problem.starts[1], start_m=np.array(begin)))
    found = nearest(
        dataclasses.replace(problem, starts=starts),
        along(problem, [[-200, 0], [200, 0]], [begin, end]),
    )
    assert found is not None
    assert found.away_m == pytest.approx(least_m / math.sqrt(2.0), abs=1e-6)


@pytest.mark.parametrize(
    ("served_m", "in_step", "late_s", "least_m"),
    [
        (-100.0, False, 0.0, 200.0),  # one is over the crossing at 10 s, the other one at 20 s
        (-100.0, True, 0.0, 0.0),  # both have 100 m left when they go on at 15 s
        (-150.0, True, 0.0, 50.0),
        (-150.0, True, 1.0, 30.0),
    ],
)
def test_in_step_they_go_on_together(
    served_m: float, in_step: bool, late_s: float, least_m: float
) -> None:
    """Across each other, from 200 and 400 m before the crossing; each serves somebody on the way,
    100 m before it, or `served_m`."""
    problem = crossing(
        starts=tuple(
            Start(np.array(at), 900.0, RoundLimits(RIGID)) for at in ([-200.0, 0.0], [0.0, -400.0])
        ),
        devices_m=np.zeros((2, 2)), importance=np.ones(2), steps=3, in_step=in_step, late_s=late_s,
    )  # fmt: skip
    plan = along(problem, [[-200, 0], [served_m, 0], [200, 0]], [[0, -400], [0, -100], [0, 200]])
    schedule = np.zeros((2, 3, 2), dtype=np.bool_)
    schedule[(0, 1), 1, (0, 1)] = True
    found = nearest(problem, dataclasses.replace(plan, schedule=schedule))
    assert found is not None
    assert found.away_m == pytest.approx(least_m / math.sqrt(2.0), abs=1e-6)


@pytest.mark.parametrize(("height_m", "flies"), [(60.0, False), (85.0, True)])
def test_who_hovers_is_kept_away_from(height_m: float, flies: bool) -> None:
    """By one that is left, and has no other path; its height stays as it is."""
    problem = RoundProblem(
        devices_m=np.array([[200.0, 0.0]]), importance=np.ones(1),
        starts=(Start(np.zeros(2), 200.0, RoundLimits(GUIDED)),),
        steps=2, per_step=1, channel=CHANNEL_PRESETS["suburban+10dB"], separation_m=20.0,
        hovering_m=np.array([[100.0, 0.0, height_m], [100.0, 1.0, height_m]]),
    )  # fmt: skip
    made = planned(problem)
    assert (made.waypoints_m[1, 0] > 100.0) == flies
    said = "" if flies else "aircraft 0 and one that hovers come within 0.0 m .* aircraft 0 stays;"
    assert re.search(said, made.mended)
    assert made.altitude_m is None


@pytest.mark.parametrize(("apart_m", "least_m", "kept"), [
    (12.0, None, False), (12.0, 10.0, True), (12.0, 15.0, False), (8.0, 10.0, False),
])  # fmt: skip
def test_who_starts_nearer_keeps_as_much_as_it_has(
    apart_m: float, least_m: float | None, kept: bool
) -> None:
    """Beside each other all the way; None: it counts once one has left."""
    problem = crossing(
        starts=tuple(
            Start(np.array([-200.0, y]), 500.0, RoundLimits(RIGID), name=name)
            for y, name in ((0.0, "north"), (apart_m, "south"))
        ),
        least_m=least_m,
    )
    plan = along(problem, [[-200, 0], [0, 0]], [[-200, apart_m], [0, apart_m]])
    found = too_near(problem, plan)
    assert (found is None) == kept
    if found is not None:
        assert found.words.startswith(f"north and south come within {apart_m:.1f} m")


@pytest.mark.parametrize("hold_s", [0.0, 3.0])
def test_a_plan_of_anybody_is_mended(hold_s: float) -> None:
    """Beside each other to the same place, on the paths that there are."""
    problem = crossing(
        starts=tuple(Start(np.array([-200.0, y]), 500.0, RoundLimits(GUIDED)) for y in (0.0, 5.0)),
        least_m=1.0, importance=np.ones(1),
    )  # fmt: skip
    plan = along(problem, [[-200, 0], [0, 0]], [[-200, 5], [0, 5]])
    problem = dataclasses.replace(problem, separation_m=5.0)
    assert kept_apart(problem, plan, hold_s=hold_s) is plan
    wider = dataclasses.replace(problem, separation_m=20.0, least_m=13.0)
    made = kept_apart(wider, plan, hold_s=hold_s)
    check_plan(wider, made, hold_s=hold_s)
    assert re.search(r"within 5\.0 m of each other .*, 20 m are kept: flown at ", made.mended)
    assert sorted(path.altitude_m or 0.0 for path in made.paths) == [50.0, 70.0]
    narrow = tuple(dataclasses.replace(start, altitudes_m=(59.0, 61.0)) for start in problem.starts)
    made = kept_apart(dataclasses.replace(wider, starts=narrow), plan, hold_s=hold_s)
    assert made.mended.endswith("20 m are kept: no other paths, heights or waits do that")
    assert made.paths == plan.paths


@pytest.mark.parametrize(
    ("count", "apart_m", "own", "height_m", "flown_m"),
    [
        (2, 20.0, {}, None, [50, 70]),  # about the channel's 60 m
        (3, 20.0, {}, None, [40, 60, 80]),
        (2, 7.0, {}, None, [55, 65]),  # ten metres at least
        (2, 20.0, {"altitude_m": 20.0}, None, [10, 30]),
        (2, 20.0, {"altitude_m": 19.9}, None, []),  # not under ten metres
        (2, 20.0, {"altitude_m": 490.0}, None, [480, 500]),
        (2, 20.0, {"altitudes_m": (40.0, 80.0)}, 60.0, [50, 70]),
        (2, 20.0, {"altitudes_m": (40.0, 80.0)}, 45.0, [40, 60]),
        (2, 20.0, {"altitudes_m": (40.0, 80.0)}, 78.0, [60, 80]),
        (3, 20.0, {"altitudes_m": (40.0, 80.0)}, 78.0, [40, 60, 80]),
        (2, 20.0, {"altitudes_m": (40.0, 60.0)}, 59.0, [40, 60]),
        (2, 20.0, {"altitudes_m": (40.0, 59.9)}, 59.0, []),
    ],
)
def test_layers_are_about_what_was_planned_as_far_as_may_be_flown(
    count: int, apart_m: float, own: dict[str, Any], height_m: float | None, flown_m: list[float]
) -> None:
    """Beside each other to places side by side, 5 m apart, where nobody may wait for long."""
    starts = tuple(
        Start(np.array([-200.0, 5.0 * a]), 500.0, RoundLimits(GUIDED, 20.0), **own)
        for a in range(count)
    )
    problem = crossing(starts=starts, least_m=apart_m, separation_m=apart_m)
    ways = [[[-200, 5 * a], [0, 5 * a]] for a in range(count)]
    made = kept_apart(problem, along(problem, *ways, altitude_m=height_m))
    if flown_m:
        assert sorted(path.altitude_m or 0.0 for path in made.paths) == flown_m
        heights = ", ".join(f"{path.altitude_m:g}" for path in made.paths)
        assert f"{apart_m:g} m are kept: flown at {heights} m; " in made.mended
    else:
        assert "flown at" not in made.mended


def test_a_wait_and_a_height_part_what_crosses() -> None:
    problem = crossing(GUIDED)
    plan = along(problem, [[-200, 0], [200, 0]], [[0, -200], [0, 200]])
    with pytest.raises(
        InfeasiblePlanError, match=r"aircraft 0 and aircraft 1 come within 0\.\d m .* is 20"
    ):
        check_plan(problem, plan)
    first, second = plan.paths
    later = dataclasses.replace(second, wait_s=5.0)
    higher = dataclasses.replace(second, altitude_m=70.0)
    lower = dataclasses.replace(first, altitude_m=50.0)
    for paths in ((first, later), (lower, higher)):
        check_plan(problem, dataclasses.replace(plan, paths=paths))
    assert too_near(problem, dataclasses.replace(plan, paths=(first, higher))) is not None
    wrong = dataclasses.replace(plan, paths=(first, dataclasses.replace(second, altitude_m=71.0)))
    with pytest.raises(InfeasiblePlanError, match="60 m, and layers up to 10 m from it"):
        check_plan(problem, wrong)


def test_tracks_are_at_the_stops_when_they_are_foreseen_to_be() -> None:
    problem = dataclasses.replace(drawn(3), upload_s=np.full(12, 2.0))
    made = planned(problem)
    for a, (track,) in enumerate(tracks_of(problem, made)):
        one, part = problem.alone(a), made.alone(a)
        flight, stops = foresee_round(one, part), stops_of(part, upload_s=problem.upload_s)
        for at_s, stop in zip(flight.arrived_s, stops, strict=True):
            away_m = np.hypot(*(track[round(at_s / STEP_S), :2] - stop.xy_m))
            assert away_m <= (0.6 if stop.hold_s else 5.0)
        assert np.hypot(*(track[-1, :2] - stops[-1].xy_m)) < 1e-9
        speed = np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1) / STEP_S
        assert speed.max() <= 20.0 + 1e-6
        assert np.abs(np.diff(speed)).max() <= 5.0 * STEP_S + 1e-6


def test_a_pair_of_one_step_counts() -> None:
    one, other = (np.array([[x, 0.0, 60.0], [x + by, 0.0, 60.0]]) for x, by in ((0, 2), (30, -4)))
    assert nearest_of([one], [other], 20.0) == pytest.approx((24.0, STEP_S))


def test_a_shared_home_is_excused_until_it_is_left() -> None:
    t = np.arange(0.0, 100.0)[:, None]
    east, west = t * [1.0, 0.0, 0.0], t * [-1.0, 0.0, 0.0]
    away_m, _ = nearest_of([east], [west], 20.0)
    assert away_m == pytest.approx(20.0)
    beside = east + np.array([0.0, 5.0, 0.0])
    away_m, at_s = nearest_of([east], [beside], 20.0)
    assert away_m == pytest.approx(5.0)
    assert at_s == pytest.approx(20.0 * STEP_S, abs=STEP_S)
    still = np.zeros((100, 3))
    assert nearest_of([still], [still], 20.0)[0] == math.inf
    assert nearest_of([still], [east], 20.0)[0] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"altitude_m": 60.0}, "paths are exchanged|flown at"),
        ({"altitudes_m": (59.0, 61.0)}, "paths are exchanged|waits for|stays"),
    ],
)
def test_conflicts_are_mended(own: dict[str, Any], words: str) -> None:
    """Both aircraft leave towards the same two devices, side by side."""
    problem = RoundProblem(
        devices_m=np.array([[150.0, 0.0], [150.0, 12.0]]), importance=np.ones(2),
        starts=tuple(
            Start(np.array([0.0, y]), 160.0, RoundLimits(GUIDED), **own) for y in (0.0, 12.0)
        ),
        steps=2, per_step=1, channel=CHANNEL_PRESETS["suburban+10dB"], separation_m=20.0,
    )  # fmt: skip
    free = planned(dataclasses.replace(problem, separation_m=0.0))
    assert too_near(problem, free) is not None
    made = planned(problem)
    assert re.search(words, made.mended), made.mended
    said = re.search(r"come within \d+\.\d m of each other .* by ([+-]\d+\.\d\d) %$", made.mended)
    assert said is not None
    assert float(said[1]) == pytest.approx(100.0 * (made.value / free.value - 1.0), abs=0.006)
    assert made.value >= 0.4 * free.value


def test_whom_no_wait_helps_stays() -> None:
    """A start in the way of the other's only path, at one height alone."""
    problem = RoundProblem(
        devices_m=np.array([[100.0, 0.0], [0.0, 0.0]]), importance=np.ones(2),
        starts=tuple(
            Start(np.array([x, 0.0]), 300.0, RoundLimits(GUIDED), altitudes_m=(59.0, 61.0))
            for x in (0.0, 40.0)
        ),
        steps=2, per_step=1, channel=CHANNEL_PRESETS["suburban+10dB"], separation_m=30.0,
    )  # fmt: skip
    made = planned(problem)
    assert made.value > 1.0


def test_separation_is_of_files_too() -> None:
    entry = {
        "id": "a", "devices": [[0, 0]], "importance": [1.0], "steps": 2, "per_step": 1,
        "vehicles": [{"start": [-200, 0]}, {"start": [0, -200]}], "path_budget_m": 500,
        "channel": dataclasses.asdict(CHANNEL_PRESETS["suburban"]), "separation_m": 20,
    }  # fmt: skip
    (named,) = problems_of([entry], "p")
    assert named.problem.separation_m == 20.0
    assert all(start.limits is not None for start in named.problem.starts)
    plan = along(named.problem, [[-200, 0], [200, 0]], [[0, -200], [0, 200]], wait_s=5.0)
    plan = dataclasses.replace(plan, mended="aircraft 0 and 1 ...")
    made = json.loads(json.dumps(plans_as_json([NamedPlan("a", plan, 0.1)])))["a"]
    assert made["mended"] == plan.mended
    assert [each["wait_s"] for each in made["vehicles"]] == [5.0, 5.0]
    with pytest.raises(PlanInputError, match=r"separation_m"):
        problems_of([{**entry, "separation_m": -1}], "p")
    starts = tuple(dataclasses.replace(start, limits=None) for start in named.problem.starts)
    with pytest.raises(PlanInputError, match="separation_m needs limits of each"):
        check_problem(dataclasses.replace(named.problem, starts=starts))


def test_as_many_as_a_run_may_have_are_planned() -> None:
    problem = drawn(1, apart_m=5.0, aircraft=MOST)
    assert planned(dataclasses.replace(problem, separation_m=0.0)).schedule.any()


def test_of_many_not_all_exchanges_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 have 20! of them, each with ways that may be turned."""
    count, tried = MOST, 0

    def none(*_: Any, **__: Any) -> None:
        nonlocal tried
        tried += 1

    monkeypatch.setattr(mending, "part_along", none)
    problem = drawn(1, aircraft=count)
    plan = along(problem, *([start.start_m] * problem.steps for start in problem.starts))
    case = mending._Mending(problem, alone_of(problem), plan, 0.0)
    assert not list(case.exchanged())
    assert 0 < tried <= 24 * 2**4 * count
