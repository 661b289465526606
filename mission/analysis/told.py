"""A flight against what the vehicle was told: errors, delays and steps, stretch by stretch.

A stretch is a time in one mode with one reference: the mission where one was flown, else the
position setpoint, else the velocity, else where it was to go, else attitude and height.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from mission.analysis.holes import Hole
from mission.base import polyline
from mission.base.arrays import Floats
from mission.base.gaps import HOLE, gaps
from mission.log.signals import Signal
from mission.log.values import HEIGHTS, LOCAL, NS_PER_S, PLANE, ROVER, FlightData, Modes

MISSION, POSITION, TARGET = "mission", "position", "target"
# By which signal of what was told a stretch has its reference, the best first.
_REFERENCES = {
    POSITION: "wanted_position_m",
    "velocity": "wanted_velocity_mps",
    TARGET: "goal_deg",
    "attitude": "wanted_attitude_deg",
}
_OF_POSITION = ("tracking_m", "along_m", "across_m")
ERRORS = (  # names of errors over time
    *(*_OF_POSITION, "target_m", "height_off_m", "speed_off_mps"),
    *("tilt_off_deg", "yaw_off_deg", "rates_off_degps"),
    *("plan_cross_m", "plan_height_m"),
)
_BY_STICK = ("STABILIZE", "ACRO", "FLIP", "TURTLE", "DRIFT", "THROW")  # heights are not ordered
_LEAST_S = 1.0  # a shorter stretch is part of the one before
_MOVES_MPS = 0.5  # a setpoint that is slower leads nowhere
_GRID_S, _MOST_LAG_S = 0.02, 3.0  # of correlations
_ALIKE = 0.5  # the least correlation of a response
_LEAST_AXES = {"attitude_deg": 3, "rates_degps": 3, "height_m": 1}
_STEPS = {"position_m": 1.0, "velocity_mps": 1.0, "height_m": 1.0, "yaw_deg": 20.0}  # the least
_SUDDEN_S, _HELD_S, _ANSWER_S, _STILL = 0.5, 2.0, 20.0, 0.1  # steps: times, and share of one


Spans: TypeAlias = Sequence[tuple[float, float]]  # begins and ends in seconds


@dataclass(frozen=True)
class Values:
    """A number over the time of a flight; NaN: nothing was told."""

    t_s: Floats  # (n,)
    values: Floats  # (n,)
    hidden_s: float = 0.0  # the longest time in the air in which it is not known

    def between(self, start_s: float, end_s: float) -> "Values":
        """The samples with start <= t <= end."""
        kept = (self.t_s >= start_s) & (self.t_s <= end_s)
        return Values(self.t_s[kept], self.values[kept], self.hidden_s)


@dataclass(frozen=True)
class Stretch:
    """A time of one mode and one reference, and the errors in it."""

    number: int
    start_s: float
    end_s: float
    mode: str
    reference: str  # "nothing" where the log does not hold what was told
    delay_s: float  # of the position, else of the attitude, behind what was told
    series: Mapping[str, Values]


@dataclass(frozen=True)
class Step:
    """A sudden change of what was told, and how it was answered."""

    what: str
    t_s: float
    size: float
    rise_s: float  # from 10 to 90 %; NaN: not reached before the next one
    overshoot: float  # share of the step

    @property
    def words(self) -> str:
        """One line of text."""
        what, _, unit = self.what.rpartition("_")
        unit = unit.replace("mps", "m/s")
        if math.isnan(self.rise_s):
            answer = "not answered by 90 % before the next one"
        else:
            answer = f"10 to 90 % in {self.rise_s:.2f} s, {100 * self.overshoot:.0f} % beyond"
        return f"at {self.t_s:.1f} s a step of {what} by {self.size:.1f} {unit}: {answer}"


@dataclass(frozen=True)
class FlightErrors:
    """A flight in the air: the errors by name, and its stretches and steps."""

    start_s: float
    end_s: float
    series: Mapping[str, Values]
    stretches: tuple[Stretch, ...]
    steps: tuple[Step, ...]
    holes: tuple[Hole, ...] = ()


_HELD = {  # what a log may not hold, and the signals of which one is enough
    "position setpoints": "wanted_position_m",
    "velocity setpoints": "wanted_velocity_mps",
    "wanted heights": "wanted_height_m height_error_m wanted_position_m",
    "wanted attitude": "wanted_attitude_deg",
    "wanted body rates": "wanted_rates_degps",
    "vibration": "vibration_mps2",
    "clipping": "clips",
    "innovation ratios": "innovation_ratio",
    "satellites": "satellites",
    "accuracy of GNSS": "gnss_accuracy_m hdop",
    "motors": "motors",
}


def missing(data: FlightData) -> list[str]:
    """What the log of a flight does not hold, in words."""
    lacks = [] if any(m.kind == "mission" and m.items for m in data.missions) else ["a mission"]
    lacks += ["positions"] * (data.source.only == HEIGHTS)
    lacks += ["places on the globe"] * (data.source.only == LOCAL)
    lacks += [what for what, of in _HELD.items() if not set(of.split()) & set(data.signals)]
    return lacks + ["battery"] * (not len(data.battery.t_ns) and "voltage_v" not in data.signals)


def pair(signals: Mapping[str, Signal], name: str) -> tuple[Floats, Floats, Floats] | None:
    """Times (n,) of a setpoint, what was wanted (n, k) and what was (n, k) then; None without."""
    wanted, actual = signals.get(f"wanted_{name}"), signals.get(name)
    if wanted is None or actual is None:
        return None
    times_s, values = actual.t_s, actual.values
    if name == "attitude_deg":
        known = np.isfinite(values).all(axis=1)
        times_s, values = times_s[known], np.unwrap(values[known], axis=0, period=360.0)
    width = min(wanted.values.shape[1], values.shape[1])
    if width < _LEAST_AXES.get(name, 2):  # damage took the others
        return None
    value = Signal(times_s, values[:, :width]).at(wanted.t_s)
    return wanted.t_s, wanted.values[:, :width], value


def flown_against(
    data: FlightData, modes: Modes, air_s: Spans, passes_s: Spans, health: Mapping[str, Values]
) -> FlightErrors:
    """Compare a flight with what the vehicle was told, in its `modes` and while in the air, of it
    `passes_s` through a mission; `health` has more numbers over time, by name."""
    start_s, end_s = air_s[0][0], air_s[-1][1]
    errors = _errors(data, modes, air_s)
    series = {name: of.between(start_s, end_s) for name, of in errors.items()} | dict(health)
    all_s = delay(data.signals, air_s)
    series["tracking_delay_s"] = Values(np.array([math.nan]), np.array([all_s]))
    stretches = list[Stretch]()
    for begin_s, until_s, mode, reference in _cut(data, modes, air_s, passes_s):
        inside = {name: of.between(begin_s, until_s) for name, of in series.items()}
        if reference not in (MISSION, POSITION):  # what is left of its neighbours
            inside = {name: of for name, of in inside.items() if name not in _OF_POSITION}
        delay_s = delay(data.signals, [(begin_s, until_s)])
        stretches.append(
            Stretch(len(stretches) + 1, begin_s, until_s, mode, reference, delay_s, inside)
        )
    return FlightErrors(
        start_s, end_s, series, tuple(stretches), tuple(_steps(data.signals, start_s, end_s))
    )


def heights(signals: Mapping[str, Signal]) -> tuple[Floats, Floats, Floats] | None:
    """Times (n,), what height was wanted (n,), and which it was (n,); None where no log tells."""
    if (of := pair(signals, "height_m")) is not None:
        return of[0], of[1][:, 0], of[2][:, 0]
    if (told := signals.get("height_error_m")) is not None and "height_m" in signals:
        actual = signals["height_m"].at(told.t_s)[:, 0]
        return told.t_s, actual + told.values[:, 0], actual
    if (of := pair(signals, "position_m")) is not None and of[1].shape[1] > 2:
        return of[0], -of[1][:, 2], -of[2][:, 2]
    return None


def _errors(data: FlightData, modes: Modes, air_s: Spans) -> dict[str, Values]:
    """The errors, by name, at the times at which it was told; actual less wanted."""
    signals, found = data.signals, dict[str, Values]()
    here_s = data.truth.t_ns / NS_PER_S

    def put(name: str, t_s: Floats, values: Floats, of: str) -> None:
        """Keep an error; it is known where the actual signal `of`, or else the position, is."""
        known_s = signals[of].t_s if of in signals else here_s
        found[name] = Values(t_s, values, hidden_s(known_s, air_s))

    if (of := pair(signals, "position_m")) is not None:
        t_s, wanted, actual = of
        off = (actual - wanted)[:, :2]
        put("tracking_m", t_s, np.hypot(*off.T), "position_m")
        speed = np.gradient(wanted[:, :2], t_s, axis=0) if len(t_s) > 1 else np.zeros_like(off)
        pace = np.hypot(*speed.T)
        north, east = np.where(pace > _MOVES_MPS, speed.T / np.maximum(pace, 1e-9), math.nan)
        put("along_m", t_s, off[:, 0] * north + off[:, 1] * east, "position_m")
        put("across_m", t_s, off[:, 1] * north - off[:, 0] * east, "position_m")
    if data.vehicle != ROVER and (height := heights(signals)) is not None:
        t_s, told, was = height
        stick = np.isin(modes_at(modes, t_s), _BY_STICK)
        known = "height_m" if "height_m" in signals else "position_m"
        put("height_off_m", t_s, np.where(stick, math.nan, was - told), known)
    if (of := pair(signals, "velocity_mps")) is not None:
        paces = [np.hypot(*each[:, :2].T) for each in of[1:]]
        put("speed_off_mps", of[0], paces[1] - paces[0], "velocity_mps")
    if data.vehicle != ROVER and (of := pair(signals, "attitude_deg")) is not None:
        t_s, wanted, actual = of
        if data.vehicle == PLANE:  # it turns by banking: no yaw is ordered
            wanted = np.column_stack((wanted[:, :2], actual[:, 2]))
        else:
            turn = (actual[:, 2] - wanted[:, 2] + 180.0) % 360.0 - 180.0
            put("yaw_off_deg", t_s, turn, "attitude_deg")
        cosine = (_down(wanted) * _down(actual)).sum(axis=1)
        put("tilt_off_deg", t_s, np.degrees(np.arccos(np.clip(cosine, -1, 1))), "attitude_deg")
    if (of := pair(signals, "rates_degps")) is not None:
        put("rates_off_degps", of[0], np.linalg.norm(of[2] - of[1], axis=1), "rates_degps")
    if (goal := _across_goals(data)) is not None:
        put("target_m", *goal, "")
    return found


def hidden_s(t_s: Floats, air_s: Spans) -> float:
    """The longest hole in the times (n,) of a signal while the vehicle was in the air."""
    delays_s = [0.0]
    for span_s in air_s:
        begin_ns, end_ns = ends = [int(at * NS_PER_S) for at in span_s]
        t_ns = (t_s * NS_PER_S).astype(np.int64)
        every = gaps(t_ns, (begin_ns, end_ns), usual=HOLE, ends_ns=ends)
        delays_s += np.diff(np.clip(every, *span_s)).ravel().tolist()
    return max(delays_s)


def modes_at(modes: Modes, t_s: Floats) -> list[str]:
    """The mode at each of some times (n,)."""
    at = np.searchsorted(modes.t_ns, t_s * NS_PER_S, side="right") - 1
    return [modes.names[index] if index >= 0 else "mode unknown" for index in at.tolist()]


def _down(attitude_deg: Floats) -> Floats:
    """(n, 3) the body's down axis in NED, of roll, pitch and yaw (n, 3)."""
    roll, pitch, yaw = np.radians(attitude_deg).T
    across, along = np.sin(roll), np.cos(roll) * np.sin(pitch)
    north = along * np.cos(yaw) + across * np.sin(yaw)
    east = along * np.sin(yaw) - across * np.cos(yaw)
    return np.column_stack((north, east, np.cos(roll) * np.cos(pitch)))


