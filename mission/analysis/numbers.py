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
class Number:
    """A number of a comparison: what it is made of and how, and its label and decimal places in
    tables of several runs, where it has a label."""

    of: str
    by: Callable[[Any], float]
    text: str = ""
    digits: int = 2


class Made(Number):
    """Reduction of measured rounds, one or all of a run, to one number."""


class Told(Number):
    """Reduction of a number over the time of a flight, by its name in `FlightErrors.series`."""

    def worst_s(self, values: Values) -> float:
        """When a number was at its worst; NaN where there is none."""
        size = -values.values if self.by is least else np.abs(values.values)
        size = np.where(np.isnan(values.t_s), math.nan, size)
        return float(values.t_s[np.nanargmax(size)]) if np.isfinite(size).any() else math.nan


def _max_abs(values: Floats) -> float:
    return greatest(np.abs(values))


def _of(reduce: Callable[[Floats], float], name: str, text: str = "", digits: int = 3) -> Made:
    """A statistic of all rounds' samples (or slots) pooled, not a mean of the rounds' own."""

    def by(items: Sequence[Measured]) -> float:
        return reduce(np.concatenate([getattr(item, name) for item in items]))

    return Made(name, by, text, digits)


def _sum(name: str, text: str = "", digits: int = 0) -> Made:
    """Sum of a number over all rounds; NaN where the run does not have it."""

    def add(items: Sequence[Measured]) -> float:
        known = all(name in item.numbers for item in items)
        return sum(item.numbers[name] for item in items) if known else math.nan

    return Made(name, add, text, digits)


def _longest(name: str, text: str) -> Made:
    return Made(name, lambda items: max(item.numbers[name] for item in items), text, 1)


def _last(name: str, text: str) -> Made:
    return Made(name, lambda items: items[-1].numbers[name], text, 3)


def _expected(true_per: Floats) -> float:
    return float((1.0 - true_per).sum())


