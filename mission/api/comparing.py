"""Planned against flown, run beside run."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mission.api.runs import Run, load
from mission.base.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def compare(
    *runs: Run | Path | str, rounds: int | None = None, by_round: bool = False
) -> "pd.DataFrame":
    """Planned against flown, a row a run: the numbers of `aerofed compare`.

    The columns are explained in docs/comparing.md; the index is the name of the run's folder, with
    `by_round` that and the round. Two runs of one name keep their paths.

    Args:
        runs: one or more, flown or loaded, or their folders.
        rounds: only the first rounds, so that runs of different length compare.
        by_round: a row a round of each run, instead of one over all its rounds.

    Raises:
        InputError: none was given, or no round of one was flown.
    """
    from mission.analysis.compare import compare_run
    from mission.api.frames import frame

    if not runs:
        raise InputError("compare: give at least one run")
    if rounds is not None and rounds < 1:
        raise InputError(f"compare: rounds = {rounds}: must be at least 1")
    loaded = [run if isinstance(run, Run) else load(run) for run in runs]
    found = [compare_run(run._loaded, rounds=rounds) for run in loaded]
    names = [item.run.name for item in found]
    rows = [
        {
            "run": item.run.name if names.count(item.run.name) == 1 else str(item.run.path),
            **asdict(numbers),
        }
        for item in found
        for numbers in (item.rounds if by_round else (item.total,))
    ]
    table = frame(None, rows)
    if by_round:
        return table.set_index(["run", "round"])
    return table.set_index("run").drop(columns="round")