def _across_goals(data: FlightData) -> tuple[Floats, Floats] | None:
    """Times (n,), and how far the vehicle then was (n,) from the straight line to where it was to
    go, from where it was when that was told; None where no log tells."""
    goals = data.signals.get("goal_deg")
    if goals is None:
        return None
    track = data.truth
    t_s = track.t_ns / NS_PER_S
    off = np.full(len(t_s), math.nan)
    new = np.flatnonzero(np.any(np.diff(goals.values, axis=0, prepend=math.nan) != 0, axis=1))
    for first, last in zip(new, [*new[1:], len(new) and len(goals.t_s)], strict=True):
        lat, lon = goals.values[first]
        here = (t_s >= goals.t_s[first]) & (t_s <= goals.t_s[last - 1])
        if not here.any() or not math.isfinite(lat + lon):
            continue
        xy = track.pos_m[here, :2]
        goal = data.area.from_ned(data.area.frame.to_ned(lat, lon, data.area.home.alt_msl_m))
        way = np.broadcast_to(xy[0], xy.shape), np.broadcast_to(goal, xy.shape)
        off[here] = np.linalg.norm(polyline.to_segments(xy, *way)[0], axis=1)
    return t_s, off


def _cut(
    data: FlightData, modes: Modes, air_s: Spans, passes_s: Spans
) -> Iterator[tuple[float, float, str, str]]:
    """Yield begin, end, mode and reference of each stretch, by the times of positions."""
    every_s = data.truth.t_ns / NS_PER_S
    for start_s, end_s in air_s:
        t_s = every_s[(every_s >= start_s) & (every_s <= end_s)]
        reference = np.full(len(t_s), "nothing", dtype=object)
        for name, signal in reversed(_REFERENCES.items()):
            if signal in data.signals:
                known = np.isfinite(data.signals[signal].at(t_s)[:, :2]).all(axis=1)
                reference[known] = name
        for begin_s, until_s in passes_s:
            reference[(t_s >= begin_s) & (t_s <= until_s)] = MISSION
        names = list(zip(modes_at(modes, t_s), reference.tolist(), strict=True))
        for first, last in list(_runs(names)):
            if first and t_s[last] - t_s[first] < _LEAST_S:
                names[first : last + 1] = [names[first - 1]] * (last + 1 - first)
        for first, last in _runs(names):
            begin_s = float(t_s[first - 1]) if first else start_s
            yield begin_s, float(t_s[last]) if last + 1 < len(names) else end_s, *names[first]


