"""When a vehicle of which only telemetry tells has passed its stops."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mission.commands.options import load
from mission.flight.flyers.built_in import BuiltInFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlightRecorder, FlownTrack, TrackPoint, passages
from mission.planner.flyable import Stop
from sitl.observer import VehicleEvent

S = 1_000_000_000


def flight(points: list[tuple[float, float]]) -> FlownTrack:
    ned = np.array([(x, y, -60.0) for x, y in points])
    return FlownTrack(np.arange(len(points)) * S, ned, ned, 1.0)


def stops(*points: tuple[float, float]) -> np.ndarray:
    return np.array([(x, y, -60.0) for x, y in points])


def seconds(found: tuple[TrackPoint, ...]) -> list[float]:
    return [round(passage.t_ns / S, 6) for passage in found]


def test_closest_approach_lies_between_the_samples() -> None:
    # 10 m/s to the north, sampled once a second; the second stop lies 3 m beside the track.
    found = passages(
        flight([(10.0 * n, 0.0) for n in range(11)]),
        stops((0, 0), (44, 3), (100, 0)),
        reported_ns=[0, 4 * S, 10 * S], hovers=[False] * 3,
    )  # fmt: skip
    assert seconds(found) == [0.0, 4.4, 10.0]
    assert found[1].true_ned_m == pytest.approx([44, 0, -60])


def test_a_track_that_comes_back_is_taken_in_order() -> None:
    # Two metres aside on the way out, right over the stop on the way back.
    there = [(10.0 * n, 2.0) for n in range(6)]
    back = [(10.0 * n, 0.0) for n in range(4, -1, -1)]
    found = passages(
        flight([*there, *back]),
        stops((0, 2), (21, 0), (50, 2), (21, 0), (0, 0)),
        reported_ns=[0, 2 * S, 5 * S, 8 * S, 10 * S], hovers=[False] * 5,
    )  # fmt: skip
    assert seconds(found) == [0.0, 2.1, 5.0, 7.9, 10.0]


def test_a_lost_report_does_not_lose_the_stop() -> None:
    found = passages(
        flight([(10.0 * n, 0.0) for n in range(11)]),
        stops((0, 0), (30, 0), (60, 0), (100, 0)),
        reported_ns=[0, None, 6 * S, None], hovers=[False] * 4,
    )  # fmt: skip
    assert seconds(found) == [0.0, 3.0, 6.0, 10.0]


def test_a_hover_is_reached_when_it_begins() -> None:
    arriving = [(10.0 * n, 0.0) for n in range(4)]
    hovering = [(30.0 + 0.2 * np.sin(n), 0.1 * np.cos(n)) for n in range(8)]
    found = passages(
        flight([*arriving, *hovering]),
        stops((0, 0), (30, 0)),
        reported_ns=[0, 11 * S], hovers=[False, True],
    )  # fmt: skip
    assert 2.8 < found[1].t_ns / S < 4.0


def test_the_built_in_vehicle_reports_the_end_of_a_hover_whose_passage_is_its_beginning() -> None:
    recorder, config = FlightRecorder(), load(None, ())
    now: Any = SimpleNamespace(pos_ned_m=np.zeros(3))
    aircraft = SimpleNamespace(truth=now, belief=now, battery=SimpleNamespace(remaining=1.0))
    vehicle: Any = SimpleNamespace(t_ns=0, aircraft=aircraft)

    async def fly() -> None:  # 100 m at 10 m/s, a hover of 4 s, 50 m: items 0, 2 and 3
        for second in range(20):
            now.pos_ned_m = np.array([min(10.0 * second, max(100.0, 10.0 * second - 40.0)), 0, 0])
            vehicle.t_ns = second * S
            full = SimpleNamespace(consumed_mah=0.0, voltage_v=0.0)
            sample: Any = SimpleNamespace(t_ns=vehicle.t_ns, truth=now, belief=now, battery=full)
            recorder.sampled(sample)
            if second in (0, 14, 19):
                seq = {0: 0, 14: 2, 19: 3}[second]
                recorder.happened(VehicleEvent(vehicle.t_ns, "reached", "", now, now, seq, 6))

    pilot, guidance = cast(Any, SimpleNamespace(fly=fly)), cast(Any, None)
    flyer = BuiltInFlyer(
        pilot, vehicle, recorder,
        area=config.area.build(), mission=config.mission, guidance=guidance,
    )  # fmt: skip
    places = [Stop(np.array([0.0, x]), (), hold_s=h) for x, h in ((0, 0), (100, 4), (150, 0))]
    flown = asyncio.run(flyer.fly(FlightPlan(tuple(places), 60.0, 10.0, 5.0)))
    assert [p.t_ns / S for p in flown.passages if p is not None] == [0.0, 10.0, 19.0]
