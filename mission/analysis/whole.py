"""A whole flight, with passes through a mission or without: its numbers, and what it was told."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mission.analysis.airborne import air_times, airborne, flown_modes
from mission.analysis.health import health
from mission.analysis.holes import holes, position_gaps
from mission.analysis.load import LoadedRun
from mission.analysis.measure import Measured, happened
from mission.analysis.told import FlightErrors, Values, flown_against, modes_at
from mission.base import polyline
from mission.base.arrays import greatest, mean, rms
from mission.base.errors import InputError
from mission.base.gaps import inside
from mission.log.values import HEIGHTS, NS_PER_S


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
    track, lost = data.truth.between(start_ns, end_ns), position_gaps(data, start_ns, end_ns)
    t_s, xy = track.t_ns / NS_PER_S, track.pos_m[:, :2]
    speed = np.linalg.norm(np.gradient(xy, t_s, axis=0), axis=1) if len(t_s) > 1 else 0.0 * t_s
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
        "flown_path_m": math.nan if heights_only else polyline.length(xy),
        "duration_s": float(t_s[-1] - t_s[0]),
        "energy_j": data.battery.energy_j(start_ns, end_ns),
        "battery_remaining": data.battery.left(end_ns),
        "speed_max_mps": greatest(np.where(inside(t_s, lost) | heights_only, math.nan, speed)),
        "wind_mean_mps": mean(wind_mps),
        "wind_max_mps": greatest(wind_mps),
        "estimate_rms_m": rms(np.hypot(*off[:, :2].T)),
        "estimate_max_m": greatest(np.hypot(*off[:, :2].T)),
        "gap_max_s": float(np.diff(lost).max(initial=0.0)),
    }


def _missions(measured: Sequence[Measured]) -> dict[str, Values]:
    """The errors of all passes and rounds against their plans, over time."""
    t_s = np.concatenate([np.zeros(0), *(item.truth.t_ns / NS_PER_S for item in measured)])
    errors = {name: [getattr(item, name) for item in measured] for name in ("cross_m", "height_m")}
    return {f"plan_{name}": Values(t_s, np.concatenate(of)) for name, of in errors.items() if of}
