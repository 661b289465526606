"""Charts of learning and radio: accuracy, fairness, updates, packet error rates."""

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial

import altair as alt

from mission.analysis.compare import DeviceComparison, RunComparison
from mission.analysis.load import LoadedRun, vehicles_of
from mission.base.palette import community_colour
from mission.figures.charts import Series, bar_chart, finished, line_chart, ticks
from mission.figures.style import COOL, GOOD, GRID, PLANNED, SOFT, WARM, Chart, keys, named, table
from mission.log.records import LATE, OUTCOMES
from mission.log.values import FlightData

_PALE = 0.35
_SPREAD = "spread of accuracy over a community's devices; in force for the next round"


def learning_charts(run: FlightData, others: Sequence[FlightData] = ()) -> list[Chart]:
    """Accuracy and fairness CoV per community, and the updates that arrived, by round: those of all
    aircraft, where the logs of `others` of the experiment are given.

    Where the log has the untrained models, as round 0, accuracy begins with them.
    """
    rounds = [record.round for record in run.rounds]
    before = {item.community: item for item in run.learning if item.round == 0}
    first = [0] if before else []

    def by_community(kind: str, unit: float) -> list[Series]:
        return [
            Series(
                name,
                community_colour(index),
                [*first, *rounds],
                [unit * getattr(before[name], kind) for _ in first]
                + [unit * getattr(record, kind)[name] for record in run.rounds],
            )
            for index, name in enumerate(run.rounds[0].accuracy)
        ]

    by_round = partial(line_chart, x="round", whole_x=True)
    percent = by_community("accuracy", 100.0)
    accuracy = by_round("Accuracy", percent, y="accuracy (%)", most=100.0)
    cov = by_round("Fairness CoV ψ", by_community("cov", 1.0), y="CoV ψ", note=_SPREAD, steps=True)
    scheduled = {record.round: record.scheduled for record in run.rounds}
    delivered = {record.round: record.delivered for record in run.rounds}
    if others:  # a device that two were to serve is one
        sent = [item for each in (run, *others) for item in each.uplinks]
        scheduled = Counter(number for number, _ in {(u.round, u.device) for u in sent})
        delivered = Counter(
            number for number, _ in {(u.round, u.device) for u in sent if u.delivered}
        )
    updates = bar_chart(
        "Updates",
        [
            Series("scheduled", GRID, rounds, [scheduled[number] for number in rounds]),
            Series("delivered", GOOD, rounds, [delivered[number] for number in rounds]),
        ],
        x="round",
        y="updates",
    )
    return [accuracy, cov, updates]


def experiment_charts(flights: Sequence[LoadedRun]) -> list[Chart]:
    """`learning_charts` of the experiment in which the first of these flew, maybe with others;
    none where no round was over."""
    together = vehicles_of(flights[0].path.parent)
    # Who was lost knows of the rounds before.
    first, *rest = sorted(flights, key=lambda one: -len(one.data.rounds))
    others = [one.data for one in rest if one.path in together]
    return learning_charts(first.data, others) if first.data.rounds else []


def radio_charts(run: FlightData, comparison: RunComparison) -> list[Chart]:
    """Objective, packet error rates of those scheduled, and participation."""
    scheduled = [device for device in comparison.devices if device.scheduled]
    rates = [_error_rates(scheduled)] if scheduled else []
    return [_objective(run), *rates, _participation(run)]


def _objective(run: FlightData) -> Chart:
    rounds = [record.round for record in run.rounds]
    series = [
        Series("planned", COOL, rounds, [r.plan_objective for r in run.rounds], dashed=True),
        Series("believed", WARM, rounds, [r.est_objective for r in run.rounds]),
        Series("true", GOOD, rounds, [r.true_objective for r in run.rounds]),
    ]
    bounds = [record.upper_bound for record in run.rounds]
    if any(math.isfinite(bound) for bound in bounds):
        series.insert(0, Series("proven bound", SOFT, rounds, bounds, dashed=True))
    return line_chart("Objective", series, x="round", y="importance times success", whole_x=True)


def _error_rates(devices: Sequence[DeviceComparison]) -> Chart:
    """Planned, believed and true PER, a row a device."""
    kinds = ("planned", "believed", "true")
    data = table(
        kind=[kind for kind in kinds for _ in devices],
        device=[device.device for device in devices] * len(kinds),
        community=[device.community for device in devices] * len(kinds),
        per=[device.plan_per for device in devices]
        + [device.est_per for device in devices]
        + [device.true_per for device in devices],
    )
    key = keys(kinds)
    marks = alt.Chart(data).mark_point(filled=True, opacity=0.85, tooltip=True)
    placed = marks.encode(
        x=alt.X(
            "per:Q",
            title="packet error rate (mean)",
            scale=alt.Scale(zero=True, nice=False, padding=8),  # or dots at 0 are cut
            axis=alt.Axis(format="~g"),
        ),
        y=alt.Y("device:O", title="device"),
        color=alt.Color("kind:O", scale=named(kinds, [PLANNED, WARM, GOOD]), legend=key),
        size=alt.Size("kind:O", scale=named(kinds, [110, 55, 22]), legend=key),
        detail=alt.Detail("community:N"),
    )
    height = max(60.0, (16.0 if len(devices) <= 40 else 12.0) * len(devices))
    return finished([placed], title="Packet error rate by device", height=height)


def _participation(run: FlightData) -> Chart:
    """Device by round: delivered, lost, late, or not scheduled."""
    late = any(item.outcome == LATE for item in run.uplinks)
    names, count = run.devices.communities, len(run.devices.community)
    rounds = [record.round for record in run.rounds]
    colours = named(names, [community_colour(index) for index in range(len(names))])
    data = table(
        round=[item.round for item in run.uplinks],
        device=[item.device for item in run.uplinks],
        community=[item.community for item in run.uplinks],
        update=[item.outcome for item in run.uplinks],
    )
    scale = partial(alt.Scale, padding=0.1)
    across = alt.Axis(values=ticks(rounds), labelAngle=0)
    x = alt.X("round:O", title="round", scale=scale(domain=rounds), axis=across)
    up = alt.Axis(values=ticks(range(count), 40))
    y = alt.Y("device:O", title="device", scale=scale(domain=list(range(count))), axis=up)
    rects = alt.Chart(data).mark_rect(strokeWidth=1.3, tooltip=True)
    marks = rects.encode(
        x,
        y,
        fill=alt.Fill("community:N", scale=colours, legend=keys(names)),
        stroke=alt.Stroke("community:N", scale=colours, legend=keys(names)),
        fillOpacity=alt.FillOpacity(
            "update:O", scale=named(OUTCOMES, [1.0, 0.0, _PALE]), legend=None
        ),
    )
    return finished(
        [marks],
        title="Participation",
        height=max(60.0, min(14.0 * count, 900.0)),
        note=f"filled: delivered, outlined: lost,{' pale: late,' if late else ''} "
        "grey: not scheduled",
        view={"fill": GRID, "fillOpacity": 0.4},
    )
