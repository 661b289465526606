"""A mission leg by leg, as it was flown."""

import math
from dataclasses import dataclass

import numpy as np

from mission.analysis.alignment import LEAST_LEG_M
from mission.analysis.measure import Measured
from mission.base import polyline
from mission.base.arrays import greatest, rms
from mission.log.values import NS_PER_S


@dataclass(frozen=True)
class Leg:
    """One leg of the plan as it was flown; NaN where it was not."""

    number: int  # of its pass
    leg: int  # from 1
    item: int | None  # the mission item that it leads to
    length_m: float
    start_s: float
    end_s: float
    cross_track_rms_m: float
    cross_track_max_m: float
    height_max_m: float
    speed_mean_mps: float


def legs(measured: Measured) -> tuple[Leg, ...]:
    """Every leg of a pass through a mission, in order; none of a round."""
    t_s, at_m = measured.truth.t_ns / NS_PER_S, measured.fit.waypoints_at_m
    numbers, seqs = measured.pieces, measured.seqs
    found = []
    for number in range(1, numbers[-1] + 1 if len(seqs) else 0):
        first, *_, last = np.flatnonzero(np.diff(numbers == number, prepend=False, append=False))
        length_m = float(at_m[last] - at_m[first])
        if length_m < LEAST_LEG_M:  # at the end of the path
            continue
        here = np.flatnonzero(measured.leg == number)
        # It ends where the next one begins.
        here = (
            np.append(here, np.minimum(here[-1:] + 1, len(t_s) - 1)) if len(here) > 1 else here[:0]
        )
        start_s, end_s = t_s[here[[0, -1]]].tolist() if len(here) else (math.nan, math.nan)
        found.append(
            Leg(
                number=measured.record.round,
                leg=number,
                item=int(seqs[last]) if seqs[last] >= 0 else None,
                length_m=length_m,
                start_s=start_s,
                end_s=end_s,
                cross_track_rms_m=rms(measured.cross_m[here]),
                cross_track_max_m=greatest(measured.cross_m[here]),
                height_max_m=greatest(np.abs(measured.height_m[here])),
                speed_mean_mps=polyline.length(measured.truth.pos_m[here, :2]) / (end_s - start_s),
            )
        )
    return tuple(found)
