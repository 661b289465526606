"""`aerofed.vehicle`: a vehicle in the process of a test, whose time passes as the test says."""

import asyncio
import gc
import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav

import aerofed
from mission.api.life import NotInTimeError, Simulated
from mission.base.errors import FlightError
from mission.cli import call
from native.errors import ModelDivergedError

pytestmark = pytest.mark.slow

SURVEY = Path(__file__).parents[3] / "examples" / "survey.plan"
OFFBOARD = (mav.MAV_CMD_DO_SET_MODE, 129.0, 6.0)  # PX4's main mode
UNDER_PX4 = {"vehicle.autopilot": "px4", "vehicle.firmware.path": "nowhere/px4"}
ONLY_VELOCITY = 0b0000_1101_1100_0111


def order(client: Any, command: int, *params: float) -> None:
    """Give an order, and see it accepted."""
    values = (*params, *(0.0 for _ in range(7 - len(params))))
    client.mav.command_long_send(1, 1, command, 0, *values)
    answer = client.recv_match(type="COMMAND_ACK", blocking=True, timeout=HANG_S)
    assert (answer.command, answer.result) == (command, mav.MAV_RESULT_ACCEPTED)


def taken_off(vehicle: Any, height_m: float = 20.0) -> Any:
    """A client of the vehicle, which hovers."""
    client = vehicle.mavlink()
    order(client, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    nan = math.nan
    order(client, mav.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, nan, nan, nan, 488.0 + height_m)
    vehicle.until(lambda v: v.height_m > height_m - 0.5)
    return client


def velocity(client: Any, north_mps: float) -> None:
    client.mav.set_position_target_local_ned_send(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, ONLY_VELOCITY, 0, 0, 0, north_mps, 0, 0, 0, 0, 0, 0, 0
    )


def test_time_stands_still_but_for_steps() -> None:
    with aerofed.vehicle() as vehicle:
        client, began_s = taken_off(vehicle), vehicle.t_s
        time.sleep(0.3)
        assert vehicle.t_s == began_s
        vehicle.step(0.37)
        assert vehicle.t_s == pytest.approx(began_s + 0.37, abs=0.005)  # whole physics ticks
        # It is heard and answered all the same.
        order(client, mav.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 3.0)
        assert (vehicle.mode, vehicle.armed) == ("HOLD", True)
        assert 0.9 < vehicle.battery < 1.0
        assert vehicle.velocity_mps == pytest.approx([0, 0, 0], abs=0.7)


def test_a_flight_without_a_mission_hides_no_other_in_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with aerofed.vehicle(logs=tmp_path) as vehicle:
        taken_off(vehicle)
    with aerofed.vehicle(home=SURVEY, logs=tmp_path) as vehicle:
        vehicle.fly(SURVEY)
    assert call(["compare", str(tmp_path), "--limit", "slots_missed=0"]) == 0
    said, why = capsys.readouterr(), "the log has no mission to compare with"
    assert f"left out: {tmp_path}/flight-0001.mcap: {why}" in said.err
    assert said.out.endswith("\n1 limit met, but 1 log left out\n")
    with pytest.warns(UserWarning, match=f"left out: .*: {why}"):
        assert aerofed.compare(tmp_path).index.tolist() == ["flight-0002.mcap"]
    assert call(["compare", str(tmp_path / "flight-0001.mcap")]) == 0
    assert "not in the log: a mission" in " ".join(capsys.readouterr().out.split())


def offboard(pieces: list[float], *, pauses_s: float) -> tuple[bytes, float]:
    """Flown north by setpoints at 10 Hz: the truth, in each tenth stepped in `pieces` of it."""
    with aerofed.vehicle(wind_mps=6.0) as vehicle:
        client = taken_off(vehicle)
        for number in range(40):
            velocity(client, 3.0)
            if number == 5:
                order(client, *OFFBOARD)
            if number == 12:
                time.sleep(pauses_s)
            for piece in pieces:
                vehicle.step(0.1 * piece)
        assert vehicle.mode == "OFFBOARD"
        return vehicle.truth().to_csv().encode(), float(vehicle.position_m[1])


def test_a_flight_by_setpoints_repeats_however_slow_its_pilot_and_however_it_is_stepped() -> None:
    once, north_m = offboard([1.0], pauses_s=0.0)
    assert north_m > 5.0
    # A pause of wall time is no silence: nobody was to speak while time stood still.
    assert offboard([0.28, 0.52, 0.2], pauses_s=1.5) == (once, north_m)


def test_silence_in_simulated_time_is_a_loss() -> None:
    with aerofed.vehicle() as vehicle:
        client = taken_off(vehicle)
        velocity(client, 3.0)
        order(client, *OFFBOARD)
        vehicle.step(0.3)
        assert vehicle.mode == "OFFBOARD"
        vehicle.until(lambda v: v.mode != "OFFBOARD", timeout_s=3.0)


def test_what_does_not_happen_in_time_is_said_with_where_it_stands() -> None:
    with aerofed.vehicle() as vehicle:
        began_s = vehicle.t_s
        with pytest.raises(TimeoutError) as refused:
            vehicle.until(lambda v: v.armed, timeout_s=2.0)
        assert vehicle.t_s - began_s == pytest.approx(2.0, abs=0.01)
    words = "not within 2 s of simulated time; the vehicle is in mode HOLD, disarmed, at x = "
    assert str(refused.value).startswith(words)


def test_a_plan_is_flown_and_judged_and_repeats(tmp_path: Path) -> None:
    truths = []
    for number in range(2):
        with aerofed.vehicle(home=SURVEY, seed=3, logs=tmp_path / str(number)) as vehicle:
            vehicle.fly(SURVEY)
            assert not vehicle.armed
            assert vehicle.log.name == "flight-0001.mcap"
            vehicle.compare(SURVEY).check(cross_track_rms_m=1.0)
            with pytest.raises(aerofed.LimitsNotMetError, match="cross_track_max_m"):
                vehicle.compare().check(cross_track_max_m=0.01)
            truths.append(vehicle.truth())
    assert truths[0].equals(truths[1])
    assert truths[0].height_m.max() > 40.0
    assert np.ptp(truths[0].x_m) > 30.0


def test_mavsdk_flies_it() -> None:
    async def fly() -> None:
        from mavsdk.asyncio.plugins.action import ActionAsync

        async with vehicle.mavsdk() as system:
            action = ActionAsync(system)
            await action.set_takeoff_altitude(8.0)
            await action.arm()
            await action.takeoff()
            vehicle.until(lambda v: v.height_m > 7.5)
            await action.land()
            vehicle.until(lambda v: not v.armed)

    with aerofed.vehicle() as vehicle:
        asyncio.run(fly())
        assert not vehicle.armed
        assert vehicle.truth().height_m.max() > 7.5


def test_several_have_one_time_and_their_own_place_and_number() -> None:
    with aerofed.vehicles(3) as made:
        began_s = made.t_s
        made[1].step(2.0)
        assert [made.t_s, *(each.t_s for each in made)] == pytest.approx([began_s + 2.0] * 4)
        assert len({each.url for each in made}) == 3
        numbers = [each.mavlink().recv_match(blocking=True).get_srcSystem() for each in made]
        assert numbers == [1, 2, 3]


def test_several_are_opened_once_as_one_is() -> None:
    several = aerofed.vehicles(2)
    with several as made:
        made[1].step(0.1)
        with pytest.raises(aerofed.InputError, match="opened once"), several:
            pass
        made[1].step(0.1)
    with pytest.raises(aerofed.InputError, match="opened once"), several:
        pass
    with pytest.raises(aerofed.InputError, match="not open"):
        made[0].step(0.1)


def test_time_passes_by_itself_at_other_paces() -> None:
    with aerofed.vehicle(pace="moving") as vehicle:
        taken = vehicle.mavlink()
        limit = time.monotonic() + HANG_S
        while vehicle.height_m < 19.0 and time.monotonic() < limit:
            if not vehicle.armed:
                order(taken, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
                order(taken, mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, 508.0)
        with pytest.raises(aerofed.InputError, match=r"pace='steps'"):
            vehicle.step(1.0)
    with aerofed.vehicle(pace=50.0) as vehicle:
        began_s = vehicle.t_s
        while vehicle.t_s == began_s:
            assert time.monotonic() < limit


class Clock(Simulated):
    """Time alone, which begins at 5 s."""

    KIND = "clock"

    def __init__(self) -> None:
        self.steps: list[float] = []

    @property
    def t_s(self) -> float:
        return 5.0 + 0.125 * len(self.steps)  # a step lasts a little longer than it was asked to

    def step(self, seconds: float) -> None:
        self.steps.append(seconds)

    def _where(self) -> str:
        return ": here"


def test_a_condition_is_looked_at_every_tenth_until_time_is_up() -> None:
    times: list[tuple[Any, int]] = [(0, 0), (1.0, 8), (1.01, 9), (Fraction(1, 2), 4)]
    for timeout_s, steps in times:
        clock = Clock()
        with pytest.raises(NotInTimeError, match=r"^not within .* s of simulated time: here"):
            clock.until(lambda _: False, timeout_s=timeout_s)
        assert clock.steps == [0.1] * steps
    clock = Clock()
    with pytest.raises(NotInTimeError, match=r"^not within 60 s of"):
        clock.until(lambda _: False)
    assert len(clock.steps) == 480
    asked: list[Any] = []

    def met(it: Clock) -> bool:
        asked.append(it)
        return len(it.steps) == 2

    (clock := Clock()).until(met, timeout_s=0.25)
    assert asked == [clock] * 3
    clock.until(lambda _: True, timeout_s=999_999.9)
    clock.until(lambda _: True, timeout_s=0)
    for wrong in (1e6, -0.1, math.nan, math.inf, "1", True, None, 1j):
        with pytest.raises(aerofed.InputError, match=r"a function of the clock, and simulated sec"):
            clock.until(lambda _: True, timeout_s=wrong)  # type: ignore[arg-type]  # is refused
    with pytest.raises(aerofed.InputError, match=r"^until\(3, timeout_s=60.0\): a function of"):
        clock.until(3)  # type: ignore[arg-type]  # is refused
    assert len(clock.steps) == 2


def test_the_paces_and_steps_that_are_allowed() -> None:
    for pace in (0.001, 1, 1000, 1000.0, Fraction(1, 3), "steps", "moving"):
        aerofed.vehicle(pace=pace)  # type: ignore[arg-type]  # some are no float
    for wrong in (-1.0, 1000.5, math.nan, "always"):
        with pytest.raises(aerofed.InputError, match=r"^pace = .*: more than 0, at most 1000$"):
            aerofed.vehicle(pace=wrong)  # type: ignore[arg-type]  # is refused
    with aerofed.vehicle() as vehicle:
        for seconds in (0, -1.0, 1e6, "1", True):
            with pytest.raises(aerofed.InputError, match=r"^step\(.*\): simulated seconds, more"):
                vehicle.step(seconds)  # type: ignore[arg-type]  # is refused
        began_s = vehicle.t_s
        vehicle.step(Fraction(1, 4))  # type: ignore[arg-type]  # not a float, and a number
        assert vehicle.t_s - began_s == pytest.approx(0.25, abs=0.005)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pace": "fast"}, r"pace = 'fast': 'steps', 'moving', or times real time"),
        ({"pace": 0}, r"pace = 0: "),
        ({"home": (47.0, 8.0)}, r"home = \(47.0, 8.0\): \(degrees north"),
        ({"home": "nowhere.plan"}, "nowhere.plan"),
        ({"wind_mps": -1.0}, "vehicle.aircraft.wind.speed_mps = -1.0"),
        ({"overrides": {"vehicle.spedd": 1}}, "vehicle.spedd"),
        (
            {"overrides": {"mission.steps": 3}},
            "^overrides: mission.steps: counts for nothing here; area, vehicle, link, seed do",
        ),
        ({"pace": None}, r"pace = None: "),
        ({"pace": np.array([1.0, 2.0])}, r"pace = array"),
        ({"overrides": "survey.plan"}, "^overrides = 'survey.plan': must be a dictionary"),
        ({"overrides": [1], "firmware": "px4"}, r"^overrides = \[1\]: must be a dictionary"),
        ({"source": 5}, "source = 5: must be"),
        ({"logs": 5}, "logs = 5: must be a path"),
        ({"logs": "a\0b"}, "logs = .*: must be a path"),
        ({"firmware": ["px4"]}, r"firmware = \['px4'\]: must be"),
        ({"firmware": "betaflight"}, "firmware = 'betaflight': must be 'px4' or 'arducopter'"),
        ({"overrides": UNDER_PX4, "pace": "moving"}, "pace = 'moving': of a firmware time passes"),
        ({"overrides": UNDER_PX4}, "nowhere/px4: no such file"),
    ],
)
def test_options_that_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(aerofed.InputError, match=words), aerofed.vehicle(**options):
        pass


