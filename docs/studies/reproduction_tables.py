"""A sweep as the tables of reproduction.md, beside the paper's; and where the method wins.

    python docs/studies/reproduction_tables.py SWEEP [--figures DIR]

SWEEP is the folder of a sweep, which need not be over; where its runs are gone, its tables are
enough. `--figures` draws the sweep's pictures anew, and maps of the gain over two swept settings.
"""

import argparse
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import altair as alt
import numpy as np

from mission.figures.charts import finished
from mission.figures.render import save_all, stacked
from mission.figures.style import BAD, COOL, GRID, INK, SOFT, Chart, arranged, table
from mission.sweep.folder import SweepState, read_sweep
from mission.sweep.grid import file_name
from mission.sweep.outcome.curves import ENOUGH
from mission.sweep.outcome.figures import draw_sweep
from mission.sweep.outcome.view import (
    ACCURACY,
    METHOD,
    POINTS,
    REST,
    Gain,
    gain_table,
    outcome,
    over_seeds,
    paired_gains,
    percent,
)
from mission.sweep.results import RunResult, communities_of, with_equals

# What the paper reports of its method against the same without fairness (section V).
CLAIMED, CLAIM = 0.14, "+14 %"
PAPER = {("no_cov", "cifar10"): CLAIM, ("no_cov", "mnist"): "about equal"}


def reproduction(state: SweepState) -> str:
    """Markdown tables of a sweep, finished or not."""
    single, state = paired_gains(state.results), replace(state, results=smoothed(state.results))
    lines = [state.progress, "", *_outcome(state)]
    gains = paired_gains(state.results)
    if gains:
        heads, rows = gain_table(gains)
        rows = [
            [*row, PAPER.get((gain.other, gain.community), "")]
            for row, gain in zip(rows, gains, strict=True)
        ]
        lines += ["", *_table([*heads, "paper"], rows), "", f"P{POINTS[1:]}."]
    claimed = [
        (of_ten, of_one)
        for of_ten, of_one in zip(gains, single, strict=True)
        if PAPER.get((of_ten.other, of_ten.community)) == CLAIM
    ]
    if claimed:
        note = (
            f"How often {METHOD} seems ahead by {CLAIM} or more to a reader of fewer runs. All "
            "choices of seeds, and of rounds of the second half, count alike."
        )
        lines += ["", *_table(*luck_rows(claimed, CLAIMED)), "", note]
    return "\n".join(lines) + "\n"


def smoothed(results: Sequence[RunResult]) -> tuple[RunResult, ...]:
    """The results with each accuracy as the mean of its round and the nine before: one round swings
    by points, and these runs have fifty."""
    found = []
    for run in results:
        rows = [dict(row) for row in run.rounds]
        summary = dict(run.summary)
        for column in (c for c in rows[0] if c.startswith("accuracy_")):
            values = run.curve(column)
            for k, row in enumerate(rows):
                row[column] = float(values[max(0, k - 9) : k + 1].mean())
            summary[f"final_{column}"] = rows[-1][column]
        found.append(replace(run, summary=summary, rounds=tuple(rows)))
    return with_equals(found)


def _outcome(state: SweepState) -> list[str]:
    heads, rows = outcome(state.results, (*ACCURACY, *REST), seeds=state.seeds)
    note = (
        "First columns: accuracy on the images that it is reported on, mean of the last 10 rounds. "
        "Arrived: devices whose update arrived, of the community's "
        "devices (participation in runs.csv), or of those scheduled (delivered_share). "
        "±: 95 % interval over seeds (Student's t)."
    )
    return [*_table(heads, rows), "", note]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---", *("---:" for _ in heads[1:])]
    return [f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows)]


LATE = 0.5  # share of a run's rounds after which one may be picked to be read off


def seen_in_one_round(gain: Gain, least: float) -> float:
    """Share of single rounds of single seeds, late in the run, with a relative gain that large."""
    seen: list[bool] = []
    for mine, other in gain.pairs:
        rounds = min(len(mine.rounds), len(other.rounds))
        late = slice(int(LATE * rounds), rounds)
        a, b = (run.curve(f"accuracy_{gain.community}")[late] for run in (mine, other))
        seen.extend(a >= (1.0 + least) * b)
    return _share(seen)


def seen_with_seeds(gain: Gain, least: float, seeds: int) -> float:
    """Share of all choices of so many seeds whose mean final accuracies have a gain that large."""
    chosen = itertools.combinations(gain.finals, seeds)
    sums = (np.sum(finals, axis=0) for finals in chosen)
    return _share(mine >= (1.0 + least) * other for mine, other in sums)


def luck_rows(
    gains: Iterable[tuple[Gain, Gain]], least: float
) -> tuple[list[str], list[list[str]]]:
    """Heads and a row for each gain, over means of rounds and single ones: shares in percent."""
    heads = ["one seed, one round", "one seed, at the end", f"mean of {ENOUGH} seeds, at the end"]
    rows = [
        [
            gain.label,
            gain.community,
            *map(
                _percent,
                (
                    seen_in_one_round(of_one, least),
                    *(seen_with_seeds(gain, least, n) for n in (1, ENOUGH)),
                ),
            ),
        ]
        for gain, of_one in gains
    ]
    return ["against", "community", *heads], rows


def _share(seen: Iterable[bool]) -> float:
    every = list(seen)
    return sum(every) / len(every) if every else math.nan


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.0f} %"


_FAINTEST = 1.0  # points that have the strongest colour at least: less is not worth one


def compared(results: Sequence[RunResult]) -> list[str]:
    """The strategies that the method can be mapped against: two settings are swept, no more."""
    if any(len(result.point.settings) != 2 for result in results):
        return []
    return list(dict.fromkeys(gain.other for gain in paired_gains(results)))


