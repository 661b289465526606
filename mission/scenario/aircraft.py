"""What each aircraft of a run has of its own, and what all have to spend."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mission.base.area import Area
from mission.config.models import RunConfig
from mission.planner.performance import Performance
from mission.scenario.limits import Amount, Budget, budget_of, foreseen_performance


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
