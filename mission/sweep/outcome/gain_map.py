"""Where the method wins: its gain on another strategy over two swept settings, as a map."""

import math
from collections.abc import Sequence

import altair as alt

from mission.figures.charts import LayerChart, finished
from mission.figures.style import BAD, COOL, GRID, INK, PAPER, SOFT, table
from mission.sweep.outcome.gains import METHOD, Gain, paired_gains
from mission.sweep.outcome.view import over_seeds, percent
from mission.sweep.results import RunResult

_CELL = (78.0, 40.0)  # width, height
_SMALLEST = 1.0  # points: what the strongest colour stands for at least


def compared(results: Sequence[RunResult]) -> list[str]:
    """The strategies that the method can be mapped against: two settings are swept, no more."""
    if any(len(result.point.settings) != 2 for result in results):
        return []
    return list(dict.fromkeys(gain.other for gain in paired_gains(results)))


def gain_map(results: Sequence[RunResult], other: str, community: str) -> LayerChart:
    """Points of final accuracy that the method gains, a cell a setting, blue where it wins."""
    gains = [g for g in paired_gains(results) if (g.other, g.community) == (other, community)]
    means = [100.0 * gain.interval.mean for gain in gains]
    most = max(_SMALLEST, *(abs(mean) for mean in means))
    scale = alt.Scale(domain=[-most, 0.0, most], range=[BAD, PAPER, COOL], interpolate="rgb")
    return _map(
        results,
        f"{community}: {METHOD} less {other}, points",
        settings=[gain.settings for gain in gains],
        values=means,
        words=[percent(gain.interval, signed=True) for gain in gains],
        sure=[_sure(gain) for gain in gains],
        scale=scale,
        note="bold: its 95 % interval leaves zero out",
    )


def participation_map(results: Sequence[RunResult], other: str, community: str) -> LayerChart:
    """Devices of a community whose update arrived: with the other strategy, and the method."""
    column = f"participation_{community}"
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for result in results:
        groups.setdefault((result.point.strategy, result.point.where), []).append(result)
    shares = {key: 100.0 * over_seeds(runs, column).mean for key, runs in groups.items()}
    settings = [where for strategy, where in shares if strategy == METHOD]
    settings = [where for where in settings if (other, where) in shares]
    return _map(
        results,
        f"{community}: arrived with {other} → {METHOD}, % of its devices",
        settings=settings,
        values=[shares[other, where] for where in settings],
        words=[f"{shares[other, w]:.0f} → {shares[METHOD, w]:.0f}" for w in settings],
        sure=[False] * len(settings),
        scale=alt.Scale(domain=[0.0, 100.0], range=[PAPER, SOFT], interpolate="rgb"),
        note=f"shade: with {other}",
    )


def _map(
    results: Sequence[RunResult],
    title: str,
    *,
    settings: Sequence[str],
    values: Sequence[float],
    words: Sequence[str],
    sure: Sequence[bool],
    scale: alt.Scale,
    note: str,
) -> LayerChart:
    places = {result.point.where: result.point.settings for result in results}
    rows, columns = (list(dict.fromkeys(place[k][1] for place in places.values())) for k in (0, 1))
    down, across = (name for name, _ in next(iter(places.values())))
    data = table(
        down=[str(places[where][0][1]) for where in settings],
        across=[str(places[where][1][1]) for where in settings],
        value=list(values),
        words=list(words),
        sure=["bold" if item else "normal" for item in sure],
    )
    base = alt.Chart(data).encode(
        x=alt.X("across:O", title=across, sort=[str(v) for v in columns],
                axis=alt.Axis(labelAngle=0)),
        y=alt.Y("down:O", title=down, sort=[str(v) for v in rows]),
    )  # fmt: skip
    colour = alt.Color("value:Q", scale=scale, legend=None)
    tip = [alt.Tooltip("down:O", title=down), alt.Tooltip("across:O", title=across),
           alt.Tooltip("words:N", title=" ")]  # fmt: skip
    layers = [
        base.mark_rect(stroke=GRID, fillOpacity=0.7).encode(color=colour, tooltip=tip),
        *(
            base.transform_filter(alt.datum.sure == weight)
            .mark_text(fontSize=11, fontWeight=weight, color=INK)
            .encode(text="words:N")
            for weight in ("bold", "normal")
        ),
    ]
    width, height = _CELL[0] * len(columns), _CELL[1] * len(rows)
    return finished(layers, title=title, note=note, width=width, height=height)


def _sure(gain: Gain) -> bool:
    interval = gain.interval
    return math.isfinite(interval.half) and abs(interval.mean) > interval.half
