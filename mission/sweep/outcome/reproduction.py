"""A sweep as the tables of `docs/reproduction.md`: the outcome, and what fairness gains."""

from collections.abc import Sequence

from mission.sweep.outcome.gains import METHOD, POINTS, gain_table, paired_gains
from mission.sweep.outcome.luck import luck_rows
from mission.sweep.outcome.view import ACCURACY, REST, final_rounds, outcome
from mission.sweep.state import SweepState

# What the paper reports of its method against the same without fairness (section V).
CLAIMED, CLAIM = 0.14, "+14 %"
PAPER = {("no_cov", "cifar10"): CLAIM, ("no_cov", "mnist"): "about equal"}


def reproduction(state: SweepState) -> str:
    """Markdown tables of a sweep, finished or not."""
    lines = [state.progress, "", *_outcome(state)]
    gains = paired_gains(state.results)
    if gains:
        heads, rows = gain_table(gains)
        rows = [
            [*row, PAPER.get((gain.other, gain.community), "")]
            for row, gain in zip(rows, gains, strict=True)
        ]
        lines += ["", *_table([*heads, "paper"], rows), "", f"P{POINTS[1:]}."]
    claimed = [g for g in gains if PAPER.get((g.other, g.community)) == CLAIM]
    if claimed:
        note = (
            f"How often {METHOD} seems ahead by {CLAIM} or more to a reader of fewer runs. All "
            "choices of seeds, and of rounds of the second half, count alike."
        )
        lines += ["", *_table(*luck_rows(claimed, CLAIMED)), "", note]
    return "\n".join(lines) + "\n"


def _outcome(state: SweepState) -> list[str]:
    heads, rows = outcome(state.results, (ACCURACY, *REST), seeds=state.seeds)
    note = (
        "First columns: accuracy on the images that it is reported on, "
        f"{final_rounds(state.results)}. Arrived: devices whose update arrived, of the community's "
        "devices (participation in runs.csv), or of those scheduled (delivered_share). "
        "±: 95 % interval over seeds (Student's t)."
    )
    return [*_table(heads, rows), "", note]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---", *("---:" for _ in heads[1:])]
    return [f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows)]
