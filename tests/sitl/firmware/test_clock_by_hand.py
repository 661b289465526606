"""Simulated time of a firmware that asks for every tick, in a wall time of our own."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from firmware_stand_ins import plant

from native.errors import FirmwareRestartedError, FirmwareSilentError
from sitl.firmware import clock as clock_module
from sitl.firmware import together as together_module
from sitl.firmware.bridge import STALL_S, Bridge
from sitl.firmware.clock import SharedClock
from sitl.firmware.native.library import TruthRing
from sitl.firmware.together import Bridged

MS = 1_000_000


class Asks:
    """A bridge whose firmware asks for `gives` ticks at once at most."""

    def __init__(self, gives: int = 10**9) -> None:
        self.plant, self.gives = plant(), gives
        self.truths = TruthRing(self.plant)
        self.connected, self.calls, self.gone, self.port = False, True, False, 4560
        self.asked: list[int] = []
        self.closed = self.rests = 0
        self.fails: Exception | None = None

    def run(self, ticks: int) -> int:
        self.asked.append(ticks)
        if self.fails is not None:
            raise self.fails
        done = min(ticks, self.gives)
        self.plant.clock.tick += done
        return done

    def called(self) -> bool:
        return self.calls

    def rest(self) -> None:
        self.rests += 1
        self.connected = True

    def deserted(self) -> bool:
        return self.gone

    def close(self) -> None:
        self.closed += 1


class Wall:
    """Wall time that goes on by what is slept."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        told = SimpleNamespace(monotonic=lambda: self.now_s, sleep=self.sleep)
        monkeypatch.setattr(clock_module, "time", told)
        monkeypatch.setattr(together_module, "time", told)

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    return Wall(monkeypatch)


def shared(bridge: Asks, said: list[str] | None = None, **more: Any) -> SharedClock:
    words = [] if said is None else said
    made = SharedClock(
        cast(Bridge, bridge), more.pop("listen", lambda: None), number=2, near_m=4.0,
        say=words.append, **more,
    )  # fmt: skip
    assert made.look()
    return made


def test_time_is_given_up_to_an_instant_and_taken_back(wall: Wall) -> None:
    clock = shared(Asks())
    wakes: list[int] = []
    clock.wake = lambda: wakes.append(clock.t_ns)
    assert not clock.moving
    clock.run(40 * MS)
    assert clock.moving
    clock.step()
    assert (clock.t_ns, clock.moving) == (20 * MS, True)
    clock.step()
    assert (clock.t_ns, clock.moving) == (40 * MS, False)  # it stands at the instant
    clock.run()
    assert clock.moving
    clock.rest()
    assert not clock.moving
    with clock.going(60 * MS, speed=2.0):
        assert (clock.moving, clock.pace(wall.now_s)) == (True, 2.0)
        with clock.going(speed=8.0):
            assert clock.pace(wall.now_s) == 2.0
        assert clock.moving
        clock.step()
        assert not clock.moving
    assert not clock.moving
    assert clock.pace(wall.now_s) == math.inf
    assert wakes == [0, 40 * MS, 40 * MS, 40 * MS]


def test_who_is_answered_has_time_at_wall_pace(wall: Wall) -> None:
    for speed, slow in ((math.inf, 1.0), (8.0, 1.0), (0.25, 0.25)):
        clock = shared(Asks(), speed=speed)
        assert clock.pace(wall.now_s) == speed
        clock.cap_at_wall_pace(0.5)
        assert clock.pace(wall.now_s) == clock.pace(wall.now_s + 0.49) == slow
        assert clock.pace(wall.now_s + 0.5) == speed


def test_time_is_half_a_second_ahead_of_what_was_heard_at_most(wall: Wall) -> None:
    """It listens each millisecond, and gives up after a stall."""
    heard = iter((None, None, 700 * MS))

    def listen() -> None:
        if t_ns := next(heard, None):
            clock.heard(t_ns)

    clock = shared(Asks(), listen=listen)
    clock.heard(120 * MS)
    clock.heard(100 * MS)  # is older
    while clock.t_ns < 620 * MS:
        clock.step()
    assert wall.now_s == 100.0
    clock.stride(640 * MS)  # 620 is not more than half a second ahead, 640 is
    assert (clock.t_ns, wall.now_s) == (640 * MS, 100.0)
    clock.step()
    assert (clock.t_ns, round(wall.now_s - 100.0, 6)) == (660 * MS, 0.003)
    while clock.there:
        clock.step()
    assert clock.t_ns == 1240 * MS
    stall_s = STALL_S
    assert wall.now_s - 100.003 == pytest.approx(stall_s, abs=0.0025)
    assert isinstance(clock.error, FirmwareSilentError)
    assert str(clock.error) == (
        f"no telemetry for {stall_s:g} s: the newest is of t 0.70 s, and time waits for more at "
        "1.22 s"
    )
    assert [t_ns for t_ns, _ in clock.fall] == [1240 * MS]
    assert not clock.look()