def _runs(names: Sequence[tuple[str, str]]) -> Iterator[tuple[int, int]]:
    """Yield first and last index of equal names one after another."""
    cuts = [at for at in range(1, len(names)) if names[at] != names[at - 1]]
    for first, end in pairwise([0, *cuts, len(names)] if names else []):
        yield first, end - 1


def delay(signals: Mapping[str, Signal], spans_s: Spans) -> float:
    """Return by how long (s) the horizontal position, else roll and pitch, follow what was wanted:
    where they correlate best, over some times. NaN: nothing changed, or they are not alike."""
    for name in ("position_m", "attitude_deg"):
        wanted, actual = signals.get(f"wanted_{name}"), signals.get(name)
        if wanted is None or actual is None:
            continue
        pieces = list[Floats]()
        for begin_s, end_s in spans_s:
            grid_s = np.arange(begin_s, end_s, _GRID_S)
            both = np.stack([of.at(grid_s)[:, :2].T for of in (wanted, actual)])
            known = np.asarray(np.isfinite(both).all(axis=(0, 1)))
            cuts = np.flatnonzero(np.diff(known)) + 1
            pieces += [
                _level(both[..., piece])
                for piece in np.split(np.arange(len(grid_s)), cuts)
                if len(piece) * _GRID_S > 2 * _MOST_LAG_S and known[piece[0]]
            ]
        if not math.isnan(found := _lag_s(pieces)):
            return found
    return math.nan


