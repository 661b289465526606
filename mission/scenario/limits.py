"""What limits rounds and runs: metres, seconds, joules; and how the aircraft flies, which decides
what a round takes of them; of each aircraft of a run and of all."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from flightdyn.config import LimitsConfig, WindConfig
from flightdyn.foresight import STOPPING_S
from flightdyn.physics.air import steady_wind_ned
from flightdyn.physics.power import density_ratio
from mission.base.area import Area
from mission.base.explain import WrongKey
from mission.config.models import MissionConfig, RunConfig
from mission.planner.limits import LIMITS, RoundLimits
from mission.planner.performance import Performance
from sitl.config import VehicleConfig


class Amount(NamedTuple):
    """Metres, seconds and joules; infinity where they are not limited."""

    metres: float
    seconds: float = math.inf
    joules: float = math.inf


NOTHING, UNLIMITED = Amount(0.0, 0.0, 0.0), Amount(math.inf)
# Of each budget: its key, its unit, and its name where it ends a run.
KEYS = (
    ("mission.total_budget_m", "m", "path budget"),
    ("mission.total_deadline_s", "s", "time"),
    ("mission.total_energy_j", "J", "energy"),
)
# Keys of limits in the table `mission`, and of which kind each is.
_KEYS = tuple(
    (f"{span}_{kind.key}", kind)
    for kind in LIMITS
    for span in ("round", *(["total"] if kind.budget else []))
)
# What flying adds to a separation that is planned: errors of estimate and track, and by how much
# one aircraft may be later than another.
MARGIN_M, LATE_S = 3.0, 1.0
_WITHIN_ROUNDING = 1.0 - 1e-9  # 800.1 m pay for 3 rounds of 266.7 m, also in binary fractions
# Share of a whole round's metres, seconds and joules that is enough to begin one: flights take some
# more or less than planned, so that a little less may be left for the last of them.
ENOUGH = Amount(_WITHIN_ROUNDING, 0.95, 0.95)


@dataclass(frozen=True)
class Budget:
    """A run's rounds and total budget, and what a whole round takes of it."""

    rounds: int
    total: Amount
    whole_round: Amount


def is_limited(mission: MissionConfig) -> bool:
    """Whether anything but metres is limited."""
    return any(getattr(mission, key) is not None for key, _ in _KEYS)


def _of_round(mission: MissionConfig) -> dict[str, float]:
    """The limits of a round that are given, by their names in `RoundLimits`."""
    given = ((kind.name, getattr(mission, f"round_{kind.key}")) for kind in LIMITS)
    return {name: most for name, most in given if most is not None}


def performance_of(
    mission: MissionConfig,
    home_alt_msl_m: float,
    guidance: LimitsConfig | None,
    *,
    wind: WindConfig | None = None,
    pace: float = 1.0,
) -> Performance:
    """Return the flight performance at the mission's speed and (lowest) altitude; the rest as in
    `Performance`. Air density is that of the lowest altitude; it falls by 1 % in 90 m."""
    north, east, _ = (0.0, 0.0, 0.0) if wind is None else steady_wind_ned(wind)
    density = density_ratio(home_alt_msl_m + mission.heights_m[0])
    return Performance(
        mission.speed_mps, mission.acceptance_radius_m, guidance, density, (east, north), pace,
        STOPPING_S,
    )  # fmt: skip


def guidance_of(vehicle: VehicleConfig) -> LimitsConfig:
    """Speed and acceleration limits that the built-in autopilot keeps to."""
    limits = vehicle.aircraft.limits
    fastest_mps = min(limits.speed_mps, vehicle.parameters.get("MPC_XY_VEL_MAX", math.inf))
    return limits.model_copy(update={"speed_mps": fastest_mps})


def foreseen_performance(config: RunConfig) -> Performance:
    """Return the performance that the configuration predicts, before a vehicle is asked."""
    mission, home_alt_msl_m = config.mission, config.area.home_alt_msl_m
    if mission.flight == "none":
        return performance_of(mission, home_alt_msl_m, None)
    # Rounds are planned for the steady wind of the simulated world.
    wind = None if config.link.kind == "external" else config.vehicle.aircraft.wind
    return performance_of(mission, home_alt_msl_m, guidance_of(config.vehicle), wind=wind)


def budget_of(config: RunConfig, performance: Performance) -> Budget:
    """Return the run's budget by the configuration, and the cost of a whole round.

    A round costs its own limits; where it has none, what its metres take at least.
    """
    mission = config.mission
    budgets = {kind.budget: kind for kind in LIMITS if kind.budget}
    totals = {name: getattr(mission, f"total_{kind.key}") for name, kind in budgets.items()}
    given = {name: most for name, most in totals.items() if most is not None}
    total = Amount(mission.total_budget_m, **given)
    hovers = mission.strategy == "barycenter"
    metres = mission.hover_cost_m if hovers else mission.path_budget_m
    if hovers:
        hover = performance.foresee_hover(mission.hover_s)
        taken = {name: kind.of(vars(hover)) for name, kind in budgets.items()}
        whole = Amount(metres, **taken)
        return Budget(mission.rounds, total, whole)
    limits = RoundLimits(performance, **_of_round(mission))
    flown_m = min(metres, limits.longest_m())
    costs = {
        name: getattr(mission, f"round_{kind.key}") or kind(math.inf, performance).least(flown_m)
        for name, kind in budgets.items()
    }
    return Budget(mission.rounds, total, Amount(metres, **costs))


