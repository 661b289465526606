"""What an external vehicle is believed to reach, and what it is ordered nevertheless."""

import asyncio
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from flightdyn.config import LimitsConfig
from mission.base.errors import FlightError
from mission.commands.options import load
from mission.flight.flyers.external import ExternalFlyer, check_end
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlownTrack
from mission.planner.flyable import Stop
from sitl.autopilot.codec.orders import MissionItem

CONFIG = load(None, ())


class Vehicle:
    """Flies one straight leg, with an acceleration and a top speed of its own."""

    def __init__(self, ordered_mps: float) -> None:
        self.ordered: list[float] = []
        self.said: list[str] = []
        self.top_mps, self.acc_mps2 = np.inf, 2.0
        # Of pilot, telemetry and recorder a flight of one leg needs this much; MAVSDK has no part
        # in it, as the flyer's recording of a flight is the drive along the leg below.
        self.flyer = ExternalFlyer(
            SimpleNamespace(upload_items=self._upload, fly=None),  # type: ignore[arg-type]
            SimpleNamespace(battery_remaining=1.0, reached_ns={}, passed=lambda *_: None),  # type: ignore[arg-type]
            None,  # type: ignore[arg-type]
            area=CONFIG.area.build(),
            mission=CONFIG.mission.model_copy(update={"speed_mps": ordered_mps}),
            guidance=LimitsConfig(),
            link=CONFIG.link,
            say=self.said.append,
        )
        self.flyer.record = self._record  # type: ignore[method-assign]

    async def _upload(self, items: Sequence[MissionItem]) -> None:
        self.ordered.append(items[1].params[1])  # of DO_CHANGE_SPEED

    async def _record(self, *_: object, **__: object) -> FlownTrack:  # as the flyer calls it
        v_mps, moved_m, at_m = 0.0, [0.0], 0.0
        top_mps = min(self.top_mps, self.ordered[-1])
        while v_mps > 0.0 or at_m == 0.0:
            brakes = v_mps**2 / (2.0 * self.acc_mps2) >= self.leg_m - at_m
            v_mps = max(v_mps - 0.02 * self.acc_mps2, 0.0) if brakes else v_mps
            v_mps = v_mps if brakes else min(v_mps + 0.02 * self.acc_mps2, top_mps)
            at_m += 0.02 * v_mps
            moved_m.append(at_m)
        t_ns = np.arange(len(moved_m)) * 20_000_000 + 7_300_000_000
        way = self.ends_ned_m[1] - self.ends_ned_m[0]
        places = self.ends_ned_m[0] + np.outer(moved_m, way / self.leg_m)
        return FlownTrack(t_ns, places, places, 1.0)

    def fly(self, leg_m: float) -> float:
        """The speed that the next rounds are timed by."""
        self.leg_m = leg_m
        stops = tuple(Stop(np.array([x, 0.0]), ()) for x in (0.0, leg_m))
        plan = FlightPlan(stops, 60.0, self.flyer.mission.speed_mps, 5.0)
        self.ends_ned_m = self.flyer.area.to_ned(plan.points_m, plan.alt_rel_m)

        async def there() -> None:
            await self.flyer.upload(plan)
            await self.flyer.fly(plan)

        asyncio.run(there())
        return self.flyer.mission.speed_mps


@pytest.mark.slow
@pytest.mark.parametrize("leg_of_s", [0.0, 0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("acc_mps2", [2.0, 3.0, 5.0])
def test_a_short_leg_does_not_make_a_vehicle_slow(acc_mps2: float, leg_of_s: float) -> None:
    for v_mps in (2.0, 5.0, 12.0):
        vehicle = Vehicle(v_mps)
        vehicle.acc_mps2 = acc_mps2
        assert vehicle.fly(v_mps**2 / 2.0 + leg_of_s * v_mps) == v_mps
        assert vehicle.said == []


def test_rounds_are_timed_by_the_reached_speed_and_the_configured_one_is_ordered() -> None:
    vehicle = Vehicle(10.0)
    vehicle.top_mps = 4.0
    assert vehicle.fly(200.0) == 4.0
    assert vehicle.fly(200.0) == 4.0
    (words,) = vehicle.said
    assert "reached 4.0 m/s where 10 were ordered" in words
    vehicle.top_mps = np.inf  # the wind is over
    assert vehicle.fly(200.0) == 10.0
    assert vehicle.ordered == [10.0, 10.0, 10.0]
    assert len(vehicle.said) == 1


@pytest.mark.parametrize(("leg_m", "timed_mps"), [(69.5, 10.0), (70.5, 4.0)])
def test_a_leg_counts_from_a_run_up_at_2_m_s2_and_two_seconds_on(
    leg_m: float, timed_mps: float
) -> None:
    vehicle = Vehicle(10.0)  # 50 m and 20 m
    vehicle.top_mps = 4.0
    assert vehicle.fly(leg_m) == timed_mps


@pytest.mark.parametrize(("top_mps", "timed_mps"), [(9.4, 9.4), (9.6, 10.0)])
def test_a_twentieth_below_the_ordered_speed_is_how_a_leg_is_flown(
    top_mps: float, timed_mps: float
) -> None:
    vehicle = Vehicle(10.0)
    vehicle.top_mps = top_mps
    assert vehicle.fly(200.0) == timed_mps
    assert bool(vehicle.said) is (timed_mps < 10.0)


@pytest.mark.parametrize(("flown", "pace"), [(0.4, 0.5), (0.6, 0.6), (2.9, 2.9), (3.5, 3.0)])
def test_rounds_are_foreseen_at_the_pace_so_far_within_bounds(flown: float, pace: float) -> None:
    flyer = Vehicle(10.0).flyer
    stops = tuple(Stop(np.array([x, 0.0]), ()) for x in (0.0, 200.0))
    plan = FlightPlan(stops, 60.0, 10.0, 5.0)
    taken = flown * plan.foreseen(flyer.performance).duration_s
    flyer._believe_pace(plan, SimpleNamespace(duration_s=taken))  # type: ignore[arg-type]  # all of it
    assert flyer.pace == pytest.approx(pace)


def test_a_mission_that_is_over_20_m_beyond_its_acceptance_radius_has_failed() -> None:
    check_end(24.9, acceptance_m=5.0)
    with pytest.raises(FlightError, match="over, 25 m short of its end"):
        check_end(25.1, acceptance_m=5.0)
