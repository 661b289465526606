"""Comparison of runs: planned against flown."""

import warnings
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mission.api.configuring import as_path
from mission.api.runs import Run
from mission.base.errors import InputError

if TYPE_CHECKING:
    from mission.api.comparison import Comparison


def compare(
    *runs: Run | Path | str,
    plan: Path | str | None = None,
    believed: bool = False,
    rounds: int | None = None,
    by_round: bool = False,
) -> "Comparison":
    """Compare flown with planned: one row per run, with the numbers of `aerofed compare`.

    The columns are explained in docs/comparing.md; the index is the name of the run's folder, with
    `by_round` that and the round. Runs of the same name get as much of their paths as tells
    them apart. The table is a DataFrame with one more method, `check`, for a verdict:
    compare(log).check(cross_track_max_m=3). `table`, `errors` and `health` hold each flight's
    stretches, and its errors against what the vehicle was told and its health over time.

    Args:
        runs: one or more, flown or loaded, or their folders, or flight logs of any kind, or folders
            of such logs; a warning names those in it that are left out: damaged ones, and those
            without a mission where others have one.
        plan: a plan file to compare with; default: the mission in the log.
        believed: compare where the autopilot believed to be, also where the truth is known.
        rounds: only the first rounds, so that runs of different length compare.
        by_round: a row a round of each run, instead of one over all its rounds.

    Raises:
        InputError: none was given, or no round of one was flown.
    """
    from mission.analysis.compare import compare_run
    from mission.analysis.comparison_text import names_of
    from mission.analysis.load import load_flights
    from mission.api.comparison import Comparison
    from mission.api.frames import frame

    if not runs:
        raise InputError("compare: give at least one run")
    if rounds is not None and rounds < 1:
        raise InputError(f"compare: rounds = {rounds}: must be at least 1")
    file = None if plan is None else as_path(plan, "plan")
    loaded = []
    for run in runs:
        if isinstance(run, Run) and file is None and not believed:
            loaded.append(run._loaded)
        else:
            path = run.path if isinstance(run, Run) else as_path(run, "path")
            flights, left_out = load_flights(path, file, believed=believed)
            loaded += flights
            for why in left_out:
                warnings.warn(f"left out: {why}", stacklevel=2)
    found = [compare_run(run, rounds=rounds) for run in loaded]
    rows = [
        {"run": name, **asdict(numbers)}
        for name, item in zip(names_of(found), found, strict=True)
        for numbers in (item.rounds if by_round else (item.total,))
    ]
    table = frame(None, rows).set_index(["run", "round"])
    made = Comparison(table if by_round else table.droplevel("round"))
    made.flights = tuple(found)
    return made
