"""Where the method wins: its gain on another strategy over two swept settings, as a map."""

import math
from collections.abc import Sequence

from mission.base import schema
from mission.figures.cells import Cell, cell_map
from mission.figures.charts import LayerChart
from mission.sweep.outcome.gains import METHOD, Gain, paired_gains
from mission.sweep.outcome.view import over_seeds, percent
from mission.sweep.results import RunResult

_FAINTEST = 1.0  # points that have the strongest colour at least: less is not worth one


def compared(results: Sequence[RunResult]) -> list[str]:
    """The strategies that the method can be mapped against: two settings are swept, no more."""
    if any(len(result.point.settings) != 2 for result in results):
        return []
    return list(dict.fromkeys(gain.other for gain in paired_gains(results)))


def gain_map(results: Sequence[RunResult], other: str, community: str) -> LayerChart:
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


def participation_map(results: Sequence[RunResult], other: str, community: str) -> LayerChart:
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
    return schema.title(down), schema.title(across)


def _sure(gain: Gain) -> bool:
    interval = gain.interval
    return math.isfinite(interval.half) and abs(interval.mean) > interval.half
