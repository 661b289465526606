"""What is taken from a vehicle's telemetry, and what is not."""

import asyncio
import math
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest
from patience import HANG_S

from flightdyn.frames import frozen
from flightdyn.state import BatteryState, GeodeticPoint, Kinematics, Moment
from mission.base.area import Area
from mission.base.errors import InputError
from mission.commands.options import load
from mission.flight.pilot import connection
from mission.flight.pilot.dialects import PX4
from mission.flight.pilot.feed import Known, TelemetryFeed
from sitl.observer import VehicleEvent


def battery(number: int, percent: int) -> dict[str, object]:
    return {
        "id": number, "battery_remaining": percent, "current_consumed": 100,
        "voltages": [12_000, 65_535], "current_battery": 500,
    }  # fmt: skip


def feed_of(*heard: dict[str, object]) -> TelemetryFeed:
    async def fed() -> TelemetryFeed:
        pilot: Any = SimpleNamespace(dialect=PX4, watch=SimpleNamespace(listeners=[]))
        feed = TelemetryFeed(pilot, area=load(None, ()).area.build(), observers=())
        for fields in heard:
            feed._hear_battery(fields)
        return feed

    return asyncio.run(fed())


@pytest.mark.parametrize(
    ("heard", "counts"),
    [([(1, 30), (0, 80), (1, 29)], 0.8), ([(0, 80), (255, 10)], 0.8), ([(255, 50)], 0.5)],
)
def test_of_several_batteries_the_first_counts(heard: list[tuple[int, int]], counts: float) -> None:
    assert feed_of(*(battery(*one) for one in heard)).battery_remaining == counts


def test_a_voltage_that_is_not_told_is_not_known() -> None:
    state = feed_of({**battery(0, 50), "voltages": [65_535] * 10})._battery
    assert math.isnan(state.voltage_v)
    assert state.current_a == 5.0


def beat(state: int, *, armed: bool = True, autopilot: int = 12) -> dict[str, int]:
    return {"autopilot": autopilot, "base_mode": 29 | 128 * armed, "system_status": state}


def test_what_a_vehicle_calls_critical_is_a_failsafe_and_our_faults_are_told() -> None:
    """CRITICAL (5), EMERGENCY (6), TERMINATION (8) in the air; not ACTIVE (4), not of a camera."""
    told: list[VehicleEvent] = []
    watcher: Any = SimpleNamespace(sampled=lambda _: None, happened=told.append)
    faults = [(1_000_000_000, "Fault begins: gnss_off")]

    def at(t_s: float) -> Kinematics:
        still = frozen([0.0, 0.0, 0.0])
        return Kinematics(round(t_s * 1e9), still, still, frozen([1.0, 0, 0, 0]), still)

    async def fed() -> None:
        pilot: Any = SimpleNamespace(
            dialect=PX4, watch=SimpleNamespace(listeners=[]), mode="HOLD", armed=True, flying=True
        )
        known = Known(lambda t_ns: Moment(at(t_ns / 1e9), BatteryState(1, 1, 1, 1), None), faults)
        feed = TelemetryFeed(
            pilot, area=load(None, ()).area.build(), observers=[watcher], known=known
        )
        for second, fields in enumerate((
            beat(4), beat(5, autopilot=8), beat(5, armed=False), beat(5), beat(6), beat(4), beat(8),
        )):  # fmt: skip
            feed._sampled(known.truth(second * 10**9), at(second))
            feed._hear_heartbeat(fields)
        for second, breached in enumerate((0, 1, 1), start=7):
            feed._sampled(known.truth(second * 10**9), at(second))
            feed._hear_fence({"breach_status": breached})
        faults.append((10_500_000_000, "Fault ends: gnss_off"))  # later than what is told
        feed._sampled(known.truth(10 * 10**9), at(10))

    asyncio.run(fed())
    found = [(e.t_ns // 10**9, e.kind, e.text) for e in told if e.kind in ("failsafe", "fault")]
    assert found == [
        (1, "fault", "Fault begins: gnss_off"),
        (3, "failsafe", "failsafe"),
        (6, "failsafe", "failsafe"),
        (8, "failsafe", "fence breached"),
    ]


def test_one_that_is_first_heard_in_flight_is_armed_from_then_on() -> None:
    """Else no log of it would begin."""
    told: list[VehicleEvent] = []
    watcher: Any = SimpleNamespace(sampled=lambda _: None, happened=told.append)
    still = frozen([0.0, 0.0, 0.0])
    at = Kinematics(10**9, still, still, frozen([1.0, 0, 0, 0]), still)

    async def fed() -> None:
        pilot: Any = SimpleNamespace(
            dialect=PX4, watch=SimpleNamespace(listeners=[]), mode="HOLD", armed=True, flying=True
        )
        feed = TelemetryFeed(pilot, area=load(None, ()).area.build(), observers=[watcher])
        for _ in range(2):
            feed._sampled(Moment(at, BatteryState(1, 1, 1, 1), None), at)

    asyncio.run(fed())
    assert [event.text for event in told if event.kind == "armed"] == ["armed"]


def test_an_item_is_reached_as_often_as_it_is_reported_after_another() -> None:
    """PX4 repeats its last report once a second; a jump leads to items again."""
    told: list[VehicleEvent] = []
    watcher: Any = SimpleNamespace(sampled=lambda _: None, happened=told.append)
    still = frozen([0.0, 0.0, 0.0])

    async def fed() -> TelemetryFeed:
        pilot: Any = SimpleNamespace(
            dialect=PX4,
            watch=SimpleNamespace(listeners=[]),
            mode="MISSION",
            armed=True,
            flying=True,
        )
        feed = TelemetryFeed(pilot, area=load(None, ()).area.build(), observers=[watcher])
        for second, seq in enumerate((1, 1, 2, 2, 2, 1, 1)):
            at = Kinematics(second, still, still, frozen([1.0, 0, 0, 0]), still)
            feed._sampled(Moment(at, BatteryState(1, 1, 1, 1), None), at)
            feed._hear_reached({"seq": seq})
        return feed

    assert asyncio.run(fed()).reached_ns == {1: [0, 5], 2: [2]}
    assert [event.seq for event in told if "reported" in event.text] == [1, 2, 1]


@pytest.mark.parametrize(("away_m", "far"), [(0.0, False), (4_950.0, False), (5_050.0, True)])
def test_a_vehicle_more_than_five_kilometres_away_is_of_another_place(
    away_m: float, far: bool
) -> None:
    """A degree of latitude has 111.2 km, here within half a percent."""
    area = Area.at((800.0, 800.0), (0.0, 0.0), GeodeticPoint(47.0, 8.0, 500.0))
    place = GeodeticPoint(47.0 + away_m / 111_195.0, 8.0, 500.0)

    async def locate() -> None:
        first: asyncio.Future[GeodeticPoint] = asyncio.get_running_loop().create_future()
        first.set_result(place)
        feed: Any = SimpleNamespace(first=first, readiness=SimpleNamespace(missing=""))
        await connection._locate(feed, area, timeout_s=HANG_S, say=print)

    with pytest.raises(InputError, match="5 km from the area: set") if far else nullcontext():
        asyncio.run(locate())
