"""Numbers of rounds and of whole flights of vehicles whose every place is given."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight

from mission.analysis.measure import Measured, measure
from mission.analysis.whole import whole_flight
from mission.base.errors import InputError
from mission.log.records import UNKNOWN_ROUND, TimedUplinkRecord
from mission.log.values import (
    BatteryTrack,
    EventRecord,
    FlightData,
    Modes,
    PlanRecord,
    Track,
    WindTrack,
)

RECORD = replace(UNKNOWN_ROUND, round=2, start_t_s=10.0, duration_s=40.0)
CORNERS = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 200.0]])
PLAN = replace(
    PlanRecord.of_flight(
        2, 10 * 10**9, np.column_stack((CORNERS, np.full(3, 30.0))), slot_s=np.array([0.0, 20, 40])
    ),
    altitude_m=30.0,
)


def uplink(
    step: int, slot_t_s: float, true_m: tuple[float, float], **more: Any
) -> TimedUplinkRecord:
    x, y = CORNERS[step].tolist()
    known: dict[str, Any] = {
        "community": "a", "device": 0, "est_x_m": 0.0, "est_y_m": 0.0, "est_alt_m": 0.0,
        "plan_x_m": x, "plan_y_m": y, "true_x_m": true_m[0], "true_y_m": true_m[1],
        "true_alt_m": 30.0, "plan_per": 0.25, "est_per": 0.5, "true_per": 0.75, "importance": 1.0,
        "delivered": True, "ready_t_s": 0.0, "late": False, "staleness": 0, "upload_s": 0.0,
    }  # fmt: skip
    return TimedUplinkRecord(round=2, step=step, slot_t_s=slot_t_s, **(known | more))


def flight(*, hole_s: tuple[float, float] = (0.0, 0.0), **more: Any) -> FlightData:
    """At 10 m/s along the plan, 3 m to the left of it and 2 m above; it cuts its corner by a line
    from 20 m before to 20 m behind. Believed 3 m east, 4 m south and 12 m too low."""
    t_s = np.arange(5.0, 55.25, 0.25)
    t_s = t_s[(t_s <= hole_s[0]) | (t_s >= hole_s[1])]
    known = (5, 10, 28, 32, 50, 55)
    x = np.interp(t_s, known, (0, 0, 180, 197, 197, 197))
    y = np.interp(t_s, known, (3, 3, 3, 20, 200, 200))
    places = np.column_stack((x, y, 0 * x + 32.0))
    data = bare_flight(t_s, places)
    belief = Track(data.truth.t_ns, places + (3.0, -4.0, -12.0))  # noqa: RUF005  # of arrays
    return replace(data, belief=belief, rounds=(RECORD,), **more)


def measured(**more: Any) -> Measured:
    run = flight(**more)
    return measure("a log", run, RECORD, PLAN)


def test_a_round_is_measured_against_its_plan() -> None:
    of = measured()
    t_s = of.truth.t_ns / 1e9
    first, second = t_s < 27.5, t_s > 32.5
    assert (t_s[0], t_s[-1]) == (10.0, 50.0)
    assert of.cross_m[first | second] == pytest.approx(3.0, abs=1e-6)
    assert of.height_m == pytest.approx(2.0)
    assert of.estimate_m == pytest.approx(5.0)
    assert of.estimate_height_m == pytest.approx(-12.0)
    # The line from (180, 3) to (197, 20) is as far from the corner as from the lines beyond it.
    assert of.corner_cut_m == pytest.approx([abs(200 - 0 - 177) / math.sqrt(2)], abs=0.01)
    straight = np.isfinite(of.straight)
    assert straight[(t_s < 27.4)].all()  # 25 m before the corner
    assert not straight[(t_s > 27.6) & (t_s < 32.4)].any()
    assert straight[t_s > 32.6].all()
    assert of.speed_mps[t_s < 27.0] == pytest.approx(10.0)
    assert of.speed_mps[(t_s > 28.6) & (t_s < 31.4)] == pytest.approx(math.hypot(17, 17) / 4)
    assert of.leg[t_s < 29.9].tolist() == [1] * int((t_s < 29.9).sum())
    assert of.leg[t_s > 30.1].tolist() == [2] * int((t_s > 30.1).sum())
    assert of.fit.above_m == pytest.approx(0.0)
    assert of.hidden_s.shape == (0, 2)
    assert of.numbers["gap_max_s"] == 0.0
    assert of.numbers["plan_duration_s"] == 40.0


def test_slots_count_once_a_step_and_devices_each() -> None:
    sent = (
        uplink(1, 30.5, (197.0, 4.0)), uplink(1, 30.7, (0.0, 0.0), device=1, true_per=0.5),
        uplink(1, 30.5, (0.0, 0.0), device=2, late=True), uplink(2, 49.0, (197.0, 190.0), device=3),
        uplink(0, math.nan, (math.nan, math.nan), device=4, true_per=1.0, est_per=math.nan),
        replace(uplink(2, 1.0, (0.0, 0.0)), round=1),
    )  # fmt: skip
    of = measured(uplinks=sent)
    assert {name: of.numbers[name] for name in ("slots", "slots_missed", "unready")} == {
        "slots": 3, "slots_missed": 1, "unready": 1
    }  # fmt: skip
    # At the corner the path heads north-east, at its end north.
    assert of.slot_miss_m == pytest.approx([5.0, math.hypot(3.0, 10.0)])
    assert of.slot_along_m == pytest.approx([(4.0 - 3.0) / math.sqrt(2), -10.0])
    assert of.slot_late_s == pytest.approx([0.5, -1.0])
    assert of.plan_per.tolist() == [0.25] * 4
    assert of.est_per.tolist() == [0.5] * 3
    assert of.true_per.tolist() == [0.75, 0.5, 0.75, 1.0]
    assert of.per_shift.tolist() == [0.5, 0.25, 0.5, 0.75]


def test_in_a_hole_nothing_is_known() -> None:
    of = measured(hole_s=(35.0, 42.0))
    assert of.hidden_s.tolist() == [[35.0, 42.0]]
    assert of.numbers["gap_max_s"] == 7.0
    (hole,) = of.holes
    assert (hole.number, hole.leg, hole.start_s, hole.end_s) == (2, 2, 35.0, 42.0)
    corner = measured(hole_s=(27.0, 33.0))
    assert np.isnan(corner.corner_cut_m).all()  # all of its neighbourhood is in there
    later = replace(RECORD, start_t_s=99.0)
    with pytest.raises(InputError, match="a log: round 2: the log has no position in its time"):
        measure("a log", flight(), later, PLAN)


def test_a_path_that_turns_back_heads_there_and_a_hover_nowhere() -> None:
    """At its farthest point on the way out; where all points are one, no miss is along."""
    there = np.array([[0.0, 0.0], [200.0, 0.0], [0.0, 0.0]])
    back = replace(PLAN, waypoints_m=there, route_m=there)
    sent = (uplink(1, 30.0, (196.0, 3.0)), uplink(2, 50.0, (-4.0, 203.0)))
    of = measure("a log", flight(uplinks=sent), RECORD, back)
    assert of.slot_along_m == pytest.approx([-4.0, 204.0])
    still = replace(PLAN, waypoints_m=0 * there, route_m=0 * there)
    of = measure("a log", flight(uplinks=sent), RECORD, still)
    assert of.slot_along_m == pytest.approx([0.0, 0.0])
    assert of.slot_miss_m == pytest.approx([5.0, math.hypot(204.0, 3.0)])


def test_a_place_where_it_hovers_heads_from_the_one_before_to_the_one_behind() -> None:
    there = np.array([[-50.0, 90], [0, 0], [200, 0], [200, 0], [200, 200], [900, 300.0]])
    plan = replace(
        PLAN, waypoints_m=there, route_m=there, slot_s=np.zeros(6), stops_at=np.arange(6)
    )
    sent = tuple(
        replace(uplink(1, 30.0, (204.0, 0.0)), step=step, plan_x_m=200.0, plan_y_m=0.0)
        for step in (2, 3)
    )
    of = measure("a log", flight(uplinks=sent), RECORD, plan)
    assert of.slot_along_m == pytest.approx([4.0 / math.sqrt(2)] * 2)


def test_what_happens_between_two_rounds_is_of_the_first_one() -> None:
    """The first has what is before it, too, and the last what is behind it."""
    here = (0.0, 0.0, 0.0)
    told = tuple(EventRecord(round(t * 1e9), "mode", "x", None, 6, here, here)
                 for t in (6.0, 29.9, 30.0, 39.0, 45.0, 54.0))  # fmt: skip
    rounds = tuple(
        replace(RECORD, round=n, start_t_s=at_s, duration_s=8.0)
        for n, at_s in ((1, 10.0), (2, 30.0), (3, 40.0))
    )
    run = replace(flight(events=told), rounds=rounds)
    found = [measure("a log", run, record, PLAN).numbers["mode_changes"] for record in rounds]
    assert found == [2, 2, 2]
    # A hole between rounds is one of the first, and hides nothing that was flown in it.
    holed = replace(flight(hole_s=(20.0, 28.0), events=told), rounds=rounds)
    first, second, _ = (measure("a log", holed, record, PLAN) for record in rounds)
    assert (first.numbers["gap_max_s"], second.numbers["gap_max_s"]) == (8.0, 0.0)
    assert [hole.leg for hole in first.holes] == [None]
    assert first.hidden_s.tolist() == [[20.0, 28.0]]
    assert np.isfinite(first.cross_m).all()


def whole(data: FlightData) -> dict[str, Any]:
    loaded: Any = SimpleNamespace(path="a log", data=data)
    return whole_flight(loaded, [])[1]


def test_a_flight_without_a_plan_has_its_numbers() -> None:
    """Up from 5 s on, 100 m to the east at 5 m/s, and down; the wind is of 3 and 4 m/s."""
    t_s = np.arange(0.0, 40.1, 0.1)
    x = np.interp(t_s, (10, 30), (0, 100))
    up = np.interp(t_s, (5, 10, 30, 35), (0, 20, 20, 0))
    data = bare_flight(t_s, np.column_stack((x, 0 * x, up)))
    t_ns = data.truth.t_ns
    here = (0.0, 0.0, 0.0)
    told = [(4.0, "armed", "armed"), (20.0, "failsafe", "low"), (38.0, "armed", "disarmed")]
    data = replace(
        data,
        belief=Track(t_ns, data.truth.pos_m + np.array([3.0, 4.0, 12.0])),
        events=tuple(
            EventRecord(round(at * 1e9), kind, text, None, 6, here, here) for at, kind, text in told
        ),
        modes=Modes(np.zeros(1, dtype=np.int64), ("HOLD",)),
        wind=WindTrack(t_ns, np.tile([0.0, 3.0, 9.0], (401, 1)) + np.eye(3)[0] * 4.0),
        battery=BatteryTrack(t_ns, np.full(401, 20.0), np.full(401, 6.0), np.arange(401) / 3.6,
                             np.linspace(1.0, 0.6, 401)),
    )  # fmt: skip
    found = whole(data)
    assert found["flown_path_m"] == pytest.approx(100.0)
    # From the last second in which it stands before it leaves until it is disarmed.
    assert found["duration_s"] == pytest.approx(38.0 - 4.0, abs=0.11)
    assert found["speed_max_mps"] == pytest.approx(5.0)
    assert (found["estimate_rms_m"], found["estimate_max_m"]) == pytest.approx((5.0, 5.0))
    assert (found["wind_mean_mps"], found["wind_max_mps"]) == pytest.approx((5.0, 5.0))
    assert found["failsafes"] == 1
    assert found["gap_max_s"] == 0.0
    # A coulomb at 20 V each tenth of a second.
    assert found["energy_j"] == pytest.approx(20.0 * 10 * found["duration_s"], rel=0.01)
    assert found["battery_remaining"] == pytest.approx(0.62, abs=0.002)
    # Of a hole nobody knows on which leg it is, but in which mode.
    known = (t_s <= 15.0) | (t_s >= 22.0)
    holed = replace(data, truth=data.truth.at(t_ns[known]))
    loaded: Any = SimpleNamespace(path="a log", data=holed)
    errors, found = whole_flight(loaded, [])
    (hole,) = errors.holes
    assert (hole.number, hole.leg, hole.mode) == (1, None, "HOLD")
    assert (hole.start_s, hole.end_s, found["gap_max_s"]) == (15.0, 22.0, 7.0)
    with pytest.raises(InputError, match="the log has no positions, so there is nothing"):
        whole(replace(data, truth=data.truth.between(0, 0)))
    with pytest.raises(InputError, match="it never left the ground"):
        whole(replace(data, truth=Track(t_ns, 0 * data.truth.pos_m)))
