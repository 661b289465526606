"""Comparisons on the terminal."""

import itertools
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table

from mission.analysis.compare import RunComparison, names_of
from mission.analysis.measure import CORNER_M, Leg
from mission.analysis.numbers import Comparison, Number
from mission.analysis.spikes import spikes
from mission.analysis.told import MISSION, TARGET, missing
from mission.base.console import TABLE_WIDTH
from mission.base.explain import shown
from mission.base.tables import annotated, count, dotted, number
from mission.log.values import FlightData

if TYPE_CHECKING:
    from mission.analysis.passes import Judged
    from mission.analysis.together import Together

_Cell = Callable[[Comparison], str]

_OF_DEVICES = ("scheduled", "expected", "delivered", "unready")
TOLD = "Against what it was told"
_STEPS = 12  # at most as many are told in a line each
_WORDS = ("community", "mode", "against", "pair", "where")  # columns of words
_NAME_WIDTH = 10  # characters of a run's name in a line, at least


def _off(c: Comparison) -> str:
    share = c.plan_duration_s / c.duration_s if c.duration_s > 0.0 else math.nan
    return "-" if math.isnan(share) else f"{100.0 * (share - 1.0):+.1f} %"


def _lost(c: Comparison) -> float:
    return 100 * (1 - c.true_objective / c.plan_objective) if c.plan_objective > 0 else math.nan


def _of(head: str, names: str, digits: int = 2) -> tuple[str, _Cell]:
    """A column: its head, and numbers of a comparison."""
    return head, lambda c: " / ".join(number(getattr(c, name), digits) for name in names.split())


_Columns = tuple[tuple[str, _Cell], ...]

# Each fits a terminal of 80 columns.
_PATH: _Columns = (
    _of("path (m)\nplan / flown", "plan_path_m flown_path_m", 0),
    _of("cross-track (m)\nrms / max", "cross_track_rms_m cross_track_max_m"),
    _of("on straights\nrms / max", "straight_rms_m straight_max_m"),
    _of("corner cut\nmean / max", "corner_cut_mean_m corner_cut_max_m"),
)
_TIME: _Columns = (
    _of("duration (s)\nplan / flown", "plan_duration_s duration_s", 1),
    ("plan off\nby", _off),
    _of("slot late (s)\nmean / max", "slot_late_mean_s slot_late_max_s"),
)
_ENERGY: _Columns = (_of("energy (J)\nplan / flown", "plan_energy_j energy_j", 0),)
_SLOTS: _Columns = (
    _of("slot miss (m)\nrms / max", "slot_miss_rms_m slot_miss_max_m"),
    _of("height (m)\nrms / max", "height_rms_m height_max_m"),
    _of("estimate (m)\nrms / max", "estimate_rms_m estimate_max_m"),
)
_RADIO: _Columns = (
    _of("mean PER\nplan / believed / true", "plan_per_mean est_per_mean true_per_mean", 4),
    _of("shift\nmax", "per_shift_max", 4),
    _of("objective\nplan / believed / true", "plan_objective est_objective true_objective", 3),
    ("arrived", lambda c: f"{number(c.delivered, 0)}/{number(c.scheduled, 0)}"),
)
_LATE: _Columns = (("devices\nlate", lambda c: str(c.unready)),)


# All of it, for a page.
COLUMNS: _Columns = (
    *(*_PATH, *_TIME, *_ENERGY, *_SLOTS, *_RADIO, *_LATE),
    ("lost %", lambda c: number(_lost(c))),
    _of("proven bound", "upper_bound", 3),
    ("slots\nnever reached", lambda c: f"{c.slots_missed} of {c.slots}"),
)


def tables(comparison: RunComparison) -> tuple[Table, ...]:
    """Return tables of one run: path, time, slots and radio (a row a round, a total), and devices.

    A flight that is no run has a table of its numbers and one of its legs.
    """
    if comparison.run.data.planned is not None:
        legs, more = comparison.legs, stretch_rows(comparison)
        return (
            *side_by_side([comparison], width=TABLE_WIDTH),
            *([_table("Legs", *leg_rows(legs))] if legs else []),
            *([_table(TOLD, *more)] if more[1] else []),
        )
    some_late = _LATE if comparison.total.unready else ()
    energy = _ENERGY if math.isfinite(comparison.total.energy_j) else ()
    caption = f"straights: farther than {CORNER_M:.0f} m from every corner of the plan"
    rounds = [(str(item.round), item) for item in comparison.rounds]

    def by_round(title: str, columns: _Columns, caption: str | None = None) -> Table:
        heads, cells = zip(*columns, strict=True)
        *rows, total = (
            [name, *(cell(item) for cell in cells)]
            for name, item in (*rounds, ("all", comparison.total))
        )
        return _table(title, ("round", *heads), rows, total, caption=caption)

    return (
        by_round("Path", _PATH, caption),
        by_round("Time and energy" if energy else "Time", _TIME + energy),
        by_round("Slots, height and estimate", _SLOTS + some_late),
        by_round("Radio", _RADIO),
        _devices(comparison),
    )


