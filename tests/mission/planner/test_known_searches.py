"""Searches and climbs that are known by every number they end with.

What bounds and random changes come to depends on every line of the search: a slip in a bound that
stays valid, or in a step that still leads uphill, shows nowhere else. Whoever changes a search on
purpose looks whether it got better, and has `python test_known_searches.py` write today's numbers.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_problems import drawn_problem

from fl.radio.channel import CHANNEL_PRESETS
from fl.radio.per_grid import PerGrid
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.planner.altitudes import CertifiedAltitudes
from mission.planner.certified import CertifiedPlanner, branched, case_of
from mission.planner.check import check_plan
from mission.planner.config import PlannerConfig
from mission.planner.evaluate import plan_along
from mission.planner.factory import make_planner
from mission.planner.fleet.joint import first_plans
from mission.planner.fleet.prices import columns_of, search_prices
from mission.planner.fleet.team import team_of
from mission.planner.improving import fitted, varied
from mission.planner.limits import RoundLimits
from mission.planner.native.crews import search_orders
from mission.planner.native.library import Goal
from mission.planner.performance import Performance
from mission.planner.problem import RoundProblem, Start
from mission.planner.sqp import ascended
from mission.planner.timed import timed_bound

KNOWN = Path(__file__).with_name("known_searches.json")
FLYING = Performance(20.0, 5.0, LimitsConfig(), 0.95, (3.0, -2.0), 1.1)
AREAS = Airspace((np.array([[450.0, 300], [600, 300], [600, 560], [450, 560]]),), None, 15.0)
Numbers = list[float]


def searched(seed: int, nodes: int, **more: Any) -> Numbers:
    """Orders and places of one aircraft."""
    channel = CHANNEL_PRESETS[more.pop("channel")]
    case = case_of(drawn_problem(seed, channel=channel, **more))
    found = branched(case, case.explored(20), Goal(1e-4, nodes))
    return [found.value, found.bound, found.nodes]


def team(
    seed: int,
    aircraft: int,
    devices: int,
    steps: int,
    *,
    own: dict[str, Any] | None = None,
    **more: Any,
) -> RoundProblem:
    rng = np.random.default_rng(seed)
    return RoundProblem(
        rng.uniform(0.0, 800.0, (devices, 2)), rng.uniform(0.5, 1.5, devices),
        tuple(
            Start(rng.uniform(0, 800, 2), rng.uniform(300, 500), **own or {})
            for _ in range(aircraft)
        ),
        steps, 2, CHANNEL_PRESETS["suburban"], **more,
    )  # fmt: skip


def joint(*drawn: int) -> Numbers:
    """Orders of several aircraft at once."""
    alone = team(*drawn)
    crew = team_of([alone.alone(a) for a in range(len(alone.starts))])
    found = search_orders(crew.joint, plan=first_plans(crew)[-1], goal=Goal(1e-4, 150))
    return [found.value, found.bound, found.nodes]


def together(*drawn: int, nodes: int = 60, **more: Any) -> Numbers:
    """Prices, packed paths and changes of several aircraft, mended where they come too near."""
    problem = team(*drawn, **more)
    made = make_planner(PlannerConfig(max_nodes=nodes)).plan(problem)
    check_plan(problem, made)
    rest = [path.altitude_m or path.wait_s for path in made.paths]
    return [made.value, made.upper_bound, made.nodes, made.path_m, *rest]


def apart(metres: float) -> dict[str, Any]:
    own = {"limits": RoundLimits(FLYING, 60.0)}
    return {"own": own, "separation_m": metres, "late_s": 1.0, "least_m": 20.0}


def priced(*drawn: int, gap: float = 1e-3) -> Numbers:
    """The bound at prices, with the nodes of its searches, and the prices."""
    given = team(*drawn)
    crew = team_of([given.alone(a) for a in range(len(given.starts))])
    begun = first_plans(crew)[-1]
    found, prices = search_prices(crew, begun, columns_of(crew, begun), Goal(gap, 20_000))
    return [found.value, found.bound, found.nodes, *prices.tolist()]


def higher(seed: int, gap: float = 1e-3, nodes: int = 60, **more: Any) -> Numbers:
    """The plan at the best altitude, and its bound."""
    problem = drawn_problem(seed, **{"altitudes_m": (40.0, 120.0), **more})
    made = CertifiedAltitudes(CertifiedPlanner(gap=gap, max_nodes=nodes)).plan(problem)
    assert made.altitude_m is not None
    return [made.value, made.upper_bound, made.nodes, made.altitude_m]


def limited(seed: int, **more: Any) -> Numbers:
    """The whole plan within limits, from all its beginnings."""
    made = make_planner(PlannerConfig(max_nodes=60)).plan(drawn_problem(seed, **more))
    return [made.value, made.upper_bound, made.nodes, made.path_m]


def stepped(seed: int, **more: Any) -> Numbers:
    """Where quadratic programs take a circle to."""
    problem = drawn_problem(seed, channel=CHANNEL_PRESETS["suburban+10dB"], **more)
    turns = np.linspace(0.0, 6.0, problem.steps)
    circle = problem.start_m + 120.0 * np.column_stack((np.sin(turns), 1.0 - np.cos(turns)))
    begun = plan_along(problem, circle)
    made = ascended(problem, begun)
    return [begun.value, made.value, made.path_m, *made.waypoints_m[-1]]


def foreseen(seed: int, guidance: LimitsConfig | None, radius_m: float) -> Numbers:
    """When a flight is at its stops, what it takes, and where it is on the way."""
    rng = np.random.default_rng(seed)
    flying = Performance(18.0, 5.0, guidance, 0.95, (3.0, -2.0), 1.1)
    way, hold_s = rng.uniform(0, 300, (9, 2)), [2.0, 0, 0, 1.5, 0, 0, 0, 0, 3.0]
    flight = flying.foresee(way, hold_s, radius_m)
    at_m = flying.follow(way, hold_s, radius_m, step_s=7.0, count=12)
    return [*flight.arrived_s.tolist(), flight.duration_s, flight.energy_j, *at_m.ravel().tolist()]


def timed(seed: int, value: float, **more: Any) -> Numbers:
    """The bound where hovers and turns count."""
    rng = np.random.default_rng(seed)
    given = {"upload_s": rng.uniform(1, 5, 7), "ready_in_s": rng.uniform(-20, 20, 7).clip(0)}
    limits = RoundLimits(FLYING, 45.0, more.pop("energy_j", np.inf))
    channel = CHANNEL_PRESETS["suburban+10dB"]
    problem = drawn_problem(
        seed, devices=7, channel=channel, limits=limits, **{**given, **more}
    )  # fmt: skip
    return [timed_bound(problem, value, Goal(1e-3, 120))]


def climbed(seed: int, changes: int, **more: Any) -> Numbers:
    """A plan along a way at random, then after changes at random."""
    rng = np.random.default_rng(seed)
    limits, channel = more.pop("limits", None), CHANNEL_PRESETS["suburban+10dB"]
    problem = drawn_problem(seed, limits=limits, channel=channel, **more)
    way = np.vstack((problem.start_m, rng.uniform(100.0, 700.0, (problem.steps - 1, 2))))
    begun = fitted(problem, way)
    assert begun is not None
    made = varied(problem, begun, changes, tolerance=0.02, seed=seed)
    return [begun.value, begun.path_m, made.value, made.path_m]


def grid(seed: int) -> PerGrid:
    return PerGrid(np.random.default_rng(seed).uniform(0, 1, (8, 9, 8)) ** 2, (0.0, 0.0), 100.0)


UPLOAD_S = np.array([0.0, 2.0, 0.5, 1.0, 3.0, 4.0, 1.5, 0.5])
READY_S = np.array([0.0, 20.0, 5.0, 0.0, 30.0, 0.0, 14.0, 0.0])
CASES: dict[str, Callable[[], Numbers]] = {
    "orders": lambda: searched(1, 150, devices=12, steps=8, channel="suburban"),
    "orders of few places": lambda: searched(
        2, 150, devices=14, steps=7, per_step=1, path_budget_m=400.0, channel="suburban+10dB"
    ),
    "stops that merge": lambda: searched(
        3, 150, devices=16, steps=7, channel="suburban", path_budget_m=500.0
    ),
    "a steep channel": lambda: searched(4, 150, devices=9, steps=9, channel="high-rise"),
    "two places": lambda: searched(5, 100, devices=6, steps=3, channel="suburban"),
    "three places": lambda: searched(6, 150, devices=5, steps=4, channel="high-rise"),
    "places of many devices": lambda: searched(
        7, 60, devices=45, steps=3, per_step=4, channel="suburban+10dB"
    ),
    "two aircraft at once": lambda: joint(8, 2, 7, 4),
    "three aircraft at once": lambda: joint(9, 3, 8, 3),
    "two aircraft": lambda: together(10, 2, 12, 6),
    "two aircraft within limits": lambda: together(
        32, 2, 8, 4, own={"limits": RoundLimits(FLYING, 30.0)}, upload_s=UPLOAD_S
    ),
    "two aircraft in time": lambda: together(
        33, 2, 8, 4, own={"limits": RoundLimits(FLYING, 60.0)}, ready_in_s=READY_S
    ),
    "two aircraft at the best altitudes": lambda: together(
        34, 2, 6, 3, own={"altitudes_m": (40.0, 120.0)}
    ),
    "two aircraft, and no search": lambda: together(10, 2, 12, 6, nodes=0),
    "two aircraft, and hardly a search": lambda: together(10, 2, 12, 6, nodes=1),
    "two aircraft on a grid": lambda: together(39, 2, 8, 3, per_grid=grid(39)),
    "two aircraft that may not move": lambda: together(35, 2, 8, 1),
    "two aircraft that exchange paths": lambda: together(48, 2, 8, 4, **apart(250.0)),
    "three aircraft that wait": lambda: together(41, 3, 8, 4, **apart(150.0)),
    "prices of two": lambda: priced(22, 2, 9, 5),
    "prices of three": lambda: priced(23, 3, 7, 5),
    "prices of places": lambda: priced(31, 2, 6, 3, gap=5e-3),
    "altitudes": lambda: higher(24),
    "altitudes of a steep channel": lambda: higher(25, channel=CHANNEL_PRESETS["high-rise"]),
    "a whole plan within limits": lambda: limited(
        26, limits=RoundLimits(FLYING, 35.0), upload_s=UPLOAD_S
    ),
    "a whole plan on a grid": lambda: limited(40, per_grid=grid(40), steps=4),
    "a whole plan around areas": lambda: limited(27, airspace=AREAS),
    "quadratic programs": lambda: stepped(37, devices=20, steps=8),
    "altitudes that are nearly one": lambda: higher(38, 1e-4, 150, altitudes_m=(60.0, 61.6)),
    "altitudes that are hardly more": lambda: higher(38, 1e-4, 150, altitudes_m=(60.0, 62.4)),
    "a flight": lambda: foreseen(28, LimitsConfig(), 5.0),
    "a flight with sharp corners": lambda: foreseen(29, LimitsConfig(), 0.5),
    "a flight at one speed": lambda: foreseen(30, None, 5.0),
    "seconds": lambda: timed(11, 2.0, ready_in_s=None),
    "turns": lambda: timed(12, 2.0, upload_s=None),
    "seconds and turns": lambda: timed(13, 2.0),
    "joules": lambda: timed(14, 2.0, energy_j=6000.0),
    "metres": lambda: climbed(15, 3000),
    "around areas": lambda: climbed(16, 1500, airspace=AREAS),
    "in time": lambda: climbed(17, 1500, limits=RoundLimits(FLYING, 30.0)),
    "with joules": lambda: climbed(18, 1000, limits=RoundLimits(FLYING, 60.0, 6000.0)),
    "all that limits": lambda: climbed(
        19, 1500, limits=RoundLimits(FLYING, 50.0, 9000.0), airspace=AREAS, upload_s=UPLOAD_S,
        ready_in_s=READY_S,
    ),
    "paper": lambda: climbed(
        20, 1500, limits=RoundLimits(Performance(20.0, 5.0, None), 40.0), upload_s=UPLOAD_S,
        ready_in_s=READY_S,
    ),
    "on a grid": lambda: climbed(21, 1500, per_grid=grid(21)),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_search_ends_as_it_is_known_to(name: str) -> None:
    known = json.loads(KNOWN.read_text(encoding="utf-8"))
    assert list(known) == list(CASES)
    assert CASES[name]() == pytest.approx(known[name], rel=1e-9)


if __name__ == "__main__":
    rows = (f'  "{name}": {json.dumps(find())}' for name, find in CASES.items())
    KNOWN.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
    sys.stdout.write(KNOWN.read_text(encoding="utf-8"))
