"""Which scheduled updates arrive, given where the aircraft truly was; and pilot tones heard."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from fl.federation.device_work import DeviceWork
from fl.radio.learned import Heard
from fl.radio.place import Radio
from fl.radio.uplink import Gate, deliver
from mission.base.area import Area
from mission.base.arrays import Bools
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlownTrack, TrackPoint
from mission.log.records import TimedUplinkRecord, UplinkRecord
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.run.outing import Outing
from mission.scenario.scenario import Scenario


def slots(plan: FlightPlan, flight: FlownTrack) -> dict[int, TrackPoint]:
    """The passage of every time step that was reached, by 0-based step.

    A step transmits when its stop is passed. Several steps at one stop share that instant, or
    the stop's hover where it has one: one after another, the first at the arrival.
    """
    passages: dict[int, TrackPoint] = {}
    for stop, arrival in zip(plan.stops, flight.passages, strict=True):
        if arrival is None:
            continue
        for step, begin_s in zip(stop.steps, stop.slots_s, strict=True):
            passage = _after(arrival, begin_s, flight)
            if passage is not None:
                passages[step] = passage
    return passages


def turns(
    problem: RoundProblem, plan: RoundPlan, passages: Mapping[int, TrackPoint], flight: FlownTrack
) -> dict[int, TrackPoint]:
    """Return where the aircraft is as each scheduled device begins to send, by device.

    The devices of a step, whose `passages` are given, send one after another, in their order.
    Devices whose turn never came are left out.
    """
    found: dict[int, TrackPoint] = {}
    for step, arrival in passages.items():
        begin_s = 0.0
        for device in np.flatnonzero(plan.schedule[0, step]).tolist():
            passage = _after(arrival, begin_s, flight)
            if passage is not None:
                found[device] = passage
            begin_s += _upload_s(problem, device)
    return found


def _upload_s(problem: RoundProblem, device: int) -> float:
    return 0.0 if problem.upload_s is None else float(problem.upload_s[device])


def _after(arrival: TrackPoint, seconds: float, flight: FlownTrack) -> TrackPoint | None:
    """Where the aircraft is some time after an instant; None where the flight is over."""
    if seconds == 0.0:
        return arrival
    instant = arrival.t_ns + round(1e9 * seconds)
    return flight.at(instant) if instant <= flight.t_ns[-1] else None


def uplinks(
    round_number: int,
    problem: RoundProblem,
    plan: RoundPlan,
    passages: Mapping[int, TrackPoint],
    *,
    area: Area,
    community_of: Sequence[str],
    radio: Radio,
    rng: np.random.Generator,
    gate: Gate = "average",
    work: DeviceWork | None = None,
    aircraft: str = "",
) -> tuple[UplinkRecord, ...]:
    """Return a record per device that an aircraft serves, in order of step and device; `passages`
    by device, `aircraft` its name where there are several.

    Updates are drawn at the true positions, where `radio` gives the rates; planned and believed
    rates are those of the problem's radio. `rng` is this round's own stream. `work` says when
    devices are ready, where training takes time: late ones send nothing.
    """
    count = len(problem.devices_m)
    true_m = np.full((count, 3), math.nan)
    late, sends = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for device, passed in passages.items():
        true_m[device] = area.xyz(passed.true_ned_m)
        late[device] = work is not None and passed.t_ns < work.ready_ns[device]
        sends[device] = not late[device]
    arrivals = deliver(radio, true_m, transmitted=sends, rng=rng, gate=gate)
    channel, belief = problem.channel, problem.radio

    records = []
    for step, device in np.argwhere(plan.schedule[0]).tolist():
        passage = passages.get(device)
        where = plan.waypoints_m[step]
        t_s = est_per = math.nan
        est, true = (math.nan, math.nan, math.nan), true_m[device].tolist()
        if passage is not None:
            t_s = passage.t_ns / 1e9
            est = tuple(area.xyz(passage.est_ned_m).tolist())
            est_per = 1.0 if late[device] else _per(belief, device, est)
        record = UplinkRecord(
            round=round_number,
            device=device,
            community=community_of[device],
            step=step,
            slot_t_s=t_s,
            plan_x_m=float(where[0]),
            plan_y_m=float(where[1]),
            est_x_m=est[0],
            est_y_m=est[1],
            est_alt_m=est[2],
            true_x_m=true[0],
            true_y_m=true[1],
            true_alt_m=true[2],
            plan_per=_per(belief, device, (*where, channel.altitude_m)),
            est_per=est_per,
            true_per=float(arrivals.per[device]),
            importance=float(problem.importance[device]),
            delivered=bool(arrivals.delivered[device]),
            aircraft=aircraft,
        )
        if work is not None:
            record = _timed(record, work, late=late, upload_s=_upload_s(problem, device))
        records.append(record)
    return tuple(records)


def _timed(
    record: UplinkRecord, work: DeviceWork, *, late: Bools, upload_s: float
) -> TimedUplinkRecord:
    return TimedUplinkRecord(
        **asdict(record),
        ready_t_s=int(work.ready_ns[record.device]) / 1e9,
        late=bool(late[record.device]),
        staleness=record.round - int(work.begun[record.device]),
        upload_s=upload_s,
    )


def _per(radio: Radio, device: int, at_m: Sequence[float]) -> float:
    return float(np.asarray(radio.per(np.array([device]), np.array([at_m])))[0])


PILOTS_NS = 1_000_000_000  # between two pilot tones


def served_in(
    one: Outing, part: FlightPlan, scenario: Scenario, number: int, work: DeviceWork
) -> list[UplinkRecord]:
    """Return the uplinks of the devices that the last flown part of an outing of a round serves.

    A device that is served again in a round gets a random stream of its own each time. Each
    device's luck is its own, whoever serves it.
    """
    course = one.course
    here = np.zeros((course.problem.steps, 1), dtype=bool)
    here[[step for stop in part.stops for step in stop.steps]] = True
    plan = replace(course.plan, schedule=course.plan.schedule & here)
    flight = one.flights[-1]
    passages = turns(course.problem, plan, slots(part, flight), flight)
    devices = [record.device for record in one.served]
    before = np.bincount(devices, minlength=len(scenario.devices_m))
    records: list[UplinkRecord] = []
    for times in np.unique(before[plan.schedule.any(axis=(0, 1))]).tolist():
        again = f"/{times}" if times else ""
        records += uplinks(
            number,
            course.problem,
            replace(plan, schedule=plan.schedule & (before == times)),
            passages,
            area=one.aircraft.area,
            community_of=scenario.community_of,
            radio=scenario.radio,
            gate=scenario.config.channel.gate,
            rng=scenario.streams.generator(f"uplink/{number}{again}"),
            work=work if scenario.device_times else None,
            aircraft=one.aircraft.name if len(scenario.fleet) > 1 else "",
        )
    return sorted(records, key=lambda record: (record.step, record.device))


def listened(heard: Heard, one: Outing, scenario: Scenario, number: int) -> Heard:
    """Hear pilot tones of the last part of a round, once a second, where a radio belief is learned.

    What one aircraft hears all believe from then on, by way of the server.
    """
    listener = scenario.listener
    if listener is None:
        return heard
    flight, part, plan = one.flights[-1], len(one.flights), one.course.plan
    instants = range(int(flight.t_ns[0]), int(flight.t_ns[-1]) + 1, PILOTS_NS)
    area, passages = one.aircraft.area, [flight.at(t_ns) for t_ns in instants]
    of = f"/{one.number}" if one.number else ""
    rng = scenario.streams.generator(f"pilots/{number}/{part}{of}")
    est_m = np.array([area.xyz(passage.est_ned_m) for passage in passages])
    true_m = np.array([area.xyz(passage.true_ned_m) for passage in passages])
    every = scenario.config.radio.pilots != "scheduled"
    devices = np.asarray(plan.schedule.any(axis=(0, 1)) | every, dtype=bool)
    return listener.hear(heard, est_m, true_m, devices, rng)
