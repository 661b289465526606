"""Slots and uplinks: the instants and positions that count, and who gets through."""

import math
from dataclasses import replace

import numpy as np
import pytest
from one_aircraft import one_path, round_problem

from fl.federation.device_work import DeviceWork
from fl.radio.channel import CHANNEL_PRESETS, average_per
from fl.radio.place import AverageRadio
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlownTrack, TrackPoint
from mission.log.records import TimedUplinkRecord, UplinkRecord
from mission.planner.flyable import Stop, stops_of
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from mission.run.gate import slots, uplinks

CHANNEL = CHANNEL_PRESETS["suburban"]
AREA = Area.at((800.0, 800.0), (400.0, 100.0), GeodeticPoint(43.6, 7.07, 100.0))


def passage(t_s: float, true_xy: tuple[float, float], est_xy: tuple[float, float]) -> TrackPoint:
    return TrackPoint(
        round(t_s * 1e9),
        AREA.to_ned(np.array(true_xy), 60.5),
        AREA.to_ned(np.array(est_xy), 60.0),
    )


def flight(*passages: TrackPoint | None) -> FlownTrack:
    """From x = 400 at t = 0 to x = 500 at t = 10 s, the estimate 1 m north of the truth."""
    ends = [
        passage(0.0, (400.0, 100.0), (400.0, 101.0)),
        passage(10.0, (500.0, 100.0), (500.0, 101.0)),
    ]
    return FlownTrack(
        np.array([p.t_ns for p in ends]),
        np.array([p.true_ned_m for p in ends]),
        np.array([p.est_ned_m for p in ends]),
        0.9,
        passages,
    )


def problem(devices: list[list[float]]) -> RoundProblem:
    return round_problem(
        np.array(devices), np.ones(len(devices)), np.array([400.0, 100.0]), 3, 2, 800.0, CHANNEL
    )


def served(
    given: RoundProblem, plan: RoundPlan, seen: dict[int, TrackPoint], rng: np.random.Generator
) -> tuple[UplinkRecord, ...]:
    names = ["a"] * len(given.devices_m)
    radio = AverageRadio(CHANNEL, given.devices_m)
    return uplinks(0, given, plan, seen, area=AREA, community_of=names, radio=radio, rng=rng)


def test_waypoints_that_coincide_become_one_stop() -> None:
    path = np.array([[0.0, 0], [0.3, 0], [100, 0], [100, 0.2], [100, 5], [0, 0]])
    stops = stops_of(one_path(path, np.zeros((6, 1), bool), 0.0), hold_s=2.0)
    assert [s.steps for s in stops] == [(0, 1), (2, 3), (4,), (5,)]
    assert [s.hold_s for s in stops] == [0.0, 2.0, 2.0, 2.0]


def test_a_slot_that_is_never_reached_transmits_nothing() -> None:
    plan = FlightPlan(
        (Stop(np.zeros(2), (0,), slots_s=(0.0,)), Stop(np.ones(2), (1, 2), slots_s=(0.0, 0.0))),
        60.0,
        20.0,
        5.0,
    )
    start = passage(0.0, (400.0, 100.0), (400.0, 101.0))
    assert slots(plan, flight(start, None)) == {0: start}


def test_slots_of_a_hover_are_spread_over_it() -> None:
    plan = FlightPlan(
        (Stop(np.zeros(2), (0, 1, 2, 3), 8.0, (0.0, 2.0, 4.0, 6.0)),), 60.0, 20.0, 5.0
    )
    there = passage(0.0, (400.0, 100.0), (400.0, 101.0))
    found = slots(plan, flight(there))
    assert [p.t_ns for p in found.values()] == [0, 2_000_000_000, 4_000_000_000, 6_000_000_000]
    np.testing.assert_allclose(AREA.from_ned(found[2].true_ned_m), [440.0, 100.0])


