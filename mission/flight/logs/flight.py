"""What the readers of other programs' logs have in common: from what they find to a flight."""

import math
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mav
from pymavlink.mavutil import mode_mapping_acm, mode_mapping_apm, mode_mapping_rover

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.arrays import Bools, Floats, Ints
from mission.base.errors import InputError, NoFlightError
from mission.base.gaps import HOLE, gaps, inside
from mission.base.tables import count
from mission.base.user_files import read_bytes
from mission.flight.missions.mission_path import record_of
from mission.log.signals import Signal
from mission.log.values import (
    COPTER,
    HEIGHTS,
    LOCAL,
    NS_PER_S,
    PLANE,
    ROVER,
    BatteryTrack,
    EventRecord,
    FlightData,
    MissionRecord,
    Modes,
    Source,
    Track,
    WindTrack,
)
from sitl.autopilot.codec.orders import MissionItem

MOST_BYTES = 1 << 30
ALL = range(MOST_BYTES)
DAMAGE = "byte with damage"
_CLOSEST_NS = 20_000_000  # samples of positions that are kept
_STANDS_M = 1.0  # from where the log begins: on the ground
_OTHER = "stretch of {:.1f} to {:.1f} s, on whose other side the clock goes back,"
_LONGEST_S = 86_400.0  # of a log by heights or local places alone: beyond is damage
_FEW = 5  # messages of a stretch: fewer are damage
_LATEST_NS = 9 * 10**18  # what is later is damage
_HELD_NS = 1_000_000_000  # at most the true place is held before its first and after its last one
_UTC_SPREAD_NS = 500_000_000  # at most, of most of the instants that tell UTC
_MISSION = mav.MAV_MISSION_TYPE_MISSION
_BOUNDS = (9e18, 90.0, 360.0, 1e6)  # of times and places that are some
_NOWHERE = MissionItem(0, 0, mav.MAV_FRAME_MISSION, (0.0,) * 4, 0.0, 0.0, 0.0)
_MARGIN_M = 50.0  # around the flight, for the map
_ORIGIN = GeodeticPoint(0.0, 0.0, 0.0)  # stands for where a filter without a place began

_MODES = {COPTER: mode_mapping_acm, PLANE: mode_mapping_apm, ROVER: mode_mapping_rover}


def ardupilot_mode(vehicle: str, number: int) -> str:
    """The name of a mode of ArduPilot's for a kind of vehicle."""
    return str(_MODES[vehicle].get(number, f"MODE {number}"))


