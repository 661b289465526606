"""Comparison of runs: planned against flown."""

import warnings
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mission.api.configuring import as_path
from mission.api.runs import Run, frame
from mission.base.errors import InputError

if TYPE_CHECKING:
    from mission.api.comparison import Comparison


def compare(
    *runs: Run | Path | str,
    plan: Path | str | None = None,
    believed: bool = False,
    rounds: int | None = None,
    by_round: bool = False,
    together: bool = False,
    offsets: Mapping[str, float] | None = None,
) -> "Comparison":
    """Compare flown with planned: one row per run, with the numbers of `aerofed compare`.

    The columns are explained in docs/comparing.md; the index is the name of the run's folder, with
    `by_round` that and the round. Runs of the same name get as much of their paths as tells
    them apart. The table is a DataFrame with one more method, `check`, for a verdict:
    compare(log).check(cross_track_max_m=3). `table`, `errors` and `health` hold each flight's
    stretches, and its errors against what the vehicle was told and its health over time; `pairs`
    has the least distances of flights that are judged together.

    Args:
        runs: one or more, flown or loaded, or their folders, or flight logs of any kind, or folders
            of such logs; a warning names those in it that are left out: damaged ones, and those
            without a mission where others have one.
        plan: a plan file to compare with; default: the mission in the log.
        believed: compare where the autopilot believed to be, also where the truth is known.
        rounds: only the first rounds, so that runs of different length compare.
        by_round: a row a round of each run, instead of one over all its rounds.
        together: they flew at one time in one place: `pairs` says who came how near to whom, and
            limits such as separation_min_m judge it. A folder of one world's vehicles is judged
            so by itself.
        offsets: seconds to add to the times of a log for those of the first, by its name.

    Raises:
        InputError: none was given, or no round of one was flown; or flights that are to be judged
            together did not fly at one time in one place, or their clocks cannot be aligned.
    """
    from mission.analysis.compare import names_of
    from mission.analysis.several import load_several
    from mission.api.comparison import Comparison

    if not runs:
        raise InputError("compare: give at least one run")
    if rounds is not None and rounds < 1:
        raise InputError(f"compare: rounds = {rounds}: must be at least 1")
    file = None if plan is None else as_path(plan, "plan")
    given = [
        run._loaded
        if isinstance(run, Run) and not (run._vehicles or file or believed)
        else run.path
        if isinstance(run, Run)
        else as_path(run, "path")
        for run in runs
    ]
    several = load_several(
        given, file, believed=believed, rounds=rounds, asked=together, offsets=offsets
    )
    for why in several.left_out:
        warnings.warn(f"left out: {why}", stacklevel=2)
    flights = several.flights
    rows = [
        {"run": name, **asdict(numbers)}
        for name, item in zip(names_of(flights), flights, strict=True)
        for numbers in (item.rounds if by_round else (item.total,))
    ]
    table = frame(None, rows).set_index(["run", "round"])
    made = Comparison(table if by_round else table.droplevel("round"))
    made.several = several
    return made
