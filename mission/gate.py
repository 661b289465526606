"""The radio meets the truth: which scheduled updates arrive, given where the aircraft was."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fl.radio import Channel, average_per
from mission.area import Area
from mission.flightplan import FlightPlan
from mission.planner.problem import RoundPlan, RoundProblem
from mission.records import UplinkRecord
from mission.track import Flight, Passage

Floats = NDArray[np.float64]


def slots(plan: FlightPlan, flight: Flight, *, seq_of_stop: Sequence[int]) -> dict[int, Passage]:
    """The passage of every time step that was reached, by 0-based step.

    A step transmits when its stop is passed. Several steps at one stop share that instant, or
    the stop's hover where it has one: evenly spread, the first at the arrival.
    """
    passages: dict[int, Passage] = {}
    for stop, seq in zip(plan.stops, seq_of_stop, strict=True):
        arrival = flight.reached.get(seq)
        if arrival is None:
            continue
        for rank, step in enumerate(stop.steps):
            if stop.hold_s == 0.0 or rank == 0:
                passages[step] = arrival
                continue
            instant = arrival.t_ns + round(1e9 * stop.hold_s * rank / len(stop.steps))
            if instant <= flight.t_ns[-1]:
                passages[step] = flight.at(instant)
    return passages


def uplinks(
    round_index: int,
    problem: RoundProblem,
    plan: RoundPlan,
    passages: dict[int, Passage],
    *,
    area: Area,
    community_of: Sequence[str],
    stream: Callable[[str], np.random.Generator],
) -> tuple[UplinkRecord, ...]:
    """One record per scheduled device, in order of step and device.

    An update arrives with probability 1 - PER at the true position. Every device has a stream of
    its own in every round, so that one device's fate does not depend on who else is scheduled.
    """
    records = []
    for step, device in np.argwhere(plan.schedule):
        where = plan.waypoints_m[step]
        ground = problem.devices_m[device]
        passage = passages.get(int(step))
        if passage is None:
            t_s = est_per = math.nan
            true_per = 1.0
            est = true = (math.nan, math.nan, math.nan)
        else:
            t_s = passage.t_ns / 1e9
            est, true = _place(area, passage.est_ned_m), _place(area, passage.true_ned_m)
            est_per, true_per = (_per(problem.channel, ground, at) for at in (est, true))
        draw = stream(f"uplink/{round_index}/{device}").random()
        records.append(
            UplinkRecord(
                round=round_index,
                device=int(device),
                community=community_of[device],
                step=int(step),
                slot_t_s=t_s,
                plan_x_m=float(where[0]),
                plan_y_m=float(where[1]),
                est_x_m=est[0],
                est_y_m=est[1],
                est_alt_m=est[2],
                true_x_m=true[0],
                true_y_m=true[1],
                true_alt_m=true[2],
                plan_per=_per(problem.channel, ground, (*where, problem.channel.altitude_m)),
                est_per=est_per,
                true_per=true_per,
                importance=float(problem.importance[device]),
                delivered=bool(draw >= true_per),
            )
        )
    return tuple(records)


def _place(area: Area, pos_ned_m: Floats) -> tuple[float, float, float]:
    x, y = area.from_ned(pos_ned_m)
    return float(x), float(y), -float(pos_ned_m[2])


def _per(channel: Channel, device_m: Floats, at: tuple[float, float, float]) -> float:
    horizontal = math.hypot(at[0] - device_m[0], at[1] - device_m[1])
    return float(average_per(channel, horizontal, height_m=at[2]))
