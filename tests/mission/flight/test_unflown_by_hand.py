"""A flyer that is not flown: where and when it is, by hand."""

import asyncio
from typing import Any

import numpy as np
import pytest

from flightdyn.state import BatteryState
from mission.config.models import RunConfig
from mission.flight.flyers.unflown import UnflownFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.planner.flyable import Stop

S = 10**9


class Heard:
    def __init__(self) -> None:
        self.seen: list[tuple[int, list[float], list[float]]] = []

    def sampled(self, sample: Any) -> None:
        assert sample.truth is sample.belief
        assert (sample.mode, sample.armed) == ("NOT FLOWN", False)
        assert sample.battery == BatteryState(0.0, 0.0, 0.0, 1.0)
        assert sample.truth.q_frd_to_ned.tolist() == [1.0, 0.0, 0.0, 0.0]
        assert sample.truth.omega_frd_radps.tolist() == [0.0, 0.0, 0.0]
        assert sample.truth.t_ns == sample.t_ns
        self.seen.append(
            (sample.t_ns, sample.truth.pos_ned_m.tolist(), sample.truth.vel_ned_mps.tolist())
        )

    def happened(self, _: object) -> None: ...


def test_a_plan_is_met_at_its_speed_and_hovered_for_so_long() -> None:
    """Home at (20, 30): 40 m east and 30 m north at 5 m/s take 10 s."""
    config = RunConfig.model_validate({
        "area": {"size_m": (200.0, 200.0), "home_m": (20.0, 30.0)},
        "mission": {"altitude_m": 60.0},
        "communities": [{"name": "a", "task": "digits", "devices": 2}],
    })  # fmt: skip
    heard = Heard()
    flyer = UnflownFlyer(config.area.build(), config.mission, [heard])
    assert flyer.here().true_ned_m.tolist() == [0.0, 0.0, 0.0]
    asyncio.run(flyer.take_off())
    assert flyer.here().est_ned_m.tolist() == [0.0, 0.0, -60.0]
    stops = (
        Stop(np.array([20.0, 30.0]), (0,)),
        Stop(np.array([60.0, 60.0]), (1,), hold_s=2.5),
        Stop(np.array([60.0, 50.0]), (2,)),
    )
    flight = asyncio.run(flyer.fly(FlightPlan(stops, 60.0, 5.0, 1.0)))
    passed = [(each.t_ns, each.true_ned_m.tolist()) for each in flight.passages if each]
    assert passed == [
        (0, [0.0, 0.0, -60.0]),
        (10 * S, [30.0, 40.0, -60.0]),
        (14_500_000_000, [20.0, 40.0, -60.0]),
    ]
    assert flight.battery_remaining == flyer.battery_remaining == 1.0
    assert flyer.t_ns == 14_500_000_000
    assert [t_ns for t_ns, _, _ in heard.seen] == [0, 10 * S, 12_500_000_000, 14_500_000_000]
    for (_, place, speed), (north, east, moving) in zip(
        heard.seen,
        [(0, 0, [0, 0, 0]), (30, 40, [3, 4, 0]), (30, 40, [0, 0, 0]), (20, 40, [-5, 0, 0])],
        strict=True,
    ):
        assert place == pytest.approx(
            [north, east, (north**2 + east**2) / 2 / 6.37e6 - 60], abs=2e-6
        )
        assert speed == pytest.approx(moving)
    for until_ns in (0, 14_500_000_000):
        assert flyer.wait_until(until_ns, flight) is flight
    near = (Stop(np.array([60.0, 50.0]), (0,)), Stop(np.array([62.0, 50.0]), (1,), hold_s=0.5))
    begun_ns = flyer.t_ns
    part = asyncio.run(flyer.fly(FlightPlan(near, 60.0, 5.0, 1.0)))
    assert flyer.t_ns - begun_ns == 900_000_000
    assert part.t_ns[0] == begun_ns
    assert heard.seen[-2][2] == [0.0, 5.0, 0.0]
    longer = flyer.wait_until(20 * S, flight)
    assert (flyer.t_ns, longer.t_ns[-1]) == (20 * S, 20 * S)
    assert longer.passages == flight.passages
    assert heard.seen[-1][2] == [0.0, 0.0, 0.0]
    assert longer.true_ned_m[-1] == pytest.approx([20.0, 42.0, -60.0], abs=1e-3)
    asyncio.run(flyer.climb(80.0))
    asyncio.run(flyer.go_to(np.array([10.0, 31.0])))
    assert flyer.here().true_ned_m == pytest.approx([1.0, -10.0, -80.0])
    assert flyer.here().t_ns == 20 * S
