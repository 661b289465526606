"""The report of a sweep: strategies against each other, in one HTML file."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from mission.errors import InputError
from mission.report import html
from mission.report.sweep_charts import curve_cards, interval_card
from mission.sweep.curves import communities_of, groups_of, pictures_of
from mission.sweep.folder import read_manifest
from mission.sweep.gains import GAIN_HEADS, METHOD, paired_gains
from mission.sweep.results import FINAL_ROUNDS, RunResult, read_results
from mission.sweep.stats import Interval
from mission.sweep.view import over_seeds, percent

# Section of each picture.
_SECTIONS = {
    "accuracy-rounds": "Accuracy by round",
    "accuracy-distance": "Accuracy by distance",
    "accuracy-time": "Accuracy by time",
    "per": "Packet error rate and participation",
    "participation": "Packet error rate and participation",
    "fairness": "Fairness",
}


def write_sweep_report(folder: Path, target: Path) -> Path:
    """Write the report of a sweep's folder to `target`; returns the file.

    Raises:
        InputError: not a sweep's folder, none of its runs is finished, or `target` cannot be
            written.
    """
    manifest = read_manifest(folder)
    results = read_results(folder)
    if not results:
        raise InputError(f"{folder}: no run of this sweep is finished")
    planned = math.prod(len(values) for values in manifest["axes"].values())
    page = sweep_html(
        str(manifest["config"].get("name", folder.name)),
        results,
        planned=planned,
        config=json.dumps(manifest["config"], indent=2),
    )
    try:
        target.write_text(page, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{target}: cannot write the report: {error.strerror}") from None
    return target


def sweep_html(title: str, results: Sequence[RunResult], *, planned: int, config: str) -> str:
    """The page about the finished runs of a sweep of `planned` runs."""
    groups, communities = groups_of(results), communities_of(results)
    seeds = len({result.keys["seed"] for result in results})
    facts = [f"{len(groups)} strategies and settings", f"{seeds} seeds"]
    done = len(results)
    sections = [
        html.heading(
            title,
            badge="finished" if done == planned else f"{done} of {planned} runs",
            good=done == planned,
            facts=["sweep", *facts],
        ),
        html.tiles(_headline(results)),
        _outcome(results),
        html.cards("Final accuracy", [interval_card(results, name) for name in communities]),
    ]
    curves: dict[str, list[str]] = {}
    for picture in pictures_of(results):
        curves.setdefault(_SECTIONS[picture.name], []).extend(curve_cards(picture))
    sections += [html.cards(name, cards) for name, cards in curves.items()]
    gains = paired_gains(results)
    if gains:
        note = "final accuracy; points: mean difference within a seed, ± 95 % interval"
        rows = [gain.cells for gain in gains]
        sections.append(html.table(f"What {METHOD} gains", GAIN_HEADS, rows, text=3, note=note))
    sections += [_runs(results), html.cards("Conditions", [html.folded("Configuration", config)])]
    footer = "Aerofed sweep report. Lines are means over seeds, areas their 95 % intervals."
    return html.document(title, sections, footer=footer)


def _headline(results: Sequence[RunResult]) -> list[tuple[str, str]]:
    tiles = [(str(len(results)), "runs")]
    for name in communities_of(results):
        column = f"final_accuracy_{name}"
        means = {
            label: over_seeds(runs, column).mean
            for label, runs in groups_of(results).items()
            if any(float(run.summary["simulated_s"]) > 0 for run in runs)
        }
        known = {label: mean for label, mean in means.items() if not math.isnan(mean)}
        if known:
            best = max(known, key=lambda label: known[label])
            tiles.append((f"{100 * known[best]:.1f} %", f"best flown, {name}: {best}"))
    flown_m = sum(float(run.summary["flown_m"]) for run in results)
    hours = sum(float(run.summary["simulated_s"]) for run in results) / 3600
    wall_h = sum(run.wall_s.get("total", 0.0) for run in results) / 3600
    return [
        *tiles,
        (f"{flown_m / 1000:.1f} km", "flown in rounds"),
        (f"{hours:.1f} h", "simulated"),
        (f"{wall_h:.2f} h", "of one core's wall time"),
    ]


def _outcome(results: Sequence[RunResult]) -> str:
    communities = communities_of(results)
    heads = ["strategy", "seeds", *(f"{name} %" for name in communities)]
    heads += [*(f"CoV {name}" for name in communities), "Jain", "participation %", "delivered %"]
    heads += ["PER planned", "PER true", "rounds", "km flown"]
    rows = [
        [
            label,
            str(len(runs)),
            *(percent(over_seeds(runs, f"final_accuracy_{name}")) for name in communities),
            *(_number(over_seeds(runs, f"final_cov_{name}"), 2) for name in communities),
            _number(over_seeds(runs, "final_jain_communities"), 3),
            percent(over_seeds(runs, "participation")),
            percent(over_seeds(runs, "delivered_share")),
            _number(over_seeds(runs, "plan_per"), 3),
            _number(over_seeds(runs, "true_per"), 3),
            _number(over_seeds(runs, "rounds"), 0),
            _number(over_seeds(runs, "flown_m"), 1, unit=1000.0),
        ]
        for label, runs in groups_of(results).items()
    ]
    note = (
        f"accuracy, CoV and Jain index: mean of the last {FINAL_ROUNDS} rounds; "
        "mean over seeds ± 95 % interval (Student's t)"
    )
    return html.table("Outcome", heads, rows, text=1, note=note)


def _runs(results: Sequence[RunResult]) -> str:
    communities = communities_of(results)
    heads = ["run", "seed", *(f"{name} %" for name in communities), "rounds", "km flown"]
    heads += ["delivered", "minutes simulated", "wall minutes"]
    rows = []
    for run in results:
        of = run.summary
        finals = [float(of.get(f"final_accuracy_{name}", math.nan)) for name in communities]
        rows.append(
            [
                str(of["run"]),
                str(run.keys["seed"]),
                *("-" if math.isnan(value) else f"{100 * value:.1f}" for value in finals),
                str(of["rounds"]),
                f"{float(of['flown_m']) / 1000:.1f}",
                f"{of['delivered']}/{of['scheduled']}",
                f"{float(of['simulated_s']) / 60:.1f}",
                f"{run.wall_s.get('total', math.nan) / 60:.1f}",
            ]
        )
    note = "aerofed report runs/RUN writes the report of one of them"
    return html.table("Every run", heads, rows, text=1, note=note)


def _number(value: Interval, digits: int, *, unit: float = 1.0) -> str:
    return "-" if math.isnan(value.mean) else f"{value.mean / unit:.{digits}f}"