@pytest.mark.parametrize("count", ["2", 2.0, None, [1], math.nan])
def test_a_count_that_is_none(count: Any) -> None:
    with pytest.raises(aerofed.InputError, match=r"count = .*: must be a whole number"):
        aerofed.vehicles(count)


def test_wrong_types_and_numbers_are_told_in_one_error() -> None:
    with aerofed.vehicle() as vehicle:
        seconds: Any
        for seconds in ("1", None, [1], True, 1j, math.nan, math.inf, 10**400, np.array([1.0])):
            with pytest.raises(aerofed.InputError, match=r"step\(.*\): simulated seconds"):
                vehicle.step(seconds)
            with pytest.raises(aerofed.InputError, match=r"until\(.*: a function of the vehicle"):
                vehicle.until(lambda _: True, timeout_s=seconds)
        began_s = vehicle.t_s
        for seconds in (np.float32(0.5), np.int64(1), Fraction(1, 2)):
            vehicle.step(seconds)
        assert vehicle.t_s == pytest.approx(began_s + 2.0, abs=0.01)
        met: Any
        for met in (None, 5, True):
            with pytest.raises(aerofed.InputError, match="a function of the vehicle"):
                vehicle.until(met)
        with pytest.raises(TimeoutError):
            vehicle.until(lambda _: False, timeout_s=0)  # it is asked once


