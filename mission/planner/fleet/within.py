"""Joint plans within limits and around areas: of several, the best are improved and packed."""

from collections.abc import Iterator, Sequence

import numpy as np

from mission.planner.evaluate import distances
from mission.planner.fleet.joint import first_plans, parts_along
from mission.planner.fleet.packing import Column, packed
from mission.planner.fleet.parts import (
    Parts,
    brought,
    improved_in_turn,
    masked,
    part_along,
    served,
    taken,
    total,
)
from mission.planner.fleet.team import partitions, team_of
from mission.planner.improving import changes_for, standing
from mission.planner.plan import Planner
from mission.planner.problem import RoundProblem

_SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.45, 0.3)  # of the metres, where limits and ways take the rest
_OF_EACH = 2  # best first plans of each
_CLUSTERINGS = 4  # whose shares are planned for by themselves
_STAGES = ((8, 0.1), (3, 0.4))  # so many of the best plans are improved, by such a share of changes
_ALIKE = 0.001  # of the value: plans that differ by less are taken for one


def planned_within(
    alone: Sequence[RoundProblem],
    free: Sequence[RoundProblem],
    begun: list[Parts],
    *,
    inner: Planner,
    enough: float,
) -> Parts:
    """Return the best joint plan that a staged search finds, until it is worth `enough`.

    `alone` are the problems of the aircraft, `free` the same without areas and limits; `begun` are
    plans to begin with, `inner` plans for one aircraft.
    """
    drawn = list(drawn_plans(alone, free))
    some = [*begun, *drawn, *shared_out(alone, [*begun, *drawn], inner)]
    changes, seen = len(alone) * changes_for(alone[0]), list(some)
    for most, share in _STAGES:
        if max(map(total, some)) >= enough:
            return max(some, key=total)
        some = [
            improved_in_turn(alone, parts, int(share * changes), seed=seed)
            for seed, parts in enumerate(best_of(some, most))
        ]
        seen += some
        some.append(completed(alone, packed_parts(alone, seen)))
    return improved_in_turn(alone, max(some, key=total), changes)


def shared_out(
    alone: Sequence[RoundProblem], drawn: list[Parts], inner: Planner
) -> Iterator[Parts]:
    """Yield plans that `inner` makes for one aircraft after another, of what those before it leave:
    of all devices; of those nearest to its path in the best of drawn plans; of clusters."""
    importance, starts_m = alone[0].importance, np.stack([each.start_m for each in alone])
    everybody = np.ones(len(importance), dtype=np.bool_)
    shares = {(everybody.tobytes(),) * len(alone): [everybody] * len(alone)}
    near = [distances(alone[0], part.waypoints_m).min(axis=0) for part in max(drawn, key=total)]
    clusters = list(partitions(alone[0].devices_m, importance, starts_m))[-_CLUSTERINGS:]
    for whose in (np.argmin(near, axis=0), *clusters):
        mine = [whose == a for a in range(len(alone))]
        shares.setdefault(tuple(one.tobytes() for one in mine), mine)
    for mine in shares.values():
        made, left = [], everybody
        for problem, own in zip(alone, mine, strict=True):
            made.append(inner.plan(masked(problem, own & left)))
            left = left & ~served(made[-1])
        yield completed(alone, made)


def completed(alone: Sequence[RoundProblem], parts: Parts) -> Parts:
    """Let each aircraft serve on its way whom nobody serves."""
    for a, problem in enumerate(alone):
        part = parts[a]
        more = part_along(problem, part.waypoints_m, ~taken(parts, a), altitude_m=part.altitude_m)
        if more is not None and more.value > part.value:
            parts = [*parts[:a], more, *parts[a + 1 :]]
    return parts


def packed_parts(alone: Sequence[RoundProblem], seen: list[Parts]) -> Parts:
    """Return the joint plan of parts of several ones, packed so that the most is brought."""
    columns, whole = [], []
    for parts in best_of(seen, len(seen)):
        for a, part in enumerate(parts):
            columns.append(Column(a, part.waypoints_m, brought(alone[a], part)))
            whole.append(part)
    best = max(seen, key=total)
    chosen = packed(columns, [one.group for one in columns], np.ones(len(alone), dtype=np.int64))
    parts, most = list(best), np.max([columns[i].brought for i in chosen], axis=0, initial=0.0)
    for i in chosen:
        column, part = columns[i], whole[i]
        a = column.group
        mine = (column.brought > 0.0) & (column.brought >= most)
        most = np.where(mine, np.inf, most)  # of two that bring the same, the first serves
        one = part_along(alone[a], part.waypoints_m, mine, altitude_m=part.altitude_m)
        if one is None:
            return best
        parts[a] = one
    for a in set(range(len(alone))) - {columns[i].group for i in chosen}:
        parts[a] = standing(masked(alone[a], ~taken(parts, a)))
    return max(parts, best, key=total)


def drawn_plans(alone: Sequence[RoundProblem], free: Sequence[RoundProblem]) -> Iterator[Parts]:
    """Yield plans along paths for fewer and fewer metres, the best of each; where there is a choice
    of altitudes, the best at those of `free`."""
    fixed = [
        each if each.altitudes_m is None else each.at(one.channel.altitude_m)
        for each, one in zip(alone, free, strict=True)
    ]
    for share in _SHARES:
        team = team_of([each.with_own(path_budget_m=share * each.path_budget_m) for each in free])
        made = []
        for found in first_plans(team):
            turned = np.concatenate((found.way[:, :1], found.way[:, :0:-1]), axis=1)
            both = (found.way,) if alone[0].ready_in_s is None else (found.way, turned)
            made += [parts for ways in both if (parts := parts_along(fixed, found, ways))]
        for parts in best_of(made, _OF_EACH):
            opened = [
                part_along(each, part.waypoints_m, served(part))
                if each.altitudes_m is not None
                else part
                for each, part in zip(alone, parts, strict=True)
            ]
            yield completed(alone, [part for part in opened if part is not None])


def best_of(some: list[Parts], most: int) -> list[Parts]:
    """Best plans first, at most so many, without those of nearly equal value."""
    kept: list[Parts] = []
    for parts in sorted(some, key=total, reverse=True):
        if not kept or total(kept[-1]) > total(parts) * (1.0 + _ALIKE):
            kept.append(parts)
    return kept[:most]
