"""What the readers of other programs' logs have in common: from what they find to a flight."""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mav
from pymavlink.mavutil import mode_mapping_acm, mode_mapping_apm, mode_mapping_rover

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.arrays import Bools, Floats, Ints
from mission.base.errors import InputError
from mission.base.gaps import HOLE, gaps, inside
from mission.flight.missions.mission_path import record_of
from mission.log.signals import Signal
from mission.log.values import (
    COPTER,
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
DAMAGE = "byte with damage"
_CLOSEST_NS = 20_000_000  # samples of positions that are kept
_STANDS_M = 1.0  # from where the log begins: on the ground
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
            InputError: there are fewer than two positions, or the clock of the log goes back.
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
            only, true = LOCAL, true[:0]
            t_ns, ned = self._around_origin()
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
                self.kind,
                self.clock,
                None if spans else only,
                dict(+self.skipped),
                self._utc_ns(),
            ),
        )

    def _around_origin(self) -> tuple[Ints, Floats]:
        """Times (n,) and places (n, 3) in NED around where the vehicle's filter began, of a log
        that names none on the globe, as without GNSS. InputError: it has no positions."""
        signal = self.signals.get("position_m", Signal(np.zeros(0), np.zeros((0, 3))))
        known = np.isfinite(signal.values).all(axis=1) & (signal.values.shape[1] == len("NED"))
        t_ns, ned = (signal.t_s[known] * NS_PER_S).astype(np.int64), signal.values[known]
        _, kept = np.unique(np.round(t_ns / _CLOSEST_NS), return_index=True)
        if len(kept) < 2:
            damage = self.skipped[DAMAGE]
            why = f" ({damage} bytes of it are damage)" if damage else ""
            raise InputError(
                f"{self.path}: the log has no positions, so there is no flight in it{why}"
            )
        return t_ns[kept], ned[kept]

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
        # Later than the two that follow, or earlier than the two before, which agree: it is damage.
        t_ns = table[:, 0]
        first = np.concatenate((t_ns[:1], t_ns[:1], t_ns))[: len(t_ns)]
        last = np.concatenate((t_ns, t_ns[-1:], t_ns[-1:]))[-len(t_ns) :]
        before, after = np.append(-math.inf, t_ns)[:-1], np.append(t_ns, math.inf)[1:]
        early, late = t_ns < np.minimum(first, before), t_ns > np.maximum(after, last)
        alone: Bools = (early | late) & (before <= after)
        self.skipped["position at a time that cannot be"] += int(alone.sum())
        table = table[~alone]
        back = np.flatnonzero(np.diff(table[:, 0]) < 0)
        if len(back):
            last_s, back_s = table[back[0], 0] / 1e9, table[back[0] + 1, 0] / 1e9
            raise InputError(
                f"{self.path}: its clock goes back from {last_s:.2f} to {back_s:.2f} s: the "
                "vehicle started anew or set it, or two logs were joined; cut it there"
            )
        _, kept = np.unique(np.round(table[:, 0] / _CLOSEST_NS), return_index=True)
        return table[kept]


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
