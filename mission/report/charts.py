"""The charts of a report, each from the values that the tables and the log hold."""

import math
from html import escape

import numpy as np

from mission.analysis.alignment import align
from mission.analysis.compare import RunComparison
from mission.analysis.load import flown
from mission.base.palette import community_colour
from mission.log.values import FlightData
from mission.report import svg
from mission.report.svg import Chart, Series

_ALONG = "of the round chosen above; dashed: corners of the plan"
GOOD, WARM, BAD, COOL = "#009E73", "#E69F00", "#C8361D", "#0072B2"


def card(chart: Chart, *, note: str = "") -> str:
    """A chart with its title, legend and a line that says how to read it."""
    sub = f'<p class="sub">{escape(note)}</p>' if note else ""
    return (
        f'<section class="card"><h3>{escape(chart.title)}</h3>{sub}'
        f"{chart.legend_html()}{chart.text()}</section>"
    )


def learning_cards(run: FlightData) -> list[str]:
    """Accuracy and CoV per community, and updates, by round."""
    rounds = [record.round for record in run.rounds]
    names = list(run.rounds[0].accuracy)

    def by_community(kind: str) -> list[Series]:
        return [
            Series(name, community_colour(i), rounds, [getattr(r, kind)[name] for r in run.rounds])
            for i, name in enumerate(names)
        ]

    updates = Chart(
        "Updates", "round", "updates", (rounds[0] - 0.5, rounds[-1] + 0.5),
        svg.padded([float(r.scheduled) for r in run.rounds]), whole_x=True,
    )  # fmt: skip
    updates.bars("scheduled", "var(--grid)", rounds, [r.scheduled for r in run.rounds])
    updates.bars("delivered", GOOD, rounds, [r.delivered for r in run.rounds])
    accuracy = svg.line_chart(
        "Validation accuracy", by_community("accuracy"),
        x_label="round", y=(0.0, 1.0), percent=True, whole_x=True,
    )  # fmt: skip
    cov = svg.line_chart(
        "Fairness CoV ψ", by_community("cov"), x_label="round", y_label="ψ", whole_x=True
    )
    spread = "spread of accuracy over a community's devices; in force for the next round"
    return [card(accuracy), card(cov, note=spread), card(updates)]


def flight_cards(run: FlightData, comparison: RunComparison) -> list[str]:
    """Errors against the plan, by round and (with the slider) along the path."""
    items = comparison.rounds
    rounds = [item.round for item in items if item.round is not None]

    def by_round(label: str, colour: str, name: str, *, dashed: bool = False) -> Series:
        values = [float(getattr(item, name)) for item in items]
        return Series(label, colour, rounds, values, dashed=dashed)

    cross = svg.line_chart(
        "Distance from the planned path",
        [
            by_round("straights, rms", COOL, "straight_rms_m"),
            by_round("straights, max", COOL, "straight_max_m", dashed=True),
            by_round("corners cut, max", WARM, "corner_cut_max_m"),
            by_round("estimate error, rms", GOOD, "estimate_rms_m"),
        ],
        x_label="round", y_label="m", whole_x=True,
    )  # fmt: skip
    late = svg.line_chart(
        "Slots later than at constant speed",
        [
            by_round("mean", COOL, "slot_late_mean_s"),
            by_round("max", COOL, "slot_late_max_s", dashed=True),
        ],
        x_label="round", y_label="s", whole_x=True,
    )  # fmt: skip
    moved = any(plan.path_m > 0 for plan in run.plans)
    return [*([along_card(run, note=_ALONG)] if moved else []), card(cross), card(late)]


def radio_cards(run: FlightData, comparison: RunComparison) -> list[str]:
    """Objective, PER and participation."""
    rounds = [record.round for record in run.rounds]
    series = [
        Series("planned", COOL, rounds, [r.plan_objective for r in run.rounds], dashed=True),
        Series("believed", WARM, rounds, [r.est_objective for r in run.rounds]),
        Series("true", GOOD, rounds, [r.true_objective for r in run.rounds]),
    ]
    bounds = [r.upper_bound for r in run.rounds]
    if any(math.isfinite(bound) for bound in bounds):
        series.insert(
            0, Series("proven bound", "var(--soft)", rounds, bounds, dashed=True, dots=False)
        )
    objective = svg.line_chart(
        "Objective: importance times success", series,
        x_label="round", y_label="importance", whole_x=True,
    )  # fmt: skip
    return [card(objective), _per_card(comparison), _participation_card(run)]


def along_card(run: FlightData, *, note: str) -> str:
    """Cross-track against progress, one line a round, shown by the slider."""
    lines, longest, widest = [], 0.0, 0.0
    for plan in run.plans:
        record = next((r for r in run.rounds if r.round == plan.round), None)
        if record is None:
            continue
        fit = align(flown(run, record).pos_m[:, :2], plan.waypoints_m)
        lines.append((plan.round, fit))
        longest, widest = max(longest, fit.length_m), max(widest, float(fit.cross_m.max()))
    chart = Chart(
        "Distance from the path, along it", "m along the path", "m away",
        (0.0, max(longest, 1.0)), svg.padded([widest]),
    )  # fmt: skip
    for number, fit in lines:
        points = [
            (chart.across.at(s), chart.up.at(d))
            for s, d in zip(fit.along_m.tolist(), fit.cross_m.tolist(), strict=True)
        ]
        shown = "" if chart.parts else ' class="on"'
        corners = "".join(
            f'<line class="grid" stroke-dasharray="3 3" x1="{chart.across.at(at):.1f}" '
            f'x2="{chart.across.at(at):.1f}" y1="{svg.TOP}" y2="{chart.height - svg.BOTTOM}"/>'
            for at in fit.corners_m.tolist()
        )
        chart.parts.append(
            f'<g{shown} data-round="{number}">{corners}<path d="{svg.path(points)}" fill="none" '
            f'stroke="{COOL}" stroke-width="1.6"/></g>'
        )
    chart.legend.append(("true track", COOL, False))
    return card(chart, note=note)