def in_full(
    found: Sequence[RunComparison], *, width: int, world: "Together | None" = None
) -> Iterator[Table | str]:
    """What `aerofed compare` prints of a run, a flight, several side by side, or together."""
    yield from side_by_side(found, width=width) if len(found) > 1 else tables(found[0])
    if world is not None:
        yield _table("Who came how near to whom", *pair_rows(world))
        yield from world.lines
    # Logs of others have none.
    settings = [dotted(item.run.data.config) for item in found if item.run.data.config]
    for key in dict.fromkeys(key for each in settings for key in each):
        values = [each.get(key) for each in settings]
        if any(value != values[0] for value in values):
            words = ("-" if value is None else shown(value) for value in values)
            yield f"{key}: {' / '.join(words)}"
    for name, item in zip(names_of(found), found, strict=True):
        for line in lines(item):
            yield f"{name}: {line}" if len(found) > 1 else line


def lines(comparison: RunComparison) -> list[str]:
    """Describe holes, and of a flight spikes and what was not compared, a line each."""
    judged, found = comparison.run.judged, [hole.words for hole in comparison.holes]
    if comparison.run.data.planned is None:
        return found
    steps = [step.words for step in (comparison.flown.steps if comparison.flown else ())]
    found += steps[:_STEPS] + [f"and {count(len(steps) - _STEPS, 'step')} more"] * (
        len(steps) > _STEPS
    )
    lacks = ", ".join(missing(comparison.run.data))
    found += [f"not in the log: {lacks}"] * bool(lacks)
    if judged is None:
        if "a mission" not in lacks:
            found.append(comparison.run.unjudged.removeprefix(f"{comparison.run.path}: "))
        return [*found, *_skipped(comparison.run.data)]
    found += [spike.words for spike in spikes(comparison.run.data, comparison.measured)]
    return [*found, *in_words(judged, holes=any(hole.leg is not None for hole in comparison.holes))]


def in_words(found: "Judged", *, holes: bool = False) -> list[str]:
    """Describe what was not compared or not reached, one line each; empty if all was."""
    lines = _skipped(found.data)
    if not len(found.data.battery.t_ns):
        lines.append("energy not known: the log has no numbers of a battery")
    if found.apart:
        each = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in found.apart.items())
        lines.append(f"flown outside the plan, not compared: {each}")
    if found.left_out:
        each = ", ".join(f"{name} ({number})" for name, number in found.left_out.items())
        lines.append(f"items that lead nowhere known here: {each}")
    missed = [p.seq for item in found.passes for p in item.passages if math.isnan(p.t_s)]
    if missed:
        which = ", ".join(map(str, missed))
        lines.append(f"items never reached{' outside holes' * holes}: {which}")
    return lines


def _skipped(data: FlightData) -> list[str]:
    return [f"{count(number, what)} not read" for what, number in data.source.skipped.items()]


def pair_rows(world: "Together") -> tuple[list[str], list[list[str]]]:
    """Heads and cells of the table of pairs: least distances and when, and where they were."""
    ways = (("least", ""), ("horizontal", "_horizontal"), ("vertical", "_vertical"))
    rows = []
    for pair, row in zip(world.pairs, world.rows, strict=True):
        cells = [f"{row['first']}\n{row['second']}"]
        for _, way in ways:
            flown = row[f"separation{way}_min_m"]
            words = "not known" if pair.lost() else number(float(str(flown)))
            plan = number(float(str(row[f"plan_separation{way}_min_m"])))
            cells.append(f"{plan} / {words}\nat {row[f'separation{way}_min_t_s']:.1f} s")
        lat, lon, height = (
            row[f"separation_min_{of}"] for of in ("lat_deg", "lon_deg", "height_m")
        )
        rows.append([*cells, f"{lat:.7f}\n{lon:.7f}\n{height:.1f} m high"])
    heads = [f"{head} (m)\nplan / flown" for head, _ in ways]
    return ["pair", *heads, "where"], rows


def stretch_rows(comparison: RunComparison) -> tuple[list[str], list[list[str]]]:
    """Heads and cells of the table of stretches: errors, rms and max, against their references."""
    heads = ["time (s)", "mode", "against", "position (m)\nrms / max"]
    rows = []
    for row in comparison.stretches:
        place, height = "tracking_{}_m", "height_tracking_{}_m"
        if row["reference"] == MISSION:
            place, height = "cross_track_{}_m", "height_{}_m"
        elif row["reference"] == TARGET:
            place = "across_target_{}_m"
        cells = [
            " / ".join(number(row.get(of.format(how), math.nan)) for how in ("rms", "max"))
            for of in (place, height)
        ]
        cells += [number(row["attitude_tracking_rms_deg"]), number(row["delay_s"])]
        times = f"{number(row['start_s'], 0)}-{number(row['end_s'], 0)}"
        rows.append([times, row["mode"], row["reference"], *cells])
    return [*heads, "height (m)\nrms / max", "tilt\n(deg)", "delay\n(s)"], rows


