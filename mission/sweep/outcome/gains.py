"""The method against every other strategy, paired by seed.

A seed fixes device positions, labels and samples, so the difference within a seed is free of most
of what makes seeds differ.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission.sweep.outcome.curves import communities_of
from mission.sweep.outcome.stats import Interval, interval
from mission.sweep.outcome.view import percent
from mission.sweep.results import RunResult

METHOD = "cov"


@dataclass(frozen=True)
class Gain:
    """Final accuracy of one community: the method's less another strategy's, same settings."""

    other: str
    settings: str
    community: str
    differences: tuple[float, ...]  # one a seed
    relative: float  # of the means over seeds; NaN where the other learnt nothing

    @property
    def label(self) -> str:
        """The other group: strategy and settings."""
        return f"{self.other}, {self.settings}" if self.settings else self.other

    @property
    def interval(self) -> Interval:
        """Mean difference within a seed."""
        return interval(self.differences)

    @property
    def better(self) -> int:
        """Seeds in which the method is ahead."""
        return sum(difference > 0.0 for difference in self.differences)


def gain_table(gains: Sequence[Gain]) -> tuple[list[str], list[list[str]]]:
    """Heads and a row for each gain; settings have a column where there are any."""
    where = any(gain.settings for gain in gains)
    heads = [f"{METHOD} against", *(["settings"] if where else []), "community"]
    rows = [
        [
            gain.other,
            *([gain.settings] if where else []),
            gain.community,
            percent(gain.interval, signed=True),
            "-" if math.isnan(gain.relative) else f"{100 * gain.relative:+z.1f} %",
            f"{gain.better} of {len(gain.differences)}",
        ]
        for gain in gains
    ]
    return [*heads, "points", "relative", "seeds better"], rows


def paired_gains(results: Sequence[RunResult]) -> tuple[Gain, ...]:
    """Every other strategy and setting of which the method has flown a seed too."""
    by_key = {(r.point.strategy, r.point.where, r.point.seed): r.summary for r in results}
    gains = []
    for other, where in dict.fromkeys((r.point.strategy, r.point.where) for r in results):
        for community in communities_of(results):
            column = f"final_accuracy_{community}"
            pairs = [
                (float(by_key[METHOD, where, seed][column]), float(summary[column]))
                for (strategy, place, seed), summary in by_key.items()
                if (strategy, place) == (other, where)
                and (METHOD, where, seed) in by_key
                and column in summary
            ]
            if other == METHOD or not pairs:
                continue
            mine, theirs = (math.fsum(values) for values in zip(*pairs, strict=True))
            gains.append(
                Gain(
                    other,
                    where,
                    community,
                    tuple(a - b for a, b in pairs),
                    mine / theirs - 1.0 if theirs > 0.0 else math.nan,
                )
            )
    return tuple(gains)
