"""How a vehicle was in the air: vibration, estimator, GNSS, battery, motors, holes of its log."""

import math
from dataclasses import replace

import numpy as np

from mission.analysis.told import Spans, Values, hidden_s
from mission.base.arrays import Bools, Floats
from mission.log.signals import Signal
from mission.log.values import NS_PER_S, FlightData

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