def leg_rows(found: Sequence[Leg]) -> tuple[list[str], list[list[str]]]:
    """Heads and cells of the table of legs."""
    several = len({leg.number for leg in found}) > 1  # passes
    heads = ["leg", "item", "length\n(m)", "time (s)\nfrom / to", "cross-track\nrms / max"]
    rows = [
        [
            f"{leg.number}.{leg.leg}" if several else str(leg.leg),
            "-" if leg.item is None else str(leg.item),
            number(leg.length_m, 0),
            f"{number(leg.start_s, 1)} / {number(leg.end_s, 1)}",
            f"{number(leg.cross_track_rms_m)} / {number(leg.cross_track_max_m)}",
            number(leg.height_max_m),
            number(leg.speed_mean_mps, 1),
        ]
        for leg in found
    ]
    return [*heads, "height\nmax", "speed\n(m/s)"], rows


def _devices(comparison: RunComparison) -> Table:
    some_late = any(item.late for item in comparison.devices)
    heads = ("device", "community", "arrived", "late", "PER plan", "believed", "true")
    rows = [
        [
            str(item.device),
            item.community,
            f"{item.delivered}/{item.scheduled}",
            str(item.late),
            *(number(value, 4) for value in (item.plan_per, item.est_per, item.true_per)),
        ]
        for item in comparison.devices
    ]
    kept = [at for at, head in enumerate(heads) if head != "late" or some_late]
    return _table("Devices", [heads[at] for at in kept], [[row[at] for at in kept] for row in rows])


def side_by_side(comparisons: Sequence[RunComparison], *, width: int) -> tuple[Table, ...]:
    """Return tables of runs: a row a number, a column a run, and the difference of two.

    As many tables as it takes for none to be wider than `width` characters.
    """
    names, two = names_of(comparisons), len(comparisons) == 2
    rows = labelled([item.total for item in comparisons])
    cells = [[number(value, digits) for value in values] for _, digits, values in rows]
    widest = max(len(cell) for row in cells for cell in row)
    labels = max(len(label) for label, _, _ in rows)
    # 2 characters at either edge of a table, and 3 between columns.
    room = (width - labels - 4) // (max(widest, _NAME_WIDTH) + 3)
    fit = max(2, room)  # two stay together; on a narrow terminal the labels make way
    size = math.ceil(len(names) / math.ceil(len(names) / fit))  # none much shorter than the others
    title = "Planned and flown" if len(names) == 1 else "Runs side by side"
    found = []
    for begin in range(0, len(names), size):
        table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left")
        table.add_column("whole run", no_wrap=room > 2, overflow="fold")
        each = max(widest, (width - labels - 4) // (min(size, len(names)) + two) - 3)
        for name in names[begin : begin + size]:
            head = "\n".join(textwrap.wrap(name, each))  # at a hyphen
            table.add_column(head, justify="right", overflow="fold", min_width=widest)
        if two:
            table.add_column("difference", justify="right", no_wrap=True)
        for (label, digits, values), row in zip(rows, cells, strict=True):
            changes = [_change(values[1] - values[0], digits)] if two else []
            table.add_row(label, *row[begin : begin + size], *changes)
        found.append(table)
    return tuple(found)


def labels_of(comparisons: Sequence[RunComparison]) -> list[str]:
    """Return titles of the runs (`LoadedRun.about`), or their names where two titles agree."""
    about = [item.run.about for item in comparisons]
    return about if len(set(about)) == len(about) else names_of(comparisons)


def labelled(numbers: Sequence[Comparison]) -> list[tuple[str, int, list[float]]]:
    """Label, digits and values of every number that has a label, and a value in any of them."""
    rows = [
        (name, label.text, label.digits, [float(getattr(item, name)) for item in numbers])
        for name, label in annotated(Comparison, Number)
        if label.text
    ]
    return [
        (text, digits, values)
        for name, text, digits, values in rows
        if not all(math.isnan(value) or (value == 0 and name in _OF_DEVICES) for value in values)
    ]


def _change(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{round(value, digits) + 0.0:+.{digits}f}"  # no -0.0


def _table(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    total: Sequence[str] = (),
    *,
    caption: str | None = None,
) -> Table:
    """Numbers, right-justified; `total` stands apart below."""
    table = Table(
        box=box.SIMPLE_HEAD,
        title=title,
        title_justify="left",
        caption=caption,
        caption_justify="left",
        show_footer=bool(total),
        pad_edge=False,
    )
    for head, last in itertools.zip_longest(heads, total, fillvalue=""):
        table.add_column(
            head, footer=last, justify="left" if head in _WORDS else "right", no_wrap=True
        )
    for row in rows:
        table.add_row(*row)
    return table