def _level(values: Floats) -> Floats:
    """Less the straight line (of both, the wanted one's) that is most like (2, k, n) values: what
    only moves on is as like to itself at any delay."""
    at = np.arange(values.shape[2])
    slope = np.polyfit(at, values[0].T, 1)[0]
    return np.asarray(values - slope[:, None] * at)


def _lag_s(pieces: Sequence[Floats]) -> float:
    """The delay at which what was (1, k, n) is most like what was wanted (0, k, n)."""
    alike = []
    for lag in range(round(_MOST_LAG_S / _GRID_S)):
        sums = np.zeros(3)
        for wanted, actual in pieces:
            w, a = wanted[:, : wanted.shape[1] - lag], actual[:, lag:]
            w, a = (each - each.mean(axis=1, keepdims=True) for each in (w, a))
            sums += np.vdot(w, a), np.vdot(w, w), np.vdot(a, a)
        alike.append(sums[0] / math.sqrt(sums[1] * sums[2]) if sums[1:].all() else 0.0)
    best = int(np.argmax(alike)) if alike else 0
    if not pieces or alike[best] < _ALIKE:
        return math.nan
    if 0 < best < len(alike) - 1:  # the top of a parabola through three
        before, top, after = alike[best - 1 : best + 2]
        return _GRID_S * (best + (before - after) / (2 * (before - 2 * top + after) or 1.0))
    return _GRID_S * best


