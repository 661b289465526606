"""What an external vehicle is ordered and when, and what is said of its battery, without one."""

import asyncio
import math
from collections.abc import Callable
from contextlib import nullcontext
from copy import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from mavsdk.exceptions import MavsdkError

from flightdyn.config import LimitsConfig
from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import FlightError, LinkLostError
from mission.commands.options import load
from mission.flight.flyers.external import ExternalFlyer, limits_of
from mission.flight.flyers.firmware import FirmwareFlyer, Milestones
from mission.flight.missions.plan_file import PlanFile
from mission.flight.missions.round_mission import Demand, FlightPlan
from mission.flight.pilot.dialects import ARDUPILOT, PX4, Dialect
from mission.flight.pilot.pilot import Pilot
from mission.flight.track import FlightRecorder, FlownTrack, TrackPoint
from mission.planner.flyable import Stop
from sitl.autopilot.codec.orders import MissionItem

S = 1_000_000_000
HOME = GeodeticPoint(47.0, 8.0, 500.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME)
CONFIG = load(None, ())


class Vehicle:
    """Does what it is ordered at once, and notes it; its pilot, its telemetry, and its clock."""

    def __init__(self, *, reserve: float = 0.3, readings: tuple[float, ...] = (1.0,)) -> None:
        self.log: list[Any] = []
        self.said: list[str] = []
        self.now_s, self.readings, self.passed = 0.0, list(readings), list[int]()
        self.here_m = [0.0, 0.0, 0.0]
        self.pilot: Any = SimpleNamespace(
            armed=False, watch=SimpleNamespace(armable=True, last_warning=""),
            clock=lambda: self.now_s, until=self._until, dialect=ARDUPILOT,
            **{name: self._order(name) for name in (
                "upload_items", "upload_fence", "upload_surroundings", "take_off", "arm", "land",
                "carry_out", "fly",
            )},
        )  # fmt: skip
        self.feed: Any = SimpleNamespace(
            readiness=SimpleNamespace(missing=""), battery=SimpleNamespace(doubt=""),
            reached_ns={}, passed=lambda seq, _: self.passed.append(seq), ask=self._order("ask"),
            note=self.log.append,
        )  # fmt: skip
        made = self

        class Feed(SimpleNamespace):
            @property
            def battery_remaining(self) -> float:
                return made.readings[0]

            @property
            def here(self) -> TrackPoint | None:
                at = np.array(made.here_m)
                made.now_s += 1.0
                return TrackPoint(round(made.now_s * S), at, at)

        self.feed = Feed(**vars(self.feed))
        mission = CONFIG.mission.model_copy(update={"battery_reserve": reserve})
        link = CONFIG.link.model_copy(update={"battery_timeout_s": 0.05})
        self.flyer = ExternalFlyer(
            cast("Any", self.pilot), self.feed, FlightRecorder(),
            AREA, mission, LimitsConfig(), link,
            self.said.append,
        )  # fmt: skip

    def _order(self, name: str) -> Callable[..., Any]:
        async def order(*given: Any, **named: Any) -> None:
            self.log.append((name, *(given if name in ("take_off",) else ()), *named.items()))
            if name == "upload_items":
                self.items = list(given[0])
            if len(self.readings) > 1:
                self.readings.pop(0)

        return order

    async def _until(self, met: Callable[[], bool], what: str) -> None:
        for _ in range(99):
            if met():
                self.log.append(f"until {what}")
                return
            self.now_s += 1.0
        raise AssertionError(what)

    @property
    def ordered(self) -> list[str]:
        return [entry[0] for entry in self.log if isinstance(entry, tuple)]


def item(seq: int, command: int, north_m: float = 0.0, z: float = 20.0) -> MissionItem:
    at = AREA.frame.to_geodetic(np.array([north_m, 0.0, 0.0]))
    return MissionItem(seq, command, 3, (0.0, 0.0, 0.0, 0.0), at.lat_deg, at.lon_deg, z)