async def connected(vehicle: Any) -> None:
    async with vehicle.mavsdk():
        pass


@pytest.mark.parametrize("entered", [True, False])
def test_outside_of_its_with_a_vehicle_says_so(entered: bool) -> None:
    vehicle: Any = aerofed.vehicle()
    if entered:
        with vehicle, pytest.raises(aerofed.InputError, match="opened once"), vehicle:
            pass
        with pytest.raises(aerofed.InputError, match="opened once"), vehicle:
            pass
        vehicle.__exit__()
    used: list[Callable[[], object]] = [
        *(partial(getattr, vehicle, name) for name in ("url", "t_s", "height_m", "armed", "mode")),
        partial(vehicle.step, 1),
        partial(vehicle.until, lambda _: True),
        partial(vehicle.fly, SURVEY),
        vehicle.mavlink,
        vehicle.truth,
        lambda: asyncio.run(connected(vehicle)),
    ]
    for use in used:
        with pytest.raises(aerofed.InputError, match="not open"):
            use()


INTERRUPTED = """
import os, signal, sys, threading, time
import aerofed

def interrupted(work):
    began = len(rows)
    def kick():
        while len(rows) < began + 20:  # until time passes
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)
    threading.Thread(target=kick).start()
    try:
        work()
    except KeyboardInterrupt:
        return len({vehicle.t_s for _ in range(20)}) == 1
    return "not interrupted"

plan, logs = sys.argv[1:]
with aerofed.vehicle(home=plan, logs=logs) as vehicle:
    rows = vehicle._host.track.rows
    print(interrupted(lambda: vehicle.step(900_000)))
    print(interrupted(lambda: vehicle.until(lambda v: False, timeout_s=900_000)))
    print(interrupted(lambda: [vehicle.fly(plan) for _ in range(999)]))
    print(vehicle.armed)
    child = os.fork()
    if not child:
        try:
            vehicle.step(1)
        except aerofed.InputError as error:
            print(error, flush=True)
            sys.exit(3)  # through `with`, and the end of the interpreter
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    began_s = vehicle.t_s
    vehicle.step(2)
    print(round(vehicle.t_s - began_s, 2), flush=True)
"""


