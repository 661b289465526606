"""The numbers of a comparison: what each is called, and what it is made of."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from mission.analysis.measure import Measured
from mission.analysis.told import Values
from mission.base.arrays import Floats, greatest, least, mean, rms
from mission.base.tables import annotated


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


@dataclass(frozen=True)
class Told(Label):
    """Reduction of a number over the time of a flight, by its name in `FlightErrors.series`."""

    by: Callable[[Floats], float]
    of: str

    def worst_s(self, values: Values) -> float:
        """When a number was at its worst; NaN where there is none."""
        size = -values.values if self.by is least else np.abs(values.values)
        size = np.where(np.isnan(values.t_s), math.nan, size)
        return float(values.t_s[np.nanargmax(size)]) if np.isfinite(size).any() else math.nan


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
    # Against what the vehicle was told, where the log holds that: see `mission.analysis.told`.
    tracking_rms_m: Annotated[float, Told("off setpoint rms (m)", 3, rms, "tracking_m")]
    tracking_max_m: Annotated[float, Told("off setpoint max (m)", 3, greatest, "tracking_m")]
    along_rms_m: Annotated[float, Told("along rms (m)", 3, rms, "along_m")]
    across_rms_m: Annotated[float, Told("across rms (m)", 3, rms, "across_m")]
    across_target_rms_m: Annotated[float, Told("off target rms (m)", 3, rms, "target_m")]
    across_target_max_m: Annotated[float, Told("off target's way max (m)", 3, greatest, "target_m")]
    height_tracking_rms_m: Annotated[float, Told("height off rms (m)", 3, rms, "height_off_m")]
    height_tracking_max_m: Annotated[float, Told("height off max (m)", 3, _max_abs, "height_off_m")]
    speed_tracking_rms_mps: Annotated[float, Told("speed off rms (m/s)", 3, rms, "speed_off_mps")]
    speed_tracking_max_mps: Annotated[
        float, Told("speed off max (m/s)", 3, _max_abs, "speed_off_mps")
    ]
    attitude_tracking_rms_deg: Annotated[float, Told("tilt off rms (deg)", 2, rms, "tilt_off_deg")]
    attitude_tracking_max_deg: Annotated[
        float, Told("tilt off max (deg)", 2, greatest, "tilt_off_deg")
    ]
    yaw_tracking_rms_deg: Annotated[float, Told("yaw off rms (deg)", 2, rms, "yaw_off_deg")]
    yaw_tracking_max_deg: Annotated[float, Told("yaw off max (deg)", 2, _max_abs, "yaw_off_deg")]
    rates_tracking_rms_degps: Annotated[
        float, Told("rates off rms (deg/s)", 2, rms, "rates_off_degps")
    ]
    tracking_delay_s: Annotated[float, Told("delay (s)", 3, mean, "tracking_delay_s")]
    # Health in the air: see `mission.analysis.health`.
    vibration_max_mps2: Annotated[
        float, Told("vibration max (m/s2)", 2, greatest, "vibration_mps2")
    ]
    clips_max: Annotated[float, Told("clips", 0, greatest, "clips")]
    innovation_ratio_max: Annotated[
        float, Told("innovation ratio max", 2, greatest, "innovation_ratio")
    ]
    gnss_fix_min: Annotated[float, Told("GNSS fix, least (3: 3D)", 0, least, "gnss_fix")]
    satellites_min: Annotated[float, Told("satellites, least", 0, least, "satellites")]
    hdop_max: Annotated[float, Told("HDOP max", 2, greatest, "hdop")]
    gnss_accuracy_max_m: Annotated[
        float, Told("GNSS accuracy max (m)", 2, greatest, "gnss_accuracy_m")
    ]
    battery_min: Annotated[float, Told("battery least (0..1)", 3, least, "remaining")]
    voltage_min_v: Annotated[float, Told("voltage min (V)", 2, least, "voltage_v")]
    voltage_sag_max_v: Annotated[float, Told("voltage sag max (V)", 2, greatest, "sag_v")]
    current_max_a: Annotated[float, Told("current max (A)", 1, greatest, "current_a")]
    motor_max: Annotated[float, Told("motor max (0..1)", 3, greatest, "motors")]
    motors_full_s: Annotated[float, Told("motors at full (s)", 1, greatest, "motors_full_s")]
    motor_imbalance: Annotated[float, Told("motors apart (0..1)", 3, greatest, "motor_imbalance")]
    log_dropout_max_s: Annotated[float, Told("longest dropout (s)", 2, greatest, "log_gap_s")]
    gnss_gaps: Annotated[float, _sum("gnss_gaps")]
    gnss_gap_max_s: Annotated[
        float,
        Made(lambda items: max(i.numbers["gnss_gap_max_s"] for i in items), "gnss_gap_max_s"),
        Label("longest gap of GNSS (s)", 1),
    ]


# Of a stretch that flew a mission.
OF_PLAN: Mapping[str, tuple[str, Callable[[Floats], float]]] = {
    "cross_track_rms_m": ("plan_cross_m", rms),
    "cross_track_max_m": ("plan_cross_m", greatest),
    "height_rms_m": ("plan_height_m", rms),
    "height_max_m": ("plan_height_m", _max_abs),
}


def told_numbers(series: Mapping[str, Values]) -> dict[str, Any]:
    """The numbers of what was told and of health, by name; NaN where the log holds none."""
    return {
        name: how.by(series[how.of].values) if how.of in series else math.nan
        for name, how in annotated(Comparison, Told)
    }