@pytest.mark.parametrize(
    ("commands", "ordered"),
    [
        ((22, 16, 20), ["upload_surroundings", "upload_items", "arm", "carry_out", "land"]),
        ((22, 16, 21), ["upload_surroundings", "upload_items", "arm", "carry_out"]),
        ((16, 16, 20), ["upload_surroundings", "upload_items", "take_off", "carry_out", "land"]),
    ],
)
def test_a_plan_is_uploaded_without_its_return_and_armed_or_taken_off(
    commands: tuple[int, ...], ordered: list[str]
) -> None:
    vehicle, begun = Vehicle(), list[int]()
    plan = PlanFile(Path("x"), b"", HOME, tuple(item(n, c) for n, c in enumerate(commands)))
    places = [(n, np.array([0.0, 0.0, -35.0])) for n in (0, 1)]
    path: Any = SimpleNamespace(places=places)
    vehicle.here_m = [0.0, 19.0, -20.0]
    asyncio.run(vehicle.flyer.carry_out(plan, path, begins=lambda: begun.append(len(vehicle.log))))
    assert vehicle.ordered == ordered
    assert [each.command for each in vehicle.items] == [c for c in commands if c != 20]
    assert ("carry_out", ("lands", commands[-1] == 21)) in vehicle.log
    if commands[0] == 16:
        assert ("take_off", 35.0) in vehicle.log
    assert begun == [3]  # once it is in the air, or may be
    assert vehicle.passed == [0, 1]
    vehicle.here_m = [0.0, 21.0, -20.0]
    with pytest.raises(FlightError, match="21 m short of its end"):
        asyncio.run(vehicle.flyer.carry_out(plan, path, begins=lambda: None))


def test_a_vehicle_that_is_armed_is_left_alone() -> None:
    vehicle = Vehicle()
    vehicle.pilot.armed = True
    with pytest.raises(FlightError, match="armed already: land and disarm it first"):
        asyncio.run(vehicle.flyer.set_fence([]))
    assert vehicle.log == []


@pytest.mark.parametrize(
    ("reserve", "readings", "ordered"),
    [
        (0.0, (0.0,), ["take_off"]), (0.3, (0.3,), ["take_off"]),
        (0.3, (0.29, 0.64, 0.65), ["ask", "ask", "take_off"]),
        (0.9, (0.89, 0.94, 0.95), ["ask", "ask", "take_off"]),  # at most 95 %
    ],
)  # fmt: skip
def test_no_take_off_before_half_of_what_is_missing_is_charged(
    reserve: float, readings: tuple[float, ...], ordered: list[str], monkeypatch: Any
) -> None:
    monkeypatch.setattr("mission.flight.flyers.external.ASK_AGAIN_S", 0.0)
    monkeypatch.setattr("mission.flight.flyers.external.CHARGED", 0.95)
    vehicle = Vehicle(reserve=reserve, readings=readings)
    vehicle.flyer.link = CONFIG.link
    asyncio.run(vehicle.flyer.take_off())
    assert vehicle.ordered == ordered
    assert ("until tell how full its battery is" in vehicle.log) is (reserve > 0.0)
    assert vehicle.said == ([] if len(readings) == 1 else [
        f"battery at {100 * readings[0]:.0f} %, {100 * reserve:.0f} % are needed "
        f"(mission.battery_reserve is {100 * reserve:.0f} %): no take-off before it is charged"
    ])  # fmt: skip


def test_an_empty_battery_that_nobody_charges_ends_the_flight(monkeypatch: Any) -> None:
    monkeypatch.setattr("mission.flight.flyers.external.ASK_AGAIN_S", 0.01)
    vehicle = Vehicle(reserve=0.7, readings=(0.6,))
    with pytest.raises(FlightError) as ended:
        asyncio.run(vehicle.flyer.take_off())
    assert str(ended.value) == (
        "the battery reads 60 % after 0.05 s on the ground (link.battery_timeout_s); a flight "
        "needs 85 %; the vehicle stands on the ground, motors off"
    )


def test_a_first_reading_is_waited_for_three_seconds_of_the_vehicles() -> None:
    vehicle = Vehicle(reserve=0.3, readings=(math.nan,))
    asyncio.run(vehicle.flyer.take_off())
    assert vehicle.log[0] == "until tell how full its battery is"
    assert 3.0 < vehicle.now_s <= 5.0
    assert vehicle.ordered == ["take_off"]  # an unknown charge is not below any