@dataclass
class LogRows:
    """Rows found in a log, in time order; each row begins with its time (ns of the log's clock)."""

    path: Path
    kind: str
    clock: str
    part: range = ALL  # the bytes of the file whose messages count
    places: list[tuple[float, ...]] = field(default_factory=list)  # lat, lon, alt msl
    truth: list[tuple[float, ...]] = field(default_factory=list)
    homes: list[tuple[float, ...]] = field(default_factory=list)
    modes: list[tuple[int, str]] = field(default_factory=list)
    events: list[tuple[int, str, str, int | None, int]] = field(default_factory=list)
    battery: list[tuple[float, ...]] = field(default_factory=list)
    wind: list[tuple[float, ...]] = field(default_factory=list)  # towards east, north
    fixes: list[int] = field(default_factory=list)
    missions: list[MissionRecord] = field(default_factory=list)
    current: list[tuple[int, int]] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)
    signals: dict[str, Signal] = field(default_factory=dict)
    dropouts_s: list[tuple[float, float]] = field(default_factory=list)  # told: when, how long
    utc_ns: list[tuple[int, int]] = field(default_factory=list)  # since 1970
    vehicle: str = COPTER
    # By kind of message: the byte at which each begins and its time, in the order of the file.
    times: dict[str, "array[int]"] = field(default_factory=dict)
    _in_force: set[str] = field(default_factory=set)

    def messages(
        self,
        content: bytes,
        mark: re.Pattern[bytes],
        end_of: Callable[[int], int],
        *,
        begin: int = 0,
        head: int = 0,
    ) -> Iterator[tuple[int, int]]:
        """Yield begin and end of each message from `begin` on; bytes of none are counted as damage.

        `end_of` says where the message that begins at a place ends: there if none does. `mark`
        finds where one may begin: `head` bytes before what it matches.
        """
        at = sound = begin
        while at < len(content):
            if at < (end := end_of(at)) <= len(content):
                self.skipped[DAMAGE] += at - sound
                yield at, end
                at = sound = end
            else:
                ahead = mark.search(content, at + 1 + head)
                at = ahead.start() - head if ahead else len(content)
        if end_of(sound) > at or 0 < at - sound < head + 3:  # less than any message has
            self.skipped["message that the end cut off"] += 1
        else:
            self.skipped[DAMAGE] += at - sound

    def counts(self, at: int, kind: str, t_ns: int) -> bool:
        """Note the time of the message that begins at a byte; whether it is of the part to read."""
        self.times.setdefault(kind, array("q")).extend((at, min(t_ns, _LATEST_NS)))
        return at in self.part

    def cuts(self, regular: Sequence[str]) -> list[int]:
        """The bytes from which on the clock is back, as where the vehicle started anew, by the
        first kind of message of some `regular` ones that the log has: behind the last message of
        before, since what has no time, as heads of logs, belongs to what follows."""
        kinds = [kind for kind in regular if kind in self.times]
        if not kinds:
            return []
        at, t_ns = _in_file(self.times[kinds[0]])
        for _ in range(2):  # two after one another do not stand alone
            at, t_ns = (of[~alone(t_ns)] for of in (at, t_ns))
            starts = np.cumsum(np.diff(t_ns, prepend=t_ns[:1]) < 0)
            some = np.bincount(starts, minlength=1)[starts] >= _FEW
            at, t_ns = at[some], t_ns[some]
        every = np.hstack([_in_file(of) for of in self.times.values()])
        every = every[:, every[0].argsort()]
        found = []
        for index in np.flatnonzero(np.diff(t_ns) < 0).tolist():
            # Of what lies between, the clock is back where it is nearer to the later message's.
            middle = t_ns[index] / 2 + t_ns[index + 1] / 2
            first, last = np.searchsorted(every[0], at[index : index + 2])
            back = every[1, first : last + 1] <= middle
            found.append(int(every[0, first + back.argmax() - 1]) + 1)
        return found

    def event(
        self, t_ns: int, kind: str, text: str, *, seq: int | None = None, severity: int = 6
    ) -> None:
        """Note what happened at an instant; see `EventRecord`."""
        self.events.append((t_ns, kind, text, seq, severity))

    def mode(self, t_ns: int, name: str) -> None:
        """Note the mode of an instant; only a change counts."""
        if not self.modes or self.modes[-1][1] != name:
            self.modes.append((t_ns, name))
            self.event(t_ns, "mode", name)

    def armed(self, t_ns: int, *, on: bool) -> None:
        """Note whether the motors may turn at an instant; only a change counts."""
        if on != ("armed" in self._in_force):
            self._in_force ^= {"armed"}
            self.event(t_ns, "armed", "armed" if on else "disarmed")

    def failing(self, t_ns: int, what: str, *, on: bool) -> None:
        """Note whether something that a failsafe is for is so at an instant; only that it begins,
        or that the vehicle is armed meanwhile, counts."""
        on = on and "armed" in self._in_force
        if on != (what in self._in_force):
            self._in_force ^= {what}
            if on:
                self.event(t_ns, "failsafe", what, severity=4)

    def heads_for(self, t_ns: int, seq: int) -> None:
        """Note the item that is flown to at an instant."""
        if not self.current or self.current[-1][1] != seq:
            self.current.append((t_ns, seq))

    def add_list(self, t_ns: int, items: Mapping[int, MissionItem], kind: int = _MISSION) -> None:
        """Note an uploaded list of a MAV_MISSION_TYPE, by number, unless it equals the last one.
        Numbers that are missing become items that lead nowhere."""
        numbers = range(max(items, default=-1) + 1)
        listed = [items.get(seq, replace(_NOWHERE, seq=seq)) for seq in numbers]
        record = record_of(t_ns, kind, listed)
        before = [mission.items for mission in self.missions if mission.kind == record.kind]
        if before[-1:] != [record.items]:
            self.missions.append(record)

    def flight(self) -> FlightData:
        """Convert all of it to a flight.

        Raises:
            InputError: there are fewer than two positions or heights, or their clock goes back.
        """
        timed: tuple[list[Any], ...] = (
            self.modes,
            self.events,
            self.battery,
            self.wind,
            self.current,
        )
        for rows in timed:
            known = [row for row in rows if abs(row[0]) < _BOUNDS[0]]
            self.skipped["row without a time"] += len(rows) - len(known)
            rows[:] = known
        places, true = (self._of_one_clock(rows) for rows in (self.places, self.truth))
        only, home = "believed", _ORIGIN
        if len(places) < 2:
            true = true[:0]
            only, t_ns, ned = self._around_origin()
        else:
            # Home may be set anew on the ground: that of the flight is the last before its top.
            top_ns = places[places[:, 3].argmax(), 0]
            set_at = _places(self.homes)
            homes = [*places[:1], *set_at[:1], *set_at[set_at[:, 0] <= top_ns]]
            home = GeodeticPoint(*homes[-1][1:].tolist())
            t_ns, ned = _ned(places, home)
        area = Area.around(home, ned, margin_m=_MARGIN_M)
        truth = belief = Track(t_ns, area.xyz(ned))
        away = np.flatnonzero(np.linalg.norm(ned - ned[0], axis=1) > _STANDS_M)
        begin_ns, end_ns = t_ns[[away[0], away[-1]] if len(away) else [0, -1]].tolist()
        spans = len(true) > 0 and (
            true[0, 0] - _HELD_NS <= begin_ns and end_ns <= true[-1, 0] + _HELD_NS
        )
        if spans:
            at_ns, true_ned = _ned(true, home)
            # A hole in the truth is one of the belief, too: what is compared has the same times.
            lost = gaps(at_ns, (begin_ns, end_ns), usual=HOLE)
            t_ns = t_ns[~inside(t_ns / NS_PER_S, lost)]
            truth, belief = Track(at_ns, area.xyz(true_ned)).at(t_ns), belief.at(t_ns)
        else:
            self.skipped["position of a ground truth that does not span the log"] += len(true)
        battery, wind = _rows(self.battery, 5), _rows(self.wind, 3)
        if not (battery[:, 1] > 0.0).any():  # without a monitor some write zeros
            battery[:, 1:3] = math.nan
        if not wind[:, 1:].any():  # a filter that estimates none writes zeros
            wind = wind[:0]
        events = sorted(self.events, key=lambda event: event[0])
        at = np.clip(np.searchsorted(t_ns, [event[0] for event in events]), 0, len(t_ns) - 1)
        where = belief.pos_m[at].tolist()
        times, seqs = np.array(self.current, dtype=np.int64).reshape(-1, 2).T
        return FlightData(
            area=area,
            truth=truth,
            belief=belief,
            battery=BatteryTrack(battery[:, 0].astype(np.int64), *battery[:, 1:].T),
            wind=WindTrack(wind[:, 0].astype(np.int64), np.pad(wind[:, 1:], ((0, 0), (0, 1)))),
            events=tuple(
                EventRecord(*event, tuple(place), tuple(place))
                for event, place in zip(events, where, strict=True)
            ),
            missions=tuple(self.missions),
            modes=Modes(
                np.array([t for t, _ in self.modes], dtype=np.int64),
                tuple(n for _, n in self.modes),
            ),
            current=(times, seqs),
            gnss_ns=np.array([t for t in self.fixes if t < _BOUNDS[0]], dtype=np.int64),
            signals={name: signal.between(t_ns) for name, signal in self.signals.items()},
            dropouts_s=_rows(self.dropouts_s, 2),
            vehicle=self.vehicle,
            source=Source(
                self.kind, self.clock, None if spans else only, dict(+self.skipped), self._utc_ns()
            ),
        )

    def _around_origin(self) -> tuple[str, Ints, Floats]:
        """Which positions they are, times (n,) and places (n, 3) in NED around where the vehicle's
        filter began, of a log that names none on the globe, as without GNSS; of one that has only
        heights, all above that place. InputError: it has neither."""
        none = Signal(np.zeros(0), np.zeros((0, 3)))
        place, height = (self.signals.get(name, none) for name in ("position_m", "height_m"))
        found = [(LOCAL, place.t_s, place.values)]
        found += [
            (HEIGHTS, of.t_s, np.pad(down[:, None], ((0, 0), (2, 0))))
            for of, down in ((place, place.values[:, -1]), (height, -height.values[:, -1]))
        ]
        for only, t_s, ned in found:
            known = np.isfinite(ned).all(axis=1) & (ned.shape[1] == len("NED"))
            known &= np.abs(t_s - np.median(t_s)) < _LONGEST_S if len(t_s) else known
            t_ns, ned = (t_s[known] * NS_PER_S).astype(np.int64), ned[known]
            _, kept = np.unique(np.round(t_ns / _CLOSEST_NS), return_index=True)
            if len(kept) > 1:
                return only, t_ns[kept], ned[kept]
        passed_over = ", ".join(count(number, what) for what, number in (+self.skipped).items())
        why = f"; not read: {passed_over}" * bool(passed_over)
        kind = InputError if passed_over else NoFlightError
        raise kind(f"{self.path}: the log has no positions, so there is no flight in it{why}")

    def _utc_ns(self) -> int | None:
        """The time since 1970 at which the log's clock is zero: by most of the instants, as first
        fixes and late packets tell it wrongly; None where they differ, as where simulated time
        is faster."""
        found = sorted(utc_ns - t_ns for t_ns, utc_ns in self.utc_ns)
        count = len(found)
        if not count or found[9 * count // 10] - found[count // 10] > _UTC_SPREAD_NS:
            return None
        return found[count // 2]

    def _of_one_clock(self, rows: Sequence[tuple[float, ...]]) -> Floats:
        """Return valid rows in time order, thinned to 20 ms; InputError: the clock goes back."""
        table = _places(rows)
        self.skipped["position without a value"] += len(rows) - len(table)
        wrong = alone(table[:, 0])
        self.skipped["position at a time that cannot be"] += int(wrong.sum())
        table = table[~wrong]
        back = np.flatnonzero(np.diff(table[:, 0]) < 0)
        if len(back):
            last_s, back_s = table[back[0], 0] / 1e9, table[back[0] + 1, 0] / 1e9
            raise InputError(
                f"{self.path}: the clock of its positions goes back from {last_s:.2f} to "
                f"{back_s:.2f} s; cut it there"
            )
        _, kept = np.unique(np.round(table[:, 0] / _CLOSEST_NS), return_index=True)
        return table[kept]


@dataclass(frozen=True)
class LogKind:
    """How a kind of log is read."""

    name: str
    clock: str  # what its times count from
    regular: Sequence[str]  # kinds of messages by which its clock is known, the best first
    take: Callable[[bytes, LogRows], None]  # finds the rows of a part in the content of a file

    def flight(self, path: Path) -> FlightData:
        """The flight of a log. Where its clock goes back, as the vehicle started anew or logs were
        joined, that of the stretch in which it was longest armed and away from where it began; the
        others are said.

        Raises:
            InputError: it cannot be read, is no such log, or has no positions.
        """
        content = read_bytes(path, most=MOST_BYTES)
        rows = self._rows(path, content, ALL)
        if not (cuts := rows.cuts(self.regular)):
            return rows.flight()
        found, errors = list[FlightData](), list[InputError]()
        for begin, end in pairwise([0, *cuts, MOST_BYTES]):
            try:
                found.append(self._rows(path, content, range(begin, end)).flight())
            except InputError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        best = max(found, key=_flown)
        spans_s = (of.truth.t_ns[[0, -1]] / NS_PER_S for of in found if of is not best)
        others = {_OTHER.format(*span_s): 1 for span_s in spans_s}
        skipped = {**best.source.skipped, **others}
        return replace(best, source=replace(best.source, skipped=skipped))

    def _rows(self, path: Path, content: bytes, part: range) -> LogRows:
        rows = LogRows(path, self.name, self.clock, part)
        self.take(content, rows)
        return rows


def _flown(data: FlightData) -> tuple[bool, int]:
    """Whether it is said to be armed, and how long (ns) it was that and away from its begin."""
    t_ns, pos_m = data.truth.t_ns, data.truth.pos_m
    away = np.linalg.norm(pos_m - pos_m[0], axis=1) > _STANDS_M
    away &= np.any([(t_ns >= since) & (t_ns < until) for since, until in data.armed_ns], axis=0)
    told = any(event.kind == "armed" for event in data.events)
    return told, int(np.diff(t_ns)[away[1:]].sum())


def _in_file(times: "array[int]") -> Ints:
    """(2, n) bytes and times."""
    return np.frombuffer(times, dtype=np.int64).reshape(-1, 2).T


def alone(t_ns: NDArray[Any]) -> Bools:
    """(n,) which times are damage: later than the two that follow, or earlier than the two before,
    which agree."""
    first = np.concatenate((t_ns[:1], t_ns[:1], t_ns))[: len(t_ns)]
    last = np.concatenate((t_ns, t_ns[-1:], t_ns[-1:]))[-len(t_ns) :]
    before, after = np.append(-math.inf, t_ns)[:-1], np.append(t_ns, math.inf)[1:]
    early, late = t_ns < np.minimum(first, before), t_ns > np.maximum(after, last)
    return np.asarray((early | late) & (before <= after))


def _places(rows: Sequence[tuple[float, ...]]) -> Floats:
    """The rows that have a place: finite, and not at 0/0."""
    table = _rows(rows, 4)
    some = (np.abs(table) < _BOUNDS).all(axis=1)  # and no NaN
    return table[some & (np.abs(table[:, 1:3]) > 1e-9).any(axis=1)]


def _ned(rows: Floats, home: GeodeticPoint) -> tuple[Ints, Floats]:
    frame = Area.at((1.0, 1.0), (0.0, 0.0), home).frame
    ned = np.array([frame.to_ned(*row) for row in rows[:, 1:].tolist()])
    # Height above home, not above the plane that touches the globe there.
    ned[:, 2] = home.alt_msl_m - rows[:, 3]
    return rows[:, 0].astype(np.int64), ned


def _rows(rows: Sequence[tuple[float, ...]], width: int) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, width)
