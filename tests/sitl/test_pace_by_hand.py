"""How far simulated time goes between two looks at the links, in a wall time of our own."""

import asyncio
import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from patience import HANG_S
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from sitl.links import RawLink, UdpLink
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

MS = 1_000_000


class Paced:
    """A vehicle that steps by 20 ms and strides by 100 ms, each of which takes some wall time."""

    near_m, traffic, waited_for = 0.0, "off", False

    def __init__(self, *, costs_s: float = 0.0, due_s: float = math.inf) -> None:
        self.now_s, self.costs_s, self.due_s = 0.0, costs_s, due_s
        self.t_ns, self.end_ns = 0, math.inf
        self.seen: list[tuple[float, int]] = []  # wall time (ms) and simulated time (ms) of looks
        self.slept_ms: list[float] = []
        self.greeted = 0
        self.aircraft: Any = SimpleNamespace(
            frame=LocalFrame(HOME), pos_ned_m=np.zeros(3), vel_ned_mps=np.zeros(3), dt_ns=4 * MS
        )

    @property
    def moving(self) -> bool:
        return self.t_ns < self.end_ns

    def step(self) -> None:
        self.t_ns += 20 * MS
        self.now_s += self.costs_s

    def stride(self, until_ns: float = math.inf) -> None:
        self.t_ns = int(min(self.t_ns + 100 * MS, until_ns))
        self.now_s += self.costs_s

    def outgoing(self, now: float) -> list[Any]:
        self.seen.append((round(now * 1e3, 3), self.t_ns // MS))
        return []

    def greet(self) -> None:
        self.greeted += 1

    def due(self) -> float:
        return self.now_s + self.due_s

    async def sleep(self, seconds: float) -> None:
        self.slept_ms.append(round(seconds * 1e3, 3))
        self.now_s += seconds
        await asyncio.sleep(0)

    def looks(
        self, monkeypatch: pytest.MonkeyPatch, count: int, *links: Any, **how: Any
    ) -> list[tuple[float, int]]:
        """The first looks at the links."""
        monkeypatch.setattr("sitl.pace.time", SimpleNamespace(monotonic=lambda: self.now_s))
        ours = SimpleNamespace(sleep=self.sleep, Event=asyncio.Event, timeout=asyncio.timeout)
        monkeypatch.setattr("sitl.pace.asyncio", ours)

        async def run() -> None:
            simulation = Simulation(cast(Vehicle, self), *(links or (RawLink(),)), **how)
            async with asyncio.timeout(HANG_S), simulation:
                while len(self.seen) < count:  # noqa: ASYNC110  wall time is ours
                    await asyncio.sleep(0)

        asyncio.run(run())
        return self.seen[:count]


def test_a_pace_is_kept_in_stretches_of_20_ms(monkeypatch: pytest.MonkeyPatch) -> None:
    """One stretch ahead, and then one in each 20 ms of wall time, at four times its pace."""
    paced = Paced()
    assert paced.looks(monkeypatch, 5, speed=4.0) == [
        (0, 0), (0, 80), (20, 160), (40, 240), (60, 320)
    ]  # fmt: skip
    assert paced.slept_ms[:4] == [0, 20, 20, 20]
    changes = iter((4.0, 2.0, 1.0, 0.5))  # which may change; a step of 20 ms is the least
    faster = Paced().looks(monkeypatch, 5, speed=lambda: next(changes, 1.0))
    assert faster == [(0, 0), (0, 80), (20, 120), (40, 140), (80, 160)]


def test_telemetry_is_on_time_and_a_slow_machine_does_not_rush_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Due in 5 ms, 20 ms at four times the pace are run. Steps that take 20 ms of wall time end
    after 50 ms, three of them; once they take none, it is as if nothing had been missed."""
    assert Paced(due_s=0.005).looks(monkeypatch, 4, speed=4.0) == [
        (0, 0), (0, 20), (0, 40), (0, 60)
    ]  # fmt: skip
    late = Paced(due_s=-0.005).looks(monkeypatch, 3, speed=4.0)  # a step at least
    assert [t_ms for _, t_ms in late] == [0, 20, 40]
    assert Paced(costs_s=0.025).looks(monkeypatch, 2, speed=4.0) == [(0, 0), (50, 40)]
    slow = Paced(costs_s=0.02)
    speeds = [4.0]

    def speed() -> float:
        slow.costs_s *= slow.t_ns < 100 * MS
        return speeds[0]

    assert slow.looks(monkeypatch, 6, speed=speed) == [
        (0, 0), (60, 60), (120, 120), (120, 200), (140, 280), (160, 360)
    ]  # fmt: skip


def test_flat_out_time_runs_for_50_ms_of_wall_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of strides that take 20 ms, and a millisecond of pause; by somebody outside a second of
    simulated time at most, and no farther than a manoeuvre goes."""
    inside = Paced(costs_s=0.02)
    assert inside.looks(monkeypatch, 3) == [(0, 0), (61, 300), (122, 600)]
    assert inside.slept_ms[:2] == [1, 1]
    even = Paced(costs_s=0.025)
    assert even.looks(monkeypatch, 2) == [(0, 0), (51, 200)]
    outside = Paced(costs_s=0.001)
    link = UdpLink("udpin://127.0.0.1:0")
    assert outside.looks(monkeypatch, 3, link) == [(0, 0), (11, 1000), (22, 2000)]
    ends = Paced(costs_s=0.001)
    ends.end_ns, ends.due_s = 300 * MS, 0.0
    assert ends.looks(monkeypatch, 4) == [(0, 0), (3, 300), (3, 300), (3, 300)]
    assert ends.slept_ms[0] == 0  # nobody waits for a pause where time stands still
    joins, raw = Paced(costs_s=0.02), RawLink()
    raw.attach(lambda _: None)
    joins.looks(monkeypatch, 4, raw)
    assert joins.greeted == 1


def test_ordered_time_stands_still_at_the_instant_and_while_a_pilot_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    paced = Paced(costs_s=0.001)
    monkeypatch.setattr("sitl.pace.time", SimpleNamespace(monotonic=lambda: paced.now_s))

    async def run() -> None:
        simulation = Simulation(cast(Vehicle, paced), RawLink(), runs="ordered")
        async with asyncio.timeout(HANG_S), simulation:
            await asyncio.sleep(0)
            assert paced.t_ns == 0
            await simulation.run_to(250 * MS)
            assert paced.t_ns == 250 * MS
            for_ever = asyncio.create_task(simulation.run_to(math.inf))  # as long as one is piloted
            for _ in range(5):
                await asyncio.sleep(0)
            assert paced.t_ns == 250 * MS
            for_ever.cancel()
            await asyncio.wait((for_ever,))
            simulation.piloted.add(cast(Vehicle, paced))
            await simulation.run_to(600 * MS)
            assert paced.t_ns == 600 * MS
            other = Paced()
            assert not simulation.waits(cast(Vehicle, other))
            paced.end_ns = 0  # its pilot is at work
            assert simulation.waits(cast(Vehicle, other))
            assert not simulation.waits(cast(Vehicle, paced))
            late = asyncio.create_task(simulation.run_to(900 * MS))
            for _ in range(5):
                await asyncio.sleep(0)
            assert paced.t_ns == 600 * MS
            paced.end_ns = math.inf
            simulation.wake()
            await late
            assert paced.t_ns == 900 * MS

    asyncio.run(run())
