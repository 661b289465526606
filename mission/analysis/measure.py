"""One round's flight against its plan, sample by sample and slot by slot."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mission.analysis.alignment import LEAST_LEG_M, Alignment, leg_numbers, leg_of, matched
from mission.analysis.holes import Hole, holes, position_gaps, while_armed
from mission.analysis.load import flown
from mission.base import polyline
from mission.base.arrays import Floats, Ints, greatest, rms
from mission.base.errors import InputError
from mission.base.gaps import gaps, inside
from mission.log.records import LATE, RoundRecord, UplinkRecord, flat
from mission.log.values import NS_PER_S, FlightData, PlanRecord, Track

if TYPE_CHECKING:
    from mission.analysis.one_pass import Pass

# A straight is what lies farther than this along the planned path from every corner.
CORNER_M = 25.0
_FAULT_ENDS = "Fault ends"  # what the vehicle's word for the end of a fault begins with
_GNSS_USUAL = 3.0  # intervals of fixes: a longer one is a gap
_EDGE_S = np.array([-0.5, 0.5])  # a place passed beside a hole may have been passed closer in it
_OF_ROUNDS = ("slot_along_m", "slot_late_s", "plan_per", "est_per", "true_per", "per_shift")


@dataclass(frozen=True)
class Measured:
    """One round's samples and slots, from which its numbers and the run's are made."""

    record: RoundRecord
    # Its row of `rounds.csv`; `plan_duration_s` of the plan; `slots`, the steps with a scheduled
    # device or the places of a mission, and `slots_missed`; `unready`, the devices that sent
    # nothing, as they still trained.
    numbers: Mapping[str, float]
    truth: Track
    belief: Track
    fit: Alignment  # of the true track to the plan
    pieces: Ints  # (L,) to which leg of the plan, from 1, each piece of its path belongs
    seqs: Ints  # (L + 1,) to which item each point of that leads, -1: none; empty of a round
    leg: Ints  # (n,) on which leg each sample was
    straight: Floats  # (n,) cross-track; NaN near corners
    corner_cut_m: Floats  # by corner; NaN where it was not passed
    height_m: Floats  # (n,) error; NaN where the plan says no height
    speed_mps: Floats  # (n,) over ground
    wind_mps: Floats  # horizontal, at the aircraft
    holes: tuple[Hole, ...]  # what is made of samples in them is NaN
    estimate_m: Floats
    estimate_height_m: Floats
    slot_miss_m: Floats
    slot_along_m: Floats
    slot_late_s: Floats
    plan_per: Floats
    est_per: Floats
    true_per: Floats
    per_shift: Floats  # true - planned

    @property
    def hidden_s(self) -> Floats:
        """(g, 2) begin and end of its holes, in seconds."""
        return np.array([(hole.start_s, hole.end_s) for hole in self.holes]).reshape(-1, 2)

    @property
    def cross_m(self) -> Floats:
        """(n,) horizontal distance (m) of the true track to its planned path; NaN on a return, and
        in holes."""
        return self.fit.cross_m


def measure_pass(run: FlightData, found: "Pass") -> Measured:
    """Measure one pass of a flight through its mission."""
    passed = [item for item in found.passages if not math.isnan(item.t_s)]
    miss = np.array([item.miss_m for item in passed]).reshape(-1, 3)
    hidden = position_gaps(run, *found.span_ns)
    miss[inside(np.array([item.t_s for item in passed]), hidden + _EDGE_S)] = math.nan
    pieces = leg_numbers(found.fit.waypoints_at_m, found.path.seqs[1:] >= 0)
    return _measured(
        run,
        found.record,
        found.track,
        found.fit,
        pieces,
        {
            "plan_duration_s": found.plan.duration_s,
            "slots": len(found.passages),
            "slots_missed": len(found.passages) - len(passed),
            "unready": 0,
        },
        height_m=np.where(found.known_height, found.fit.above_m, math.nan),
        slot_miss_m=np.linalg.norm(miss[:, :2], axis=1),
        hidden=hidden,
        seqs=found.path.seqs,
        **dict.fromkeys(_OF_ROUNDS, np.zeros(0)),
    )


def measure(path: object, run: FlightData, record: RoundRecord, plan: PlanRecord) -> Measured:
    """Measure a round that was flown; raises InputError where the log has no position of it."""
    truth = flown(run, record)
    if not len(truth.t_ns):
        raise InputError(f"{path}: round {record.round}: the log has no position in its time")
    truth, fit = matched(truth, plan.route_m)
    start_ns = round(record.start_t_s * NS_PER_S)
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
    plan_per = np.array([item.plan_per for item in sent])
    true_per = np.array([item.true_per for item in sent])
    return _measured(
        run,
        record,
        truth,
        fit,
        np.arange(1, len(plan.route_m)),
        {
            "plan_duration_s": plan.duration_s,
            "slots": len(slots),
            "slots_missed": len(slots) - len(reached),
            "unready": len(uplinks) - len(sent),
        },
        height_m=truth.pos_m[:, 2] - plan.altitude_m,
        hidden=position_gaps(run, start_ns, start_ns + round(record.duration_s * NS_PER_S)),
        seqs=np.zeros(0, dtype=np.int64),
        slot_along_m=(miss * heading).sum(axis=1),
        slot_miss_m=np.linalg.norm(miss, axis=1),
        slot_late_s=np.array([_late(item, record, plan) for item in reached]),
        plan_per=plan_per,
        est_per=np.array([i.est_per for i in sent if math.isfinite(i.slot_t_s)]),
        true_per=true_per,
        per_shift=true_per - plan_per,
    )


def _measured(
    run: FlightData,
    record: RoundRecord,
    truth: Track,
    fit: Alignment,
    pieces: Ints,
    numbers: Mapping[str, float],
    *,
    height_m: Floats,
    hidden: Floats,
    **arrays: Any,
) -> Measured:
    """Measure a track and the log's events in its time; `numbers`, `arrays` are added as given."""
    xy = truth.pos_m[:, :2]
    start_ns, end_ns = int(truth.t_ns[0]), int(truth.t_ns[-1])
    belief = run.belief.at(truth.t_ns)
    t_s, leg = truth.t_ns / NS_PER_S, pieces[leg_of(fit)]
    known = np.where(inside(t_s, hidden), math.nan, 1.0)  # times what is measured
    fit = replace(fit, cross_m=fit.cross_m * known)
    error = (belief.pos_m - truth.pos_m) * known[:, None]
    if run.source.only is not None:  # of one kind of position nobody knows the error
        error = error[:0]
    velocity = np.gradient(xy, t_s, axis=0) if len(t_s) > 1 else np.zeros((1, 2))
    from_corner = np.abs(fit.along_m[:, None] - fit.corners_m)
    near, following = from_corner <= CORNER_M, np.vstack((xy[1:], xy[-1:]))
    following[inside(np.append((t_s[1:] + t_s[:-1]) / 2, 0.0), hidden)] = math.nan
    reach_m = [
        np.linalg.norm(polyline.to_segments(corner, xy[here], following[here])[0], axis=1)
        for here, corner in zip(near.T, fit.corner_points_m, strict=True)
    ]
    since_ns, until_ns = _span(run, record)
    every = np.unique(np.vstack((hidden, position_gaps(run, since_ns, until_ns))), axis=0)
    return Measured(
        record=record,
        numbers={
            **flat(record),
            **numbers,
            **happened(run, since_ns, until_ns),
            "gap_max_s": float(np.diff(every).max(initial=0.0)),
        },
        truth=truth,
        belief=belief,
        fit=fit,
        pieces=pieces,
        leg=leg,
        straight=np.where(near.any(axis=1), math.nan, fit.cross_m),
        corner_cut_m=np.array([reach.min() if len(reach) else math.nan for reach in reach_m]),
        height_m=height_m * known,
        speed_mps=np.linalg.norm(velocity, axis=1) * known,
        wind_mps=run.wind.across_mps(start_ns, end_ns),
        holes=tuple(holes(run, every, hidden=hidden, number=record.round, track=truth, leg=leg)),
        estimate_m=np.linalg.norm(error[:, :2], axis=1),
        estimate_height_m=error[:, 2],
        **arrays,
    )


