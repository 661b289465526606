"""Planned against flown: how far a run's flights were from their plans, and what it cost.

Errors are measured on the true track; what the autopilot believed has its own numbers. Corner
cutting is flown on purpose (the autopilot may cut a corner by its acceptance radius), so errors on
straights and at corners stand apart.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mission.analysis.alignment import align, closest_approach
from mission.analysis.load import LoadedRun, flown
from mission.base.errors import InputError
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.values import FlightData, Floats, PlanRecord

# A straight is what lies farther than this along the planned path from every corner.
CORNER_M = 25.0


@dataclass(frozen=True)
class Comparison:
    """The numbers of one round, or of a whole run (`round` is None, pooled over all rounds).

    NaN where there is nothing to measure: no straight long enough, no corner, no slot reached.
    Rms and mean values of a run weigh every sample or slot alike, not every round.
    """

    round: int | None
    plan_path_m: float  # length of the planned polyline
    flown_path_m: float  # horizontal length of the true track
    duration_s: float  # simulated
    cross_track_rms_m: float  # horizontal distance of the true track to the planned polyline
    cross_track_max_m: float
    straight_rms_m: float  # the same, only farther than CORNER_M from every corner
    straight_max_m: float
    corner_cut_mean_m: float  # closest approach to a corner of the plan
    corner_cut_max_m: float
    height_rms_m: float  # true height against the planned one
    height_max_m: float
    slot_along_rms_m: float  # true position at a slot against its waypoint, along the path
    slot_along_max_m: float  # largest absolute value
    slot_miss_rms_m: float  # horizontal distance of the two
    slot_miss_max_m: float
    slot_late_mean_s: float  # instant of a slot against flight at constant planned speed
    slot_late_max_s: float
    slots: int  # steps with a scheduled device
    slots_missed: int  # of these, never reached
    estimate_rms_m: float  # horizontal distance of belief to truth, over the track
    estimate_max_m: float
    estimate_height_rms_m: float
    plan_per_mean: float  # over the scheduled devices
    est_per_mean: float  # over those whose slot was reached
    true_per_mean: float  # a slot never reached counts as 1
    per_shift_max: float  # largest |true - planned|
    plan_objective: float  # sum of importance (1 - PER)
    est_objective: float
    true_objective: float
    upper_bound: float
    scheduled: int
    expected: float  # sum of 1 - true PER: arrivals to be expected
    delivered: int


@dataclass(frozen=True)
class DeviceComparison:
    """One device over a run; means over the rounds in which it was scheduled, NaN if never."""

    device: int
    community: str
    scheduled: int
    delivered: int
    plan_per: float
    est_per: float
    true_per: float


@dataclass(frozen=True)
class RunComparison:
    """One run: every round, all of them together, and device by device."""

    source: Path
    name: str
    about: str  # name, strategy and seed
    rounds: tuple[Comparison, ...]
    total: Comparison
    devices: tuple[DeviceComparison, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain values; NaN as None."""
        return {
            "source": str(self.source),
            "rounds": [_plain(item) for item in self.rounds],
            "total": _plain(self.total),
            "devices": [_plain(item) for item in self.devices],
        }


@dataclass(frozen=True)
class _Measured:
    """One round's samples and slots, from which its numbers and the run's are made."""

    record: RoundRecord
    cross_m: Floats
    straight: Floats  # cross-track of the samples on straights
    corner_cut_m: Floats
    height_m: Floats
    slot_along_m: Floats
    slot_miss_m: Floats
    slot_late_s: Floats
    slots: int
    estimate_m: Floats
    estimate_height_m: Floats
    plan_per: Floats
    est_per: Floats
    true_per: Floats


def compare_run(loaded: LoadedRun, *, rounds: int | None = None) -> RunComparison:
    """Compare every finished round of a run with its plan, or those up to number `rounds`.

    Raises:
        InputError: a run in which no round was flown.
    """
    run = loaded.data
    if rounds is not None:
        run = replace(
            run,
            rounds=tuple(item for item in run.rounds if item.round <= rounds),
            uplinks=tuple(item for item in run.uplinks if item.round <= rounds),
        )
    plans = {plan.round: plan for plan in run.plans}
    measured = [_measure(run, record, plans[record.round]) for record in run.rounds
                if record.round in plans]  # fmt: skip
    if not measured:
        why = f": {loaded.notice}" if loaded.notice else ""
        raise InputError(f"{loaded.path}: no round was flown, so there is nothing to compare{why}")
    return RunComparison(
        source=loaded.path,
        name=loaded.name,
        about=loaded.about,
        rounds=tuple(_numbers([item], item.record.round) for item in measured),
        total=_numbers(measured, None),
        devices=tuple(
            _device(run, device, community)
            for device, community in enumerate(run.devices.community)
        ),
    )


def _device(run: FlightData, device: int, community: str) -> DeviceComparison:
    uplinks = [item for item in run.uplinks if item.device == device]
    return DeviceComparison(
        device=device,
        community=community,
        scheduled=len(uplinks),
        delivered=sum(item.delivered for item in uplinks),
        plan_per=_mean(np.array([item.plan_per for item in uplinks])),
        est_per=_mean(np.array([i.est_per for i in uplinks if math.isfinite(i.slot_t_s)])),
        true_per=_mean(np.array([item.true_per for item in uplinks])),
    )


