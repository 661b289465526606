"""One round's flight against its plan, sample by sample and slot by slot."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mission.analysis.alignment import Alignment, align, closest_approach
from mission.analysis.load import flown, reached
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.log.records import LATE, RoundRecord, UplinkRecord, flat
from mission.log.values import FlightData, PlanRecord, Track

# A straight is what lies farther than this along the planned path from every corner.
CORNER_M = 25.0


@dataclass(frozen=True)
class Measured:
    """One round's samples and slots, from which its numbers and the run's are made."""

    record: RoundRecord
    # Its row of `rounds.csv`; `plan_duration_s` of the plan; `slots`, the steps with a scheduled
    # device or the places of a plan file, and `slots_missed`; `unready`, the devices that sent
    # nothing, as they still trained.
    numbers: Mapping[str, float]
    truth: Track
    belief: Track
    fit: Alignment  # of the true track to the plan
    straight: Floats  # cross-track of the samples on straights
    corner_cut_m: Floats
    height_m: Floats  # error over the track; at the places of a plan file, whose heights vary
    slot_along_m: Floats
    slot_miss_m: Floats
    slot_late_s: Floats
    estimate_m: Floats
    estimate_height_m: Floats
    plan_per: Floats
    est_per: Floats
    true_per: Floats
    per_shift: Floats  # true - planned

    @property
    def cross_m(self) -> Floats:
        """(n,) distance of the true track to the planned path."""
        return self.fit.cross_m


def measure(run: FlightData, record: RoundRecord, plan: PlanRecord) -> Measured:
    """Measure a round that was flown; raises InputError where the log has no position of it."""
    truth = flown(run, record)
    belief = flown(run, record, track=run.belief)
    if not len(truth.t_ns):
        raise InputError(f"round {record.round}: the log has no position in its time")
    xy = truth.pos_m[:, :2]
    fit = align(xy, plan.route_m)
    from_corner = np.abs(fit.along_m[:, None] - fit.corners_m).min(axis=1, initial=math.inf)
    cuts = [
        closest_approach(xy[np.abs(fit.along_m - at) <= CORNER_M], corner)
        for at, corner in zip(fit.corners_m, fit.corner_points_m, strict=True)
        if np.any(np.abs(fit.along_m - at) <= CORNER_M)
    ]
    uplinks = [item for item in run.uplinks if item.round == record.round]
    sent = [item for item in uplinks if item.outcome != LATE]
    slots: dict[int, UplinkRecord] = {}
    for item in uplinks:  # whoever sends first at a step, sends as it begins
        slots.setdefault(item.step, item)
    reached = [item for item in slots.values() if math.isfinite(item.slot_t_s)]
    miss = np.array(
        [(item.true_x_m - item.plan_x_m, item.true_y_m - item.plan_y_m) for item in reached]
    ).reshape(-1, 2)
    heading = np.array(
        [_heading(plan.route_m, int(plan.stops_at[item.step])) for item in reached]
    ).reshape(-1, 2)
    error = belief.pos_m - truth.pos_m
    plan_per = np.array([item.plan_per for item in sent])
    true_per = np.array([item.true_per for item in sent])
    measured = Measured(
        record=record,
        numbers={
            **flat(record),
            "plan_duration_s": plan.duration_s,
            "slots": len(slots),
            "slots_missed": len(slots) - len(reached),
            "unready": len(uplinks) - len(sent),
        },
        truth=truth,
        belief=belief,
        fit=fit,
        straight=fit.cross_m[from_corner > CORNER_M],
        corner_cut_m=np.array(cuts),
        height_m=truth.pos_m[:, 2] - plan.altitude_m,
        slot_along_m=(miss * heading).sum(axis=1),
        slot_miss_m=np.linalg.norm(miss, axis=1),
        slot_late_s=np.array([_late(item, record, plan) for item in reached]),
        estimate_m=np.linalg.norm(error[:, :2], axis=1),
        estimate_height_m=error[:, 2],
        plan_per=plan_per,
        est_per=np.array([i.est_per for i in sent if math.isfinite(i.slot_t_s)]),
        true_per=true_per,
        per_shift=true_per - plan_per,
    )
    return measured if run.plan_file is None else _at_places(measured, run)


def _at_places(measured: Measured, run: FlightData) -> Measured:
    """The measurement, with the places of the plan file in place of slots."""
    places_m = run.plan_file.places_m if run.plan_file else {}
    away_m = [np.array(event.true_m) - places_m[seq] for seq, event in reached(run).items()]
    miss = np.array(away_m).reshape(-1, 3)
    return replace(
        measured,
        height_m=miss[:, 2],
        slot_miss_m=np.linalg.norm(miss[:, :2], axis=1),
        numbers={
            **measured.numbers,
            "slots": len(places_m),
            "slots_missed": len(places_m) - len(miss),
        },
    )


def _late(item: UplinkRecord, record: RoundRecord, plan: PlanRecord) -> float:
    return item.slot_t_s - record.start_t_s - float(plan.slot_s[item.step])


def _heading(route_m: Floats, at: int) -> Floats:
    """Unit vector of the path at one of its points: the mean of the legs in and out; 0 at a hover.

    A path that turns right back has no direction of its own there: the way in.
    """
    away_m = route_m - route_m[at]
    apart = np.linalg.norm(away_m, axis=1) > 1e-6
    before, after = -away_m[:at][apart[:at]][-1:], away_m[at:][apart[at:]][:1]
    legs = np.vstack((before, after))
    units = legs / np.linalg.norm(legs, axis=1, keepdims=True)
    total = units.sum(axis=0)
    size = np.linalg.norm(total)
    return np.asarray(total / size if size > 1e-6 else units[:1].sum(axis=0))