def gain_map(results: Sequence[RunResult], other: str, community: str) -> Chart:
    """Points of final accuracy that the method gains, a cell a setting, blue where it wins."""
    gains = [g for g in paired_gains(results) if (g.other, g.community) == (other, community)]
    places = _places(results)
    cells = [
        Cell(
            *places[gain.settings],
            100.0 * gain.interval.mean,
            percent(gain.interval, signed=True),
            bold=_sure(gain),
        )
        for gain in gains
    ]
    known = any(math.isfinite(gain.interval.half) for gain in gains)
    down, across = _axes(results)
    return cell_map(
        f"{community}: {METHOD} less {other}, points", cells, down=down, across=across,
        most=max(_FAINTEST, *(abs(cell.value) for cell in cells)), signed=True,
        note="bold: its 95 % interval leaves zero out" if known else "",
    )  # fmt: skip


def participation_map(results: Sequence[RunResult], other: str, community: str) -> Chart:
    """Devices of a community whose update arrived: with the other strategy, and the method."""
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for result in results:
        groups.setdefault((result.point.strategy, result.point.where), []).append(result)
    shares = {
        key: 100.0 * over_seeds(runs, f"participation_{community}").mean
        for key, runs in groups.items()
    }
    cells = [
        Cell(*place, shares[other, where], f"{shares[other, where]:.0f} → {mine:.0f}")
        for where, place in _places(results).items()
        if (other, where) in shares and (mine := shares.get((METHOD, where))) is not None
    ]
    down, across = _axes(results)
    return cell_map(
        f"{community}: arrived with {other} → {METHOD}, % of its devices", cells,
        down=down, across=across, most=100.0, signed=False, note=f"shade: with {other}",
    )  # fmt: skip


def _places(results: Sequence[RunResult]) -> dict[str, tuple[str, str]]:
    """Row and column of each setting."""
    found = {}
    for point in (result.point for result in results):
        (_, down), (_, across) = point.settings
        found[point.where] = (str(down), str(across))
    return found


def _axes(results: Sequence[RunResult]) -> tuple[str, str]:
    (down, _), (across, _) = results[0].point.settings
    return down.rpartition(".")[2], across.rpartition(".")[2]


def _sure(gain: Gain) -> bool:
    interval = gain.interval
    return math.isfinite(interval.half) and abs(interval.mean) > interval.half


_WIDTH, _HEIGHT = 78.0, 40.0


@dataclass(frozen=True)
class Cell:
    """What stands at one place of the two settings."""

    down: str
    across: str
    value: float  # by which it is coloured
    words: str
    bold: bool = False


def cell_map(
    title: str, cells: list[Cell], *, down: str, across: str, most: float, signed: bool, note: str
) -> Chart:
    """Rows by the setting `down`, columns by `across`, both in order of appearance.

    Colours reach to `most`; `signed`: from -`most`, through none at zero.
    """
    columns = list(dict.fromkeys(cell.across for cell in cells))
    rows = list(dict.fromkeys(cell.down for cell in cells))
    data = table(
        down=[cell.down for cell in cells],
        across=[cell.across for cell in cells],
        value=[cell.value for cell in cells],
        strength=[abs(cell.value) for cell in cells],
        words=[cell.words for cell in cells],
        weight=["bold" if cell.bold else "normal" for cell in cells],
    )
    base = alt.Chart(data).encode(
        x=alt.X("across:O", title=across, sort=columns, axis=alt.Axis(labelAngle=0)),
        y=alt.Y("down:O", title=down, sort=rows),
    )
    # By how much it covers the paper, which is of either theme, and not by a mixed colour.
    strength = alt.FillOpacity(
        "strength:Q", scale=alt.Scale(domain=[0.0, most], range=[0.0, 0.7]), legend=None
    )
    colour = alt.when("datum.value < 0").then(alt.value(BAD)).otherwise(alt.value(COOL))
    tip = [
        alt.Tooltip("down:O", title=down),
        alt.Tooltip("across:O", title=across),
        alt.Tooltip("words:N", title=" "),
    ]
    layers = [
        base.mark_rect(stroke=GRID).encode(
            fill=colour if signed else alt.value(SOFT), fillOpacity=strength, tooltip=tip
        ),
        *(
            base.transform_filter(alt.datum.weight == weight)
            .mark_text(fontSize=11, fontWeight=weight, color=INK)
            .encode(alt.Text("words:N"))
            for weight in ("bold", "normal")
        ),
    ]
    width, height = _WIDTH * len(columns), _HEIGHT * len(rows)
    return finished(layers, title=title, note=note, width=width, height=height)


def gain_maps(name: str, results: Sequence[RunResult]) -> dict[str, Chart]:
    """Where the method wins over two swept settings, and whose updates arrive, by name of file."""
    return {
        f"gain-map-{file_name(other)}.png": stacked(
            [
                arranged(
                    (gain_map(results, other, who), participation_map(results, other, who)),
                    how="hconcat",
                    own=("color", "fillOpacity"),
                    spacing=24,
                )
                for who in communities_of(results)
            ],
            title=f"Where {METHOD} wins against {other}: mean of the last 10 rounds, within a seed",
            about=name,
        )
        for other in compared(results)
    }


def main() -> None:
    """Print the tables; draw on demand."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sweep", type=Path)
    parser.add_argument("--figures", type=Path, metavar="DIR", help="draw into this folder")
    options = parser.parse_args()
    state, name = read_sweep(options.sweep), options.sweep.resolve().name
    print(reproduction(state), end="")
    if options.figures is not None:
        draw_sweep(name, state.results, options.figures)
        save_all(gain_maps(name, smoothed(state.results)), options.figures)


if __name__ == "__main__":
    main()
