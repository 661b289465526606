"""`aerofed compare`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from mission.base.console import PLAIN, Terminal
from mission.base.errors import LIMITS_NOT_MET, InputError
from mission.base.tables import count
from mission.commands.options import Flag, Json, Limits, Offsets, given_offsets, print_json

if TYPE_CHECKING:
    from mission.analysis.compare import RunComparison
    from mission.analysis.limits import Verdict
    from mission.analysis.several import Several


def compare(
    run: Path,
    *others: Path,
    plan: Path | None = None,
    believed: Flag = False,
    together: Flag = False,
    offset: Offsets = (),
    limit: Limits = (),
    limits: Path | None = None,
    junit: Path | None = None,
    as_json: Json = False,
    figure: Path | None = None,
    rounds: int | None = None,
) -> int:
    """Compare flown with planned, or with what the vehicle was told: runs, and any flight.

    Example: aerofed compare paper6
    Example: aerofed compare cov no_cov --figure both.png
    Example: aerofed compare log_12.ulg --plan survey.plan --limit cross_track_max_m=3
    Example: aerofed compare a.ulg b.ulg c.ulg --together --limit separation_min_m=5
    Example: aerofed compare 00000012.BIN --limit tracking_rms_m=1 --limit clips_max=0

    Args:
        run: The folder of a run or of an `aerofed fly`, or a flight log: .mcap (also of `aerofed
            sitl --logs`), PX4's .ulg, ArduPilot's .bin, a ground station's .tlog; or a folder of
            such logs.
        others: More folders or logs, shown beside the first.
        plan: A .plan or waypoint file to compare with. Default: the mission in the log; without
            one, what the vehicle was told.
        believed: Compare where the autopilot believed to be, also where the log has the true
            position.
        together: They flew at one time in one place: who came how near to whom. A folder of one
            world (vehicle-1, vehicle-2, ...) is judged so by itself.
        offset: LOG=SECONDS to add to the times of a log for those of the first, where it does not
            tell UTC or GPS time, or not the right one.
        limit: NAME=VALUE, once for each limit: a number of the comparison (as --json names it) and
            the most that is allowed, or the least of battery_remaining, of what ends in _min and of
            what arrives. Exit code 6 and a line for each that is not met.
        limits: TOML file with a table [limits] of such numbers.
        junit: Also write the verdict into this file, as JUnit's XML.
        as_json: Print JSON, with every number at full precision, not tables: a list with one entry
            per run; of flights together an object of such flights and of pairs.
        figure: Also draw the comparison into this file (.png, .svg or .pdf): runs round by round,
            flights of plan files along the plan, others over time; of flights together a map and
            distances.
        rounds: Compare only the first rounds, as many as this, where runs differ in length.
    """
    if rounds is not None and rounds < 1:
        raise InputError(f"--rounds {rounds}: must be at least 1")
    from mission.analysis.comparison_text import in_full
    from mission.analysis.limits import every_verdict, given_limits, limits_in
    from mission.analysis.several import load_several

    table = None if limits is None else limits_in(limits)
    if limits is not None and table is None:
        raise InputError(f"{limits}: has no table [limits]")
    bounds = given_limits(limit, table)
    aside = Console(stderr=True, **PLAIN)
    several = load_several(
        (run, *others), plan, believed=believed, rounds=rounds, asked=together,
        offsets=given_offsets(offset),
    )  # fmt: skip
    found, world = several.flights, several.world
    for why in several.left_out if as_json or not world else ():
        aside.print(f"left out: {why}")
    _warn_of_lengths(found, aside)
    if figure is not None:
        from mission.figures.render import save
        from mission.figures.run import comparison_figure

        save(comparison_figure(found, world, bounds), figure)
    console = Terminal.for_tables()
    judged = every_verdict(several, bounds)
    if as_json:
        values = [*(item.values for item in found), *(world.rows if world else ())]
        values += ({"unread": file, "why": why} for file, why in several.unread)
        rows = [{**of, **in_json(its)} for of, its in zip(values, judged, strict=True)]
        count, end = len(found), len(rows) - len(several.unread)
        apart = {"flights": rows[:count], "pairs": rows[count:end], "unread": rows[end:]}
        print_json(apart if world else rows)
    else:
        for part in in_full(found, width=console.width, world=world):
            console.print(part)
    for item in found:
        if item.run.notice:
            aside.print(f"{item.run.path}: {item.run.notice}")
    return tell_verdict(several, bounds, judged, junit, quiet=as_json)


def in_json(verdicts: Sequence["Verdict"]) -> dict[str, object]:
    """Return the verdicts as entries of a flight's JSON; {} where it had no limits."""
    met = all(item.met for item in verdicts)
    return {"limits": verdicts, "limits_met": met} if verdicts else {}


def tell_verdict(
    several: "Several",
    bounds: Mapping[str, float],
    judged: Sequence[Sequence["Verdict"]],
    junit: Path | None,
    *,
    quiet: bool,
) -> int:
    """Print which limits are not met, or that all are; write `junit`; return the exit code."""
    from mission.analysis.compare import names_of
    from mission.analysis.limits import junit as write
    from mission.analysis.together import SEPARATIONS

    found, left_out = several.flights, several.left_out
    if junit is not None:
        pairs = several.world.pairs if several.world else ()
        unread = [file for file, _ in several.unread]
        names = [*names_of(found), *(pair.name for pair in pairs), *unread]
        lasted_s = [item.total.duration_s for item in found] + [pair.known_s for pair in pairs]
        write(junit, names, judged, [*lasted_s, *(0.0 for _ in unread)], left_out)
    broken = [item for each in judged for item in each if not item.met]
    aside = Console(stderr=True, **PLAIN)
    for item in broken:
        aside.print(f"aerofed: {item.words}")
    if bounds and not (broken or quiet):
        limits, by_all = count(len(bounds), "limit"), "" if len(found) == 1 else " by all"
        but = f", but {count(len(left_out), 'log')} left out" if left_out else ""
        if several.world and not several.world.pairs and SEPARATIONS.keys() & bounds.keys():
            but += ", but no two were in the air at the same time"
        Terminal(**PLAIN).print(f"{limits} met{by_all}{but}")
    return LIMITS_NOT_MET if broken else 0


def _warn_of_lengths(found: Sequence["RunComparison"], aside: Console) -> None:
    from mission.analysis.compare import names_of

    counts = [len(item.rounds) for item in found]
    if len(set(counts)) > 1:
        each = ", ".join(f"{name} {n}" for name, n in zip(names_of(found), counts, strict=True))
        way_out = f"; --rounds {min(counts)} takes the rounds that all of them have"
        aside.print(
            f"runs of different length (rounds: {each}): their sums do not compare"
            f"{way_out if min(counts) else ''}"
        )