def _per_card(comparison: RunComparison) -> str:
    """Planned, believed and true PER, a row a device."""
    devices = [d for d in comparison.devices if d.scheduled]
    height = 24.0 + svg.BOTTOM + 20.0 * len(devices)
    rates = [rate for d in devices for rate in (d.plan_per, d.est_per, d.true_per)]
    worst = max(filter(math.isfinite, rates), default=1.0)
    chart = Chart(
        "Packet error rate by device", "mean over its slots", "", (0.0, min(1.0, 1.08 * worst)),
        (0.0, 1.0), height=height,
    )  # fmt: skip
    across = chart.across
    parts = [
        f'<line class="grid" x1="{across.at(v):.1f}" x2="{across.at(v):.1f}" y1="{svg.TOP}" '
        f'y2="{height - svg.BOTTOM}"/><text class="tick" x="{across.at(v):.1f}" '
        f'y="{height - svg.BOTTOM + 16}" text-anchor="middle">{v:g}</text>'
        for v in svg.ticks(*chart.x)
    ]
    for row, device in enumerate(devices):
        y = svg.TOP + 14.0 + 20.0 * row
        chart.parts.append(
            f'<text class="tick" x="{svg.LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">'
            f"{device.device}</text>"
        )
        for value, colour, label, radius in (
            (device.plan_per, "var(--planned)", "planned", 5.0),
            (device.est_per, WARM, "believed", 3.8),
            (device.true_per, GOOD, "true", 2.6),
        ):
            if math.isfinite(value):
                tip = f"device {device.device} ({device.community}), {label}: {value:.4f}"
                chart.dot((across.at(value), y), colour, tip, radius=radius)
    chart.dot_legend = True
    chart.legend = [("planned", "var(--planned)", False), ("believed", WARM, False),
                    ("true", GOOD, False)]  # fmt: skip
    body = (
        f'<svg viewBox="0 0 {svg.WIDTH:.0f} {height:.0f}" role="img" '
        f'aria-label="{chart.title}">{"".join(parts)}{"".join(chart.parts)}'
        f'<text class="label" x="{svg.WIDTH - svg.RIGHT}" y="{height - 5}" text-anchor="end">'
        f'{chart.x_label}</text><text class="label" x="2" y="12">device</text></svg>'
    )
    return f'<section class="card"><h3>{chart.title}</h3>{chart.legend_html()}{body}</section>'


def _participation_card(run: FlightData) -> str:
    """Device by round: delivered, lost, or not scheduled."""
    numbers = [record.round for record in run.rounds]
    outcome = {(u.device, u.round): u for u in run.uplinks}
    count = len(run.devices.community)
    cell = min(34.0, (svg.WIDTH - svg.LEFT - svg.RIGHT) / max(len(numbers), 1))
    tall = 18.0
    height = svg.TOP + tall * count + svg.BOTTOM
    parts = []
    for k, community in enumerate(run.devices.community):
        y = svg.TOP + tall * k
        parts.append(
            f'<text class="tick" x="{svg.LEFT - 8}" y="{y + 13:.1f}" text-anchor="end">{k}</text>'
        )
        colour = community_colour(int(run.devices.community_of[k]))
        for column, number in enumerate(numbers):
            uplink = outcome.get((k, number))
            state, style = "not scheduled", "fill:var(--grid);opacity:.5"
            if uplink is not None and uplink.delivered:
                state, style = "delivered", f"fill:{colour}"
            elif uplink is not None:
                state, style = "lost", f"fill:none;stroke:{colour};stroke-width:1.5"
            tip = escape(f"device {k} ({community}), round {number}: {state}")
            inset = 1.5
            parts.append(
                f'<rect x="{svg.LEFT + cell * column + inset:.1f}" y="{y + inset:.1f}" '
                f'width="{max(cell - 2 * inset, 1):.1f}" height="{tall - 2 * inset:.1f}" rx="2" '
                f'style="{style}"><title>{tip}</title></rect>'
            )
    labels = sorted({numbers[round(i)] for i in np.linspace(0, len(numbers) - 1, 6)})
    parts += [
        f'<text class="tick" x="{svg.LEFT + cell * (numbers.index(n) + 0.5):.1f}" '
        f'y="{height - svg.BOTTOM + 16}" text-anchor="middle">{n}</text>'
        for n in labels
    ]
    return (
        '<section class="card"><h3>Participation</h3><p class="sub">rows: devices, columns: '
        "rounds; filled: delivered, outlined: lost, grey: not scheduled</p>"
        f'<svg viewBox="0 0 {svg.WIDTH:.0f} {height:.0f}" role="img" '
        f'aria-label="Participation of every device in every round">{"".join(parts)}'
        f'<text class="label" x="2" y="12">device</text><text class="label" '
        f'x="{svg.WIDTH - svg.RIGHT}" y="{height - 5}" text-anchor="end">round</text></svg>'
        "</section>"
    )
