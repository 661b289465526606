"""What the pilot says of a refused order: the vehicle's own words about that order, no others."""

import asyncio
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from mavsdk.asyncio import System
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.telemetry import FlightMode
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav

from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import FlightError, LinkLostError
from mission.config.link import LinkConfig
from mission.flight.flyers.external import left_holding
from mission.flight.missions.round_mission import FlightPlan, mission_items
from mission.flight.pilot.connection import connect, located
from mission.flight.pilot.dialects import (
    ARDUPILOT,
    PX4,
    Dialect,
    as_dialect,
    raw_items,
    same_mission,
)
from mission.flight.pilot.pilot import MODE_GRACE_S, Pilot
from mission.flight.pilot.watch import Watch
from mission.log import LogError
from mission.planner.flyable import Stop
from sitl.config import VehicleConfig
from sitl.links import RawLink
from sitl.observer import VehicleEvent, VehicleSample
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

HOME = GeodeticPoint(43.6145, 7.0715, 130.0)
AREA = Area.at((800.0, 800.0), (400.0, 400.0), HOME)
OLDER = "Set current item refused: mission has 0 items, no item 99"


class TextsComeLate(RawLink):
    """Status texts arrive `delay_s` after everything else; None: never again."""

    def __init__(self) -> None:
        super().__init__()
        self.delay_s: float | None = 0.0

    def send(self, frames: Sequence[bytes], to: Any = None) -> None:
        texts = [f for f in frames if int.from_bytes(f[7:10], "little") == 253]
        super().send([frame for frame in frames if frame not in texts], to)
        if texts and self.delay_s is not None:
            asyncio.get_running_loop().call_later(self.delay_s, super().send, texts, to)


async def heard(pilot: Pilot, text: str) -> None:
    async with asyncio.timeout(HANG_S):
        while pilot.watch.last_warning != text:  # noqa: ASYNC110  in threads of MAVSDK's
            await asyncio.sleep(0.01)


@pytest.mark.parametrize(
    ("delay_s", "words"),
    [
        (0.0, " (it said: DO_SET_MODE refused: on the ground)"),
        (0.3, " (it said: DO_SET_MODE refused: on the ground)"),
        (None, ""),
    ],
)
def test_a_refusal_is_not_blamed_on_an_older_warning(delay_s: float | None, words: str) -> None:
    async def run() -> str:
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        link = TextsComeLate()
        async with Simulation(vehicle, link), connect(link) as pilot:
            await pilot.ready()
            station = mav.MAVLink(None, srcSystem=250, srcComponent=190)
            link.feed(bytes(mav.MAVLink_mission_set_current_message(1, 1, 99).pack(station)))
            await heard(pilot, OLDER)
            await pilot.arm()
            link.delay_s = delay_s
            with pytest.raises(FlightError) as refusal:
                await pilot.land()
            return str(refusal.value)

    assert asyncio.run(run()) == f"the vehicle did not return and land: COMMAND_DENIED{words}"


class FallsQuiet(RawLink):
    """Heartbeats and home positions, on which MAVSDK tells of health, may stay away."""

    quiet = False

    def send(self, frames: Sequence[bytes], to: Any = None) -> None:
        told = (0, 242) if self.quiet else ()
        super().send([f for f in frames if int.from_bytes(f[7:10], "little") not in told], to)


def test_readiness_does_not_wait_for_the_next_heartbeat() -> None:
    async def run() -> bool:
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        link = FallsQuiet()
        async with Simulation(vehicle, link), connect(link) as pilot:
            link.quiet = True
            await pilot.ready()
            return pilot.watch.armable

    assert asyncio.run(run())


# The vehicle leaves its mission, and goes on to other modes.
MODES = ("HOLD", "MISSION", "RETURN_TO_LAUNCH", "LAND", "HOLD")


@pytest.mark.parametrize(
    ("said", "ago_s", "why"),
    [
        ("Battery low", 0.0, "Battery low"),
        ("Battery low", 60.0, ""),
        ("Preflight Fail: High Accelerometer Bias", 0.0, ""),
        ("PreArm: Compasses inconsistent", 0.0, ""),
    ],
)
def test_the_mode_for_which_a_mission_is_left_is_kept_with_what_may_be_the_reason(
    monkeypatch: pytest.MonkeyPatch, said: str, ago_s: float, why: str
) -> None:
    monkeypatch.setattr("mission.flight.pilot.watch.TelemetryAsync", lambda _: None)

    async def run() -> tuple[FlightMode, str] | None:
        watch = Watch(cast("System", None))
        watch._warned(said)
        watch._warned_at -= ago_s
        for name in MODES:
            watch._take_mode(FlightMode[name])
        return watch.left_mission

    assert asyncio.run(run()) == (FlightMode.RETURN_TO_LAUNCH, why)


