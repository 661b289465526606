"""The report of a sweep: strategies against each other, in one HTML file."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from mission.base.run_folder import write_atomically
from mission.report import html
from mission.report.sweep_charts import curve_cards, ends_card
from mission.sweep.outcome.curves import communities_of, flies, groups_of, pictures_of
from mission.sweep.outcome.ends import final_rows, gain_rows
from mission.sweep.outcome.gains import METHOD, gain_table, paired_gains
from mission.sweep.outcome.view import final_rounds, number, over_seeds, percent
from mission.sweep.results import RunResult
from mission.sweep.state import SweepState, read_sweep

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
    page = sweep_html(read_sweep(folder))
    write_atomically(target, page)
    return target


def sweep_html(state: SweepState) -> str:
    """The page about a sweep, finished or not."""
    results = state.results
    communities = communities_of(results)
    title = str(state.config["name"])
    seeds = len({result.point.seed for result in results})
    settings = len({result.point.where for result in results})
    facts = [
        "sweep",
        _count(len({result.point.strategy for result in results}), "strategy", "strategies"),
        *([_count(settings, "setting", "settings")] if settings > 1 else []),
        _count(seeds, "seed", "seeds"),
    ]
    done, planned = len(results), state.planned
    sections = [
        html.heading(
            title,
            badge="finished" if not state.missing else f"{done} of {planned} runs",
            good=not state.missing,
            facts=facts,
        ),
        html.tiles(_headline(results)),
        _missing(state),
        _outcome(state),
        html.cards(
            "Final accuracy",
            [
                ends_card(f"{name}: accuracy at the end", final_rows(results, name), x_label="%")
                for name in communities
            ],
        ),
    ]
    gains = paired_gains(results)
    if gains:
        cards = [
            ends_card(f"{name}: {METHOD} less the other", ends, x_label="points", zero=True)
            for name in communities
            if (ends := gain_rows(results, name))
        ]
        note = "final accuracy; points: mean difference within a seed, ± 95 % interval"
        heads, rows = gain_table(gains)
        sections += [
            html.cards(f"What {METHOD} gains", cards),
            html.table("Seed by seed", heads, rows, text=len(heads) - 3, note=note),
        ]
    curves: dict[str, list[str]] = {}
    for picture in pictures_of(results):
        curves.setdefault(_SECTIONS[picture.name], []).extend(curve_cards(picture))
    sections += [html.cards(name, cards) for name, cards in curves.items()]
    about = next(iter(pictures_of(results))).about
    config = json.dumps(state.config, indent=2)
    sections += [_runs(results), html.cards("Conditions", [html.folded("Configuration", config)])]
    footer = f"Aerofed sweep report. Lines: {about or 'one seed'}."
    return html.document(title, sections, footer=footer)


def _count(number: int, one: str, several: str) -> str:
    return f"{number} {one if number == 1 else several}"


def _missing(state: SweepState) -> str:
    """What is not there yet, and what that means for the rest of the page."""
    if not state.missing:
        return ""
    note = (
        f"{len(state.results)} of {state.planned} runs are done, and everything below is about "
        "those. Rows that rest on different seeds are not comparable; seed by seed they are."
    )
    rows = [(item.run, item.why) for item in state.missing]
    return html.table("Not done", ("run", "state"), rows, text=2, note=note)


def _headline(results: Sequence[RunResult]) -> list[tuple[str, str]]:
    tiles = [(str(len(results)), "run" if len(results) == 1 else "runs")]
    for name in communities_of(results):
        column = f"final_accuracy_{name}"
        means = {
            label: over_seeds(runs, column).mean
            for label, runs in groups_of(results).items()
            if flies(runs)
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


def _outcome(state: SweepState) -> str:
    results = state.results
    communities = communities_of(results)
    heads = ["strategy", "seeds", *(f"{name} %" for name in communities)]
    heads += [*(f"CoV {name}" for name in communities), "Jain"]
    heads += [*(f"{name} arrived %" for name in communities), "scheduled arrived %"]
    heads += ["PER planned", "PER true", "rounds", "km flown"]
    rows = [
        [
            label,
            state.seeds(label),
            *(percent(over_seeds(runs, f"final_accuracy_{name}")) for name in communities),
            *(number(over_seeds(runs, f"final_cov_{name}"), 2) for name in communities),
            number(over_seeds(runs, "final_jain_communities"), 3),
            *(percent(over_seeds(runs, f"participation_{name}")) for name in communities),
            percent(over_seeds(runs, "delivered_share")),
            number(over_seeds(runs, "plan_per"), 3),
            number(over_seeds(runs, "true_per"), 3),
            number(over_seeds(runs, "rounds"), 0),
            number(over_seeds(runs, "flown_m"), 1, unit=1000.0),
        ]
        for label, runs in groups_of(results).items()
    ]
    note = (
        f"accuracy, CoV and Jain index: {final_rounds(results)}; arrived: devices whose update "
        "arrived, of the community's, and of those scheduled; mean over seeds ± 95 % interval "
        "(Student's t)"
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
                str(run.point.seed),
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
