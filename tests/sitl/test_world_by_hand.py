"""A world of aircraft that move evenly: when they meet, what they are told, how time goes on."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flightdyn.frames import LocalFrame
from flightdyn.state import GeodeticPoint
from sitl.world import World

ORIGIN = GeodeticPoint(47.0, 8.0, 488.0)
MS, S = 1_000_000, 1_000_000_000


class Even:
    """A brain and an aircraft that moves evenly, in ticks of 4 ms."""

    def __init__(
        self, home_m: tuple[float, float], at: tuple[float, float, float],
        moves: tuple[float, float, float], *, near_m: float = 0.0, traffic: str = "off",
        waited_for: bool = False,
    ) -> None:  # fmt: skip
        self.near_m, self.traffic, self.waited_for, self.moving = near_m, traffic, waited_for, True
        home = LocalFrame(ORIGIN).to_geodetic(np.array([*home_m, 0.0]))
        self.said: list[str] = []
        self.heard: list[tuple[int, Any]] = []
        self.wrecked: list[tuple[float, str]] = []
        self.t_ns = 0
        self.aircraft: Any = self.another(LocalFrame(home), at, moves)

    def another(self, frame: LocalFrame, at: Any, moves: Any) -> Any:
        return SimpleNamespace(
            frame=frame, pos_ned_m=np.array(at), vel_ned_mps=np.array(moves), dt_ns=4 * MS,
            crashed=False, wreck=self.wreck,
        )  # fmt: skip

    def wreck(self, speed_mps: float, by: str) -> None:
        self.wrecked.append((round(speed_mps, 6), by))
        self.aircraft.crashed, self.aircraft.vel_ned_mps = True, np.zeros(3)

    def step(self) -> bool:
        self.t_ns += 4 * MS
        self.aircraft.pos_ned_m = self.aircraft.pos_ned_m + 0.004 * self.aircraft.vel_ned_mps
        return self.moving

    def stride(self, until_ns: float = math.inf) -> bool:
        while self.t_ns < until_ns:
            self.step()
        return self.moving

    def told(self, text: str, severity: int) -> None:
        self.said.append(f"{severity} {text}")

    def transponder(self, name: str) -> Any:
        return name

    def overhear(self, said: Any) -> None:
        self.heard.append((self.t_ns, said))


def run(world: World, seconds: float) -> list[int]:
    """Let time pass; how far it went at once, in milliseconds."""
    went = []
    while world.t_ns < seconds * S:
        before = world.t_ns
        world.stride()
        went.append((world.t_ns - before) // MS)
    return went


def test_who_comes_near_is_told_and_the_least_distance_is_kept() -> None:
    """One flies 5 m/s to the north, past another 6 m to the side and 8 m higher, over a home that
    is 100 m to the north."""
    one = Even((0.0, 0.0), (0.0, 0.0, -10.0), (5.0, 0.0, 0.0), near_m=26.05)
    two = Even((100.0, 0.0), (0.0, 6.0, -18.0), (0.0, 0.0, 0.0))
    world = World({"one": one, "two": two})
    run(world, 30.0)
    assert one.said == ["4 two is near: 26.0 m at 15.20 s"]
    assert two.said == ["4 one is near: 26.0 m at 15.20 s"]
    (least,) = world.least
    assert least.pair == (0, 1)
    assert least.distance_m == pytest.approx(10.0, abs=2e-3)
    assert least.t_ns == pytest.approx(20 * S, abs=3 * MS)
    assert (least.horizontal_m, least.vertical_m) == pytest.approx((6.0, 8.0), abs=2e-3)
    np.testing.assert_allclose(least.places_ned_m, [(100, 0, -10), (100, 6, -18)], atol=0.02)
    assert [near.pair for near in world.near] == [(0, 1)]
    assert not world.collisions


def test_those_that_meet_wreck_each_other_once_at_their_speed() -> None:
    one = Even((0.0, 0.0), (0.0, 0.0, -10.0), (5.0, 0.0, 0.0))
    two = Even((0.0, 100.0), (80.0, -100.0, -10.0), (-3.0, 0.0, 0.0))
    three = Even((0.0, -50.0), (0.0, 0.0, -10.0), (1.0, 0.0, 0.0))
    world = World({"one": one, "two": two, "three": three})
    run(world, 12.0)
    assert (one.wrecked, two.wrecked) == ([(8.0, "two")], [(8.0, "one")])
    assert not three.wrecked
    ((t_ns, i, j),) = world.collisions
    assert (i, j) == (0, 1)
    # Hulls of 0.754 m touch after (80 - 0.754) / 8 s.
    assert (80 - 0.754) / 8 * S <= t_ns <= (80 - 0.754) / 8 * S + 21 * MS


def test_time_goes_on_by_as_much_as_nobody_can_touch_in() -> None:
    far = Even((0.0, 0.0), (0.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    world = World({"one": far, "two": Even((0.0, 100.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))})
    assert run(world, 2.0) == [1000, 1000]
    world.stride(2.07 * S)  # no tick begins at 2.07 s or later
    assert world.t_ns == 2072 * MS
    world.stride()
    assert world.t_ns == 3 * S  # when transponders speak
    world.step()
    assert world.t_ns == 3020 * MS
    near = World({"one": Even((0.0, 0.0), (0.0, 0.0, -10.0), (0.0, 0.0, 0.0)),
                  "two": Even((0.0, 5.0), (0.0, 0.0, -10.0), (0.0, 0.0, 0.0))})  # fmt: skip
    assert run(near, 1.0) == [500, 500]  # 0.75 m and 2.5 m are less than 5 m, 10 m are not
    slow = Even((0.0, 300.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), waited_for=True)
    waits = World({"one": Even((0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "two": slow})
    assert set(run(waits, 0.2)) == {20}
    for first_ms, second_ms, stands_ms in ((4, 10, 72), (10, 4, 80)):  # by the first one's ticks
        pair = [Even((0.0, 100.0 * i), (0, 0, 0), (0, 0, 0)) for i in range(2)]
        pair[0].aircraft.dt_ns, pair[1].aircraft.dt_ns = first_ms * MS, second_ms * MS
        ticks = World(dict(zip("ab", pair, strict=True)))
        ticks.stride(71 * MS)
        assert ticks.t_ns == stands_ms * MS


def test_one_alone_strides_as_it_asks() -> None:
    alone = Even((0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    world = World({"one": alone})
    world.stride(0.5 * S)
    world.step()
    assert world.t_ns == alone.t_ns == 504 * MS
    assert world.moving
    alone.moving = False
    assert not world.moving
    assert world.least == []


def test_every_second_those_who_listen_hear_all_others() -> None:
    places = ((0.0, 0.0), (0.0, 100.0), (0.0, 200.0))
    kinds = ("off", "adsb", "off")
    flown = [Even(at, (0, 0, 0), (0, 0, 0), traffic=kind)
             for at, kind in zip(places, kinds, strict=True)]  # fmt: skip
    world = World(dict(zip("abc", flown, strict=True)))
    run(world, 2.5)
    times = [S, 2 * S, 3 * S]
    expected = [[(t, other) for t in times for other in others] for others in ("bc", "ac", "ab")]
    assert [one.heard for one in flown] == expected
    silent = [Even(at, (0, 0, 0), (0, 0, 0)) for at in places]
    run(World(dict(zip("abc", silent, strict=True))), 2.0)
    assert not any(one.heard for one in silent)


def test_a_reboot_gives_another_aircraft_whose_time_begins_anew() -> None:
    one = Even((0.0, 0.0), (0.0, 0.0, -10.0), (5.0, 0.0, 0.0))
    two = Even((100.0, 0.0), (0.0, 0.0, -10.0), (0.0, 0.0, 0.0), near_m=5.05)
    world = World({"one": one, "two": two})
    run(world, 2.0)
    two.aircraft = two.another(two.aircraft.frame, (-70.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    two.t_ns = 0
    run(world, 5.0)
    assert (one.t_ns, two.t_ns) == (5 * S, 3 * S)
    run(world, 5.5)
    # It did not fly from its old place to the new one: 30 m from home, the other is there at 5 s.
    assert two.said == ["4 one is near: 5.0 m at 5.00 s"]


def test_what_comes_from_a_reboot_begins_at_rest() -> None:
    """Its motion begins where it stands: no nearer than the 10 m that it stays away."""
    one = Even((0.0, 0.0), (0.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    two = Even((0.0, 100.0), (0.0, 0.0, -10.0), (4.0, -4.0, 2.0))
    world = World({"one": one, "two": two})
    run(world, 1.0)
    two.aircraft = two.another(two.aircraft.frame, (0.0, -110.0, -10.0), (0.0, 0.0, 0.0))
    two.t_ns = 0
    run(world, 2.0)
    (least,) = world.least
    assert least.distance_m == pytest.approx(10.0, abs=1e-3)
