"""What is taken from a vehicle's telemetry, and what is not."""

import asyncio
import math
from types import SimpleNamespace
from typing import Any

import pytest

from mission.commands.options import load
from mission.flight.pilot.dialects import PX4
from mission.flight.pilot.feed import TelemetryFeed


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