def happened(run: FlightData, since_ns: int, until_ns: int) -> dict[str, float]:
    """Count the events, and the gaps of GNSS, of a time."""
    found = [e for e in run.flown_events if since_ns <= e.t_ns < until_ns]
    events = Counter(e.kind for e in found if not e.text.startswith(_FAULT_ENDS))
    gaps_s = np.diff(gnss_gaps(run, since_ns, until_ns))
    return {
        "mode_changes": events["mode"],
        "failsafes": events["failsafe"],
        "faults": events["fault"],
        "gnss_gaps": len(gaps_s) if len(run.gnss_ns) else math.nan,
        "gnss_gap_max_s": float(gaps_s.max(initial=0.0)) if len(run.gnss_ns) else math.nan,
    }


def _span(run: FlightData, record: RoundRecord) -> tuple[int, int]:
    """Return from when to when (ns) what happens counts for a round: up to the next one, since what
    ends it comes after it; the first from arming on, the last up to disarming."""
    starts = [round(other.start_t_s * NS_PER_S) for other in run.rounds]
    at = round(record.start_t_s * NS_PER_S)
    first_ns, last_ns = run.armed_ns[0][0], run.armed_ns[-1][1]
    since_ns = first_ns if at <= min(starts) else at
    return since_ns, min((other for other in starts if other > at), default=last_ns)


def gnss_gaps(run: FlightData, start_ns: int, end_ns: int) -> Floats:
    """Begin and end (g, 2) in seconds of the GNSS outages between two instants, not clipped."""
    last_ns = max([end_ns, *run.gnss_ns[-1:].tolist()])
    every = gaps(run.gnss_ns, (start_ns, end_ns), usual=_GNSS_USUAL, ends_ns=[last_ns])
    return while_armed(run, every)


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
