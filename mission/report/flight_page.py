"""The report of one `aerofed fly`: a plan file, planned against flown."""

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from mission.analysis.alignment import align
from mission.analysis.compare_plan import PlanFlight
from mission.analysis.load import flown, ground_speed
from mission.log.values import NS_PER_S, Floats, Track
from mission.report import html, svg
from mission.report.about import about_cards
from mission.report.charts import COOL, GOOD, along_card, card
from mission.report.conditions import condition_cards, estimator_cards
from mission.report.maps import MapFrame, map_legend, map_svg, thin
from mission.report.svg import Series

_TOLERANCE = 0.02  # metres, or metres a second, that thinning may move a line
_FLOWN = "var(--flown)"


def flight_html(flight: PlanFlight) -> str:
    """The page of a flight, as far as it came."""
    summary, data = flight.run.summary, flight.data
    title = str(summary.get("name", flight.source))
    status = str(summary.get("status", ""))
    facts = [f"plan file {flight.source}"]
    if "seed" in summary:
        facts.append(f"seed {summary['seed']}")
    sections = [
        html.heading(title, badge=status, good=status == "finished", facts=facts,
                     notice=flight.run.notice),
        html.tiles(_tiles(flight)),
        _planned_and_flown(flight),
        html.cards("Along the plan", _profiles(flight)),
        _places(flight),
        html.cards("Estimator", estimator_cards(data)),
        html.cards("The flight", [*condition_cards(data), *about_cards(flight.run)]),
    ]  # fmt: skip
    footer = "Aerofed report. Positions are metres: x east, y north; heights are above home."
    return html.document(title, sections, footer=footer)


def _tiles(flight: PlanFlight) -> list[tuple[str, str]]:
    found, summary = flight.numbers, flight.run.summary
    tiles = [
        (f"{found.places_reached} / {found.places}", "places reached"),
        (f"{found.flown_path_m:.0f} m", f"flown, {found.plan_path_m:.0f} m planned"),
        (f"{found.flown_duration_s:.0f} s", f"flown, {found.plan_duration_s:.0f} s at full speed"),
        (f"{found.cross_track_rms_m:.2f} m", "cross-track rms"),
        (f"{found.cross_track_max_m:.2f} m", "cross-track max"),
    ]
    if math.isfinite(found.battery_remaining):
        tiles.append((f"{100 * found.battery_remaining:.0f} %", "battery left"))
    if "real_time_factor" in summary:
        tiles.append((f"{float(summary['real_time_factor']):.0f}×", "real time"))
    return tiles


def _planned_and_flown(flight: PlanFlight) -> str:
    frame, run = MapFrame(flight.data), flight.data
    rest = run.truth.between(int(flown(run, flight.record).t_ns[-1]), int(run.truth.t_ns[-1]))
    marks = [f'<path class="rest" d="{frame.line(thin(rest.pos_m[:, :2], _TOLERANCE))}"/>']
    for seq, place in flight.places_m.items():
        x, y = frame.at(place[:2])
        name = f"item {seq}" + ("" if seq in flight.reached else ": not reached")
        kind = "place" if seq in flight.reached else "place missed"
        marks.append(
            f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="6"><title>{name}</title></circle>'
            f'<text class="tick" x="{x + 9:.1f}" y="{y - 9:.1f}">{seq}</text>'
        )
    for number, place in enumerate(flight.rally_m):
        x, y = frame.at(place[:2])
        marks.append(
            f'<path class="rally" d="M{x:.1f} {y - 9:.1f}l8 14h-16z">'
            f"<title>rally point {number}</title></path>"
        )
    legend = [
        *map_legend(run),
        html.key("border-top:2px dotted var(--flown)", "after the last place"),
        "<span>numbers: items of the plan</span>",
    ]
    if flight.rally_m:
        legend.append("<span>triangles: rally points</span>")
    found = flight.numbers
    rows = "".join(
        f"<tr><td>{escape(label)}</td><td class=number>{escape(value)}</td></tr>"
        for label, value in (
            ("path planned / flown", f"{found.plan_path_m:.1f} / {found.flown_path_m:.1f} m"),
            ("duration at planned speed", f"{found.plan_duration_s:.1f} s"),
            ("duration flown", f"{found.flown_duration_s:.1f} s"),
            (
                "cross-track rms / max",
                f"{found.cross_track_rms_m:.2f} / {found.cross_track_max_m:.2f} m",
            ),
            ("places passed within", _metres(found.miss_max_m)),
            ("height there, error max", _metres(found.height_error_max_m)),
            ("estimate error rms", _metres(found.estimate_rms_m)),
        )
    )
    return (
        '<h2>Planned and flown</h2><div class="flight"><section class="card">'
        f'<div class="legend">{"".join(legend)}</div>{map_svg(run, above="".join(marks))}</section>'
        f'<section class="card"><h3>The mission, to its last place</h3><table>{rows}</table>'
        "</section></div>"
    )


