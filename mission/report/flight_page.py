"""The report of one `aerofed fly`: a plan file, planned against flown."""

import math
from collections.abc import Sequence

import numpy as np

from mission.analysis.compare_plan import PlanFlight
from mission.figures.conditions import condition_charts, estimator_charts
from mission.figures.flight import flight_map, profile_charts
from mission.figures.render import card
from mission.log.values import NS_PER_S
from mission.report.about import about
from mission.report.html import page


def flight_html(flight: PlanFlight) -> str:
    """The page of a flight, as far as it came."""
    summary, data = flight.run.summary, flight.data
    status = str(summary.get("status", ""))
    return page(
        "flight.html",
        title=str(summary.get("name", flight.source)),
        badge=status,
        good=status == "finished",
        facts=flight.about.split(" · ")[1:],
        notice=flight.run.notice,
        tiles=_tiles(flight),
        map=card(flight_map(flight), is_map=True),
        details=_details(flight),
        profiles=[card(chart) for chart in profile_charts([flight])],
        places=_places(flight),
        estimator=[card(chart) for chart in estimator_charts(data)],
        conditions=[card(chart) for chart in condition_charts(data)],
        about=about(flight.run),
        footer="Aerofed report. Positions are metres: x east, y north; heights are above home.",
    )


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


def _details(flight: PlanFlight) -> list[tuple[str, str]]:
    found = flight.numbers
    return [
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
    ]


def _places(flight: PlanFlight) -> tuple[Sequence[str], list[list[str]]]:
    heads = ("item", "x m", "y m", "height m", "reached at s", "missed by m", "height error m")
    rows: list[list[str]] = []
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
    return heads, rows


def _metres(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f} m"