def _steps(signals: Mapping[str, Signal], start_s: float, end_s: float) -> Iterator[Step]:
    """Yield the steps of what was told, and the answers to them."""
    for name, least in _STEPS.items():
        of = pair(signals, "attitude_deg" if name == "yaw_deg" else name)
        if of is None:
            continue
        known = (of[0] >= start_s) & (of[0] <= end_s) & np.isfinite(of[1]).all(axis=1)
        t_s, wanted, actual = (values[known] for values in of)
        if name == "yaw_deg":
            wanted, actual = (np.unwrap(v[:, 2:], axis=0, period=360.0) for v in (wanted, actual))
        moved = np.linalg.norm(np.diff(wanted, axis=0), axis=1)
        for at in np.flatnonzero((moved >= least) & (np.diff(t_s) <= _SUDDEN_S)).tolist():
            way = wanted[at + 1] - wanted[at]
            size = float(np.linalg.norm(way))
            left = np.linalg.norm(wanted[at + 1 :] - wanted[at + 1], axis=1) > _STILL * size
            last = at + 1 + int(left.argmax() if left.any() else len(left))
            last = min(last, int(np.searchsorted(t_s, t_s[at] + _ANSWER_S)))
            if t_s[last - 1] - t_s[at + 1] < _HELD_S:
                continue
            share = (actual[at + 1 : last] - wanted[at]) @ way / size**2
            rise_s = _reached_s(t_s[at + 1 :], share, 0.9) - _reached_s(t_s[at + 1 :], share, 0.1)
            over = math.nan if math.isnan(rise_s) else max(0.0, float(np.nanmax(share)) - 1.0)
            yield Step(name, float(t_s[at + 1]), size, rise_s, over)


def _reached_s(t_s: Floats, share: Floats, bound: float) -> float:
    """When a share (n,) first reaches a bound, straight between samples; NaN if it never does."""
    here = share >= bound
    at = int(here.argmax()) if len(here) else 0
    if not here.any() or at == 0 or math.isnan(share[at - 1]):
        return float(t_s[at]) if here.any() else math.nan
    return float(np.interp(bound, share[at - 1 : at + 1], t_s[at - 1 : at + 1]))
