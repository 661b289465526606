"""Ordered time of a vehicle under a firmware."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from mission.flight.serve.hosts import FirmwareHost


def test_ordered_time_is_over_at_its_instant(monkeypatch: pytest.MonkeyPatch) -> None:
    """What clients have sent is heard before it, and time stands still after it."""
    plant, done = SimpleNamespace(t_ns=70), []

    def run(until_ns: int) -> None:
        done.append("ran")
        plant.t_ns = until_ns

    async def wait(_: float) -> None:
        raise AssertionError("it waits for more")

    monkeypatch.setattr("mission.flight.serve.hosts.asyncio.sleep", wait)
    relay = SimpleNamespace(take_orders=lambda: done.append("heard"))
    clock = SimpleNamespace(run=run, rest=lambda: done.append("stands"))
    vehicle = SimpleNamespace(plant=plant, relay=relay, clock=clock)
    host: Any = SimpleNamespace(_flyer=SimpleNamespace(vehicle=vehicle))
    asyncio.run(FirmwareHost.run_for(host, 0.5))
    assert plant.t_ns == 500_000_070
    assert done == ["heard", "ran", "stands"]
