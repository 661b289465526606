"""Aircraft under several firmwares in one world, against stand-ins that fly open loop."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from firmware_threads import CLIMB, ArduPilot, Px4
from patience import until
from sitl_mavsdk import HOME

from flightdyn.config import AircraftConfig
from flightdyn.frames import LocalFrame
from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from sitl.firmware import clock as clock_module
from sitl.firmware import together
from sitl.firmware.ardupilot import RATE_HZ, ArduPilotBridge
from sitl.firmware.bridge import Bridge
from sitl.firmware.clock import SharedClock
from sitl.firmware.px4 import Px4Bridge
from sitl.firmware.together import Bridged
from sitl.world import World

INTERVAL_S = 0.02


def seat(
    kind: Any,
    said: list[str],
    *,
    number: int = 1,
    east_m: float = 0.0,
    up_m: float = 0.0,
    alone: bool = False,
) -> Bridged:
    """An aircraft on the ground at a place of its own; its port is any, and stays the same."""
    home = LocalFrame(HOME).to_geodetic(np.array([0.0, east_m, 0.0]))
    home = replace(home, alt_msl_m=HOME.alt_msl_m + up_m)
    config = AircraftConfig(physics_hz=RATE_HZ if kind is ArduPilotBridge else 250)
    port = 0

    def make() -> Bridge:
        bridge: Bridge = kind(Plant(config, home=home, streams=RandomStreams(1)), port=port)
        bridge.open()
        return bridge

    made = Bridged(number, make, near_m=3.0, say=said.append, alone=alone)
    port = made.port
    return made


@contextmanager
def closed(*seats: Bridged) -> Iterator[None]:
    try:
        yield
    finally:
        for each in seats:
            each.close()


def come(*seats: Bridged) -> None:
    until(lambda: sum(each.look() for each in seats) == len(seats))


def run(world: World, seconds: float, *seats: Bridged) -> None:
    until_ns = world.t_ns + round(seconds * 1e9)
    while world.t_ns < until_ns:
        for each in seats:
            each.look()
        world.step()


def test_time_waits_for_the_slowest_at_each_interval() -> None:
    one, two = (seat(ArduPilotBridge, [], east_m=5.0 * i) for i in range(2))
    with closed(one, two):
        fast, slow = ArduPilot(one.port), ArduPilot(two.port)
        come(one, two)
        world = World({"one": one, "two": two})
        run(world, 1.0)
        slow.hold()
        thread = threading.Thread(target=run, args=(world, 1.0))
        thread.start()
        until(lambda: fast.seconds > slow.seconds)
        fast.join(0.3)  # which has all the time that it wants
        assert thread.is_alive()
        # The slow one's newest answer may still be on its way to it.
        assert fast.seconds - slow.seconds < 2 * INTERVAL_S
        slow.go_on()
        thread.join()
        assert one.t_ns == two.t_ns == world.t_ns == 2_000_000_000
        fast.end()
        slow.end()


@pytest.mark.parametrize("kind", [ArduPilotBridge, Px4Bridge])
def test_one_whose_firmware_ends_is_left_behind_and_the_next_one_finds_it_at_home(
    kind: Any,
) -> None:
    said: list[str] = []
    stays, goes = seat(ArduPilotBridge, []), seat(kind, said, east_m=5.0)
    makes: Callable[[int], Any] = ArduPilot if kind is ArduPilotBridge else Px4
    with closed(stays, goes):
        other, ends = ArduPilot(stays.port, CLIMB), makes(goes.port)
        come(stays, goes)
        world = World({"stays": stays, "goes": goes})
        run(world, 0.5)
        ends.end()
        run(world, 1.0, stays, goes)
        (line,) = said
        assert "s: its motors are off until one comes again" in line
        assert stays.t_ns == goes.t_ns == world.t_ns
        left = goes.plant
        again = makes(goes.port)
        come(goes)
        began_ns = world.t_ns
        run(world, 0.5)
        assert goes.plant is not left
        assert goes.t_ns == world.t_ns - began_ns
        assert goes.began_ns == began_ns
        assert stays.t_ns == world.t_ns
        assert said == [line]
        again.end()
        other.end()


def test_an_aircraft_without_its_firmware_falls() -> None:
    said: list[str] = []
    one, two = seat(ArduPilotBridge, said), seat(ArduPilotBridge, [], east_m=5.0)
    with closed(one, two):
        climbs, stands = ArduPilot(one.port, CLIMB), ArduPilot(two.port)
        come(one, two)
        world = World({"one": one, "two": two})
        run(world, 2.0)
        assert one.plant.truth.pos_ned_m[2] < -4.0
        climbs.end()
        run(world, 6.0)
        assert one.plant.hit == "the ground"
        assert not two.plant.crashed
        stands.end()


def test_one_that_asks_for_nothing_is_left_behind_after_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(together, "STALL_S", 0.3)
    said: list[str] = []
    one, two = seat(ArduPilotBridge, []), seat(ArduPilotBridge, said, east_m=5.0)
    with closed(one, two):
        goes_on, stuck = ArduPilot(one.port), ArduPilot(two.port)
        come(one, two)
        world = World({"one": one, "two": two})
        run(world, 0.2)
        stuck.hold()
        run(world, 0.2)
        (line,) = said
        assert line.startswith("its firmware has asked for nothing for 0.3 s after 0.2 s")
        goes_on.end()
        stuck.end()


def test_one_alone_is_waited_for_however_long_it_asks_for_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A debugger may have stopped it."""
    monkeypatch.setattr(together, "STALL_S", 0.0)
    said: list[str] = []
    with closed(one := seat(ArduPilotBridge, said, alone=True)):
        pilot = ArduPilot(one.port)
        come(one)
        world = World({"one": one})
        run(world, 0.2)
        pilot.hold()
        for _ in range(3):
            world.step()
        pilot.go_on()
        run(world, 0.2)
        assert not said
        pilot.end()