def test_what_is_no_use_of_a_battery_is_said_once() -> None:
    vehicle = Vehicle(reserve=0.25)
    assert asyncio.run(vehicle.flyer.refresh(0.3)) is False
    assert vehicle.said == []
    vehicle.feed.battery.doubt = "it never changes"
    for _ in range(2):
        asyncio.run(vehicle.flyer.refresh(0.3))
    assert vehicle.said == ["it never changes: mission.battery_reserve = 0.25 cannot be kept"]
    careless = Vehicle(reserve=0.0)
    careless.feed.battery.doubt = "it never changes"
    asyncio.run(careless.flyer.refresh(0.0))
    assert careless.said == []


def test_a_stop_alone_is_no_mission() -> None:
    vehicle = Vehicle()
    stop = Stop(np.array([100.0, 50.0]), (0,), 3.0)
    standing = FlightPlan((Stop(np.array([100.0, 50.0]), (0,)),), 60.0, 20.0, 5.0)
    waiting = FlightPlan((stop,), 60.0, 20.0, 5.0, is_part=True)

    async def flown() -> tuple[FlownTrack, FlownTrack]:
        await vehicle.flyer.upload(standing)
        await vehicle.flyer.upload(waiting)
        return await vehicle.flyer.fly(standing), await vehicle.flyer.fly(waiting)

    stood, waited = asyncio.run(flown())
    assert vehicle.ordered == []
    assert (stood.energy_j, stood.battery_remaining) == (0.0, 1.0)
    assert 3.0 <= waited.duration_s <= 6.0  # each look takes a second here
    (passage,) = waited.passages
    assert passage is not None
    assert passage.t_ns == waited.t_ns[0]


def test_before_it_says_where_it_is_it_is_lost() -> None:
    vehicle = Vehicle()
    flyer = vehicle.flyer
    flyer.feed = SimpleNamespace(here=None)  # type: ignore[assignment]  # all that is asked for
    with pytest.raises(LinkLostError, match="has not said yet where it is"):
        flyer.here()


@pytest.mark.parametrize("adjusted", [False, True])
def test_limits_of_a_vehicle_are_logged_and_what_it_will_not_do_is_said(adjusted: bool) -> None:
    vehicle = Vehicle()
    table = {"WPNAV_SPEED": 1000.0, "WPNAV_RADIUS": 800.0}

    async def get(name: str) -> float | None:
        return table.get(name)

    async def version() -> str:
        return "4.5.1"

    vehicle.pilot.parameters, vehicle.pilot.version = SimpleNamespace(get=get), version
    demand = Demand(20.0, 60.0, 500.0, 5.0)
    found = asyncio.run(
        limits_of(vehicle.pilot, vehicle.feed, demand, adjusted=adjusted, say=vehicle.said.append)
    )
    assert found.value("acceptance_m", otherwise=0.0) == 8.0
    assert vehicle.log == [
        "autopilot: ArduPilot 4.5.1",
        "parameter WPNAV_SPEED = 1000",
        "parameter WPNAV_RADIUS = 800",
    ]
    if adjusted:
        assert vehicle.said == []
    else:
        (words,) = vehicle.said
        assert words.startswith("the vehicle will not fly as asked: corners cut by up to 8 m")


def test_faults_may_begin_when_it_is_armed_half_a_metre_up_or_at_an_item() -> None:
    happened: list[Any] = []
    plant: Any = SimpleNamespace(faults=SimpleNamespace(happened=happened.append))
    watch = Milestones(plant)

    def seen(armed: bool, height_m: float) -> Any:
        return SimpleNamespace(armed=armed, truth=SimpleNamespace(alt_rel_m=height_m))

    watch.sampled(seen(False, 0.5))
    assert happened == []
    watch.sampled(seen(True, 0.5))
    assert happened == ["arming"]
    watch.sampled(seen(False, 0.51))
    assert happened == ["arming", "take-off"]
    events: list[Any] = [SimpleNamespace(seq=None), SimpleNamespace(seq=0)]
    for event in events:
        watch.happened(event)
    assert happened[2:] == [0]


