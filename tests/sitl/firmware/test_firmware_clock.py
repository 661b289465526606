"""Simulated time under a firmware: it waits for those who read its telemetry."""

import math
import threading
import time
from typing import cast

import pytest
from firmware_stand_ins import plant
from patience import HANG_S, until

from flightdyn.plant import Plant
from sitl.firmware import clock as clock_module
from sitl.firmware.bridge import Bridge
from sitl.firmware.clock import FirmwareClock
from sitl.firmware.native.library import TruthRing

AHEAD_S = 0.5  # of wall time, that a pace may run ahead by: a pause, and an interval at 0.1


class Eager:
    """A bridge whose firmware asks for every tick at once."""

    connected = True

    def __init__(self) -> None:
        self.plant: Plant = plant()
        self.truths = TruthRing(self.plant)
        self.rests = 0

    def run(self, ticks: int) -> int:
        self.plant.clock.tick += ticks
        return ticks

    def rest(self) -> None:
        self.rests += 1
        time.sleep(0.001)

    def called(self) -> bool:
        return False

    def close(self) -> None: ...


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock_module, "STALL_S", HANG_S)


def eager() -> FirmwareClock:
    clock = FirmwareClock(cast(Bridge, Eager()), speed=math.inf)
    clock.start()
    return clock


def test_time_waits_for_whoever_reads_and_goes_on_as_far_as_they_have_read() -> None:
    """A reader that a busy machine keeps from reading would else have a hole in the track."""
    clock = eager()
    for read_s in (0.0, 7.0, 8.0):
        clock.heard(round(read_s * 1e9))
        clock.run()
        until(lambda least_ns=(read_s + 0.5) * 1e9: clock.plant.t_ns >= least_ns)  # type: ignore[misc]
        time.sleep(0.05)
        assert clock.plant.t_ns < (read_s + 5.0) * 1e9
    clock.stop()
    assert clock.error is None


def test_telemetry_that_stops_for_good_is_an_error_and_no_hole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(clock_module, "STALL_S", 0.1)
    clock = eager()
    clock.heard(2_000_000_000)
    clock.run()
    until(lambda: clock.error is not None)
    clock.stop()
    assert "no telemetry for 0.1 s: the newest is of t 2.00 s" in str(clock.error)


def test_time_goes_as_far_as_ordered_and_beyond_only_to_answer() -> None:
    clock = eager()
    for ordered_ns in (70_000_000, 72_000_000, 3_000_000_000):
        clock.run(ordered_ns)
        until(lambda least_ns=ordered_ns: clock.plant.t_ns >= least_ns)  # type: ignore[misc]
        time.sleep(0.02)
        assert clock.plant.t_ns < ordered_ns + clock.plant.dt_ns
    clock.cap_at_wall_pace(0.1)
    time.sleep(0.02)
    assert clock.plant.t_ns < ordered_ns + clock.plant.dt_ns
    clock.answers = True
    began_s = time.monotonic()

    def answered() -> bool:
        clock.cap_at_wall_pace(0.1)
        return clock.plant.t_ns > ordered_ns + 50_000_000

    until(answered)
    clock.stop()
    assert clock.error is None
    assert clock.plant.t_ns < ordered_ns + 1e9 * (time.monotonic() - began_s + AHEAD_S)


class Held(Eager):
    """One in which a wait for the firmware lasts until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.waits, self.left = threading.Event(), threading.Event()
        self.left_at_close: list[bool] = []

    def rest(self) -> None:
        self.waits.set()
        self.left.wait(HANG_S)

    def close(self) -> None:
        self.left_at_close.append(self.left.is_set())


def test_a_bridge_is_closed_when_nobody_waits_on_it_any_more() -> None:
    """Its socket would be another one's by then."""
    bridge = Held()
    clock = FirmwareClock(cast(Bridge, bridge), speed=math.inf)
    clock.start()
    assert bridge.waits.wait(HANG_S)
    stopper = threading.Thread(target=clock.stop)
    stopper.start()
    stopper.join(0.05)
    bridge.left.set()
    stopper.join(HANG_S)
    assert bridge.left_at_close == [True]


def test_a_block_may_let_time_go_so_far_and_so_fast() -> None:
    clock = eager()
    began_s = time.monotonic()
    with clock.going(10**12, speed=0.1):
        until(lambda: clock.plant.t_ns > 30_000_000)
    assert clock.plant.t_ns < 1e8 * (time.monotonic() - began_s + AHEAD_S)
    until_ns = clock.plant.t_ns + 50_000_000
    with clock.going(until_ns):
        until(lambda: clock.plant.t_ns >= until_ns)
        time.sleep(0.02)
    assert clock.plant.t_ns < until_ns + clock.plant.dt_ns
    clock.stop()
    assert clock.error is None


def test_a_block_in_which_time_goes_on_may_lie_in_another() -> None:
    """A landing whose way home is a flight of its own, as with buildings or a fence."""
    bridge = Eager()
    clock = FirmwareClock(cast(Bridge, bridge), speed=math.inf)
    clock.start()
    with clock.going():
        until(lambda: clock.plant.t_ns > 0)
        with clock.going():
            pass
        rests, now_ns = bridge.rests, clock.plant.t_ns
        until(lambda: clock.plant.t_ns > now_ns + 10**10 or bridge.rests > rests + 2)
        assert bridge.rests == rests
    rests = bridge.rests
    until(lambda: bridge.rests > rests + 2)
    now_ns = clock.plant.t_ns
    time.sleep(0.02)
    assert clock.plant.t_ns == now_ns
    clock.stop()
    assert clock.error is None