Worse = Callable[[Pilot], None]


def says_too_early_that_it_is_over(pilot: Pilot) -> None:
    """As a vehicle whose word of the mission before is still under way, and of its mode."""
    start, finished = pilot._mission.start_mission, pilot._mission_finished

    async def slow() -> None:
        await start()
        pilot.watch.mode = FlightMode.HOLD

    async def too_early() -> bool:
        return pilot.mode != "MISSION" or await finished()

    pilot._mission.start_mission = slow
    pilot._mission_finished = too_early  # type: ignore[method-assign]


def refuses_to_start_twice(pilot: Pilot) -> None:
    """As PX4 does until its checks have seen a mission."""
    mission, refusals = pilot._mission, iter(("DENIED", "DENIED"))
    start = mission.start_mission

    async def refusing() -> None:
        for refusal in refusals:
            raise MavsdkError(refusal)
        await start()

    mission.start_mission = refusing


@pytest.mark.parametrize("worse", [says_too_early_that_it_is_over, refuses_to_start_twice])
def test_a_mission_is_flown_to_its_end(worse: Worse) -> None:
    async def east_m() -> float:
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        stops = (Stop(np.array([400.0, 400.0]), ()), Stop(np.array([500.0, 400.0]), ()))
        plan = FlightPlan(stops, 20.0, 15.0, 5.0)
        link = RawLink()
        async with Simulation(vehicle, link), connect(link) as pilot:
            await pilot.ready()
            await pilot.take_off(plan.alt_rel_m)
            await pilot.upload_items(mission_items(plan, AREA))
            worse(pilot)
            await pilot.fly()
            return float(vehicle.aircraft.truth.pos_ned_m[1])

    assert asyncio.run(east_m()) == pytest.approx(100.0, abs=5.0)


def test_a_mission_that_may_be_on_board_already_is_begun_anew() -> None:
    """PX4 goes on where it was with a mission that it holds unchanged."""

    async def rewound() -> list[int]:
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        link, orders = RawLink(), list[int]()
        stop, other = (Stop(np.array([400.0, north]), ()) for north in (400.0, 500.0))
        one, two = (FlightPlan(stops, 20.0, 15.0, 5.0) for stops in ((stop, stop), (stop, other)))
        async with Simulation(vehicle, link), connect(link) as pilot:
            await pilot.ready()
            order = pilot._mission.set_current_mission_item

            async def noted(seq: int) -> None:
                orders.append(seq)
                await order(seq)

            pilot._mission.set_current_mission_item = noted
            counts = []
            for plan in (one, one, two, one):
                await pilot.upload_items(mission_items(plan, AREA))
                counts.append(len(orders))
            return counts

    assert asyncio.run(rewound()) == [1, 2, 2, 2]


class Ticks:
    """A clock that goes on by a second each time that somebody looks."""

    now_s = 0.0

    def __call__(self) -> float:
        self.now_s += 1.0
        return self.now_s


