"""What aircraft have done in a round, how near they came, and what is recorded of a track."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flightdyn.state import BatteryState, GeodeticPoint, Kinematics
from mission.base.area import Area
from mission.flight.track import (
    FlightRecorder,
    FlownTrack,
    TrackPoint,
    passages,
    reported_in_turn,
)
from mission.log.records import UNKNOWN_ROUND
from mission.run.apart import pairs_of, row, told
from mission.run.outing import Outing, round_record, success
from sitl.observer import VehicleEvent, VehicleSample

NAN = math.nan
S = 1_000_000_000
HOME = GeodeticPoint(47.0, 8.0, 500.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME)


def track(
    *rows: tuple[float, float, float], up_m: float = 20.0, energy_j: float = NAN, left: float = 0.5
) -> FlownTrack:
    """Rows: seconds, north and east in metres."""
    t_s, north, east = np.array(rows).T
    ned = np.column_stack((north, east, np.full(len(rows), -up_m)))
    return FlownTrack((t_s * S).astype(np.int64), ned, ned + 1.0, left, (), energy_j)


class Performance:
    """Flies to its last point at 5 m/s, and stays there."""

    def follow(
        self, points_m: Any, holds_s: Any, radius_m: float, *, step_s: float, count: int
    ) -> Any:
        assert (holds_s, radius_m) == ([0.0, 0.0], 3.0)
        away = points_m[-1] - points_m[0]
        along = np.clip(np.arange(count) * step_s * 5.0 / np.linalg.norm(away), 0.0, 1.0)
        return points_m[0] + along[:, None] * away


def part(*points: tuple[float, float]) -> Any:
    stop = SimpleNamespace(hold_s=0.0)
    return SimpleNamespace(
        points_m=np.array(points), stops=[stop] * len(points), acceptance_m=3.0, alt_rel_m=20.0
    )


def outing(name: str, flights: list[FlownTrack], parts: list[Any], **more: Any) -> Any:
    """An aircraft of one area, whose home is at 100, 50."""
    return SimpleNamespace(
        aircraft=SimpleNamespace(name=name, area=AREA),
        flyer=SimpleNamespace(performance=Performance()),
        flights=flights, told=parts, flight=FlownTrack.joined(flights),
        **{"served": [], "idle_s": 0.0, "lost": False, **more},
    )  # fmt: skip


def served(device: int, delivered: bool) -> Any:
    return SimpleNamespace(device=device, delivered=delivered)


def crossing() -> list[Any]:
    """One flies east along y = 50 at 10 m/s from 10 s on; the other stands at 160, 58, in flight
    from 12 s on. By plan the first flies at 5 m/s, and the other stands at 170, 50."""
    first = outing(
        "east", [track((10, 0, 0), (20, 0, 100), energy_j=2340.0)],
        [part((100.0, 50.0), (200.0, 50.0))],
        served=[served(1, True), served(1, False), served(2, False)], idle_s=4.0,
    )  # fmt: skip
    second = outing(
        "still", [track((12, 8, 60), (21, 8, 60))], [part((170.0, 50.0), (170.1, 50.0))],
        served=[served(3, True)], idle_s=NAN, lost=True,
    )  # fmt: skip
    return [first, second]


def test_two_are_as_near_as_straight_lines_between_their_samples() -> None:
    (pair,) = pairs_of(crossing(), leaving_m=None)
    assert pair.names == ("east", "still")
    assert (pair.flown.away_m, pair.flown.t_s) == pytest.approx((8.0, 16.0))
    # At 21.05 s, a step past the end, it has flown 55.25 m of the 70.1 by plan.
    assert pair.planned.away_m == pytest.approx(14.85, abs=0.01)
    assert pair.planned.t_s == pytest.approx(21.05, abs=0.01)
    assert math.isinf(pair.parting.away_m)
    assert pairs_of(crossing()[:1], leaving_m=None) == []


def test_a_pair_counts_from_when_it_is_as_far_apart_as_it_has_to_be() -> None:
    """They are 60.5 m apart first, 44.7 m at 15.6 s, and never again."""
    (pair,) = pairs_of(crossing(), leaving_m=60.53)
    assert pair.flown.away_m == pytest.approx(8.0)
    assert math.isinf(pair.parting.away_m)
    (pair,) = pairs_of(crossing(), leaving_m=60.54)
    assert math.isinf(pair.flown.away_m)
    assert (pair.parting.away_m, pair.parting.t_s) == pytest.approx((8.0, 16.0))
    away = [outing("a", [track((0, 0, 0), (30, 0, 0))], [part((100, 50), (100.1, 50))]),
            outing("b", [track((0, 0, 3), (10, 0, 33), (20, 0, 8), (30, 0, 8))],
                   [part((103, 50), (103.1, 50))])]  # fmt: skip
    (pair,) = pairs_of(away, leaving_m=30.0)
    assert (pair.parting.away_m, pair.parting.t_s) == (3.0, 0.0)
    assert (pair.flown.away_m, pair.flown.t_s) == (8.0, 20.0)


def test_a_part_of_a_plan_begins_when_its_flight_does() -> None:
    """Its second part begins late, from where it is; until then it waits where the first ends."""
    one = outing(
        "one", [track((0, 0, 0), (10, 0, 50)), track((30, 0, 50), (40, 0, 100))],
        [part((100.0, 50.0), (150.0, 50.0)), part((150.0, 50.0), (200.0, 50.0))],
    )  # fmt: skip
    other = outing(
        "other", [track((0, 10, 75), (60, 10, 75))], [part((175.0, 60.0), (175.1, 60.0))]
    )
    (pair,) = pairs_of([one, other], leaving_m=None)
    assert pair.planned.away_m == pytest.approx(10.0, abs=0.02)
    assert pair.planned.t_s == pytest.approx(35.0, abs=0.1)


def test_the_row_of_an_aircraft_names_who_came_nearest() -> None:
    first, second = crossing()
    third = outing("far", [track((10, 100, 0), (20, 100, 100))], [part((100.0, 150.0), (200, 150))])
    whole = [first, second, third]
    pairs = pairs_of(whole, leaving_m=None)
    assert [pair.names for pair in pairs] == [
        ("east", "still"), ("east", "far"), ("still", "far"),
    ]  # fmt: skip
    for one, nearest, away_m in ((first, "still", 8.0), (second, "east", 8.0)):
        one.course = SimpleNamespace(
            plan=SimpleNamespace(value=1.0, upper_bound=2.0, altitude_m=20.0, path_m=100.0)
        )
        one.foreseen = SimpleNamespace(duration_s=11.0, energy_j=12.0)
        for record in one.served:
            record.importance = record.est_per = record.true_per = 0.5
        found = row(one, UNKNOWN_ROUND, pairs)
        assert (found.nearest, found.nearest_m) == (nearest, pytest.approx(away_m))
        assert found.nearest_t_s == pytest.approx(16.0)
        assert found.plan_nearest_m == pytest.approx(14.85, abs=0.01)
        assert found.idle_s == pytest.approx(one.idle_s, nan_ok=True)
        assert found.aircraft == one.aircraft.name
    alone = row(first, UNKNOWN_ROUND, [])
    assert (alone.nearest, alone.aircraft, alone.duration_s) == (
        "",
        "east",
        UNKNOWN_ROUND.duration_s,
    )


def test_lines_say_what_each_did_and_who_came_close() -> None:
    pair = crossing()
    pairs = pairs_of(pair, leaving_m=None)
    lines = list(told(pair, pairs, 8.0))
    assert lines == [
        "  east     1/2    100 m    6.0 s    2.3 kJ",
        "  still    1/1      0 m    9.0 s   lost",
        "  closest: east-still 8.0 m (planned 14.8) at 6.0 s",
    ]
    assert list(told(pair, pairs, 8.1))[2].endswith("s: nearer than mission.separation_m = 8.1")
    (parted,) = list(told(pair, pairs_of(pair, leaving_m=99.0), 99.0))[2:]
    assert parted == "  before they were 99 m apart: east-still 8.0 m at 6.0 s"
    assert list(told(pair[:1], [], None)) == []


def test_a_round_of_several_is_the_sum_the_longest_and_the_emptiest() -> None:
    def of(start: float, end: float, joules: float, left: float, height: float) -> Any:
        flight = track((start, 0, 0), (end, 30, 40), energy_j=joules, left=left)
        plan = SimpleNamespace(altitude_m=height, path_m=60.0)
        record = served(3, left > 0.6)
        record.importance, record.est_per, record.true_per = 2.0, 0.25, NAN
        return SimpleNamespace(
            flight=flight, served=[record], course=SimpleNamespace(plan=plan),
            foreseen=SimpleNamespace(duration_s=end, energy_j=joules + 1.0),
        )  # fmt: skip

    plan: Any = SimpleNamespace(value=3.0, upper_bound=4.0)
    both = [of(5.0, 20.0, 100.0, 0.5, 30.0), of(6.0, 30.0, 200.0, 0.7, 30.0)]
    found = round_record(both, plan, UNKNOWN_ROUND)
    assert (found.start_t_s, found.duration_s) == (5.0, 24.0)
    assert (found.plan_objective, found.est_objective, found.true_objective) == (3.0, 3.0, 0.0)
    assert (found.upper_bound, found.plan_path_m, found.flown_path_m) == (4.0, 120.0, 100.0)
    assert (found.scheduled, found.delivered, found.battery_remaining) == (1, 1, 0.5)
    assert (found.plan_altitude_m, found.plan_duration_s) == (30.0, 30.0)
    assert (found.plan_energy_j, found.energy_j) == (302.0, 300.0)
    apart = round_record([both[0], of(6.0, 30.0, NAN, 0.7, 40.0)], plan, UNKNOWN_ROUND)
    assert math.isnan(apart.plan_altitude_m)
    assert math.isnan(apart.energy_j)
    assert (success(0.25), success(1.0), success(NAN)) == (0.75, 0.0, 0.0)


def test_an_outing_counts_what_it_flew() -> None:
    def stop(hold_s: float, *steps: int) -> Any:
        return SimpleNamespace(hold_s=hold_s, steps=steps, xy_m=np.zeros(2))

    def flown(end_s: float, passed_s: float | None, joules: float = 10.0) -> FlownTrack:
        made = track((0.0, 0, 0), (end_s, 0, 30), energy_j=joules)
        at = None if passed_s is None else TrackPoint(round(passed_s * S), *np.zeros((2, 3)))
        return FlownTrack(made.t_ns, made.true_ned_m, made.est_ned_m, 1.0, (None, at), joules)

    def ordered(*stops: Any) -> Any:
        foreseen = SimpleNamespace(energy_j=7.0)
        return SimpleNamespace(stops=stops, foreseen=lambda _: foreseen)

    course: Any = SimpleNamespace(problem=SimpleNamespace(path_budget_m=20.0))
    flyer: Any = SimpleNamespace(performance=None)
    aircraft: Any = None
    one = Outing(0, aircraft, flyer, 1.0, course)
    one.flew(ordered(stop(0.0, 0), stop(2.0, 1, 2)), flown(10.0, 5.0))
    assert (one.idle_s, one.reached, one.used_j) == (3.0, 2, 10.0)
    one.flew(ordered(stop(2.0)), flown(10.0, 9.0, NAN))  # it went on within the hover
    assert (one.idle_s, one.reached, one.used_j) == (3.0, 2, 17.0)
    one.foreseen = SimpleNamespace(energy_j=99.0)  # type: ignore[assignment]  # all that counts
    assert one.cost == (20.0, 10.0, 10.0)
    one.flew(ordered(stop(2.0, 5)), flown(10.0, None))
    assert math.isnan(one.idle_s)
    assert one.reached == 5
    unknown = Outing(0, aircraft, flyer, 1.0, course)
    unknown.foreseen = one.foreseen
    unknown.flew(ordered(stop(0.0, 0)), track((0.0, 0, 0), (4.0, 0, 15)))
    assert math.isnan(unknown.idle_s)  # no passages
    assert unknown.cost == (15.0, 4.0, 99.0)


def state(t_s: float, north: float) -> Kinematics:
    at = np.array([north, 0.0, -5.0])
    return Kinematics(round(t_s * S), at, np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))


def sample(t_s: float, north: float, mah: float = NAN, volts: float = 10.0) -> VehicleSample:
    battery = BatteryState(volts, 1.0, mah, 1.0)
    return VehicleSample(
        round(t_s * S), state(t_s, north), state(t_s, north + 1.0), None, battery, "", armed=True
    )


def test_a_recorder_keeps_newer_samples_first_passages_and_energy() -> None:
    """1 mAh at 10 V is 36 J."""
    kept = FlightRecorder()
    here = TrackPoint(S, np.zeros(3), np.ones(3))
    kept.sampled(sample(0.0, 0.0, 5.0))
    kept.start(here)
    for one in (sample(1.0, 9.0, 6.0), sample(2.0, 2.0, 8.0), sample(1.5, 9.0, 8.0)):
        kept.sampled(one)
    for t_s, kind, seq in ((2.0, "reached", 3), (2.5, "reached", 3), (2.0, "status", 4)):
        event: Any = kind
        kept.happened(VehicleEvent(round(t_s * S), event, "", state(t_s, 7), state(t_s, 8), seq))
    end = TrackPoint(3 * S, np.full(3, 5.0), np.full(3, 6.0))
    flight = kept.finish(end, 0.75, items=(3, 4))
    assert flight.t_ns.tolist() == [S, 2 * S, 3 * S]
    assert flight.true_ned_m[:, 0].tolist() == [0.0, 2.0, 5.0]
    assert flight.est_ned_m[:, 0].tolist() == [1.0, 3.0, 6.0]
    assert flight.battery_remaining == 0.75
    reached, missed = flight.passages
    assert missed is None
    assert reached is not None
    assert (reached.t_ns, reached.true_ned_m[0], reached.est_ned_m[0]) == (2 * S, 7.0, 8.0)
    assert flight.energy_j == pytest.approx(3 * 36.0)
    kept.sampled(sample(4.0, 0.0, 9.0))
    kept.start(end, goes_on=True)
    kept.sampled(sample(5.0, 0.0, 10.0))
    assert kept.finish(end, 1.0).energy_j == pytest.approx(2 * 36.0)
    kept.sampled(sample(6.0, 0.0, 12.0))
    kept.start(end)
    assert math.isnan(kept.finish(end, 1.0).energy_j)
    kept.start(end)
    kept.sampled(sample(7.0, 0.0, 12.01))
    assert kept.finish(end, 1.0).energy_j == pytest.approx(0.36)


def test_tracks_are_joined_and_read_between_samples() -> None:
    one = track((0, 0, 0), (10, 0, 30), energy_j=5.0)
    two = track((10, 9, 9), (20, 0, 70), energy_j=NAN, left=0.25)
    assert FlownTrack.joined([one]) is one
    both = FlownTrack.joined([one, two])
    assert both.t_ns.tolist() == [0, 10 * S, 20 * S]
    assert both.true_ned_m[1, 1] == 30.0  # the first of an instant
    assert (both.energy_j, both.battery_remaining) == (5.0, 0.25)
    assert (both.duration_s, both.flown_m) == (20.0, 70.0)
    assert both.passages == ()
    assert math.isnan(FlownTrack.joined([two, two]).energy_j)
    at = one.at(5 * S)
    assert (at.t_ns, at.true_ned_m[1], at.est_ned_m[1]) == (5 * S, 15.0, 16.0)
    assert one.at(99 * S).true_ned_m[1] == 30.0
    here = TrackPoint(S, np.zeros(3), np.ones(3))
    standing = FlownTrack.standing(here, 0.5)
    assert (standing.energy_j, standing.passages, standing.duration_s) == (0.0, (here,), 0.0)


def test_reports_count_in_turn_where_none_was_lost() -> None:
    told = {1: [10], 2: [20, 40], 3: [30]}
    assert reported_in_turn(told, [1, 2, 3, 2]) == [10, 20, 30, 40]
    assert reported_in_turn(told, [1, 2, 3, 3]) == [10, None, None, None]
    assert reported_in_turn({}, [1]) == [None]


@pytest.mark.parametrize(("hovers", "t_s"), [(False, 6.0), (True, 5.0)])
def test_a_hover_is_reached_a_metre_before_its_closest(hovers: bool, t_s: float) -> None:
    flight = track(*((t / 5, 0.0, min(t / 5, 6.0)) for t in range(50)))
    at = np.array([[1.0, 7.0, -19.0]])  # what is believed is a metre off
    (found,) = passages(flight, at, reported_ns=[None], hovers=[hovers])
    assert found.t_ns == t_s * S