def test_a_firmware_that_is_lost_has_its_fall_in_its_flight() -> None:
    """Of its stops those that it said; and no error of what others believe of it."""
    track = FlownTrack(np.array([S, 2 * S]), np.zeros((2, 3)), np.ones((2, 3)), 0.5)
    fall = [(3 * S, np.array([0.0, 0.0, -5.0])), (4 * S, np.array([0.0, 0.0, 0.0]))]
    flyer: Any = SimpleNamespace(
        recorder=SimpleNamespace(finish=lambda *_: track), here=lambda: None,
        battery_remaining=0.5, _own=None, lost=FlightError("dead"), area=AREA,
        feed=SimpleNamespace(reached_ns={0: [S]}), vehicle=SimpleNamespace(
            clock=SimpleNamespace(fall=fall)
        ),
        find_passages=lambda flight, stops, items, hold_s: tuple(
            (len(flight.t_ns), stop.tolist(), seq, hold)
            for stop, seq, hold in zip(stops, items, hold_s, strict=True)
        ),
    )  # fmt: skip
    flyer._fallen = lambda flight: FirmwareFlyer._fallen(flyer, flight)
    stops = tuple(Stop(np.array([100.0, 50.0 + n]), (n,), float(n)) for n in range(3))
    plan = FlightPlan(stops, 60.0, 20.0, 5.0)
    found = FirmwareFlyer.end(flyer, plan)
    assert found.t_ns.tolist() == [S, 2 * S, 3 * S, 4 * S]
    assert found.true_ned_m[:, 2].tolist() == [0.0, 0.0, -5.0, 0.0]
    assert found.est_ned_m[:, 2].tolist() == [1.0, 1.0, -5.0, 0.0]
    assert found.passages == ((4, [0.0, 0.0, -60.0], 0, 0.0), None, None)
    flyer.lost, flyer._own = None, FlownTrack(
        np.array([0, S]), np.zeros((2, 3)), np.zeros((2, 3)), 0.9, (None,), 3.0
    )  # fmt: skip
    whole = FirmwareFlyer.end(flyer, plan)
    assert whole.t_ns.tolist() == [0, S, 2 * S]
    assert (whole.passages, whole.battery_remaining) == ((None,), 0.5)


class Uploads:
    """What `Pilot.upload_items` needs: takes a mission after so many failures, and may alter it."""

    def __init__(self, dialect: Dialect, *, fails: int = 0, alters: bool = False) -> None:
        self.log, self.fails, self.alters = list[str](), fails, alters
        self.dialect, self.giving, self._held = dialect, nullcontext, list[Any]()
        self.watch = SimpleNamespace(order_given=lambda: self.log.append("forget"))
        self._mission = SimpleNamespace(
            upload_mission=self._upload, download_mission=self._download,
            set_current_mission_item=lambda number: number,
        )  # fmt: skip

    async def _upload(self, items: list[Any]) -> None:
        self.log.append("upload")
        if self.fails:
            self.fails -= 1
            raise MavsdkError("TIMEOUT")
        self.there = [copy(item) for item in items]

    async def _download(self) -> list[Any]:
        back = [copy(item) for item in self.there]
        back[-1].x += self.alters
        return back

    def _check_alive(self, what: str) -> None:
        self.log.append(f"alive? {what}")

    async def _order(self, what: str, number: int) -> None:
        self.log.append(f"{what} to {number}")

    async def _refused(self, what: str, error: MavsdkError) -> FlightError:
        return FlightError(f"{what}: {error}")

    def upload(self, *norths_m: float) -> list[str]:
        self.log.clear()
        items = [item(n, 16, north_m) for n, north_m in enumerate(norths_m)]
        asyncio.run(Pilot.upload_items(cast("Any", self), items))
        return list(self.log)


def test_a_mission_is_uploaded_three_times_at_most_and_rewound_where_it_may_go_on() -> None:
    taken = ["forget", "upload"]
    px4 = Uploads(PX4, fails=2)
    again = ["upload", "alive? take a mission"] * 2
    rewound = "rewind the mission to 0"
    assert px4.upload(0.0, 10.0) == [
        "forget",
        *again,
        "upload",
        rewound,
    ]  # nobody knows what it had
    assert px4.upload(0.0, 20.0) == taken
    assert px4.upload(0.0, 20.0) == [*taken, rewound]
    ardupilot = Uploads(ARDUPILOT)
    for north_m in (10.0, 20.0):
        assert ardupilot.upload(0.0, north_m) == [*taken, "rewind the mission to 1"]
    with pytest.raises(FlightError, match=r"take the mission of 2 items: TIMEOUT"):
        Uploads(PX4, fails=3).upload(0.0, 10.0)
    altered = Uploads(PX4, alters=True)
    with pytest.raises(FlightError, match="holds another mission than the 2 items uploaded"):
        altered.upload(0.0, 10.0)
    assert altered.log.count("upload") == 3
