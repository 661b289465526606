"""Where a sweep's strategies end, and what the method gains on each: rows of a dot chart."""

import math
from collections.abc import Sequence

from mission.base.palette import community_colour
from mission.figures.charts import DotRow
from mission.sweep.outcome.curves import groups_of
from mission.sweep.outcome.gains import paired_gains
from mission.sweep.outcome.stats import interval
from mission.sweep.results import RunResult


def final_rows(results: Sequence[RunResult], community: str) -> list[DotRow]:
    """Final accuracy of every group, in percent."""
    column = f"final_accuracy_{community}"
    rows = []
    for index, (label, runs) in enumerate(groups_of(results).items()):
        values = [float(run.summary[column]) for run in runs if column in run.summary]
        if values:
            rows.append(_row(label, community_colour(index), values, least=0.0))
    return rows


def gain_rows(results: Sequence[RunResult], community: str) -> list[DotRow]:
    """The method's final accuracy less every other group's of the same seeds, in points."""
    return [
        _row(gain.label, community_colour(0), gain.differences, least=-100.0)
        for gain in paired_gains(results)
        if gain.community == community
    ]


def _row(label: str, colour: str, values: Sequence[float], *, least: float) -> DotRow:
    shown = tuple(100.0 * value for value in values)
    item = interval(shown)
    ends = (max(item.mean - item.half, least), min(item.mean + item.half, 100.0))
    return DotRow(label, colour, shown, item.mean, ends if math.isfinite(item.half) else None)
