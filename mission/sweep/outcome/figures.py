"""A sweep's pictures: curves of every strategy, where they end, and what the method gains."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mission.base.palette import COLOURS, community_colour
from mission.figures.charts import DotRow, Series, dot_rows, line_chart
from mission.figures.render import save_all, stacked
from mission.figures.style import Chart, unchecked
from mission.sweep.outcome.curves import (
    ROUNDS,
    Curve,
    Panel,
    Picture,
    groups_of,
    interval,
    pictures_of,
)
from mission.sweep.outcome.view import METHOD, paired_gains
from mission.sweep.results import RunResult, communities_of


def draw_sweep(name: str, results: Sequence[RunResult], folder: Path) -> None:
    """Draw the pictures of the sweep of that name into `folder`.

    Raises:
        InputError: they cannot be written.
    """
    save_all(sweep_pictures(name, results), folder)


@unchecked
def sweep_pictures(name: str, results: Sequence[RunResult]) -> dict[str, Chart]:
    """The pictures by the name of their file; each says which strategies and seeds it shows."""
    seeds = sorted({result.point.seed for result in results})
    about = f"{name} · seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))}"
    pictures: dict[str, Chart] = {
        f"{item.name}.png": stacked(
            curve_charts(item),
            title=item.title,
            one_key=True,
            together=len(item.apart) or 1,
            about=" · ".join(part for part in (about, item.about) if part),
        )
        for item in pictures_of(results)
    }
    ends = [final_chart(results, community) for community in communities_of(results)]
    title = "Final accuracy: after the last round"
    pictures["final.png"] = stacked(ends, title=title, about=about, together=len(ends))
    gains = gain_charts(results)
    if gains:
        title = f"What {METHOD} gains in final accuracy, within a seed"
        pictures["gains.png"] = stacked(gains, title=title, about=about, together=len(gains))
    return pictures


def curve_charts(picture: Picture) -> list[Chart]:
    """A chart for each panel: the mean of every group, with its interval where it has one.

    Where there are many groups, each panel has a chart for each setting.
    """
    return [
        _curves(picture, panel, where)
        for panel in picture.panels
        for where in picture.apart or [""]
    ]


def final_chart(results: Sequence[RunResult], community: str) -> Chart:
    """Final accuracy of a community with every strategy: each seed, mean and interval."""
    column = f"final_accuracy_{community}"
    rows = []
    for index, (label, runs) in enumerate(groups_of(results).items()):
        values = [float(run.summary[column]) for run in runs if column in run.summary]
        if values:
            rows.append(_row(label, community_colour(index), values, least=0.0))
    return dot_rows(f"{community}: accuracy at the end", rows, x="accuracy (%)")


def gain_charts(results: Sequence[RunResult]) -> list[Chart]:
    """What the method gains on each other strategy, a chart a community."""
    return [
        dot_rows(f"{name}: {METHOD} less the other", rows, x="accuracy (points)", zero=True)
        for name in communities_of(results)
        if (rows := _gain_rows(results, name))
    ]


def _gain_rows(results: Sequence[RunResult], community: str) -> list[DotRow]:
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


def _curves(picture: Picture, panel: Panel, where: str) -> Chart:
    curves = picture.curves(panel, where).items()
    return line_chart(
        f"{panel.title}, {where}" if where else panel.title,
        [_series(label, picture.order.index(label), curve) for label, curve in curves],
        x=picture.x_label,
        y=panel.axis,
        most=panel.most,
        whole_x=picture.along is ROUNDS,
    )


def _series(label: str, index: int, curve: Curve) -> Series:
    """A group's curve with its interval; dashed where it flies nothing, as `ideal`: a bound."""
    known = bool(np.isfinite(curve.low).any())
    return Series(
        label, community_colour(index), curve.x, curve.mean,
        dashed=not curve.flown, again=index >= COLOURS,
        low=curve.low if known else None, high=curve.high if known else None,
    )  # fmt: skip
