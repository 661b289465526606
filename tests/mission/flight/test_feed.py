"""What is taken from a vehicle's telemetry, and what is not."""

import asyncio
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


@pytest.mark.parametrize(
    ("heard", "counts"),
    [([(1, 30), (0, 80), (1, 29)], 0.8), ([(0, 80), (255, 10)], 0.8), ([(255, 50)], 0.5)],
)
def test_of_several_batteries_the_first_counts(heard: list[tuple[int, int]], counts: float) -> None:
    async def remaining() -> float:
        pilot: Any = SimpleNamespace(dialect=PX4, watch=SimpleNamespace(listeners=[]))
        feed = TelemetryFeed(pilot, area=load(None, ()).area.build(), observers=())
        for number, percent in heard:
            feed._hear_battery(battery(number, percent))
        return feed.battery_remaining

    assert asyncio.run(remaining()) == counts
