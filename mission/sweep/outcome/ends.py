"""Where a sweep's strategies end, and what the method gains on each: rows of a dot chart."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission.base.palette import community_colour
from mission.sweep.outcome.curves import groups_of
from mission.sweep.outcome.gains import paired_gains
from mission.sweep.outcome.stats import interval
from mission.sweep.results import RunResult


@dataclass(frozen=True)
class EndRow:
    """One row: a mean in its interval, and the seeds it is the mean of; percent or points."""

    label: str
    colour: str
    values: tuple[float, ...]  # one a seed
    mean: float
    half: float  # of the 95 % interval; NaN for a single seed
    least: float  # what the value can be
    most: float

    @property
    def ends(self) -> tuple[float, float]:
        """Of the interval, as far as the value can be; the mean itself for a single seed."""
        half = self.half if math.isfinite(self.half) else 0.0
        return max(self.mean - half, self.least), min(self.mean + half, self.most)


def final_rows(results: Sequence[RunResult], community: str) -> list[EndRow]:
    """Final accuracy of every group, in percent."""
    column = f"final_accuracy_{community}"
    rows = []
    for index, (label, runs) in enumerate(groups_of(results).items()):
        values = [float(run.summary[column]) for run in runs if column in run.summary]
        if values:
            rows.append(_row(label, community_colour(index), values, least=0.0))
    return rows


def gain_rows(results: Sequence[RunResult], community: str) -> list[EndRow]:
    """The method's final accuracy less every other group's of the same seeds, in points."""
    colours = {label: community_colour(k) for k, label in enumerate(groups_of(results))}
    return [
        _row(gain.label, colours[gain.label], gain.differences, least=-100.0)
        for gain in paired_gains(results)
        if gain.community == community
    ]


def _row(label: str, colour: str, values: Sequence[float], *, least: float) -> EndRow:
    item = interval([100.0 * value for value in values])
    shown = tuple(100.0 * value for value in values)
    return EndRow(label, colour, shown, item.mean, item.half, least, 100.0)
