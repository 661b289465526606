"""A whole flight, with passes through a mission or without: its numbers, and what it was told."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mission.analysis.airborne import air_times, airborne, flown_modes
from mission.analysis.holes import holes, position_gaps
from mission.analysis.load import LoadedRun
from mission.analysis.measure import Measured, happened
from mission.analysis.told import FlightErrors, Spans, Values, flown_against, hidden_s, modes_at
from mission.base import polyline
from mission.base.arrays import Bools, Floats, greatest, mean, rms, total
from mission.base.errors import InputError
from mission.base.gaps import inside
from mission.log.signals import Signal
from mission.log.values import HEIGHTS, NS_PER_S, FlightData, Track


def whole_flight(
    loaded: LoadedRun, measured: Sequence[Measured]
) -> tuple[FlightErrors, dict[str, Any]]:
    """Compare a flight with what the vehicle was told; and its numbers where it has no pass.

    Raises:
        InputError: it never left the ground.
    """
    data = loaded.data
    if len(data.truth.t_ns) < 2:
        raise InputError(f"{loaded.path}: the log has no positions, so there is nothing to compare")
    modes = flown_modes(data)
    start_ns, end_ns = airborne(loaded.path, replace(data, modes=modes))
    air_s = air_times(data, start_ns, end_ns)
    passes_s = [tuple(item.truth.t_ns[[0, -1]] / NS_PER_S) for item in measured]
    more = health(data, air_s) | _missions(measured)
    errors = flown_against(data, modes, air_s, passes_s, more)
    lost = position_gaps(data, start_ns, end_ns)
    # Of several flights in a log what was flown alone: between them it may be carried anywhere.
    spans_ns = [
        (round(since_s * NS_PER_S), round(until_s * NS_PER_S)) for since_s, until_s in air_s
    ]
    every = [data.truth.between(*span) for span in spans_ns]
    parts = [each for each in every if len(each.t_ns) > 1] or [data.truth.between(start_ns, end_ns)]
    track = Track(*(np.concatenate([getattr(p, of) for p in parts]) for of in ("t_ns", "pos_m")))
    t_s, flat = track.t_ns / NS_PER_S, [part.pos_m[:, :2] for part in parts]
    speed = np.concatenate([_speeds_mps(part) for part in parts])
    heights_only = data.source.only == HEIGHTS
    off = data.belief.at(track.t_ns).pos_m - track.pos_m
    known = ~inside(t_s, lost) & (data.source.only is None)
    off = np.where(known[:, None], off, math.nan)
    wind_mps = data.wind.across_mps(start_ns, end_ns)
    none, legs = lost[:0], np.zeros(len(t_s), dtype=np.int64)
    where = holes(data, lost, hidden=none, number=1, track=track, leg=legs)
    named = (replace(h, mode=modes_at(modes, np.array([h.start_s]))[0]) for h in where)
    return replace(errors, holes=tuple(named)), {
        **happened(data, start_ns - NS_PER_S, end_ns + NS_PER_S),
        "flown_path_m": math.nan if heights_only else sum(map(polyline.length, flat)),
        "duration_s": sum(float(np.ptp(part.t_ns)) for part in parts) / NS_PER_S,
        "energy_j": total(np.array([data.battery.energy_j(*span) for span in spans_ns])),
        "battery_remaining": data.battery.left(end_ns),
        "speed_max_mps": greatest(np.where(inside(t_s, lost) | heights_only, math.nan, speed)),
        "wind_mean_mps": mean(wind_mps),
        "wind_max_mps": greatest(wind_mps),
        "estimate_rms_m": rms(np.hypot(*off[:, :2].T)),
        "estimate_max_m": greatest(np.hypot(*off[:, :2].T)),
        "gap_max_s": float(np.diff(lost).max(initial=0.0)),
    }


def _speeds_mps(flown: Track) -> Floats:
    """(n,) speed over ground at each sample of a track."""
    if len(flown.t_ns) < 2:
        return np.zeros(len(flown.t_ns))
    velocity = np.gradient(flown.pos_m[:, :2], flown.t_ns / NS_PER_S, axis=0)
    return np.asarray(np.linalg.norm(velocity, axis=1))


def _missions(measured: Sequence[Measured]) -> dict[str, Values]:
    """The errors of all passes and rounds against their plans, over time."""
    t_s = np.concatenate([np.zeros(0), *(item.truth.t_ns / NS_PER_S for item in measured)])
    errors = {name: [getattr(item, name) for item in measured] for name in ("cross_m", "height_m")}
    return {f"plan_{name}": Values(t_s, np.concatenate(of)) for name, of in errors.items() if of}


_FULL = 0.99  # of a motor: it has no more to give
BATTERY = ("remaining", "voltage_v", "current_a")
_LEAST = ("remaining", "voltage_v")
HEALTH = (  # names of numbers over time: of their signals' axes the greatest, of these the least
    *("vibration_mps2", "clips", "innovation_ratio", "gnss_fix", "satellites", "hdop"),
    *("gnss_accuracy_m", "motors", *BATTERY),
)


def with_battery(data: FlightData) -> dict[str, Signal]:
    """The signals of a flight, with those of its battery, and of more where it has some."""
    found, t_s = dict(data.signals), data.battery.t_ns / NS_PER_S
    for name in BATTERY:
        own = getattr(data.battery, name)[:, None]
        if np.isfinite(own).any():
            others = found[name].at(t_s)[:, 1:] if name in found else own[:, 1:]
            found[name] = Signal(t_s, np.hstack((own, others)))
    return found


def health(data: FlightData, air_s: Spans) -> dict[str, Values]:
    """Numbers over the time of a flight, from when to when it flew, by name."""
    signals, found = with_battery(data), dict[str, Values]()
    for name in HEALTH:
        if name not in signals:
            continue
        signal = signals[name]
        here = _within(signal.t_s, air_s)
        t_s, values = signal.t_s[here], signal.values[here]
        if name == "clips":  # counters: what came since
            values = values - values[:1]
        worst = np.fmin if name in _LEAST else np.fmax
        most = worst.reduce(values, axis=1, initial=math.nan)
        found[name] = Values(t_s, most, hidden_s(signal.t_s, air_s))
        if name == "motors" and len(t_s):
            full_s = float(np.diff(t_s)[most[:-1] >= _FULL].sum())
            apart = float(np.ptp(np.nanmean(values, axis=0)))
            for key, whole in (("motors_full_s", full_s), ("motor_imbalance", apart)):  # at no time
                found[key] = replace(
                    found[name], t_s=np.full(1, math.nan), values=np.array([whole])
                )
        if name == "voltage_v":
            sag = np.fmax.reduce(values[:1] - values, axis=1, initial=math.nan)
            found["sag_v"] = replace(found[name], values=sag)
    return {**found, "log_gap_s": _log_gaps(data, air_s)}


def _within(t_s: Floats, air_s: Spans) -> Bools:
    inside = [(t_s >= begin_s) & (t_s <= end_s) for begin_s, end_s in air_s]
    return np.asarray(np.any(inside, axis=0))


def _log_gaps(data: FlightData, air_s: Spans) -> Values:
    """The times in which the log holds nothing at all, each at its begin, and those it tells of."""
    every = [data.truth.t_ns / NS_PER_S, *(signal.t_s for signal in data.signals.values())]
    t_s = np.unique(np.concatenate(every))
    inside = [t_s[(t_s >= begin_s) & (t_s <= end_s)] for begin_s, end_s in air_s]
    at_s = np.concatenate([*(each[:-1] for each in inside), data.dropouts_s[:, 0]])
    long_s = np.concatenate([*map(np.diff, inside), data.dropouts_s[:, 1]])
    here = _within(at_s, air_s)
    return Values(at_s[here], long_s[here])
