"""Puts a run's report together."""

import json
import math
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from mission.analysis.compare import Comparison, RunComparison, compare_run
from mission.analysis.compare_plan import is_plan_flight, plan_flight
from mission.analysis.load import LoadedRun, load_run
from mission.base.errors import InputError
from mission.base.palette import community_colour, css_colour, per_colour
from mission.base.run_folder import write_atomically
from mission.log.values import FlightData
from mission.report import html
from mission.report.about import about_cards
from mission.report.charts import flight_cards, learning_cards, radio_cards
from mission.report.conditions import condition_cards, estimator_cards
from mission.report.flight_page import flight_html
from mission.report.maps import map_legend, map_svg

REPORT_NAME = "report.html"


def write_report(path: Path, target: Path | None = None) -> Path:
    """Write the report of a run, or of a flight of a plan file, to `target`; returns the file.

    `path` is its folder, or its bare log. Default target: `report.html` in the folder, or beside
    the log. Of a run that was interrupted or killed, what is there is reported.

    Raises:
        InputError: neither, damaged, without a finished round, or `target` cannot be written.
    """
    run = load_run(path)
    if is_plan_flight(run):
        page = flight_html(plan_flight(run))
    elif run.data.rounds:
        page = report_html(run)
    else:
        why = f": {run.notice}" if run.notice else ""
        raise InputError(f"{path}: no round was finished, so there is nothing to report{why}")
    target = target or (path / REPORT_NAME if path.is_dir() else path.with_suffix(".html"))
    write_atomically(target, page)
    return target


def report_html(loaded: LoadedRun) -> str:
    """The page of a run; where nothing was flown, flight and radio are left out."""
    run, summary = loaded.data, loaded.summary
    comparison = compare_run(loaded) if run.plans else None
    title = str(summary.get("name", loaded.path.stem))
    sections = [_head(title, loaded), _tiles(run, comparison, summary)]
    if comparison is not None:
        sections += [
            _flight(run, comparison),
            html.cards("Against the plan", flight_cards(run, comparison)),
            html.cards("Radio", radio_cards(run, comparison)),
        ]
    sections.append(html.cards("Learning", learning_cards(run)))
    if comparison is not None:
        sections.append(_round_table(comparison))
    sections.append(html.cards("Estimator", estimator_cards(run)))
    sections.append(html.cards("The run", [*condition_cards(run), *about_cards(loaded)]))
    footer = "Aerofed report. Positions are metres in the area: x east, y north."
    return html.document(title, sections, footer=footer)


def _head(title: str, loaded: LoadedRun) -> str:
    run, summary = loaded.data, loaded.summary
    facts = [f"{len(run.devices.community)} devices of {len(run.devices.communities)} communities"]
    if "strategy" in summary:
        facts.insert(0, f"strategy {summary['strategy']}")
    if "seed" in summary:
        facts.append(f"seed {summary['seed']}")
    status = str(summary.get("status", ""))
    return html.heading(
        title, badge=status, good=status == "finished", facts=facts, notice=loaded.notice
    )


def _tiles(run: FlightData, comparison: RunComparison | None, summary: Mapping[str, Any]) -> str:
    last = run.rounds[-1]
    tiles = [(f"{len(run.rounds)}", "rounds")]
    tiles += [(f"{100 * value:.1f} %", f"accuracy {name}") for name, value in last.accuracy.items()]
    delivered = sum(record.delivered for record in run.rounds)
    scheduled = sum(record.scheduled for record in run.rounds)
    tiles.append((f"{delivered} / {scheduled}", "updates delivered"))
    if comparison is not None:
        total = comparison.total
        tiles += [
            (f"{total.flown_path_m / 1000:.2f} km", "flown in rounds"),
            (f"{_number(total.straight_rms_m)} m", "cross-track rms on straights"),
            (f"{100 * last.battery_remaining:.0f} %", "battery left"),
        ]
        if math.isfinite(total.corner_cut_max_m):
            tiles.append((f"{total.corner_cut_max_m:.2f} m", "deepest corner cut"))
        if "real_time_factor" in summary:
            tiles.append((f"{float(summary['real_time_factor']):.0f}×", "real time in flight"))
    return html.tiles(tiles)


