"""`aerofed compare`."""

import json
from pathlib import Path

from mission.errors import InputError
from mission.terminal import Terminal


def compare(run: Path, *others: Path, as_json: bool = False, figure: Path | None = None) -> int:
    """Planned against flown: cross-track error, timing and packet error rates of runs.

    Example: aerofed compare paper6

    Parameters
    ----------
    run
        A run's folder, or a flight log (.mcap); or the folder of an `aerofed fly`.
    others
        More runs, to stand beside the first.
    as_json
        Print JSON, with every number at full precision, instead of tables.
    figure
        Draw the runs round by round into this file too: .png, .svg or .pdf.
    """
    from mission.compare import compare_run
    from mission.compare_view import side_by_side, tables
    from mission.plancompare import is_plan_flight, say_plan_flights

    paths = (run, *others)
    if any(is_plan_flight(path) for path in paths):
        if figure is not None:
            raise InputError("--figure draws runs, not flights of plan files")
        print(say_plan_flights(paths, as_json=as_json))
        return 0
    comparisons = [compare_run(path) for path in paths]
    if figure is not None:
        from mission.figures import draw_comparison

        draw_comparison(comparisons, figure)
    console = Terminal()
    if as_json:
        data = [comparison.to_json() for comparison in comparisons]
        console.print_json(json.dumps(data if others else data[0]))
    elif others:
        console.print(side_by_side(comparisons))
    else:
        for table in tables(comparisons[0]):
            console.print(table)
    return 0