def test_an_interruption_stops_its_time_and_a_fork_neither_blocks_nor_disturbs(
    tmp_path: Path,
) -> None:
    command = (sys.executable, "-c", INTERRUPTED, str(SURVEY), str(tmp_path / "logs"))
    ended = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=True)
    assert ended.stdout.splitlines() == [
        "True", "True", "True", "True",
        "the vehicle is in the process from which this one was forked; open one here",
        "3", "2.0",
    ]  # fmt: skip
    assert call(["log", "check", str(tmp_path / "logs" / "flight-0001.mcap")]) == 0


def test_orders_that_are_refused(tmp_path: Path) -> None:
    waypoints = tmp_path / "away.waypoints"
    waypoints.write_text("QGC WPL 110\n0\t1\t3\t16\t0\t5\t0\t0\t47.4\t8.55\t30\t1\n")
    with aerofed.vehicle() as vehicle:
        for seconds in (0.0, -1.0, math.nan):
            with pytest.raises(aerofed.InputError, match="simulated seconds, more than 0"):
                vehicle.step(seconds)
        with pytest.raises(aerofed.InputError, match="no flight is logged"):
            vehicle.compare()
        with pytest.raises(aerofed.InputError, match=r"97 km from home.*vehicle\(home='.*survey"):
            vehicle.fly(SURVEY)
        spline = tmp_path / "spline.waypoints"
        spline.write_text("QGC WPL 110\n0 1 0 16 0 0 0 0 48 8 9 1\n1 0 3 82 0 0 0 0 48 8 9 1\n")
        with pytest.raises(aerofed.InputError) as refused:
            vehicle.fly(spline)
        assert "home=" not in str(refused.value)  # it is refused there, too
        far = tmp_path / "far.waypoints"  # it has no home of its own that could be named
        far.write_text(waypoints.read_text().replace("47.4", "48.4"))
        with pytest.raises(aerofed.InputError, match=r"km from home") as refused:
            vehicle.fly(far)
        assert "home=" not in str(refused.value)
        taken_off(vehicle)
        with pytest.raises(aerofed.InputError, match="the vehicle is armed"):
            vehicle.fly(waypoints)
    with (
        pytest.raises(aerofed.InputError, match="no planned home"),
        aerofed.vehicle(home=waypoints),
    ):
        pass