def _flight(run: FlightData, comparison: RunComparison) -> str:
    rounds = [item.round for item in comparison.rounds]
    legend = [
        *map_legend(run),
        *(
            html.key(f"background:{community_colour(index)}", name, dot=True)
            for index, name in enumerate(run.devices.communities)
        ),
        *(
            html.key(f"border-top:3px solid {css_colour(per_colour(per))}", f"link, PER {per:g}")
            for per in (0.0, 0.5, 1.0)
        ),
        "<span>crossed: lost · faint: not served · size: importance</span>",
    ]
    facts = "".join(_facts(item) for item in comparison.rounds)
    facts = facts.replace("<div data-round", '<div class="on" data-round', 1)
    return (
        '<h2>Planned and flown</h2><div class="flight"><section class="card">'
        '<div class="control"><button id="previous" aria-label="previous round">‹</button>'
        f'<input id="round" type="range" min="0" max="{len(rounds) - 1}" value="0" '
        f"data-rounds='{json.dumps(rounds)}' aria-label=\"round\">"
        '<button id="next" aria-label="next round">›</button>'
        f'<output id="round-label" for="round">Round {rounds[0]}</output>'
        '<label><input id="all" type="checkbox"> all flown paths</label></div>'
        f'<div class="legend">{"".join(legend)}</div>{map_svg(run)}</section>'
        f'<section class="card">{facts}</section></div>'
    )


def _facts(item: Comparison) -> str:
    rows = [
        ("path planned / flown", f"{item.plan_path_m:.1f} / {item.flown_path_m:.1f} m"),
        ("duration", f"{item.duration_s:.1f} s"),
        ("delivered", f"{item.delivered} of {item.scheduled} (expected {item.expected:.1f})"),
        ("objective planned", _number(item.plan_objective, 3)),
        ("objective believed", _number(item.est_objective, 3)),
        ("objective true", _number(item.true_objective, 3)),
        ("proven bound", _number(item.upper_bound, 3)),
        ("cross-track rms / max", _pair(item.cross_track_rms_m, item.cross_track_max_m, "m")),
        ("on straights rms / max", _pair(item.straight_rms_m, item.straight_max_m, "m")),
        ("corner cut mean / max", _pair(item.corner_cut_mean_m, item.corner_cut_max_m, "m")),
        ("height error rms / max", _pair(item.height_rms_m, item.height_max_m, "m")),
        ("estimate error rms / max", _pair(item.estimate_rms_m, item.estimate_max_m, "m")),
        ("slot late mean / max", _pair(item.slot_late_mean_s, item.slot_late_max_s, "s")),
        ("slots never reached", f"{item.slots_missed} of {item.slots}"),
    ]
    body = "".join(
        f"<tr><td>{escape(label)}</td><td class=number>{escape(value)}</td></tr>"
        for label, value in rows
    )
    return f'<div data-round="{item.round}"><h3>Round {item.round}</h3><table>{body}</table></div>'


def _round_table(comparison: RunComparison) -> str:
    heads = ("round", "flown m", "cross-track rms m", "max m", "corner cut m", "slot late s",
             "PER planned", "PER true", "objective planned", "true",
             "lost %", "arrived")  # fmt: skip

    def row(item: Comparison) -> list[str]:
        return [
            "all" if item.round is None else str(item.round), f"{item.flown_path_m:.0f}",
            _number(item.cross_track_rms_m), _number(item.cross_track_max_m),
            _number(item.corner_cut_max_m), _number(item.slot_late_mean_s),
            _number(item.plan_per_mean, 4), _number(item.true_per_mean, 4),
            _number(item.plan_objective, 3), _number(item.true_objective, 3),
            _number(100 * (1 - item.true_objective / item.plan_objective), 2)
            if item.plan_objective > 0 else "–",
            f"{item.delivered}/{item.scheduled}",
        ]  # fmt: skip

    rows = [row(item) for item in (*comparison.rounds, comparison.total)]
    return html.table("Every round", heads, rows)


def _number(value: float, digits: int = 2) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def _pair(first: float, second: float, unit: str) -> str:
    return f"{_number(first)} / {_number(second)} {unit}"
