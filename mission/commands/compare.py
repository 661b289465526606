"""`aerofed compare`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from mission.base.errors import InputError
from mission.base.terminal import Terminal

if TYPE_CHECKING:
    from mission.analysis.compare import RunComparison
    from mission.analysis.load import LoadedRun


def compare(
    run: Path,
    *others: Path,
    as_json: Annotated[bool, Parameter(name=("--json", "--as-json"), negative=())] = False,
    figure: Path | None = None,
    rounds: int | None = None,
) -> int:
    """Planned against flown: cross-track error, timing and packet error rates of runs.

    Of a run that was interrupted or killed, what is there is compared.

    Example: aerofed compare paper6

    Parameters
    ----------
    run
        A run's folder, or a flight log (.mcap); or those of an `aerofed fly`.
    others
        More of them, to stand beside the first.
    as_json
        Print JSON, with every number at full precision, instead of tables.
    figure
        Draw them into this file too, runs round by round, flights of plan files along the plan:
        .png, .svg or .pdf.
    rounds
        Only the first rounds, up to this number: so that runs of different length compare.
    """
    from mission.analysis.load import load_run

    if rounds is not None and rounds < 1:
        raise InputError(f"--rounds {rounds}: must be at least 1")
    loaded = [load_run(path) for path in (run, *others)]
    aside = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    data = _runs(loaded, aside, rounds=rounds, as_json=as_json, figure=figure)
    for item in loaded:
        if item.notice:
            aside.print(f"{item.path}: {item.notice}")
    if as_json:
        Terminal().print_json(json.dumps(data if others else data[0]))
    return 0


def _runs(
    loaded: Sequence["LoadedRun"],
    aside: Console,
    *,
    rounds: int | None,
    as_json: bool,
    figure: Path | None,
) -> list[dict[str, Any]]:
    from mission.analysis.compare import compare_run
    from mission.analysis.comparison_text import side_by_side, tables

    found = [compare_run(item, rounds=rounds) for item in loaded]
    _warn_of_lengths(found, aside)
    if figure is not None:
        from mission.figures.run import draw_comparison

        draw_comparison(found, figure)
    if not as_json:
        console = Terminal()
        alone = len(found) == 1
        for table in tables(found[0]) if alone else side_by_side(found, width=console.width):
            console.print(table)
    return [item.to_json() for item in found]


def _warn_of_lengths(found: Sequence["RunComparison"], aside: Console) -> None:
    counts = [len(item.rounds) for item in found]
    if len(set(counts)) > 1:
        each = ", ".join(f"{item.run.name} {n}" for item, n in zip(found, counts, strict=True))
        aside.print(
            f"runs of different length (rounds: {each}): their sums do not compare; "
            f"--rounds {min(counts)} takes the rounds that all of them have"
        )
