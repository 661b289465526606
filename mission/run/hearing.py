"""What is heard in a part of a round that was flown: uplinks, and pilot tones."""

from dataclasses import replace

import numpy as np

from fl.federation.device_work import DeviceWork
from fl.radio.learned import Heard
from mission.flight.missions.round_mission import FlightPlan
from mission.log.records import UplinkRecord
from mission.run.gate import slots, turns, uplinks
from mission.run.outing import Outing
from mission.scenario.scenario import Scenario

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