@dataclass(frozen=True)
class Comparison:
    """The numbers of one round, or of a whole run (`round` is None, pooled over all rounds).

    NaN where there is nothing to measure: no straight long enough, no corner, no slot reached.
    Rms and mean values of a run weigh every sample or slot alike, not every round. Each number is
    declared here with how it is made and what it is called beside other runs.
    """

    round: int | None
    # Length of the planned polyline, and horizontal length of the true track.
    plan_path_m: Annotated[float, _sum("plan_path_m", "planned path (m)", 1)]
    flown_path_m: Annotated[float, _sum("flown_path_m", "flown path (m)", 1)]
    # As planned, with the speeds that will be flown, and as flown; simulated.
    plan_duration_s: Annotated[float, _sum("plan_duration_s", "duration planned (s)", 1)]
    duration_s: Annotated[float, _sum("duration_s", "duration (s)", 1)]
    # Joules of the battery.
    plan_energy_j: Annotated[float, _sum("plan_energy_j", "energy planned (J)")]
    energy_j: Annotated[float, _sum("energy_j", "energy (J)")]
    # Horizontal distance of the true track to the planned polyline.
    cross_track_rms_m: Annotated[float, _of(rms, "cross_m", "cross-track rms (m)")]
    cross_track_max_m: Annotated[float, _of(greatest, "cross_m", "cross-track max (m)")]
    # The same, only farther than CORNER_M from every corner.
    straight_rms_m: Annotated[float, _of(rms, "straight", "on straights rms (m)")]
    straight_max_m: Annotated[float, _of(greatest, "straight", "on straights max (m)")]
    # Closest approach to a corner of the plan.
    corner_cut_mean_m: Annotated[float, _of(mean, "corner_cut_m", "corner cut mean (m)")]
    corner_cut_max_m: Annotated[float, _of(greatest, "corner_cut_m", "corner cut max (m)")]
    # True height against the planned one.
    height_rms_m: Annotated[float, _of(rms, "height_m", "height error rms (m)")]
    height_max_m: Annotated[float, _of(_max_abs, "height_m", "height error max (m)")]
    # True position at a slot against its waypoint: along the path, and horizontal distance.
    slot_along_rms_m: Annotated[float, _of(rms, "slot_along_m", "slot along-track rms (m)")]
    slot_along_max_m: Annotated[float, _of(_max_abs, "slot_along_m")]
    slot_miss_rms_m: Annotated[float, _of(rms, "slot_miss_m", "slot miss rms (m)")]
    slot_miss_max_m: Annotated[float, _of(greatest, "slot_miss_m", "slot miss max (m)")]
    # Instant of a slot against its planned one.
    slot_late_mean_s: Annotated[float, _of(mean, "slot_late_s", "slot late mean (s)")]
    slot_late_max_s: Annotated[float, _of(greatest, "slot_late_s", "slot late max (s)")]
    # Steps with a scheduled device, or the places of a plan file, and those never reached.
    slots: Annotated[int, _sum("slots")]
    slots_missed: Annotated[int, _sum("slots_missed", "slots never reached")]
    # Horizontal distance of belief to truth, over the track.
    estimate_rms_m: Annotated[float, _of(rms, "estimate_m", "estimate error rms (m)")]
    estimate_max_m: Annotated[float, _of(greatest, "estimate_m", "estimate error max (m)")]
    estimate_height_rms_m: Annotated[float, _of(rms, "estimate_height_m")]
    # Over the scheduled devices that had something to send; believed: over those whose slot was
    # reached; true: 1 where not.
    plan_per_mean: Annotated[float, _of(mean, "plan_per", "mean PER planned", 5)]
    est_per_mean: Annotated[float, _of(mean, "est_per", "mean PER believed", 5)]
    true_per_mean: Annotated[float, _of(mean, "true_per", "mean PER true", 5)]
    per_shift_max: Annotated[float, _of(_max_abs, "per_shift", "PER shift max", 5)]
    # Sums of importance (1 - PER).
    plan_objective: Annotated[float, _sum("plan_objective", "objective planned", 4)]
    est_objective: Annotated[float, _sum("est_objective", "objective believed", 4)]
    true_objective: Annotated[float, _sum("true_objective", "objective true", 4)]
    upper_bound: Annotated[float, _sum("upper_bound")]
    scheduled: Annotated[int, _sum("scheduled", "scheduled")]
    # Sum of 1 - true PER.
    expected: Annotated[float, _of(_expected, "true_per", "arrivals expected", 2)]
    delivered: Annotated[int, _sum("delivered", "arrived")]
    # Scheduled devices that still trained when their turn came.
    unready: Annotated[int, _sum("unready", "late devices")]
    # 0..1 of the capacity at the end.
    battery_remaining: Annotated[float, _last("battery_remaining", "battery left (0..1)")]
    # Over ground; and the wind at the aircraft, horizontally, where the log has it.
    speed_max_mps: Annotated[float, _of(greatest, "speed_mps", "speed max (m/s)", 2)]
    wind_mean_mps: Annotated[float, _of(mean, "wind_mps")]
    wind_max_mps: Annotated[float, _of(greatest, "wind_mps", "wind max (m/s)", 2)]
    # What happened meanwhile.
    mode_changes: Annotated[float, _sum("mode_changes")]
    failsafes: Annotated[float, _sum("failsafes", "failsafes")]
    faults: Annotated[float, _sum("faults", "faults")]
    gap_max_s: Annotated[float, _longest("gap_max_s", "longest hole (s)")]
    # Against what the vehicle was told, where the log holds that: see `mission.analysis.told`.
    tracking_rms_m: Annotated[float, Told("tracking_m", rms, "off setpoint rms (m)", 3)]
    tracking_max_m: Annotated[float, Told("tracking_m", greatest, "off setpoint max (m)", 3)]
    along_rms_m: Annotated[float, Told("along_m", rms, "along rms (m)", 3)]
    across_rms_m: Annotated[float, Told("across_m", rms, "across rms (m)", 3)]
    across_target_rms_m: Annotated[float, Told("target_m", rms, "off target rms (m)", 3)]
    across_target_max_m: Annotated[float, Told("target_m", greatest, "off target's way max (m)", 3)]
    height_tracking_rms_m: Annotated[float, Told("height_off_m", rms, "height off rms (m)", 3)]
    height_tracking_max_m: Annotated[float, Told("height_off_m", _max_abs, "height off max (m)", 3)]
    speed_tracking_rms_mps: Annotated[float, Told("speed_off_mps", rms, "speed off rms (m/s)", 3)]
    speed_tracking_max_mps: Annotated[
        float, Told("speed_off_mps", _max_abs, "speed off max (m/s)", 3)
    ]
    attitude_tracking_rms_deg: Annotated[float, Told("tilt_off_deg", rms, "tilt off rms (deg)")]
    attitude_tracking_max_deg: Annotated[
        float, Told("tilt_off_deg", greatest, "tilt off max (deg)")
    ]
    yaw_tracking_rms_deg: Annotated[float, Told("yaw_off_deg", rms, "yaw off rms (deg)")]
    yaw_tracking_max_deg: Annotated[float, Told("yaw_off_deg", _max_abs, "yaw off max (deg)")]
    rates_tracking_rms_degps: Annotated[
        float, Told("rates_off_degps", rms, "rates off rms (deg/s)")
    ]
    tracking_delay_s: Annotated[float, Told("tracking_delay_s", mean, "delay (s)", 3)]
    # Health in the air: see `mission.analysis.whole`.
    vibration_max_mps2: Annotated[float, Told("vibration_mps2", greatest, "vibration max (m/s2)")]
    clips_max: Annotated[float, Told("clips", greatest, "clips", 0)]
    innovation_ratio_max: Annotated[
        float, Told("innovation_ratio", greatest, "innovation ratio max")
    ]
    gnss_fix_min: Annotated[float, Told("gnss_fix", least, "GNSS fix, least (3: 3D)", 0)]
    satellites_min: Annotated[float, Told("satellites", least, "satellites, least", 0)]
    hdop_max: Annotated[float, Told("hdop", greatest, "HDOP max")]
    gnss_accuracy_max_m: Annotated[
        float, Told("gnss_accuracy_m", greatest, "GNSS accuracy max (m)")
    ]
    battery_min: Annotated[float, Told("remaining", least, "battery least (0..1)", 3)]
    voltage_min_v: Annotated[float, Told("voltage_v", least, "voltage min (V)")]
    voltage_sag_max_v: Annotated[float, Told("sag_v", greatest, "voltage sag max (V)")]
    current_max_a: Annotated[float, Told("current_a", greatest, "current max (A)", 1)]
    motor_max: Annotated[float, Told("motors", greatest, "motor max (0..1)", 3)]
    motors_full_s: Annotated[float, Told("motors_full_s", greatest, "motors at full (s)", 1)]
    motor_imbalance: Annotated[float, Told("motor_imbalance", greatest, "motors apart (0..1)", 3)]
    log_dropout_max_s: Annotated[float, Told("log_gap_s", greatest, "longest dropout (s)")]
    gnss_gaps: Annotated[float, _sum("gnss_gaps")]
    gnss_gap_max_s: Annotated[float, _longest("gnss_gap_max_s", "longest gap of GNSS (s)")]


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