def test_per_is_taken_at_plan_belief_and_truth() -> None:
    given = problem([[500.0, 250.0]])
    plan = one_path(np.array([[400.0, 100], [450, 100], [500, 100]]), np.zeros((3, 1), bool), 0.0)
    plan.schedule[0, 2, 0] = True
    seen = {0: passage(9.0, (490.0, 100.0), (490.0, 101.0))}
    (record,) = served(given, plan, seen, Fixed(0.5))
    assert (record.step, record.slot_t_s) == (2, 9.0)
    assert record.plan_per == pytest.approx(float(average_per(CHANNEL, 150.0)))
    assert record.est_per == pytest.approx(
        float(average_per(CHANNEL, math.hypot(10, 149), height_m=60.0))
    )
    assert record.true_per == pytest.approx(
        float(average_per(CHANNEL, math.hypot(10, 150), height_m=60.5))
    )


class Fixed(np.random.Generator):
    """Draws one number for ever."""

    def __init__(self, value: float) -> None:
        super().__init__(np.random.PCG64(0))
        self.value = value

    def random(self, size: int) -> np.ndarray:  # type: ignore[override]
        return np.full(size, self.value)


def test_an_update_arrives_when_the_draw_is_not_below_the_true_per() -> None:
    given = problem([[520.0, 270.0]])
    plan = one_path(np.tile([400.0, 100.0], (3, 1)), np.array([[True], [False], [False]]), 0.0)
    seen = {0: passage(0.0, (400.0, 100.0), (520.0, 270.0))}
    per = float(average_per(CHANNEL, math.hypot(120, 170), height_m=60.5))
    assert 0.01 < per < 0.99
    for draw, arrives in ((per - 1e-6, False), (per + 1e-6, True)):
        (record,) = served(given, plan, seen, Fixed(draw))
        assert record.delivered is arrives


def test_a_device_s_fate_does_not_depend_on_who_else_is_scheduled() -> None:
    given = problem([[520.0, 270.0], [510.0, 260.0]])
    there = passage(0.0, (400.0, 100.0), (400.0, 100.0))
    fates: list[list[bool]] = [[], []]
    for fate, schedule in zip(fates, ([[True, True]], [[False, True]]), strict=True):
        plan = one_path(np.array([[400.0, 100.0]]), np.array(schedule), 0.0)
        seen = {device: there for device, sends in enumerate(schedule[0]) if sends}
        for m in range(40):
            rng = RandomStreams(3).generator(f"uplink/{m}")
            records = served(given, plan, seen, rng)
            fate += [record.delivered for record in records if record.device == 1]
    assert fates[0] == fates[1]
    assert 0 < sum(fates[0]) < 40


def test_who_takes_time_is_told_when_it_was_ready_and_what_it_began_with() -> None:
    given = replace(problem([[520.0, 270.0], [410.0, 110.0]]), upload_s=np.array([0.5, 2.0]))
    plan = one_path(np.array([[400.0, 100.0]]), np.array([[True, True]]), 0.0)
    there = passage(7.0, (400.0, 100.0), (400.0, 101.0))
    work = DeviceWork(
        compute_s=np.zeros(2), goes_on=True, begun=np.array([2, 5]),
        ready_ns=np.array([7_000_000_001, 7_000_000_000]), owed=np.zeros(2, bool),
    )  # fmt: skip
    late, ready = uplinks(
        5, given, plan, {0: there, 1: there}, area=AREA, community_of=["a", "b"],
        radio=AverageRadio(CHANNEL, given.devices_m), rng=Fixed(0.5), work=work,
    )  # fmt: skip
    assert isinstance(late, TimedUplinkRecord)
    assert isinstance(ready, TimedUplinkRecord)
    assert (late.ready_t_s, late.staleness, late.upload_s) == (7.000000001, 3, 0.5)
    assert (late.late, late.est_per, late.true_per, late.delivered) == (True, 1.0, 1.0, False)
    assert (ready.ready_t_s, ready.staleness, ready.upload_s) == (7.0, 0, 2.0)
    assert (ready.late, ready.delivered) == (False, True)
    assert ready.true_per < 0.01
    assert (late.community, ready.community) == ("a", "b")


def test_never_reached_is_lost_with_certainty() -> None:
    given = problem([[400.0, 100.0]])
    plan = one_path(np.array([[400.0, 100.0]]), np.array([[True]]), 1.0)
    (record,) = served(given, plan, {}, Fixed(0.999999))
    assert (record.true_per, record.delivered) == (1.0, False)
    assert np.isnan([record.slot_t_s, record.est_x_m, record.est_alt_m, record.true_y_m]).all()
    assert math.isnan(record.est_per)
