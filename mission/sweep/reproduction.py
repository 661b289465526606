"""A sweep as the tables of `docs/reproduction.md`: the outcome, and what fairness gains."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from mission.errors import InputError
from mission.sweep.curves import communities_of, groups_of
from mission.sweep.folder import SweepFolder
from mission.sweep.gains import GAIN_HEADS, paired_gains
from mission.sweep.results import FINAL_ROUNDS, RunResult, read_runs_table
from mission.sweep.stats import Interval
from mission.sweep.view import over_seeds, percent

# What the paper reports of its method against the same without fairness (section V).
PAPER = {("no_cov", "cifar10"): "+14 %", ("no_cov", "mnist"): "about equal"}


def reproduction(path: Path) -> str:
    """Markdown tables of the sweep in `path`.

    Raises:
        InputError: not a sweep's folder, or nothing in it is finished.
    """
    results = read_runs_table(path / "runs.csv")
    if not results:
        raise InputError(f"{path}: no run of this sweep is finished")
    try:
        axes = json.loads(SweepFolder(path).manifest.read_text(encoding="utf-8"))["axes"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a sweep's folder: {error}") from None
    planned = math.prod(len(values) for values in axes.values())
    lines = [f"{len(results)} of {planned} runs are finished.", "", *_outcome(results)]
    gains = paired_gains(results)
    if gains:
        rows = [[*gain.cells, PAPER.get((gain.other, gain.community), "")] for gain in gains]
        note = "Points: mean difference within a seed."
        lines += ["", *_table([*GAIN_HEADS, "paper"], rows), "", note]
    return "\n".join(lines) + "\n"


def _outcome(results: Sequence[RunResult]) -> list[str]:
    communities = communities_of(results)
    heads = ["strategy", "seeds", *(f"{name}, %" for name in communities)]
    heads += ["participation, %", "delivered, %", "PER planned", "PER true", "rounds", "km flown"]
    rows = []
    for label, runs in groups_of(results).items():
        rows.append(
            [
                label,
                str(len(runs)),
                *(percent(over_seeds(runs, f"final_accuracy_{name}")) for name in communities),
                percent(over_seeds(runs, "participation")),
                percent(over_seeds(runs, "delivered_share")),
                _plain(over_seeds(runs, "plan_per"), 3),
                _plain(over_seeds(runs, "true_per"), 3),
                _plain(over_seeds(runs, "rounds"), 0),
                _plain(over_seeds(runs, "flown_m"), 1, unit=1000.0),
            ]
        )
    note = (
        f"Accuracy: mean of the last {FINAL_ROUNDS} rounds. "
        "±: 95 % interval over seeds (Student's t)."
    )
    return [*_table(heads, rows), "", note]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---", *("---:" for _ in heads[1:])]
    return [f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows)]


def _plain(value: Interval, digits: int, *, unit: float = 1.0) -> str:
    return "-" if math.isnan(value.mean) else f"{value.mean / unit:.{digits}f}"
