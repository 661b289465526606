"""The method against every other strategy, paired by seed.

A seed fixes device positions, labels and samples, so the difference within a seed is free of most
of what makes seeds differ.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission.sweep.curves import communities_of
from mission.sweep.results import RunResult
from mission.sweep.stats import Interval, interval
from mission.sweep.view import percent

METHOD = "cov"
GAIN_HEADS = (f"{METHOD} against", "settings", "community", "points", "relative", "seeds better")


@dataclass(frozen=True)
class Gain:
    """Final accuracy of one community: the method's less another strategy's, same settings."""

    other: str
    settings: str
    community: str
    difference: Interval
    relative: float  # NaN where the other learnt nothing
    better: int  # seeds

    @property
    def cells(self) -> tuple[str, ...]:
        """For a table under `GAIN_HEADS`."""
        return (
            self.other,
            self.settings or "-",
            self.community,
            percent(self.difference),
            "-" if math.isnan(self.relative) else f"{100 * self.relative:+z.1f} %",
            f"{self.better} of {self.difference.count}",
        )


def paired_gains(results: Sequence[RunResult]) -> tuple[Gain, ...]:
    """Every other strategy and setting of which the method has flown a seed too."""
    accuracy = {
        (result.keys["strategy"], result.settings, result.keys["seed"]): result.summary
        for result in results
    }
    gains = []
    for other, settings in dict.fromkeys((strategy, where) for strategy, where, _ in accuracy):
        for community in communities_of(results):
            column = f"final_accuracy_{community}"
            pairs = [
                (float(accuracy[METHOD, settings, seed][column]), float(summary[column]))
                for (strategy, where, seed), summary in accuracy.items()
                if (strategy, where) == (other, settings)
                and (METHOD, settings, seed) in accuracy
                and column in summary
            ]
            if other == METHOD or not pairs:
                continue
            mine, theirs = (math.fsum(values) / len(pairs) for values in zip(*pairs, strict=True))
            gains.append(
                Gain(
                    other=str(other),
                    settings=", ".join(f"{key} = {value}" for key, value in settings),
                    community=community,
                    difference=interval([a - b for a, b in pairs]),
                    relative=mine / theirs - 1 if theirs > 0.0 else math.nan,
                    better=sum(a > b for a, b in pairs),
                )
            )
    return tuple(gains)