def _profiles(flight: PlanFlight) -> list[str]:
    run, plan = flight.data, flight.plan
    track = flown(run, flight.record)
    fit = align(track.pos_m[:, :2], plan.waypoints_m)
    legs_m = np.linalg.norm(np.diff(plan.waypoints_m, axis=0), axis=1)
    planned_m = np.column_stack((np.concatenate(([0.0], np.cumsum(legs_m))), plan.height_m))
    along = "m along the plan"
    height = svg.line_chart(
        "Height above home",
        [
            _series("planned", "var(--planned)", planned_m, dashed=True),
            _series("flown", _FLOWN, np.column_stack((fit.along_m, track.pos_m[:, 2]))),
        ],
        x_label=along, y_label="m",
    )  # fmt: skip
    speed = svg.line_chart(
        "Ground speed",
        [_series("true", COOL, np.column_stack((fit.along_m, ground_speed(track))))],
        x_label=along, y_label="m/s",
    )  # fmt: skip
    cards = [card(height), card(speed), _estimate(flight, track)]
    if plan.path_m > 0:
        cards.insert(1, along_card(run, note="dashed: corners of the plan"))
    return cards


def _estimate(flight: PlanFlight, track: Track) -> str:
    belief = flown(flight.data, flight.record, track=flight.data.belief)
    away_m = belief.pos_m - track.pos_m
    t_s = track.t_ns / NS_PER_S
    chart = svg.line_chart(
        "Estimate against the truth",
        [
            _series("horizontal", COOL, np.column_stack((t_s, np.hypot(*away_m[:, :2].T)))),
            _series("height", GOOD, np.column_stack((t_s, np.abs(away_m[:, 2])))),
        ],
        x_label="simulated s", y_label="m",
    )  # fmt: skip
    return card(chart)


def _places(flight: PlanFlight) -> str:
    heads = ("item", "x m", "y m", "height m", "reached at s", "missed by m", "height error m")
    rows: list[Sequence[str]] = []
    for seq, place in flight.places_m.items():
        cells = [str(seq), *(f"{value:.1f}" for value in place)]
        event = flight.reached.get(seq)
        if event is None:
            cells += ["not reached", "–", "–"]
        else:
            miss = np.array(event.true_m) - place
            at_s = (event.t_ns - flight.plan.t_ns) / NS_PER_S
            cells += [f"{at_s:.1f}", f"{np.hypot(*miss[:2]):.2f}", f"{miss[2]:+.2f}"]
        rows.append(cells)
    note = "where the aircraft was on the instant at which it reported the item as reached"
    return html.table("Places", heads, rows, note=note)


def _series(label: str, colour: str, points: Floats, *, dashed: bool = False) -> Series:
    kept = thin(points, _TOLERANCE)
    return Series(label, colour, kept[:, 0].tolist(), kept[:, 1].tolist(), dashed, dots=False)


def _metres(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f} m"