def test_those_that_meet_are_told_and_wrecked() -> None:
    """One climbs into another that stands above it."""
    said: list[list[str]] = [[], []]
    low, high = (seat(ArduPilotBridge, said[i], up_m=5.0 * i) for i in range(2))
    with closed(low, high):
        climbs, stands = ArduPilot(low.port, CLIMB), ArduPilot(high.port)
        come(low, high)
        world = World({"low": low, "high": high})
        run(world, 3.0)
        assert (low.plant.hit, high.plant.hit) == ("high", "low")
        assert [line.partition(":")[0] for lines in said for line in lines] == [
            "high is near",
            "low is near",
        ]
        assert len(world.collisions) == 1
        climbs.end()
        stands.end()


def test_the_place_of_a_new_aircraft_is_no_way_that_was_flown() -> None:
    """One has fallen to the east of another, whose home lies between: nobody was hit."""
    said: list[str] = []
    one, two = seat(ArduPilotBridge, said), seat(ArduPilotBridge, [], east_m=5.0)
    with closed(one, two):
        first, stands = ArduPilot(one.port), ArduPilot(two.port)
        come(one, two)
        world = World({"one": one, "two": two})
        run(world, 0.1)
        first.end()
        run(world, 0.2, one, two)
        world._places[0] = [0.0, 10.0, -3.0]  # as if it had got there
        again = ArduPilot(one.port, CLIMB)
        come(one)
        run(world, 0.5)
        assert not world.collisions
        again.end()
        stands.end()


def shared(said: list[str], listen: Callable[[], None] = lambda: None) -> SharedClock:
    """The clock of one of several, whose firmware we start."""
    bridge = ArduPilotBridge(
        Plant(AircraftConfig(physics_hz=RATE_HZ), home=HOME, streams=RandomStreams(1)), port=0
    )
    bridge.open()
    return SharedClock(bridge, listen, number=1, near_m=3.0, say=said.append)


def test_time_is_given_to_all_by_one_and_no_firmware_follows_one_that_has_ended() -> None:
    clock, other = shared([]), seat(ArduPilotBridge, [], east_m=5.0)
    with closed(clock, other):
        one, two = ArduPilot(clock.port, CLIMB), ArduPilot(other.port)
        come(clock, other)
        world = World({"one": clock, "two": other})
        assert not clock.moving
        with clock.going(100_000_000):
            assert clock.moving
            run(world, 0.2)
            assert not clock.moving  # so far only
        with clock.going(speed=2.0):
            assert clock.pace(0.0) == 2.0
            run(world, 2.0)
            one.end()
            run(world, 0.2)
            assert not clock.moving
        assert str(clock.error) == "its firmware has ended"
        assert not clock.look()
        run(world, 6.0)
        assert clock.plant.hit == "the ground"
        heights = [-place[2] for _, place in clock.fall]
        assert heights[0] > 4.0 > 1.0 > heights[-1]
        assert clock.t_ns == other.t_ns == world.t_ns
        two.end()


def test_time_waits_until_telemetry_of_half_a_second_ago_is_read() -> None:
    read: list[int] = []

    def listen() -> None:
        read.append(clock.t_ns)
        if len(read) % 3 == 0:  # it comes late
            clock.heard(clock.t_ns)

    clock = shared([], listen)
    with closed(clock):
        firmware = ArduPilot(clock.port)
        come(clock)
        clock.heard(0)
        until_ns = 2_000_000_000
        while clock.t_ns < until_ns:
            clock.stride(until_ns)
        assert read[0] == 520_000_000
        assert len(read) == 9
        firmware.end()


def test_a_firmware_of_several_that_tells_nothing_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock_module, "STALL_S", 0.1)
    clock = shared([])
    with closed(clock):
        firmware = ArduPilot(clock.port)
        come(clock)
        clock.heard(0)
        while clock.error is None:
            clock.step()
        assert str(clock.error).startswith("no telemetry for 0.1 s: the newest is of t 0.00 s")
        firmware.end()


def test_rest_is_no_time_in_which_a_firmware_asks_for_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A round may be planned for longer than a firmware is waited for."""
    clock = shared([])
    with closed(clock):
        firmware = ArduPilot(clock.port)
        come(clock)
        clock.step()
        firmware.hold()
        until(lambda: not clock.step() or clock._silent_since is not None)
        clock.rest()
        monkeypatch.setattr(together, "STALL_S", 0.0)
        clock.run()
        clock.step()
        assert clock.error is None
        clock.step()
        assert str(clock.error) == "its firmware has asked for nothing for 0 s"
        firmware.end()
