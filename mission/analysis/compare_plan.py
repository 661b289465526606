"""Planned against flown for a plan file: one `aerofed fly` read back from its folder or log."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated

import numpy as np

from mission.analysis.alignment import align
from mission.analysis.compare import Label
from mission.analysis.load import LoadedRun
from mission.base import polyline
from mission.base.errors import InputError
from mission.log.records import UNKNOWN_ROUND, RoundRecord
from mission.log.values import NS_PER_S, EventRecord, FlightData, Floats, PlanRecord

KEY = "planned_and_flown"  # of the summary
METADATA = "plan flight"  # of the log, by which it is known
_NAN = math.nan


@dataclass(frozen=True)
class PlannedAndFlown:
    """How a flight was against its plan, up to its last place; metres, simulated seconds.

    A flight that did not get there is measured as far as it came.
    """

    plan_path_m: Annotated[float, Label("planned path (m)", 1)]  # horizontal
    flown_path_m: Annotated[float, Label("flown path (m)", 1)]
    plan_duration_s: Annotated[float, Label("duration planned (s)", 1)]  # always at planned speed
    flown_duration_s: Annotated[float, Label("duration flown (s)", 1)]
    # Horizontal distance of the true track to the planned line.
    cross_track_rms_m: Annotated[float, Label("cross-track rms (m)", 3)]
    cross_track_max_m: Annotated[float, Label("cross-track max (m)", 3)]
    places: Annotated[int, Label("places", 0)]
    places_reached: Annotated[int, Label("places reached", 0)]
    # Horizontal distance to a place on the instant it was passed, and vertical.
    miss_max_m: Annotated[float, Label("place missed by, max (m)", 3)]
    height_error_max_m: Annotated[float, Label("height error max (m)", 3)]
    # Horizontal distance of belief to truth.
    estimate_rms_m: Annotated[float, Label("estimate error rms (m)", 3)]
    # 0..1 of the capacity at the end of the log.
    battery_remaining: Annotated[float, Label("battery left (0..1)", 3)]

    def lines(self) -> list[str]:
        """The numbers in words, a line each."""
        passed = (
            f", passed within {self.miss_max_m:.2f} m and {self.height_error_max_m:.2f} m in height"
            if self.places_reached
            else ""
        )
        return [
            f"path      planned {self.plan_path_m:.0f} m, flown {self.flown_path_m:.0f} m",
            f"duration  at planned speed {self.plan_duration_s:.1f} s, "
            f"flown {self.flown_duration_s:.1f} s",
            f"cross-track error  rms {self.cross_track_rms_m:.2f} m, "
            f"max {self.cross_track_max_m:.2f} m",
            f"places    {self.places_reached}/{self.places} reached{passed}",
            f"estimate  {self.estimate_rms_m:.2f} m rms from the truth",
            f"battery   {100 * self.battery_remaining:.0f} % left",
        ]


@dataclass(frozen=True)
class PlanFlight:
    """One flight of a plan file. `data` has it as one round that serves nobody."""

    run: LoadedRun
    data: FlightData
    plan: PlanRecord
    source: str  # name of the plan file
    places_m: Mapping[int, Floats]  # (3,) x east, y north, height; by number of the item
    rally_m: tuple[Floats, ...]  # (3,) each: where a return might have led beside home
    reached: Mapping[int, EventRecord]  # the first passage of each place that was reached
    numbers: PlannedAndFlown

    @property
    def about(self) -> str:
        """Which flight, plan and seed it is: a line for pictures."""
        return f"{self.run.told('seed')} · plan file {self.source}"

    @property
    def record(self) -> RoundRecord:
        """The flight as a round, from its start to its last place or as far as it came."""
        return self.data.rounds[0]


def flight_metadata(
    source: str, places_m: Mapping[int, Floats], rally_m: Sequence[Floats], *, duration_s: float
) -> dict[str, str]:
    """What the log has to hold beside the plan's path; see `PlanFlight`."""
    values = {
        "plan": source,
        "duration_s": repr(float(duration_s)),
        "places_m": json.dumps({str(seq): place.tolist() for seq, place in places_m.items()}),
    }
    if rally_m:
        values["rally_m"] = json.dumps([place.tolist() for place in rally_m])
    return values