def test_a_mission_that_was_over_at_once_costs_two_seconds_of_the_vehicles_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And as many hovers, however fast its time goes: nobody saw it in mission mode."""

    async def at_once(_: Pilot) -> bool:
        return True

    async def taken(_: Pilot) -> None: ...

    monkeypatch.setattr(Pilot, "_mission_finished", at_once)
    monkeypatch.setattr(Pilot, "_start", taken)

    async def run() -> float:
        link, clock = RawLink(), Ticks()
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        async with Simulation(vehicle, link), connect(link) as pilot:
            pilot.clock = clock
            await pilot.carry_out()
        return clock.now_s

    assert asyncio.run(run()) == MODE_GRACE_S + 2.0  # the first look, and the first beyond


class Orders(RawLink):
    """What MAVSDK sends, with whether somebody waits meanwhile."""

    def __init__(self) -> None:
        super().__init__()
        self.waits = False
        self.heard: list[tuple[str, bool]] = []
        self._parser = mav.MAVLink(None)

    def feed(self, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or ():
            self.heard.append((str(getattr(message, "command", message.get_type())), self.waits))
        super().feed(data)

    @contextmanager
    def giving(self) -> Iterator[None]:
        self.waits = True
        try:
            yield
        finally:
            self.waits = False


@pytest.mark.slow
def test_a_vehicle_whose_time_is_ours_may_wait_for_each_order() -> None:
    async def heard() -> list[tuple[str, bool]]:
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        stops = (Stop(np.array([400.0, 400.0]), ()), Stop(np.array([410.0, 400.0]), ()))
        plan = FlightPlan(stops, 20.0, 15.0, 5.0)
        link = Orders()
        async with Simulation(vehicle, link), connect(link) as pilot:
            await pilot.ready()
            pilot.giving = link.giving
            await pilot.take_off(plan.alt_rel_m)
            await pilot.upload_items(mission_items(plan, AREA))
            await pilot.fly()
            await pilot.hold()
            await pilot.land()
        return link.heard

    orders = {
        *(mav.MAV_CMD_COMPONENT_ARM_DISARM, mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_DO_SET_MODE),
        *("MISSION_COUNT", "MISSION_REQUEST_LIST"),
    }
    found = [one for one in asyncio.run(heard()) if one[0] in set(map(str, orders))]
    assert {name for name, _ in found} == set(map(str, orders))
    assert all(waits for _, waits in found), found


class FullDisk:
    """A log that cannot be written any more."""

    def sampled(self, _: VehicleSample) -> None:
        raise LogError(Path("flight.mcap"), "No space left on device")

    def happened(self, _: VehicleEvent) -> None: ...


def test_a_log_that_cannot_be_written_ends_a_flight_that_is_watched() -> None:
    async def run() -> None:
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1))
        config, link = LinkConfig(kind="external", url="udpin://127.0.0.1:1"), RawLink()
        async with (
            asyncio.timeout(HANG_S),
            Simulation(vehicle, link, speed=5.0, runs="always"),
            located(config, area=AREA, observers=[FullDisk()], say=print, raw_link=link),
        ):
            await asyncio.Event().wait()

    with pytest.raises(LogError, match="No space left"):
        asyncio.run(run())


def test_an_error_over_what_the_vehicle_says_ends_the_flight() -> None:
    def full(*_: object) -> None:
        raise LogError(Path("flight.mcap"), "No space left on device")

    async def run() -> None:
        vehicle, link = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1)), RawLink()
        async with (
            asyncio.timeout(HANG_S),
            Simulation(vehicle, link),
            connect(link) as pilot,
        ):
            await pilot.ready()
            pilot.watch.listeners.append(full)
            station = mav.MAVLink(None, srcSystem=250, srcComponent=190)
            link.feed(bytes(mav.MAVLink_mission_set_current_message(1, 1, 99).pack(station)))
            await asyncio.Event().wait()

    with pytest.raises(LogError, match="No space left"):
        asyncio.run(run())


class Ordered:
    """A pilot in the air that remembers whether it was told to hold."""

    armed, held = True, False

    async def hold(self) -> None:
        self.held = True


@pytest.mark.parametrize(
    ("error", "held"),
    [
        (ZeroDivisionError(), True),
        (asyncio.CancelledError(), True),
        (FlightError("it drifted off"), True),
        (LinkLostError("nobody hears"), False),
    ],
)
def test_whatever_ends_a_flight_leaves_the_vehicle_holding(
    error: BaseException, held: bool
) -> None:
    pilot = Ordered()

    async def run() -> None:
        with pytest.raises(type(error)):
            async with left_holding(cast(Pilot, pilot)):
                raise error

    asyncio.run(run())
    assert pilot.held == held


@pytest.mark.parametrize("dialect", [PX4, ARDUPILOT])
def test_a_mission_that_came_back_with_another_hover_is_another(dialect: Dialect) -> None:
    places = np.array([[400.0, 400.0], [500.0, 400.0]])
    plan = FlightPlan(tuple(Stop(xy, (), hold_s=100.0005) for xy in places), 20.0, 15.0, 5.0)
    sent = as_dialect(raw_items(mission_items(plan, AREA)), dialect)
    sent[-1].param2 = math.nan  # the vehicle's own radius
    back = [copy(item) for item in sent]
    for item in back:  # as it travels
        item.param1 = float(np.float32(item.param1))
    back[-1].param2 = 0.0
    assert same_mission(sent, back, dialect)
    back[-1].param1 = 0.0
    assert not same_mission(sent, back, dialect)