def test_a_battery_is_exchanged_for_a_fresh_one() -> None:
    bridge = Asks()
    bridge.plant.vehicle.drive((0.9,) * 4)
    for _ in range(100):
        bridge.plant.step()
    clock = shared(bridge)
    assert bridge.plant.battery.remaining < 1.0
    clock.exchange_battery()
    assert bridge.plant.battery.remaining == 1.0


def test_a_firmware_that_starts_anew_has_ended_for_good() -> None:
    bridge = Asks()
    clock = shared(bridge)
    clock.run()
    bridge.fails = FirmwareRestartedError("anew")
    clock.step()
    assert (clock.error, clock.there, clock.moving) == (bridge.fails, False, False)
    assert bridge.closed >= 1


def test_another_firmware_is_awaited_where_somebody_else_starts_it(wall: Wall) -> None:
    made = [Asks(), Asks(gives=3), Asks()]
    waiting, said = iter(made), list[str]()
    seat = Bridged(3, lambda: cast(Bridge, next(waiting)), near_m=2.0, say=said.append)
    made[0].calls = False
    assert not seat.look()
    assert seat.moving  # time is to go on for one that nobody flies
    assert (made[0].rests, seat.port) == (0, 4560)
    for _ in range(3):
        seat.plant.clock.tick += 5
    made[0].calls = True
    assert seat.look()
    assert (seat.there, seat.began_ns) == (True, 60 * MS)
    assert seat.stride(seat.t_ns + 9 * MS)  # no tick begins after that
    seat.stride(seat.t_ns + 10**9)
    seat.stride()
    seat.step()
    assert made[0].asked == [3, 5, 5, 5]
    made[0].gone = True  # which is not asked while it goes on
    seat.step()
    assert seat.there
    made[0].gives = 0
    seat.step()
    assert not seat.there
    assert said == ["its firmware has ended after 0.2 s: its motors are off until one comes again"]
    assert seat.look()
    assert seat.plant is made[1].plant
    assert (seat.t_ns, seat.began_ns) == (0, 60 * MS + made[0].plant.t_ns)
    made[1].gives = 0
    stall_s = STALL_S
    for waits_s in (0.0, stall_s):
        wall.now_s += waits_s
        seat.step()
        assert seat.there
    made[1].gives = 1
    seat.step()
    made[1].gives = 0
    for waits_s in (0.0, stall_s):  # from anew
        wall.now_s += waits_s
        seat.step()
        assert seat.there
    wall.now_s += 0.01
    seat.step()
    assert not seat.there
    assert said[1:] == [
        f"its firmware has asked for nothing for {stall_s:g} s after 0.0 s: its motors are off "
        "until one comes again"
    ]


def test_one_alone_has_many_ticks_at_once_and_is_waited_for(wall: Wall) -> None:
    bridge = Asks()
    seat = Bridged(1, lambda: cast(Bridge, bridge), near_m=0.0, say=lambda _: None, alone=True)
    assert seat.look()
    seat.stride()
    seat.stride(seat.t_ns + 30 * MS)
    assert bridge.asked == [1000, 8]
    bridge.gives = 0
    for _ in range(3):
        seat.step()
        wall.now_s += 1e6
    assert seat.there


def test_what_it_tells_others_is_its_truth() -> None:
    bridge = Asks()
    seat = Bridged(7, lambda: cast(Bridge, bridge), near_m=2.0, say=lambda _: None)
    for height_m, airborne in ((0.2, False), (0.21, True), (35.5, True)):
        truth = SimpleNamespace(
            pos_ned_m=np.array([100.0, -50.0, -height_m]), vel_ned_mps=np.array([1.0, 2.0, -3.0])
        )
        frame = seat.plant.frame
        seat.plant = cast(Any, SimpleNamespace(truth=truth, frame=frame))
        said = seat.transponder("north")
        assert (said.name, said.system) == ("north", 7)
        assert said.place.alt_msl_m == pytest.approx(frame.origin.alt_msl_m + height_m, abs=0.01)
        there = frame.to_ned(said.place.lat_deg, said.place.lon_deg, said.place.alt_msl_m)
        assert there[:2].tolist() == pytest.approx([100.0, -50.0], abs=1e-3)
        assert (said.height_m, said.airborne) == (height_m, airborne)
        assert said.vel_ned_mps.tolist() == [1.0, 2.0, -3.0]
