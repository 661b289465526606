"""The method against every other strategy, paired by seed.

A seed fixes device positions, labels and samples, so the difference within a seed is free of most
of what makes seeds differ.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission.sweep.outcome.curves import Interval, interval
from mission.sweep.outcome.view import percent, points
from mission.sweep.results import EQUAL, RunResult, at_equal, communities_of, differ

METHOD = "cov"
POINTS = (
    "points: mean difference within a seed, ± 95 % interval from three seeds on (Student's t); "
    "relative: that mean as a share of the other's accuracy; each is rounded by itself"
)


@dataclass(frozen=True)
class Gain:
    """Final accuracy of one community: the method's less another strategy's, same settings."""

    other: str
    settings: str
    community: str
    pairs: tuple[tuple[RunResult, RunResult], ...]  # the method's run and the other, one a seed

    @property
    def label(self) -> str:
        """The other group: strategy and settings."""
        return f"{self.other}, {self.settings}" if self.settings else self.other

    @property
    def finals(self) -> tuple[tuple[float, float], ...]:
        """Final accuracies of the method and the other, a pair for each seed."""
        column = f"final_accuracy_{self.community}"
        return tuple((float(a.summary[column]), float(b.summary[column])) for a, b in self.pairs)

    @property
    def differences(self) -> tuple[float, ...]:
        """The method's final accuracy less the other's, for each seed."""
        return tuple(mine - other for mine, other in self.finals)

    def at_equal(self, what: str) -> tuple[float, ...]:
        """Return accuracy differences at equal `what` (see `EQUAL`): where the cheaper run ends."""
        column = f"accuracy_{self.community}"
        ends = (at_equal(pair, what, column) for pair in self.pairs)
        return tuple(mine - other for mine, other in ends)

    @property
    def relative(self) -> float:
        """Ratio of the mean accuracies over seeds, less 1; NaN where the other learnt nothing."""
        mine, other = (math.fsum(values) for values in zip(*self.finals, strict=True))
        return mine / other - 1.0 if other > 0.0 else math.nan

    @property
    def interval(self) -> Interval:
        """Mean of `differences` with its 95 % confidence interval."""
        return interval(self.differences)

    @property
    def better(self) -> int:
        """Number of seeds in which the method is ahead."""
        return sum(difference > 0.0 for difference in self.differences)


def gain_table(gains: Sequence[Gain]) -> tuple[list[str], list[list[str]]]:
    """Heads and a row for each gain; settings have a column where there are any."""
    where = any(gain.settings for gain in gains)
    equals = [what for what in EQUAL if any(differ(g.at_equal(what), g.differences) for g in gains)]
    heads = [f"{METHOD} against", *(["settings"] if where else []), "community"]
    rows = [
        [
            gain.other,
            *([gain.settings] if where else []),
            gain.community,
            percent(gain.interval, signed=True),
            "-" if math.isnan(gain.relative) else f"{points(gain.relative, signed=True)} %",
            f"{gain.better} of {len(gain.differences)}",
            *(percent(interval(gain.at_equal(what)), signed=True) for what in equals),
        ]
        for gain in gains
    ]
    heads += ["points", "relative", "seeds better"]
    return [*heads, *(f"points at equal {what}" for what in equals)], rows


def paired_gains(results: Sequence[RunResult]) -> tuple[Gain, ...]:
    """Pair the method with each other strategy of the same settings, by seeds both have flown."""
    by_key = {(r.point.strategy, r.point.where, r.point.seed): r for r in results}
    gains = []
    for other, where in dict.fromkeys((r.point.strategy, r.point.where) for r in results):
        for community in communities_of(results):
            pairs = [
                (by_key[METHOD, where, seed], run)
                for (strategy, place, seed), run in by_key.items()
                if (strategy, place) == (other, where)
                and (METHOD, where, seed) in by_key
                and f"final_accuracy_{community}" in run.summary
            ]
            if other != METHOD and pairs:
                gains.append(Gain(other, where, community, tuple(pairs)))
    return tuple(gains)