def _measure(run: FlightData, record: RoundRecord, plan: PlanRecord) -> _Measured:
    truth = flown(run, record)
    belief = flown(run, record, track=run.belief)
    if not len(truth.t_ns):
        raise InputError(f"round {record.round}: the log has no position in its time")
    xy = truth.pos_m[:, :2]
    fit = align(xy, plan.waypoints_m)
    from_corner = np.abs(fit.along_m[:, None] - fit.corners_m).min(axis=1, initial=math.inf)
    cuts = [
        closest_approach(xy[np.abs(fit.along_m - at) <= CORNER_M], corner)
        for at, corner in zip(fit.corners_m, fit.corner_points_m, strict=True)
        if np.any(np.abs(fit.along_m - at) <= CORNER_M)
    ]
    uplinks = [item for item in run.uplinks if item.round == record.round]
    slots = {item.step: item for item in uplinks}
    reached = [item for item in slots.values() if math.isfinite(item.slot_t_s)]
    miss = np.array(
        [(item.true_x_m - item.plan_x_m, item.true_y_m - item.plan_y_m) for item in reached]
    ).reshape(-1, 2)
    heading = np.array([_heading(plan.waypoints_m, item.step) for item in reached]).reshape(-1, 2)
    error = belief.pos_m - truth.pos_m
    return _Measured(
        record=record,
        cross_m=fit.cross_m,
        straight=fit.cross_m[from_corner > CORNER_M],
        corner_cut_m=np.array(cuts),
        height_m=truth.pos_m[:, 2] - plan.altitude_m,
        slot_along_m=(miss * heading).sum(axis=1),
        slot_miss_m=np.linalg.norm(miss, axis=1),
        slot_late_s=np.array([_late(item, record, plan) for item in reached]),
        slots=len(slots),
        estimate_m=np.linalg.norm(error[:, :2], axis=1),
        estimate_height_m=error[:, 2],
        plan_per=np.array([item.plan_per for item in uplinks]),
        est_per=np.array([i.est_per for i in uplinks if math.isfinite(i.slot_t_s)]),
        true_per=np.array([item.true_per for item in uplinks]),
    )


def _late(item: UplinkRecord, record: RoundRecord, plan: PlanRecord) -> float:
    return item.slot_t_s - record.start_t_s - float(plan.ideal_slot_s[item.step])


def _heading(waypoints_m: Floats, step: int) -> Floats:
    """Unit vector of the path at a waypoint: the mean of the legs in and out; 0 at a hover."""
    here = waypoints_m[step]
    apart = np.linalg.norm(waypoints_m - here, axis=1) > 1e-6
    before, after = np.flatnonzero(apart[:step]), np.flatnonzero(apart[step:])
    total = np.zeros(2)
    if len(before):
        leg = here - waypoints_m[before[-1]]
        total += leg / np.linalg.norm(leg)
    if len(after):
        leg = waypoints_m[step + after[0]] - here
        total += leg / np.linalg.norm(leg)
    size = np.linalg.norm(total)
    # A path that turns right back has no direction of its own there: take the way in.
    if size < 1e-6 and len(before):
        leg = here - waypoints_m[before[-1]]
        return np.asarray(leg / np.linalg.norm(leg))
    return np.asarray(total / size) if size > 0 else total


def _numbers(items: Sequence[_Measured], number: int | None) -> Comparison:
    def pooled(name: str) -> Floats:
        return np.concatenate([getattr(item, name) for item in items])

    def total(name: str) -> float:
        return float(sum(getattr(item.record, name) for item in items))

    reached = pooled("slot_miss_m")
    plan_per, true_per = pooled("plan_per"), pooled("true_per")
    slots = sum(item.slots for item in items)
    return Comparison(
        round=number,
        plan_path_m=total("plan_path_m"),
        flown_path_m=total("flown_path_m"),
        duration_s=total("duration_s"),
        cross_track_rms_m=_rms(pooled("cross_m")),
        cross_track_max_m=_max(pooled("cross_m")),
        straight_rms_m=_rms(pooled("straight")),
        straight_max_m=_max(pooled("straight")),
        corner_cut_mean_m=_mean(pooled("corner_cut_m")),
        corner_cut_max_m=_max(pooled("corner_cut_m")),
        height_rms_m=_rms(pooled("height_m")),
        height_max_m=_max(np.abs(pooled("height_m"))),
        slot_along_rms_m=_rms(pooled("slot_along_m")),
        slot_along_max_m=_max(np.abs(pooled("slot_along_m"))),
        slot_miss_rms_m=_rms(reached),
        slot_miss_max_m=_max(reached),
        slot_late_mean_s=_mean(pooled("slot_late_s")),
        slot_late_max_s=_max(pooled("slot_late_s")),
        slots=slots,
        slots_missed=slots - len(reached),
        estimate_rms_m=_rms(pooled("estimate_m")),
        estimate_max_m=_max(pooled("estimate_m")),
        estimate_height_rms_m=_rms(pooled("estimate_height_m")),
        plan_per_mean=_mean(plan_per),
        est_per_mean=_mean(pooled("est_per")),
        true_per_mean=_mean(true_per),
        per_shift_max=_max(np.abs(true_per - plan_per)),
        plan_objective=total("plan_objective"),
        est_objective=total("est_objective"),
        true_objective=total("true_objective"),
        upper_bound=total("upper_bound"),
        scheduled=sum(item.record.scheduled for item in items),
        expected=float((1.0 - true_per).sum()),
        delivered=sum(item.record.delivered for item in items),
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else math.nan


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else math.nan


def _max(values: Floats) -> float:
    return float(values.max()) if len(values) else math.nan


def _plain(item: Comparison | DeviceComparison) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in asdict(item).items()
    }
