"""A pass whose numbers are as they are given."""

from dataclasses import replace
from typing import Any

import numpy as np

from mission.analysis.alignment import align
from mission.analysis.measure import Measured
from mission.base.arrays import Floats
from mission.log.records import UNKNOWN_ROUND
from mission.log.values import Track


def bare_measured(track: Track, path_m: Floats, *, number: int, **known: Any) -> Measured:
    """Of its track, the path (N, 2) that it was to follow, and what else is known of its samples:
    no errors, on one leg, where nothing is told."""
    cross_m = known.pop("cross_m", np.zeros(len(track.t_ns)))
    zero = np.zeros(len(track.t_ns))
    names = "corner_cut_m wind_mps slot_miss_m slot_along_m slot_late_s plan_per est_per true_per"
    usual: dict[str, Any] = dict.fromkeys([*names.split(), "per_shift"], zero[:0])
    usual |= dict.fromkeys(("height_m", "estimate_m", "estimate_height_m", "speed_mps"), zero)
    usual |= {"straight": cross_m, "leg": np.ones(len(zero), dtype=int), "holes": ()}
    usual |= {"pieces": np.ones(1, dtype=int), "seqs": np.zeros(0, dtype=int)}
    return Measured(
        record=replace(UNKNOWN_ROUND, round=number),
        numbers={},
        truth=track,
        belief=track,
        fit=replace(align(track.pos_m[:, :2], path_m), cross_m=cross_m),
        **{**usual, **known},
    )