def plain_numbers(numbers: PlannedAndFlown) -> dict[str, float | None]:
    """The numbers for JSON, NaN as None."""
    return {key: None if math.isnan(value) else value for key, value in asdict(numbers).items()}


def is_plan_flight(run: LoadedRun) -> bool:
    """Whether `aerofed fly` left it."""
    return METADATA in run.data.metadata


def was_flown(run: LoadedRun) -> bool:
    """Whether the vehicle got as far as its mission."""
    plans, last_ns = run.data.plans, _last_ns(run.data)
    return bool(plans) and len(run.data.truth.between(plans[0].t_ns, last_ns).t_ns) > 0


def plan_flight(run: LoadedRun) -> PlanFlight:
    """Planned against flown, from the start of the mission to its last place.

    Raises:
        InputError: the vehicle never got as far as its mission.
    """
    told, data = run.data.metadata[METADATA], run.data
    if not was_flown(run):
        why = f": {run.state}" if run.state else ""
        raise InputError(f"{run.path}: nothing was flown{why}")
    plan = data.plans[0]
    places_m = {
        int(seq): np.array(place, dtype=np.float64)
        for seq, place in json.loads(told["places_m"]).items()
    }
    passed: dict[int, EventRecord] = {}
    for event in data.events:
        if event.kind == "reached" and event.seq is not None and event.seq in places_m:
            passed.setdefault(event.seq, event)
    last = passed.get(max(places_m))
    end_ns = last.t_ns if last is not None else _last_ns(data)
    truth, belief = (track.between(plan.t_ns, end_ns) for track in (data.truth, data.belief))
    cross_m = align(truth.pos_m[:, :2], plan.route_m).cross_m
    error_m = np.linalg.norm((belief.pos_m - truth.pos_m)[:, :2], axis=1)
    misses_m = [np.array(event.true_m) - places_m[seq] for seq, event in passed.items()]
    battery = data.battery.remaining
    numbers = PlannedAndFlown(
        plan_path_m=plan.path_m,
        flown_path_m=polyline.length(truth.pos_m[:, :2]),
        plan_duration_s=float(told["duration_s"]),
        flown_duration_s=(end_ns - plan.t_ns) / NS_PER_S,
        cross_track_rms_m=_rms(cross_m),
        cross_track_max_m=float(cross_m.max()),
        places=len(places_m),
        places_reached=len(passed),
        miss_max_m=max((float(np.linalg.norm(miss[:2])) for miss in misses_m), default=_NAN),
        height_error_max_m=max((abs(float(miss[2])) for miss in misses_m), default=_NAN),
        estimate_rms_m=_rms(error_m),
        battery_remaining=float(battery[-1]) if len(battery) else _NAN,
    )
    as_round = _as_round(plan, numbers)
    return PlanFlight(
        run,
        replace(data, plans=(plan,), rounds=(as_round,)),
        plan,
        told["plan"],
        places_m,
        tuple(np.array(place, dtype=np.float64) for place in json.loads(told.get("rally_m", "[]"))),
        passed,
        numbers,
    )


def _last_ns(data: FlightData) -> int:
    return int(data.truth.t_ns[-1]) if len(data.truth.t_ns) else 0


def _as_round(plan: PlanRecord, numbers: PlannedAndFlown) -> RoundRecord:
    return replace(
        UNKNOWN_ROUND,
        round=plan.round,
        start_t_s=plan.t_ns / NS_PER_S,
        duration_s=numbers.flown_duration_s,
        plan_path_m=numbers.plan_path_m,
        flown_path_m=numbers.flown_path_m,
        budget_used_m=numbers.flown_path_m,
        battery_remaining=numbers.battery_remaining,
    )


def _rms(values: Floats) -> float:
    return math.sqrt(float((values**2).mean()))
