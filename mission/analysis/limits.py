"""The verdict on a flight: limits on the numbers of its comparison, and where they were not met."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from mission.analysis.compare import RunComparison
from mission.analysis.measure import Measured
from mission.analysis.numbers import Comparison, Made, Told
from mission.analysis.several import Several
from mission.analysis.together import SEPARATIONS, Pair, Together
from mission.base.arrays import Floats, least
from mission.base.errors import InputError, LimitsNotMetError
from mission.base.run_folder import write_atomically
from mission.base.tables import annotated
from mission.base.user_files import parse_toml, read_text
from mission.log.values import NS_PER_S
from native.errors import did_you_mean, printable

_TOLD = dict(annotated(Comparison, Told))
# Of these more is better: their limit is the least that is allowed.
_AT_LEAST = frozenset(
    {name for name, how in _TOLD.items() if how.by is least}
    | {"battery_remaining", "delivered", "expected", "scheduled", "upper_bound"}
    | {"plan_objective", "est_objective", "true_objective", *SEPARATIONS}
)
_MOST = 10_000  # characters of a name
_MADE = {name: how.of for name, how in annotated(Comparison, Made)}
_MADE |= {name: how.of for name, how in _TOLD.items()}
_HIDDEN = frozenset(  # by a hole in positions: all that was flown, and happened
    {"cross_m", "straight", "corner_cut_m", "height_m", "estimate_m", "estimate_height_m"}
    | {"speed_mps", "wind_mps", "flown_path_m", "duration_s", "energy_j", "slot_miss_m"}
    | {"slot_along_m", "slot_late_s", "slots_missed", "mode_changes", "failsafes", "faults"}
)
_ALONE = "it is of flights that are judged together (--together)"
_EVENTS = {"mode_changes": "mode", "failsafes": "failsafe", "faults": "fault"}


@dataclass(frozen=True)
class Verdict:
    """Whether one flight meets one limit. NaN is an unknown value and meets no limit."""

    flight: str
    name: str
    value: float
    limit: float
    met: bool
    where: str  # leg, position and time of the worst; empty where it has none

    @property
    def words(self) -> str:
        """One line of text: the value, its limit, and where the worst was."""
        bound = "at least" if self.name in _AT_LEAST else "at most"
        value = "not known" if math.isnan(self.value) else f"{self.value:.4g}"
        where = f"; {self.where}" if self.where else ""
        return f"{self.flight}: {self.name} = {value}: must be {bound} {self.limit:g}{where}"


def known_limits(limits: Mapping[str, object], source: str) -> dict[str, float]:
    """Check limits, by name of a number of the comparison, and return them as floats.

    Raises:
        InputError: there is no such number, or a limit is not a valid number.
    """
    found: dict[str, float] = {}
    for name, value in limits.items():
        if name not in (every := [*_MADE, *SEPARATIONS]):
            hint = did_you_mean(name, every)
            known = ", ".join(every)
            raise InputError(
                f"{source}: {name}: the comparison has no such number{hint} (it has: {known})"
            )
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise InputError(f"{source}: {name} = {value!r}: must be a number")
        if value < 0 and not name.startswith("slot_late"):  # a slot may be early
            raise InputError(f"{source}: {name} = {value:g}: must be at least 0, as the number is")
        found[name] = float(value)
    return found


def limits_in(file: Path) -> dict[str, float] | None:
    """The table [limits] of a TOML file; None where it has none.

    Raises:
        InputError: the file cannot be read, or has a limit that `known_limits` refuses.
    """
    try:
        table = parse_toml(read_text(file)).get("limits")
    except ValueError as error:
        raise InputError(f"{file}: not valid TOML: {error}") from None
    if not isinstance(table, dict | None):
        raise InputError(f"{file}: limits is no table")
    return None if table is None else known_limits(table, str(file))


def check_flown(strategy: str) -> None:
    """Refuse limits on a run of a strategy that flies nothing.

    Raises:
        InputError: the strategy is "ideal".
    """
    if strategy == "ideal":
        raise InputError("limits: mission.strategy = 'ideal' flies nothing that they could judge")


def given_limits(
    options: Sequence[str], table: Mapping[str, object] | None = None
) -> dict[str, float]:
    """Return the limits of a table, overridden by options NAME=VALUE.

    Raises:
        InputError: an option without a value, or a limit that `known_limits` refuses.
    """
    limits = known_limits(table or {}, "limits")
    for option in options:
        name, equals, text = option.partition("=")
        if not equals:
            raise InputError(f"--limit {option}: must be NAME=VALUE, as cross_track_max_m=3")
        try:
            value: object = float(text)
        except ValueError:
            value = text
        limits |= known_limits({name.strip(): value}, "--limit")
    return limits


def verdicts(comparison: RunComparison, limits: Mapping[str, float]) -> tuple[Verdict, ...]:
    """Judge a flight, or a whole run, by each limit.

    What flew in a hole in its positions, unless `gap_max_s` allows one so long, is not known.
    """
    found = [
        Verdict(comparison.run.name, name, math.nan, limits[name], met=False, where=_ALONE)
        for name in SEPARATIONS
        if name in limits
    ]
    limits = {name: limit for name, limit in limits.items() if name not in SEPARATIONS}
    holes = [h for h in comparison.holes if h.end_s - h.start_s > limits.get("gap_max_s", 0.0)]
    for name, limit in limits.items():
        value = float(getattr(comparison.total, name))
        met = value >= limit if name in _AT_LEAST else value <= limit
        where = "" if met else _where(comparison, name)
        # A place that was never reached may have been in a hole; of others what is known counts.
        unknown = _MADE[name] in _HIDDEN and (met or name == "slots_missed")
        always = name in (*_EVENTS, "gap_max_s")
        hides = [hole for hole in holes if hole.leg is not None or hole.mode or always]
        if hides and (unknown or name == "gap_max_s"):
            value, met = math.nan if unknown else value, False
            where = max(hides, key=lambda hole: hole.end_s - hole.start_s).words
        flown = comparison.flown
        lost_s = flown.series[_MADE[name]].hidden_s if flown and met and name in _TOLD else 0.0
        if lost_s > limits.get("gap_max_s", 0.0):
            value, met = math.nan, False
            where = f"the log does not hold it for {lost_s:.1f} s of the flight"
        found.append(Verdict(comparison.run.name, name, value, limit, met, where))
    return tuple(found)


def _of_pair(world: Together, pair: Pair, limits: Mapping[str, float]) -> tuple[Verdict, ...]:
    """Judge how near two flights came, as `verdicts` does. Of the horizontal and the vertical
    distance, where both have a limit, each counts only while the other is below its own."""
    found = []
    for name in (name for name in SEPARATIONS if name in limits):
        near = pair.nearest(name, limits)
        value, met, where = near.away_m, near.away_m >= limits[name], ""
        if not met:
            where = _words("nearest", near.t_s, world.place(pair, near.t_s))
        elif lost := pair.lost(limits.get("gap_max_s", 0.0)):
            value, met, where = math.nan, False, lost
        found.append(Verdict(pair.name, name, value, limits[name], met, where))
    return tuple(found)


def every_verdict(several: Several, limits: Mapping[str, float]) -> list[tuple[Verdict, ...]]:
    """Judge flights, and the pairs of those of one world: for each flight, then for each pair; then
    for each log that cannot be read, of which nothing is known."""
    flights, world = several.flights, several.world
    alone = {name: limit for name, limit in limits.items() if name not in SEPARATIONS or not world}
    judged = [verdicts(flight, alone) for flight in flights]
    judged += [_of_pair(world, pair, limits) for pair in world.pairs] if world else []
    for file, why in several.unread:
        its = ((name, math.nan, limit, False, why) for name, limit in limits.items())
        judged.append(tuple(Verdict(file, *one) for one in its))
    return judged


def kept(several: Several, limits: Mapping[str, float]) -> tuple[Verdict, ...]:
    """Return the verdicts of `every_verdict`; all limits must be kept.

    Raises:
        LimitsNotMetError: a limit is not met; it has all verdicts.
    """
    found = tuple(item for each in every_verdict(several, limits) for item in each)
    if broken := [item.words for item in found if not item.met]:
        raise LimitsNotMetError("\n".join(broken), found)
    return found


def _where(comparison: RunComparison, name: str) -> str:
    """Say where a number was worst (leg, time, position), or which event was first; else empty."""
    if name in _EVENTS:
        events = [e for e in comparison.run.data.flown_events if e.kind == _EVENTS[name]]
        return f"first at {events[0].t_ns / NS_PER_S:.1f} s: {events[0].text}" if events else ""
    if name in _TOLD:
        flown = comparison.flown
        over_time = flown.series.get(_MADE[name]) if flown else None
        at_s = _TOLD[name].worst_s(over_time) if over_time else math.nan
        if flown is None or math.isnan(at_s):
            return ""
        mode = next((s.mode for s in flown.stretches if at_s <= s.end_s), "in the air")
        return _words(mode, at_s, comparison.place(at_s))
    worst = []
    for index, measured in enumerate(comparison.measured):
        values = np.nan_to_num(np.abs(_values(measured, _MADE[name])), nan=-1.0)
        if values.max(initial=-1.0) >= 0.0:
            worst.append((float(values.max()), index, int(values.argmax())))
    return _place(comparison, *max(worst)[1:]) if worst else ""


def _values(measured: Measured, array: str) -> Floats:
    """(n,) a measured number at each sample of the track; empty where it is not by sample."""
    fit, count = measured.fit, len(measured.truth.t_ns)
    if array == "corner_cut_m":  # at the samples that pass the corners
        values = np.full(count, math.nan)
        passed = np.minimum(np.searchsorted(fit.along_m, fit.corners_m), count - 1)
        values[passed] = measured.corner_cut_m
        return values
    values = getattr(measured, array, np.zeros(0))
    return values if len(values) == count else np.zeros(0)


def _place(comparison: RunComparison, index: int, sample: int) -> str:
    measured = comparison.measured[index]
    at_s = float(measured.truth.t_ns[sample]) / NS_PER_S
    several = f"round {measured.record.round}, " if len(comparison.measured) > 1 else ""
    return _words(f"{several}leg {measured.leg[sample]}", at_s, comparison.place(at_s))


def _words(what: str, at_s: float, place: Mapping[str, float]) -> str:
    return (
        f"{what}, {at_s:.1f} s, {place['lat_deg']:.7f}, {place['lon_deg']:.7f}, "
        f"{place['height_m']:.1f} m high"
    )


def junit(
    path: Path,
    names: Sequence[str],
    flights: Sequence[Sequence[Verdict]],
    seconds: Sequence[float],
    left_out: Sequence[str] = (),
) -> None:
    """Write verdicts as JUnit's XML: a suite a flight with how long it took, a case a limit; the
    last suite says, as skipped, which logs were left out and why.

    Raises:
        InputError: the file cannot be written.
    """
    root = ET.Element("testsuites", name="aerofed")
    for given, items, duration_s in zip(names, flights, seconds, strict=True):
        name = printable(given, most=_MOST)
        failures = sum(not item.met for item in items)
        counts = {"name": name, "tests": str(len(items)), "failures": str(failures)}
        suite = ET.SubElement(root, "testsuite", counts, time=f"{duration_s:.3f}")
        for item in items:
            case = ET.SubElement(suite, "testcase", classname=name, name=item.name, time="0.000")
            if not item.met:
                ET.SubElement(case, "failure", message=printable(item.words, most=_MOST))
    if left_out:
        counts = {"name": "left out", "tests": str(len(left_out)), "failures": "0"}
        suite = ET.SubElement(root, "testsuite", counts, skipped=counts["tests"], time="0.000")
        for why in left_out:
            said = printable(why, most=_MOST)
            of = {"classname": "left out", "name": said.partition(": ")[0], "time": "0.000"}
            ET.SubElement(ET.SubElement(suite, "testcase", of), "skipped", message=said)
    ET.indent(root)
    write_atomically(path, ET.tostring(root, encoding="utf-8", xml_declaration=True))
