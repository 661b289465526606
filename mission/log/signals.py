"""Signals: what a vehicle was told, what it did and how it was, over time, whoever wrote the log.

Positions and velocities are NED, attitudes roll, pitch and yaw in degrees, body rates FRD. What was
told (`wanted_...`) is NaN where it was not told.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mission.base import polyline
from mission.base.arrays import Floats, Ints
from mission.base.gaps import HOLE, gaps, inside

Columns: TypeAlias = Mapping[str, NDArray[Any]]  # of a kind of message; "t_s": their times

# Axes of signals; what else there is has one, or is north, east, down. Of the innovations 1 is the
# largest size that is accepted.
AXES: Mapping[str, tuple[str, ...]] = {
    "attitude_deg": ("roll", "pitch", "yaw"),
    "rates_degps": ("roll", "pitch", "yaw"),
    "vibration_mps2": ("x", "y", "z"),
    "clips": ("IMU 0", "IMU 1", "IMU 2"),
    "innovation_ratio": ("velocity", "position", "height", "heading"),
    "motors": tuple(f"motor {number}" for number in range(1, 13)),
    **dict.fromkeys(("voltage_v", "current_a", "remaining"), ("battery 1", "battery 2")),
}
_MOTORS = (*range(33, 41), *range(82, 86))  # SERVOn_FUNCTION of motors 1 to 12
_MOST = 1e10  # beyond is damage
_STANDS_S = 1.0
_AROUND_S, _LAST_S = 600.0, 9e9


@dataclass(frozen=True)
class Signal:
    """A quantity over time."""

    t_s: Floats  # (n,) ascending
    values: Floats  # (n, axes)

    @property
    def holes_s(self) -> Floats:
        """(g, 2) begin and end of the times in which it is not known."""
        t_ns = (self.t_s * 1e9).astype(np.int64)
        return gaps(t_ns, (t_ns[0], t_ns[-1]), usual=HOLE) if len(t_ns) else np.zeros((0, 2))

    def between(self, t_ns: Ints) -> "Signal":
        """The samples of the time of a track, and a little around it: others are damage."""
        kept = (self.t_s > t_ns[0] / 1e9 - _AROUND_S) & (self.t_s < t_ns[-1] / 1e9 + _AROUND_S)
        return Signal(self.t_s[kept], self.values[kept])

    def at(self, t_s: Floats) -> Floats:
        """(m, axes) linear between samples; NaN outside them, and in holes."""
        if not len(self.t_s):
            return np.full((len(t_s), 1), np.nan)
        found = polyline.at(t_s, self.t_s, self.values)
        lost = (t_s < self.t_s[0]) | (t_s > self.t_s[-1]) | inside(t_s, self.holes_s)
        found[lost] = np.nan
        return found


@dataclass(frozen=True)
class Source:
    """Where a kind of log has a signal, or some of its axes; the first that is there counts."""

    signal: str
    message: str
    columns: str
    by: Callable[[Floats], Floats] | float = 1.0  # makes the signal's values, or their unit
    axis: int = 0
    plain: float = 1.0  # to SI, in logs that do not tell units


def gathered(tables: Mapping[str, Columns], sources: Iterable[Source]) -> dict[str, Signal]:
    """Make the signals of a log's messages, a table a kind, that have a value."""
    parts: dict[str, dict[int, tuple[Floats, Floats]]] = {}
    for source in sources:
        table, columns = tables.get(source.message, {}), source.columns.split()
        if source.axis in parts.get(source.signal, ()) or any(c not in table for c in columns):
            continue
        with np.errstate(invalid="ignore"):  # damage makes signalling NaNs, too
            values = np.column_stack([table[c].astype(np.float64) for c in columns])
        values[np.abs(values) > _MOST] = np.nan
        values = values * source.by if isinstance(source.by, float) else source.by(values)
        known = np.abs(table["t_s"]) < _LAST_S
        t_s, at = np.unique(table["t_s"][known], return_index=True)
        values = values[known][at] * (1.0 if "units" in table else source.plain)
        if np.isfinite(values).any():
            parts.setdefault(source.signal, {})[source.axis] = t_s, values
    return {name: _joined(each) for name, each in parts.items()}


def while_controlled(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Without the targets of a position controller in times in which it does not run, as in a
    VTOL's forward flight: the velocity that it asks for, which follows from where the vehicle is,
    is then the same to the last bit for more than a second, in north and east or in down."""
    found = dict(signals)
    asked = found.get("wanted_velocity_mps")
    if asked is None or not len(asked.t_s):
        return found
    for name in ("wanted_velocity_mps", "wanted_position_m"):
        for axes in (slice(0, 2), slice(2, 3)):
            of = asked.values[:, axes]
            if name not in found or not of.shape[1]:
                continue
            new = np.any(np.diff(of, axis=0, prepend=np.nan) != 0, axis=1)
            lasts_s = np.diff(asked.t_s[new], append=asked.t_s[-1])
            stands = (lasts_s > _STANDS_S)[np.cumsum(new) - 1] & ~new
            told = found[name]
            at = np.searchsorted(asked.t_s, told.t_s, side="right") - 1
            values = told.values.copy()
            values[stands[at] & (at >= 0), axes] = np.nan
            found[name] = Signal(told.t_s, values)
    return found


def _joined(parts: Mapping[int, tuple[Floats, Floats]]) -> Signal:
    """Axes that stand in messages of their own, at the times of the first."""
    t_s, _ = parts[min(parts)]
    width = max(axis + values.shape[1] for axis, (_, values) in parts.items())
    found = np.full((len(t_s), width), np.nan)
    for axis, (own_s, values) in parts.items():
        found[:, axis : axis + values.shape[1]] = Signal(own_s, values).at(t_s)
    return Signal(t_s, found)


def motors(params: Mapping[str, float], outputs: Columns, name: str) -> dict[str, Signal]:
    """The motors among an ArduPilot's servo outputs (us, columns `name` with a number), 0..1;
    nothing where its parameters do not say which are motors."""
    of = {params.get(f"SERVO{number}_FUNCTION"): name.format(number) for number in range(1, 33)}
    columns = [of[function] for function in _MOTORS if of.get(function) in outputs]
    if not columns:
        return {}
    low, high = params.get("MOT_PWM_MIN") or 1000.0, params.get("MOT_PWM_MAX") or 2000.0
    source = Source(
        "motors", "", " ".join(columns), lambda us: np.clip((us - low) / (high - low), 0, 1)
    )
    return gathered({"": outputs}, [source])


def euler_deg(q: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw in degrees of quaternions (n, 4), FRD to NED as (w, x, y, z)."""
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.asarray(np.degrees(np.column_stack((roll, pitch, yaw))))
