"""The report page of a run or a flight."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.comparison_text import (
    COLUMNS,
    TOLD,
    labelled,
    leg_rows,
    lines,
    pair_rows,
    stretch_rows,
)
from mission.analysis.load import LoadedRun, load_run
from mission.analysis.several import load_several
from mission.analysis.together import SEPARATIONS, Together
from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, write_atomically
from mission.base.tables import count, number
from mission.figures.conditions import condition_charts, estimator_charts, flight_charts
from mission.figures.film import Actor, film, with_film
from mission.figures.flight import profile_charts, timeline_chart
from mission.figures.learning import experiment_charts, learning_charts, radio_charts
from mission.figures.maps import round_map
from mission.figures.radio import beliefs, plan_errors
from mission.figures.render import card
from mission.figures.style import unchecked
from mission.figures.together import separation_chart, timetable, together_film, together_map
from mission.figures.told import flight_map, health_charts, side_by_side_charts, told_charts
from mission.log.values import HEIGHTS, NS_PER_S, FlightData
from mission.report.html import page


def write_report(
    path: Path,
    target: Path | None = None,
    plan: Path | None = None,
    *,
    others: Sequence[Path] = (),
    offsets: Mapping[str, float] | None = None,
) -> Path:
    """Write the report of a run, or of any flight, to `target`; returns the file.

    Flights of one world, a folder of their logs or `path` and `others`, have one together, by
    default `together.html`; `offsets` are those of `together`.

    `path` is its folder, or its log, which is compared with `plan` in place of its own mission.
    Default target: `report.html` in the folder, or beside the log. Of a run that was interrupted
    or killed, what is there is reported.

    Raises:
        InputError: `path` is neither, damaged, or has no finished round; or `target` cannot be
            written.
    """
    if others or (path.is_dir() and not RunFolder(path).log.is_file()):
        several = load_several((path, *others), plan, asked=True, offsets=offsets)
        beside = path if path.is_dir() else path.parent
        of_run = path.is_dir() and RunFolder(path).rounds.is_file()
        target = target or (RunFolder(path).report if of_run else beside / "together.html")
        write_atomically(target, together_html(several.together, path.stem))
        return target
    run = load_run(path, plan)
    if not run.data.rounds and not run.unjudged:
        why = f": {run.notice}" if run.notice else ""
        raise InputError(f"{path}: no round was finished, so there is nothing to report{why}")
    text = report_html(run)
    target = target or (RunFolder(path).report if path.is_dir() else path.with_suffix(".html"))
    write_atomically(target, text)
    return target


@unchecked
def report_html(loaded: LoadedRun) -> str:
    """The page of a run; where nothing was flown, flight and radio are left out."""
    run, summary = loaded.data, loaded.summary
    comparison = compare_run(loaded) if run.plans or loaded.unjudged else None
    status = str(summary.get("status", ""))
    flown: dict[str, object] = {"map": None, "film": None, "tables": []}
    flown |= {"rounds": [], "details": [], "flight": [], "radio": [], "told": [], "health": []}
    if comparison is not None:
        numbers = [item.round for item in comparison.rounds]
        plans = [plan for plan in run.plans if plan.round in numbers]
        chart = round_map(run, plans) if plans else flight_map(comparison)
        shown = film([Actor(run, run.truth)], _spans_s(comparison))
        flown["rounds"] = numbers
        if run.source.only != HEIGHTS:
            flown |= {"map": card(with_film(chart), is_map=True), "film": shown}
        if run.planned is None:
            columns = [(head.replace("\n", " "), cell) for head, cell in COLUMNS]
            flown |= {
                "details": [
                    (
                        f"Round {item.round}",
                        item.round,
                        [(head, cell(item)) for head, cell in columns]
                        + [("hole", h.words) for h in comparison.holes if h.number == item.round],
                    )
                    for item in comparison.rounds
                ],
                "flight": [card(chart) for chart in flight_charts(comparison)],
                "radio": [
                    *map(card, (*radio_charts(run, comparison), *plan_errors(run))),
                    *(card(chart, is_map=True) for chart in beliefs(run)),
                ],
                "tables": [
                    (
                        "Every round",
                        ["round", *(head for head, _ in columns)],
                        [
                            [item.round or "all", *(cell(item) for _, cell in columns)]
                            for item in (*comparison.rounds, comparison.total)
                        ],
                    )
                ],
            }
        else:
            number_of = numbers[0] if numbers else 0
            facts = [
                (text, number(of[0], digits)) for text, digits, of in labelled([comparison.total])
            ]
            notes = [(str(at), line) for at, line in enumerate(lines(comparison), start=1)]
            several = ("Legs", leg_rows(comparison.legs), 0), (TOLD, stretch_rows(comparison), 3)
            line = [timeline_chart(comparison, alone=True)]
            charts = profile_charts([comparison]) if run.plans else line
            flown |= {
                "details": [
                    ("The flight", number_of, facts),
                    *([("Spikes, and what was not compared", number_of, notes)] if notes else []),
                ],
                "flight": [card(chart) for chart in charts],
                "told": [card(chart) for chart in told_charts(comparison)],
                "health": [card(chart) for chart in health_charts(comparison)],
                "tables": [
                    (title, [head.replace("\n", " ") for head in heads], rows, words)
                    for title, (heads, rows), words in several
                    if rows
                ],
            }
    return page(
        "run.html",
        title=str(summary.get("name", loaded.path.stem)),
        badge=status,
        good=status == "finished",
        facts=[*loaded.about.split(" · ")[1:], *_devices(run)],
        notice=loaded.notice,
        flight_title="Along the plan" if run.plans else TOLD,
        a_flight=run.planned is not None,
        tiles=_tiles(run, comparison),
        learning=[card(chart) for chart in learning_charts(run)] if run.learning else [],
        estimator=[card(chart) for chart in estimator_charts(run)],
        conditions=[card(chart) for chart in condition_charts(run)],
        about=about(loaded),
        footer="Aerofed report. Positions are metres: x east, y north; heights are above home.",
        **flown,
    )


@unchecked
def together_html(world: Together, name: str) -> str:
    """The page of flights judged together."""
    flights = list(world.flights)
    first = flights[0].run.data
    limits = dict(first.config.get("limits", {}))
    if (apart_m := first.config.get("mission", {}).get("separation_m")) is not None:
        limits.setdefault(next(iter(SEPARATIONS)), apart_m)
    top, lower = pair_rows(world)
    heads, *rows = ([cell.replace("\n", " ") for cell in row] for row in (top, *lower))
    names = [pair.name for pair in world.pairs]
    how_many = count(len(flights), "vehicle")
    met, pair = list[tuple[str, str]](), list[tuple[str, int, list[tuple[str, str]]]]()
    if world.met:  # where all but one were lost as they took off nobody met
        nearest = min(world.met, key=lambda near: near.away_m)
        met = [
            (f"{nearest.away_m:.2f} m", f"nearest: {nearest.name}"),
            (f"{nearest.t_s:.1f} s", "when they were nearest"),
        ]
        own = list(zip(heads, rows[names.index(nearest.name)], strict=True))[1:]
        pair = [(nearest.name, 0, own)]
    each = labelled([item.total for item in flights])
    notes = [(str(at), line) for at, line in enumerate(world.lines, start=1)]
    learnt = experiment_charts([item.run for item in flights]) if first.learning else []
    return page(
        "run.html",
        title=name,
        badge="",
        good=True,
        facts=[how_many, *world.names],
        notice="",
        tiles=[(f"{len(flights)}", how_many.partition(" ")[2]), *met],
        map=card(with_film(together_map(world)), is_map=True),
        film=together_film(world),
        rounds=[],
        details=[
            *pair,
            *([("Losses, clocks, and what is not known", 0, notes)] if notes else []),
        ],
        a_flight=True,
        flight_title="Who came how near to whom",
        flight=[*([card(separation_chart(world, limits))] if met else []), card(timetable(world))],
        told=[card(chart) for chart in side_by_side_charts(flights)],
        tables=[
            *([("All pairs", heads, rows, 1)] if rows else []),
            (
                "Each vehicle",
                ["whole flight", *world.names],
                [[text, *(number(v, digits) for v in values)] for text, digits, values in each],
                1,
            )
        ],
        learning=[card(chart) for chart in learnt],
        **dict.fromkeys(("health", "radio", "estimator", "conditions"), ()),
        about=about(flights[0].run),
        footer="Aerofed report. Positions are metres: x east, y north; heights are above the home "
        f"of {world.names[0]}.",
    )  # fmt: skip


def _spans_s(comparison: RunComparison) -> dict[int, tuple[float, float]]:
    """From when to when each round or pass lasted; of one, or without any, 0 and the flight."""
    rounds = [item.record for item in comparison.measured]
    if len(rounds) > 1:
        return {item.round: (item.start_t_s, item.start_t_s + item.duration_s) for item in rounds}
    flown = comparison.flown
    begin_s, end_s = comparison.run.data.truth.t_ns[[0, -1]] / NS_PER_S
    return {0: (flown.start_s, flown.end_s) if flown else (float(begin_s), float(end_s))}


def _tiles(run: FlightData, comparison: RunComparison | None) -> list[tuple[str, str]]:
    tiles = []
    if comparison is None or run.planned is None:
        delivered = sum(record.delivered for record in run.rounds)
        scheduled = sum(record.scheduled for record in run.rounds)
        accuracy = run.rounds[-1].accuracy.items()
        tiles = [(f"{len(run.rounds)}", "rounds")]
        tiles += [(f"{100 * value:.1f} %", f"accuracy {name}") for name, value in accuracy]
        tiles.append((f"{delivered} / {scheduled}", "updates delivered"))
        where = "flown in rounds"
    elif run.plans:
        total = comparison.total
        tiles = [(f"{total.slots - total.slots_missed} / {total.slots}", "places reached")]
        where = "flown along the plan"
    else:
        where = "flown"
    if comparison is not None:
        total = comparison.total
        if math.isfinite(total.flown_path_m):
            tiles.append((f"{total.flown_path_m / 1000:.2f} km", where))
        known = [(total.straight_rms_m, "cross-track rms on straights")]
        if not run.plans:
            known = [(total.tracking_rms_m, "off its setpoint, rms")]
            known += [(total.height_tracking_max_m, "height off, max")]
        tiles += [(f"{value:.2f} m", what) for value, what in known if math.isfinite(value)]
        if math.isfinite(total.battery_remaining):
            tiles.append((f"{number(100 * total.battery_remaining, 0)} %", "battery left"))
        if math.isfinite(total.corner_cut_max_m):
            tiles.append((f"{total.corner_cut_max_m:.2f} m", "deepest corner cut"))
    return tiles


def _devices(run: FlightData) -> list[str]:
    count, groups = len(run.devices.community), len(run.devices.communities)
    return [f"{count} devices of {groups} communities"] if count else []


_COMPASS = "north north-east east south-east south south-west west north-west"
_NAMED = (
    *("ended_by", "seed", "simulated_s", "real_time_factor", "battery_changes"),
    "position_source",
)


def about(run: LoadedRun) -> dict[str, object]:
    """Collect wall times, conditions, versions and configuration for the end of the page."""
    summary: Mapping[str, object] = run.summary
    config = run.data.attachments.get("config.toml", b"").decode("utf-8", errors="replace")
    wind = _wind(run.data.config)
    wall_s = summary.get("wall_s")
    wall_s = wall_s if isinstance(wall_s, dict) else {}
    versions = [(key, summary[key]) for key in ("python", "platform", "cpus") if key in summary]
    libraries = summary.get("libraries")
    if isinstance(libraries, dict):
        versions += libraries.items()
    return {
        "wall_s": [(name, seconds) for name, seconds in wall_s.items() if name != "total"],
        "total_s": wall_s.get("total", sum(wall_s.values())),
        "conditions": [
            *([("wind", wind)] if wind else []),
            *((key.replace("_", " "), _say(summary[key])) for key in _NAMED if key in summary),
        ],
        "versions": "\n".join(f"{name:14} {version}" for name, version in versions),
        "config": config,
    }


def _wind(config: Mapping[str, Any]) -> str:
    """The wind as it was configured, in words; empty where nothing says it."""
    wind = config.get("vehicle", {}).get("aircraft", {}).get("wind")
    if wind is None:
        return ""
    speed_mps, severity = wind.get("speed_mps", 0.0), wind.get("turbulence_severity", 0)
    gusts = wind.get("gusts", [])
    steady = f"{speed_mps:g} m/s"
    if "from_deg" in wind:
        named = _COMPASS.split()[round(wind["from_deg"] / 45) % 8]
        steady += f" from {named} ({wind['from_deg']:g}°)"
    parts = [steady if speed_mps else "no steady wind"]
    parts.append(f"turbulence of severity {severity} of 7" if severity else "no turbulence")
    parts.append(count(len(gusts), "gust") if gusts else "no gusts")
    return ", ".join(parts)


def _say(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
