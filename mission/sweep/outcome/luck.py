"""What a reader of fewer runs would have seen: how often a gain shows by the luck of the draw."""

import itertools
import math
from collections.abc import Iterable

import numpy as np

from mission.sweep.outcome.gains import Gain
from mission.sweep.outcome.stats import ENOUGH

LATE = 0.5  # share of a run's rounds after which one may be picked to be read off


def seen_in_one_round(gain: Gain, least: float) -> float:
    """Share of single rounds of single seeds, late in the run, with a relative gain that large."""
    seen: list[bool] = []
    for mine, other in gain.pairs:
        rounds = min(len(mine.rounds), len(other.rounds))
        late = slice(int(LATE * rounds), rounds)
        a, b = (run.curve(f"accuracy_{gain.community}")[late] for run in (mine, other))
        seen.extend(a >= (1.0 + least) * b)
    return _share(seen)


def seen_with_seeds(gain: Gain, least: float, seeds: int) -> float:
    """Share of all choices of so many seeds whose mean final accuracies have a gain that large."""
    chosen = itertools.combinations(gain.finals, seeds)
    sums = (np.sum(finals, axis=0) for finals in chosen)
    return _share(mine >= (1.0 + least) * other for mine, other in sums)


def luck_rows(gains: Iterable[Gain], least: float) -> tuple[list[str], list[list[str]]]:
    """Heads and a row for each gain: shares in percent."""
    heads = ["one seed, one round", "one seed, at the end", f"mean of {ENOUGH} seeds, at the end"]
    rows = [
        [
            gain.label,
            gain.community,
            *map(
                _percent,
                (
                    seen_in_one_round(gain, least),
                    *(seen_with_seeds(gain, least, n) for n in (1, ENOUGH)),
                ),
            ),
        ]
        for gain in gains
    ]
    return ["against", "community", *heads], rows


def _share(seen: Iterable[bool]) -> float:
    every = list(seen)
    return sum(every) / len(every) if every else math.nan


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.0f} %"