def test_an_aircraft_that_leaves_its_physics_ends_a_step(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: float) -> bool:
        raise ModelDivergedError("left its physics")

    def flown() -> None:
        with aerofed.vehicle() as vehicle:
            assert {vehicle.armed for _ in range(20)} == {False}
            monkeypatch.setattr(vehicle._host.__dict__["vehicle"], "stride", fail)
            vehicle.step(1.0)

    with pytest.raises(FlightError, match="left its physics"):
        flown()
    gc.collect()
    assert not caplog.records  # nor does any look before it complain


def test_an_error_of_the_test_is_its_own_and_frees_the_port() -> None:
    def broken() -> None:
        with aerofed.vehicle() as vehicle:
            ports.append(int(vehicle.url.rpartition(":")[2]))
            raise KeyError("mine")

    ports: list[int] = []
    with pytest.raises(KeyError, match="mine"):
        broken()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", ports[0]))


def test_flown_as_by_the_command(tmp_path: Path) -> None:
    run = aerofed.fly(SURVEY, {"vehicle.aircraft.wind.speed_mps": 4.0}, out=tmp_path / "flown")
    assert run.status == "finished"
    aerofed.compare(run).check(cross_track_rms_m=1.0)


@pytest.mark.real
@pytest.mark.parametrize("firmware", ["px4", "arducopter"])
def test_a_real_firmware_stands_still_but_for_steps_and_answers(firmware: Any) -> None:
    if not os.environ.get(f"AEROFED_{firmware.upper()}"):
        pytest.skip(f"needs a real binary in AEROFED_{firmware.upper()}")

    async def fly() -> None:
        from mavsdk.asyncio.plugins.action import ActionAsync

        async with vehicle.mavsdk() as system:
            action = ActionAsync(system)
            await action.set_takeoff_altitude(8.0)
            await action.arm()
            await action.takeoff()
            vehicle.until(lambda v: v.height_m > 7.5)
            assert vehicle.armed
            await action.land()
            vehicle.until(lambda v: not v.armed)

    with aerofed.vehicle(firmware=firmware) as vehicle:
        vehicle.step(1.0)
        began_s = vehicle.t_s
        time.sleep(1.0)
        assert vehicle.t_s == began_s
        vehicle.step(2.0)
        assert vehicle.t_s - began_s == pytest.approx(2.0, abs=0.02)
        client = vehicle.mavlink()
        assert client.recv_match(type="HEARTBEAT", blocking=True).get_srcSystem() == 1
        asyncio.run(fly())
        assert vehicle.truth().height_m.max() > 7.5
    with (
        pytest.raises(aerofed.InputError, match="count = 2: a firmware flies one vehicle"),
        aerofed.vehicles(2, firmware=firmware),
    ):
        pass
    with aerofed.vehicle(firmware=firmware, pace=5.0) as vehicle:
        began_s, limit = vehicle.t_s, time.monotonic() + HANG_S
        while vehicle.t_s < began_s + 1.0:
            assert time.monotonic() < limit