def round_limits(
    mission: MissionConfig, performance: Performance, *, left: Amount, timed: bool = False
) -> RoundLimits | None:
    """Return a round's limits, with `left` of the run's budgets; None: metres alone count.

    `timed`: devices take time, so that flight times matter.
    """
    if not (timed or is_limited(mission)):
        return None
    most = _of_round(mission)
    for kind in LIMITS:
        if kind.budget:
            most[kind.name] = min(most.get(kind.name, math.inf), getattr(left, kind.budget))
    return RoundLimits(performance, **most)


def separation(mission: MissionConfig, *, leaving: bool) -> dict[str, Any]:
    """Return what a round of several aircraft is planned with, by the names in `RoundProblem`: the
    separation that is wanted, and what flying adds to it. Those that are not `leaving` their homes
    begin where a round has left them, which may be nearer by what was added."""
    wanted_m, flown = mission.separation_m, mission.flight != "none"
    if wanted_m is None:
        return {}
    return {
        "separation_m": wanted_m + flown * MARGIN_M,
        "late_s": flown * LATE_S,
        "least_m": None if leaving else wanted_m,
        "in_step": mission.replan == "stop",
    }


def unflyable(config: RunConfig, performance: Performance) -> Iterator[WrongKey]:
    """Yield the keys of limits that allow no round or cannot apply, with what to give instead."""
    mission = config.mission
    if not is_limited(mission):
        return
    for key, kind in _KEYS:
        most = getattr(mission, key)
        if most is not None and kind.needs_power and config.link.kind == "external":
            yield (
                f"mission.{key}",
                most,
                "of an external vehicle nobody knows the power, so energy cannot limit its "
                "plans; leave it out, and give a deadline or metres",
            )
    hovers = mission.strategy == "barycenter"
    if hovers:
        why, out = f"a hover of mission.hover_s = {mission.hover_s:g} s", "hover shorter"
    else:
        why, out = f"flying {SHORT_M:g} m and stopping", "leave it out"
    for key, kind in _KEYS:
        limit = kind(math.inf, performance)
        hover = performance.foresee_hover(mission.hover_s) if hovers else None
        needed = limit.least(SHORT_M) if hover is None else limit.taken(hover)
        given = getattr(mission, key)
        if given is not None and given < needed:
            yield (
                f"mission.{key}",
                given,
                f"no round can be flown in it: {why} takes "
                f"{_rounded_up(needed)} {kind.unit}; give at least that, or {out}",
            )
    whole = budget_of(config, performance).whole_round
    for index, key in ((1, "deadline_s"), (2, "energy_j")):
        given, needed = getattr(mission, f"total_{key}"), ENOUGH[index] * whole[index]
        # `ideal` flies nothing, and so takes none of it.
        if given is not None and given < needed and mission.strategy != "ideal":
            of_a_round = f"mission.round_{key}"
            known = getattr(mission, f"round_{key}") is not None
            unit = KEYS[index][1]
            yield (
                f"mission.total_{key}",
                given,
                f"pays for no round: a whole one takes {whole[index]:.6g} {unit} "
                f"({of_a_round if known else 'what its metres take'}); give at least "
                f"{_rounded_up(needed)} {unit}, or "
                f"{f'a smaller {of_a_round}' if known else f'give {of_a_round}, too'}",
            )


SHORT_M = 10.0  # limits that allow less are refused


def _rounded_up(needed: float) -> str:
    return f"{math.ceil(100.0 * needed) / 100.0:.15g}"


@dataclass(frozen=True)
class Aircraft:
    """What is one aircraft's own in a run."""

    name: str
    config: RunConfig  # as if it flew alone
    area: Area  # with its home
    performance: Performance  # how rounds will be flown, before a vehicle is asked


def aircraft_of(config: RunConfig) -> tuple[Aircraft, ...]:
    """Return each aircraft, with its home on the site that all share."""
    area = config.area.build(config.heights_m)
    return tuple(
        Aircraft(
            own.name,
            alone := config.of(own),
            area if own.home_m == area.home_m else area.site.from_home(own.home_m),
            foreseen_performance(alone),
        )
        for own in config.aircraft
    )


def budget_of_all(aircraft: Sequence[Aircraft]) -> Budget:
    """The budget of each aircraft; a whole round takes what it takes of the one that uses most."""
    each = [budget_of(one.config, one.performance) for one in aircraft]
    whole = (
        Amount(*map(max, *(budget.whole_round for budget in each)))
        if len(each) > 1
        else each[0].whole_round
    )
    return replace(each[0], whole_round=whole)


def by(config: RunConfig, aircraft: Sequence[Aircraft]) -> tuple[Aircraft, ...]:
    """The aircraft by a configuration in which what they share has become more."""
    each = zip(aircraft, config.aircraft, strict=True)
    return tuple(replace(one, config=config.of(own)) for one, own in each)
