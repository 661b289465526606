"""The report of a sweep: strategies against each other, in one HTML file."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from mission.base.run_folder import write_atomically
from mission.base.tables import count
from mission.figures.render import card
from mission.figures.style import unchecked
from mission.report.html import page
from mission.sweep.folder import SweepState, read_sweep
from mission.sweep.outcome.curves import flies, groups_of, pictures_of
from mission.sweep.outcome.figures import curve_charts, final_chart, gain_charts
from mission.sweep.outcome.view import (
    ACCURACY,
    AT_THE_END,
    FAIRNESS,
    METHOD,
    POINTS,
    REST,
    Cells,
    gain_table,
    outcome,
    over_seeds,
    paired_gains,
    percent,
)
from mission.sweep.results import RunResult, communities_of

# Section of each picture.
_SECTIONS = {
    "accuracy-rounds": "Accuracy by round",
    "accuracy-distance": "Accuracy by distance",
    "accuracy-time": "Accuracy by time",
    "per": "Packet error rate and participation",
    "participation": "Packet error rate and participation",
    "fairness": "Fairness",
}
_UNFINISHED = (
    "runs are done, and everything below is about those. Rows that rest on different seeds are "
    "not comparable; seed by seed they are."
)
_EQUAL = "at equal rounds, metres or energy: where the run that spent least of it ends"
_ARRIVED = (
    "arrived: devices whose update arrived, of the community's, and of those scheduled; mean over "
    "seeds, from three on ± 95 % interval (Student's t)"
)


def write_sweep_report(folder: Path, target: Path) -> Path:
    """Write the report of a sweep's folder to `target`; returns the file.

    Raises:
        InputError: not a sweep's folder, none of its runs is finished, or `target` cannot be
            written.
    """
    write_atomically(target, sweep_html(read_sweep(folder)))
    return target


@unchecked
def sweep_html(state: SweepState) -> str:
    """The page about a sweep, finished or not."""
    results = state.results
    communities = communities_of(results)
    strategies = len({result.point.strategy for result in results})
    seeds = len({result.point.seed for result in results})
    settings = len({result.point.where for result in results})
    facts = [
        "sweep",
        f"{strategies} {'strategy' if strategies == 1 else 'strategies'}",
        *([count(settings, "setting")] if settings > 1 else []),
        count(seeds, "seed"),
    ]
    done, planned = len(results), state.planned
    pictures = pictures_of(results)
    curves: dict[str, list[dict[str, object]]] = {}
    for picture in pictures:
        cards = [card(chart) for chart in curve_charts(picture)]
        curves.setdefault(_SECTIONS[picture.name], []).extend(cards)
    return page(
        "sweep.html",
        title=str(state.config["name"]),
        badge="finished" if not state.missing else f"{done} of {planned} runs",
        good=not state.missing,
        facts=facts,
        notice="",
        tiles=_headline(results),
        missing=[(item.run, item.why) for item in state.missing],
        unfinished=f"{done} of {planned} {_UNFINISHED}",
        outcome=outcome(results, (*ACCURACY, *FAIRNESS, *REST), seeds=state.seeds),
        outcome_note=f"{AT_THE_END}; {_EQUAL}; {_ARRIVED}",
        finals=[card(final_chart(results, name)) for name in communities],
        method=METHOD,
        points=POINTS,
        gains=[card(chart) for chart in gain_charts(results)],
        gain_table=gain_table(paired_gains(results)),
        curves=curves,
        runs=_runs(results),
        config=json.dumps(state.config, indent=2),
        footer="Aerofed sweep report. "
        + (f"Lines: {pictures[0].about or 'one seed'}." if pictures else ""),
    )


def _headline(results: Sequence[RunResult]) -> list[tuple[str, str]]:
    tiles = [(str(len(results)), "run" if len(results) == 1 else "runs")]
    for name in communities_of(results):
        column = f"final_accuracy_{name}"
        means = {
            label: over_seeds(runs, column)
            for label, runs in groups_of(results).items()
            if flies(runs)
        }
        known = {label: mean for label, mean in means.items() if not math.isnan(mean.mean)}
        if known:
            # Not "the best": within the intervals another may be.
            best = max(known, key=lambda label: known[label].mean)
            apart = " (ideal apart)" if len(groups_of(results)) > len(means) else ""
            tiles.append((f"{percent(known[best])} %", f"highest mean{apart}, {name}: {best}"))
    flown_m = sum(float(run.summary["flown_m"]) for run in results)
    hours = sum(float(run.summary["simulated_s"]) for run in results) / 3600
    wall_h = sum(run.wall_s.get("total", 0.0) for run in results) / 3600
    return [
        *tiles,
        (f"{flown_m / 1000:.1f} km", "of path, all rounds"),
        (f"{hours:.1f} h", "simulated"),
        (f"{wall_h:.2f} h", "of one core's wall time"),
    ]


def _runs(results: Sequence[RunResult]) -> Cells:
    communities = communities_of(results)
    heads = ["run", "seed", *(f"{name} %" for name in communities), "rounds", "km of path"]
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
    return heads, rows
