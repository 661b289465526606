"""Planned against flown: how far a run's flights were from their plans, and what it cost.

Errors are measured on the true track; what the autopilot believed has its own numbers. Corner
cutting is flown on purpose (the autopilot may cut a corner by its acceptance radius), so errors on
straights and at corners stand apart.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from mission.analysis.holes import Hole
from mission.analysis.legs import Leg, legs
from mission.analysis.load import LoadedRun
from mission.analysis.measure import Measured, measure, measure_pass
from mission.analysis.spikes import spikes
from mission.base.arrays import Floats, greatest, mean, rms
from mission.base.errors import InputError
from mission.base.tables import told
from mission.log.records import LATE
from mission.log.values import FlightData


@dataclass(frozen=True)
class Label:
    """Label and decimal places of a number in tables of several runs."""

    text: str
    digits: int


@dataclass(frozen=True)
class Made:
    """Reduction of measured rounds, one or all of a run, to one number."""

    by: Callable[[Sequence[Measured]], float]
    of: str  # what it is made of


def _max_abs(values: Floats) -> float:
    return greatest(np.abs(values))


def _of(reduce: Callable[[Floats], float], name: str) -> Made:
    """A statistic of all rounds' samples (or slots) pooled, not a mean of the rounds' own."""
    return Made(lambda items: reduce(np.concatenate([getattr(item, name) for item in items])), name)


def _sum(name: str) -> Made:
    """Sum of a number over all rounds; NaN where the run does not have it."""

    def add(items: Sequence[Measured]) -> float:
        known = all(name in item.numbers for item in items)
        return sum(item.numbers[name] for item in items) if known else math.nan

    return Made(add, name)


@dataclass(frozen=True)
class Comparison:
    """The numbers of one round, or of a whole run (`round` is None, pooled over all rounds).

    NaN where there is nothing to measure: no straight long enough, no corner, no slot reached.
    Rms and mean values of a run weigh every sample or slot alike, not every round. Each number is
    declared here with how it is made and what it is called beside other runs.
    """

    round: int | None
    # Length of the planned polyline, and horizontal length of the true track.
    plan_path_m: Annotated[float, _sum("plan_path_m"), Label("planned path (m)", 1)]
    flown_path_m: Annotated[float, _sum("flown_path_m"), Label("flown path (m)", 1)]
    # As planned, with the speeds that will be flown, and as flown; simulated.
    plan_duration_s: Annotated[float, _sum("plan_duration_s"), Label("duration planned (s)", 1)]
    duration_s: Annotated[float, _sum("duration_s"), Label("duration (s)", 1)]
    # Joules of the battery.
    plan_energy_j: Annotated[float, _sum("plan_energy_j"), Label("energy planned (J)", 0)]
    energy_j: Annotated[float, _sum("energy_j"), Label("energy (J)", 0)]
    # Horizontal distance of the true track to the planned polyline.
    cross_track_rms_m: Annotated[float, _of(rms, "cross_m"), Label("cross-track rms (m)", 3)]
    cross_track_max_m: Annotated[float, _of(greatest, "cross_m"), Label("cross-track max (m)", 3)]
    # The same, only farther than CORNER_M from every corner.
    straight_rms_m: Annotated[float, _of(rms, "straight"), Label("on straights rms (m)", 3)]
    straight_max_m: Annotated[float, _of(greatest, "straight"), Label("on straights max (m)", 3)]
    # Closest approach to a corner of the plan.
    corner_cut_mean_m: Annotated[float, _of(mean, "corner_cut_m"), Label("corner cut mean (m)", 3)]
    corner_cut_max_m: Annotated[
        float, _of(greatest, "corner_cut_m"), Label("corner cut max (m)", 3)
    ]
    # True height against the planned one.
    height_rms_m: Annotated[float, _of(rms, "height_m"), Label("height error rms (m)", 3)]
    height_max_m: Annotated[float, _of(_max_abs, "height_m"), Label("height error max (m)", 3)]
    # True position at a slot against its waypoint: along the path, and horizontal distance.
    slot_along_rms_m: Annotated[
        float, _of(rms, "slot_along_m"), Label("slot along-track rms (m)", 3)
    ]
    slot_along_max_m: Annotated[float, _of(_max_abs, "slot_along_m")]
    slot_miss_rms_m: Annotated[float, _of(rms, "slot_miss_m"), Label("slot miss rms (m)", 3)]
    slot_miss_max_m: Annotated[float, _of(greatest, "slot_miss_m"), Label("slot miss max (m)", 3)]
    # Instant of a slot against its planned one.
    slot_late_mean_s: Annotated[float, _of(mean, "slot_late_s"), Label("slot late mean (s)", 3)]
    slot_late_max_s: Annotated[float, _of(greatest, "slot_late_s"), Label("slot late max (s)", 3)]
    # Steps with a scheduled device, or the places of a plan file, and those never reached.
    slots: Annotated[int, _sum("slots")]
    slots_missed: Annotated[int, _sum("slots_missed"), Label("slots never reached", 0)]
    # Horizontal distance of belief to truth, over the track.
    estimate_rms_m: Annotated[float, _of(rms, "estimate_m"), Label("estimate error rms (m)", 3)]
    estimate_max_m: Annotated[
        float, _of(greatest, "estimate_m"), Label("estimate error max (m)", 3)
    ]
    estimate_height_rms_m: Annotated[float, _of(rms, "estimate_height_m")]
    # Over the scheduled devices that had something to send; believed: over those whose slot was
    # reached; true: 1 where not.
    plan_per_mean: Annotated[float, _of(mean, "plan_per"), Label("mean PER planned", 5)]
    est_per_mean: Annotated[float, _of(mean, "est_per"), Label("mean PER believed", 5)]
    true_per_mean: Annotated[float, _of(mean, "true_per"), Label("mean PER true", 5)]
    per_shift_max: Annotated[float, _of(_max_abs, "per_shift"), Label("PER shift max", 5)]
    # Sums of importance (1 - PER).
    plan_objective: Annotated[float, _sum("plan_objective"), Label("objective planned", 4)]
    est_objective: Annotated[float, _sum("est_objective"), Label("objective believed", 4)]
    true_objective: Annotated[float, _sum("true_objective"), Label("objective true", 4)]
    upper_bound: Annotated[float, _sum("upper_bound")]
    scheduled: Annotated[int, _sum("scheduled"), Label("scheduled", 0)]
    # Sum of 1 - true PER.
    expected: Annotated[
        float,
        _of(lambda true_per: float((1.0 - true_per).sum()), "true_per"),
        Label("arrivals expected", 2),
    ]
    delivered: Annotated[int, _sum("delivered"), Label("arrived", 0)]
    # Scheduled devices that still trained when their turn came.
    unready: Annotated[int, _sum("unready"), Label("late devices", 0)]
    # 0..1 of the capacity at the end.
    battery_remaining: Annotated[
        float,
        Made(lambda items: items[-1].numbers["battery_remaining"], "battery_remaining"),
        Label("battery left (0..1)", 3),
    ]
    # Over ground; and the wind at the aircraft, horizontally, where the log has it.
    speed_max_mps: Annotated[float, _of(greatest, "speed_mps"), Label("speed max (m/s)", 2)]
    wind_mean_mps: Annotated[float, _of(mean, "wind_mps")]
    wind_max_mps: Annotated[float, _of(greatest, "wind_mps"), Label("wind max (m/s)", 2)]
    # What happened meanwhile.
    mode_changes: Annotated[float, _sum("mode_changes")]
    failsafes: Annotated[float, _sum("failsafes"), Label("failsafes", 0)]
    faults: Annotated[float, _sum("faults"), Label("faults", 0)]
    gap_max_s: Annotated[
        float,
        Made(lambda items: max(i.numbers["gap_max_s"] for i in items), "gap_max_s"),
        Label("longest hole (s)", 1),
    ]
    gnss_gaps: Annotated[float, _sum("gnss_gaps")]
    gnss_gap_max_s: Annotated[
        float,
        Made(lambda items: max(i.numbers["gnss_gap_max_s"] for i in items), "gnss_gap_max_s"),
        Label("longest gap of GNSS (s)", 1),
    ]


@dataclass(frozen=True)
class DeviceComparison:
    """One device over a run; means over the rounds in which it was scheduled and had something to
    send (`est_per`: and its slot was reached), NaN if never."""

    device: int
    community: str
    scheduled: int
    delivered: int
    late: int
    plan_per: float
    est_per: float
    true_per: float


@dataclass(frozen=True)
class RunComparison:
    """One run: every round, all of them together, and device by device."""

    run: LoadedRun
    measured: tuple[Measured, ...]  # round by round, what its numbers are made of
    rounds: tuple[Comparison, ...]
    total: Comparison
    devices: tuple[DeviceComparison, ...]

    @property
    def legs(self) -> tuple[Leg, ...]:
        """Legs of every pass through a mission, in order; none for a run."""
        return tuple(leg for measured in self.measured for leg in legs(measured))

    @property
    def holes(self) -> tuple[Hole, ...]:
        """Holes in the positions of every pass or round, in order."""
        found = {hole.start_s: hole for measured in self.measured for hole in measured.holes}
        return tuple(found.values())

    @property
    def values(self) -> dict[str, object]:
        """What `aerofed compare --json` prints."""
        judged, data = self.run.judged, self.run.data
        of_a_flight = (
            {}
            if judged is None
            else {
                "log": data.source,
                "plan": data.planned.source if data.planned else "",
                "not_compared_s": judged.apart,
                "items_left_out": judged.left_out,
                "legs": self.legs,
                "spikes": spikes(data, self.measured),
            }
        )
        return {
            "source": self.run.path,
            "rounds": self.rounds,
            "total": self.total,
            "devices": self.devices,
            "holes": self.holes,
            **of_a_flight,
        }


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
    flown = [record for record in run.rounds if record.round in plans]
    if loaded.judged is None:
        measured = [measure(loaded.data, record, plans[record.round]) for record in flown]
    else:
        passes = loaded.judged.passes[: len(flown)]
        measured = [measure_pass(loaded.data, found) for found in passes]
    if not measured and loaded.unjudged:
        raise InputError(loaded.unjudged)
    if not measured:
        why = f": {loaded.notice}" if loaded.notice else ""
        raise InputError(f"{loaded.path}: no round was flown, so there is nothing to compare{why}")
    return RunComparison(
        run=loaded,
        measured=tuple(measured),
        rounds=tuple(_made([item], item.record.round) for item in measured),
        total=_made(measured, None),
        devices=tuple(
            _device(run, device, community)
            for device, community in enumerate(run.devices.community)
        ),
    )


def _device(run: FlightData, device: int, community: str) -> DeviceComparison:
    uplinks = [item for item in run.uplinks if item.device == device]
    sent = [item for item in uplinks if item.outcome != LATE]
    return DeviceComparison(
        device=device,
        community=community,
        scheduled=len(uplinks),
        delivered=sum(item.delivered for item in uplinks),
        late=len(uplinks) - len(sent),
        plan_per=mean(np.array([item.plan_per for item in sent])),
        est_per=mean(np.array([i.est_per for i in sent if math.isfinite(i.slot_t_s)])),
        true_per=mean(np.array([item.true_per for item in sent])),
    )


def _made(items: Sequence[Measured], number: int | None) -> Comparison:
    made: dict[str, Any] = {name: how.by(items) for name, how in told(Comparison, Made)}
    return Comparison(round=number, **made)
