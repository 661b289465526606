"""Every message that a flight is made of, field by field, through the feed's own door."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flightdyn.frames import LocalFrame, frozen
from flightdyn.state import BatteryState, GeodeticPoint, Kinematics, Moment
from mission.base.area import Area
from mission.flight.pilot.dialects import ARDUPILOT, PX4, Dialect
from mission.flight.pilot.feed import Known, TelemetryFeed
from mission.flight.track import TrackPoint
from sitl.observer import VehicleEvent, VehicleSample

HOME = GeodeticPoint(47.0, 8.0, 500.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME)
NAN = math.nan
S = 1_000_000_000
STILL = frozen([0.0, 0.0, 0.0])


@dataclass
class Aircraft:
    """A vehicle that says what a test says, and what was made of it."""

    dialect: Dialect = PX4
    refused: tuple[int, ...] = ()
    known: Known | None = None
    said: dict[str, "asyncio.Queue[dict[str, Any]]"] = field(default_factory=dict)
    asked: list[tuple[int, float]] = field(default_factory=list)
    samples: list[VehicleSample] = field(default_factory=list)
    events: list[VehicleEvent] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.pilot: Any = SimpleNamespace(
            dialect=self.dialect, watch=SimpleNamespace(listeners=[]), messages=self,
            mode="HOLD", armed=False, flying=False,
        )  # fmt: skip

    async def of(self, name: str) -> AsyncIterator[dict[str, Any]]:
        queue = self.said.setdefault(name, asyncio.Queue())
        while True:
            yield await queue.get()

    async def stream(self, number: int, rate_hz: float) -> bool:
        self.asked.append((number, rate_hz))
        return number not in self.refused

    def sampled(self, sample: VehicleSample) -> None:
        self.samples.append(sample)

    def happened(self, event: VehicleEvent) -> None:
        self.events.append(event)

    async def says(self, name: str, **fields: Any) -> None:
        taker = self.known and self.known.takers and self.known.takers.get(name)
        if taker:
            taker(fields)
            return
        await self.said[name].put(fields)
        for _ in range(5):  # until it is taken
            await asyncio.sleep(0)

    async def is_ready(self) -> None:
        await self.says("GPS_RAW_INT", fix_type=3)
        await self.says("ESTIMATOR_STATUS", flags=831)
        await self.says("HOME_POSITION", latitude=470000000, longitude=80000000, x=0, y=0, z=0)

    async def is_at(self, boot_ms: int, ned_m: tuple[float, float, float] = (0, 0, 0)) -> None:
        at = LocalFrame(HOME).to_geodetic(np.array(ned_m))
        await self.says(
            "GLOBAL_POSITION_INT", time_boot_ms=boot_ms, lat=round(at.lat_deg * 1e7),
            lon=round(at.lon_deg * 1e7), relative_alt=round(-1e3 * ned_m[2]),
            vx=300, vy=-200, vz=50,
        )  # fmt: skip

    def follow(self, told: Callable[[TelemetryFeed], Coroutine[Any, Any, None]]) -> TelemetryFeed:
        async def run() -> TelemetryFeed:
            feed = TelemetryFeed(self.pilot, area=AREA, observers=[self], known=self.known)
            following = asyncio.create_task(feed.watch())
            await asyncio.sleep(0.0)
            for _ in range(5):
                await asyncio.sleep(0)
            await told(feed)
            assert not following.done()
            following.cancel()
            await asyncio.wait((following,))
            return feed

        return asyncio.run(run())

    def heard(self) -> list[tuple[int, str, str, int]]:
        return [(e.t_ns, e.kind, e.text, e.severity) for e in self.events]


def test_a_sample_has_what_its_messages_say_and_the_clock_begins_at_the_first() -> None:
    one = Aircraft()

    async def told(feed: TelemetryFeed) -> None:
        one.pilot.watch.listeners[0](4, " Low battery ")  # before there is a position
        await one.is_at(59_000)  # nobody believes it yet
        assert feed.here is None
        assert feed.now_s == 0.0
        assert math.isnan(feed.battery_remaining)
        await one.is_ready()
        await one.says(
            "ATTITUDE_QUATERNION", time_boot_ms=1, q1=2.0, q2=0.0, q3=0.0, q4=-2.0,
            rollspeed=0.1, pitchspeed=0.2, yawspeed=0.3,
        )  # fmt: skip
        await one.says(
            "BATTERY_STATUS", id=0, battery_remaining=80, current_consumed=120,
            voltages=[4100, 4000] + [65535] * 8, current_battery=1250,
        )  # fmt: skip
        await one.is_at(60_000, (100.0, -40.0, -25.0))
        assert feed.first.result().alt_msl_m == 525.0
        assert feed.now_s == 0.0
        await one.is_at(60_000)  # again, and one that came late
        await one.is_at(59_950)
        await one.is_at(60_050)
        assert feed.now_s == 0.05
        assert feed.battery_remaining == 0.8
        assert one.pilot.watch.listeners

    feed = one.follow(told)
    first, second = one.samples
    assert (first.t_ns, second.t_ns) == (0, S // 20)
    # The plane that touches the globe at home is 1 mm above it there.
    np.testing.assert_allclose(first.belief.pos_ned_m, [100.0, -40.0, -25.0], atol=0.02)
    assert first.belief.vel_ned_mps.tolist() == [3.0, -2.0, 0.5]
    half = math.sqrt(0.5)
    np.testing.assert_allclose(first.belief.q_frd_to_ned, [half, 0.0, 0.0, -half])
    assert first.belief.omega_frd_radps.tolist() == [0.1, 0.2, 0.3]
    assert first.truth is first.belief  # nobody knows better
    assert first.battery == (8.1, 12.5, 120.0, 0.8)
    assert (first.mode, first.armed, first.gnss, first.wind_ned_mps) == ("HOLD", False, None, None)
    assert one.heard() == [
        (0, "status", "Low battery", 4),
        (0, "mode", "HOLD", 6),
        (0, "status", "estimator: complete", 6),
    ]
    assert feed.here is not None
    assert feed.here.t_ns == S // 20


@pytest.mark.parametrize(
    ("fields", "state"),
    [
        ({"battery_remaining": -1}, (8.0, 1.0, 50.0, NAN)),
        ({"battery_remaining": 0}, (8.0, 1.0, 50.0, 0.0)),
        ({"battery_remaining": 100}, (8.0, 1.0, 50.0, 1.0)),
        ({"current_consumed": -1}, (8.0, 1.0, NAN, 0.5)),
        ({"current_consumed": 0}, (8.0, 1.0, 0.0, 0.5)),
        ({"current_battery": -1}, (8.0, NAN, 50.0, 0.5)),
        ({"current_battery": -2}, (8.0, -0.02, 50.0, 0.5)),
        ({"voltages": [65534, 65535]}, (65.534, 1.0, 50.0, 0.5)),
        ({"voltages": [65535]}, (NAN, 1.0, 50.0, 0.5)),
        ({"id": 1, "voltages": [1]}, (0.001, 1.0, 50.0, 0.5)),
    ],
)
def test_what_a_battery_does_not_know_is_not_known(
    fields: dict[str, Any], state: tuple[float, ...]
) -> None:
    one = Aircraft()
    whole = {
        "id": 0, "battery_remaining": 50, "current_consumed": 50, "voltages": [3000, 5000],
        "current_battery": 100,
    }  # fmt: skip

    async def told(_: TelemetryFeed) -> None:
        await one.is_ready()
        await one.says("BATTERY_STATUS", **(whole | fields))
        await one.is_at(1)

    one.follow(told)
    np.testing.assert_equal(tuple(one.samples[0].battery), state)
    assert one.samples[0].belief.q_frd_to_ned.tolist() == [1.0, 0.0, 0.0, 0.0]  # until it is told
    assert one.samples[0].belief.omega_frd_radps.tolist() == [0.0, 0.0, 0.0]


def test_charge_is_the_newest_of_a_battery_and_doubted_where_flight_does_not_change_it() -> None:
    one = Aircraft(ARDUPILOT)

    async def told(feed: TelemetryFeed) -> None:
        await one.says("GPS_RAW_INT", fix_type=3)
        await one.says("EKF_STATUS_REPORT", flags=831)
        await one.says("HOME_POSITION", latitude=1, longitude=0)
        told = {"current_consumed": 1, "voltages": [], "current_battery": 1}
        for percent in (90, 60):
            await one.says("BATTERY_STATUS", id=0, battery_remaining=percent, **told)
        assert feed.battery_remaining == 0.6
        one.pilot.flying = True
        await one.says("MISSION_ITEM_REACHED", seq=0)
        for t_ms in (0, 119_999):
            await one.is_at(t_ms)
            assert feed.battery.doubt == ""
        await one.is_at(120_000)
        await one.says("MISSION_ITEM_REACHED", seq=1)
        assert feed.battery.doubt == ("the vehicle's battery has read 60 % through 120 s of flight")
        assert feed.reached_ns == {0: [120 * S]}  # its item 0 is home

    one.follow(told)


def test_a_vehicle_that_starts_anew_has_to_say_again_that_it_knows_where_it_is() -> None:
    one = Aircraft()

    async def told(feed: TelemetryFeed) -> None:
        await one.is_ready()
        await one.is_at(60_000)
        await one.is_at(61_000)
        await one.is_at(56_000)  # five seconds: late, no more
        assert feed.readiness.missing == ""
        await one.is_at(55_999)
        assert feed.readiness.missing.startswith("no word of its GPS")
        await one.is_at(56_009)

    one.follow(told)
    assert [sample.t_ns for sample in one.samples] == [0, S, S + S // 100]


def test_changes_are_told_when_they_are_heard_of() -> None:
    one = Aircraft()

    async def told(feed: TelemetryFeed) -> None:
        await one.is_ready()
        await one.is_at(0)
        one.pilot.mode, one.pilot.armed, one.pilot.flying = "MISSION", True, True
        await one.is_at(100)
        await one.is_at(200)
        feed.note("a word")
        await one.says("MISSION_ITEM_REACHED", seq=3)
        feed.passed(3, TrackPoint(150_000_000, frozen([1.0, 0, 0]), frozen([2.0, 0, 0])))
        await one.says("ESTIMATOR_STATUS", flags=831 - 32)
        one.pilot.mode, one.pilot.armed = "LAND", False
        await one.is_at(300)
        assert feed.reached_ns == {3: [200_000_000]}

    one.follow(told)
    ms = S // 1000
    assert one.heard()[1:] == [
        (0, "status", "estimator: complete", 6),
        (100 * ms, "mode", "MISSION", 6),
        (100 * ms, "armed", "armed", 6),
        (200 * ms, "status", "a word", 6),
        (200 * ms, "status", "item 3: reported", 6),
        (150 * ms, "reached", "item 3", 6),
        (300 * ms, "mode", "LAND", 6),
        (300 * ms, "armed", "disarmed", 6),
        (300 * ms, "status", "estimator without height", 6),
    ]
    reported, reached = one.events[5:7]
    assert (reported.seq, reached.seq) == (3, 3)
    assert (reached.truth.pos_ned_m[0], reached.belief.pos_ned_m[0]) == (1.0, 2.0)
    assert (reached.truth.t_ns, reached.belief.t_ns) == (150 * ms, 150 * ms)
    assert reached.belief.vel_ned_mps.tolist() == [3.0, -2.0, 0.5]


def test_before_the_first_position_nothing_is_passed() -> None:
    one = Aircraft()

    async def told(feed: TelemetryFeed) -> None:
        await one.says("MISSION_ITEM_REACHED", seq=0)
        feed.passed(0, TrackPoint(0, STILL, STILL))
        assert feed.reached_ns == {}

    one.follow(told)
    assert not one.events


def firmware(dialect: Dialect, control_hz: float = 50.0) -> Aircraft:
    """One in our world: the truth stands 1 m north of home, and its motors are known."""

    def truth(t_ns: int) -> Moment:
        at = Kinematics(t_ns, frozen([1.0, 0, 0]), STILL, frozen([1.0, 0, 0, 0]), STILL)
        return Moment(at, BatteryState(22.0, 3.0, 4.0, 0.6), frozen([5.0, 6.0, 0.0]))

    faults = [(100_000_000, "Fault begins: x"), (200_000_001, "Fault ends: x")]
    return Aircraft(
        dialect,
        known=Known(truth, faults, {}, lambda t_ns: [t_ns / S, 0.2, 0.3, 0.4], control_hz),
    )


async def flies(one: Aircraft, feed: TelemetryFeed) -> None:
    """Armed, and told where to: rows of 20 and 40 ms past 100 ms."""
    watch = feed.readiness
    watch._take_fix({"fix_type": 3})
    watch._take_flags({"flags": 831})
    watch._take_home({"latitude": 1, "longitude": 1})
    await one.is_at(0)
    assert one.known is not None
    assert one.known.takers is not None
    if "HOME_POSITION" in one.known.takers:
        at = LocalFrame(HOME).to_geodetic(np.array([30.0, 40.0, 0.0]))
        lat, lon = round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)
        await one.says("HOME_POSITION", latitude=lat, longitude=lon, x=3.0, y=4.0, z=-5.0)
    for armed, ms in ((False, 90), (True, 120), (True, 140)):
        one.pilot.armed = armed
        await one.says(
            "ATTITUDE_QUATERNION", time_boot_ms=ms, q1=0.0, q2=3.0, q3=0.0, q4=0.0,
            rollspeed=1.0, pitchspeed=2.0, yawspeed=3.0,
        )  # fmt: skip
    await one.says(
        "ATTITUDE_TARGET", time_boot_ms=110, q=[0.0, 0.0, 1.0, 0.0], body_roll_rate=4.0,
        body_pitch_rate=5.0, body_yaw_rate=6.0, thrust=0.7,
    )  # fmt: skip
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    if "POSITION_TARGET_LOCAL_NED" in one.known.takers:
        order = dict(zip(names, range(10, 21), strict=True))
        await one.says("POSITION_TARGET_LOCAL_NED", time_boot_ms=130, **order)
    for ms in (100, 150, 200, 201):
        await one.is_at(ms)


def test_what_px4_tells_of_its_control_is_a_row_about_home() -> None:
    one = firmware(PX4)
    one.follow(lambda feed: flies(one, feed))
    first, second, third, *_ = one.samples
    assert first.control is None
    assert second.control is None
    assert third.control is None  # of the time up to the sample before
    rows = one.samples[3].control
    assert rows is not None
    motors = [0.12, 0.2, 0.3, 0.4]
    believed = [0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    wanted = [0.0, 0.0, 1.0, 0.0, 4.0, 5.0, 6.0, 0.7]
    # The frame of its own has its zero at 30 - 3, 40 - 4, and 5 below home.
    ordered = [10 + 27, 11 + 36, 12 + 5, *range(13, 21)]
    np.testing.assert_allclose(
        rows[0], [0.12 * S, *believed, *wanted, *motors, *[NAN] * 11], atol=0.02
    )
    np.testing.assert_allclose(
        rows[1], [0.14 * S, *believed, *wanted, 0.14, *motors[1:], *ordered], atol=0.02
    )
    assert len(rows) == 2
    assert first.truth.pos_ned_m[0] == 1.0
    assert first.belief.pos_ned_m[0] == pytest.approx(0.0, abs=0.02)
    assert first.battery.remaining == 0.6
    assert first.wind_ned_mps is not None
    assert first.wind_ned_mps.tolist() == [5.0, 6.0, 0.0]
    found = [row for row in one.heard() if row[1] == "fault"]
    assert found == [
        (100_000_000, "fault", "Fault begins: x", 4),
        (201_000_000, "fault", "Fault ends: x", 4),
    ]


def test_ardupilot_tells_no_body_rates_to_turn_at_and_nothing_of_places() -> None:
    one = firmware(ARDUPILOT)
    one.follow(lambda feed: flies(one, feed))
    assert one.known is not None
    assert one.known.takers is not None
    assert not {"POSITION_TARGET_LOCAL_NED", "HOME_POSITION"} & set(one.known.takers)
    rows = one.samples[3].control
    assert rows is not None
    np.testing.assert_array_equal(rows[0, 8:16], [0.0, 0.0, 1.0, 0.0, NAN, NAN, NAN, 0.7])
    assert np.isnan(rows[:, 20:]).all()


def test_without_a_rate_nothing_of_the_control_is_kept() -> None:
    one = firmware(PX4, control_hz=0.0)

    async def told(_: TelemetryFeed) -> None:
        assert one.known is not None
        assert one.known.takers is not None
        assert set(one.known.takers) == {
            "HEARTBEAT", "FENCE_STATUS", "GLOBAL_POSITION_INT", "ATTITUDE_QUATERNION",
            "BATTERY_STATUS", "MISSION_ITEM_REACHED",
        }  # fmt: skip

    one.follow(told)


USUAL = [
    (1, 2.0), (24, 2.0), (31, 10.0), (33, 20.0), (42, 5.0), (147, 1.0), (242, 1.0), (245, 5.0),
]  # fmt: skip


@pytest.mark.parametrize(
    ("one", "asked"),
    [
        (Aircraft(PX4), [*USUAL, (230, 2.0)]),
        (Aircraft(ARDUPILOT), [*USUAL, (162, 1.0), (193, 2.0)]),
        (firmware(PX4), [*USUAL, (31, 50.0), (83, 50.0), (85, 50.0), (230, 2.0)]),
        (Aircraft(PX4, refused=(24, 230)), [*USUAL, (230, 2.0)]),
    ],
)
def test_every_stream_is_asked_for_at_its_rate(
    one: Aircraft, asked: list[tuple[int, float]]
) -> None:
    async def told(feed: TelemetryFeed) -> None:
        await feed.ask()
        assert feed.readiness.estimator_promised is (230 not in one.refused)

    one.follow(told)
    assert one.asked == asked
