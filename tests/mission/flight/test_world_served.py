"""`aerofed world --ardupilot`: process after process of ArduPilot is served."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from firmware_stand_ins import ArduPilotStandIn
from patience import until
from serving import free_port, served

from flightdyn.state import BatteryState, GeodeticPoint, Kinematics, Moment
from mission.base.area import Area
from mission.cli import call
from mission.config.link import LinkConfig
from mission.config.loading import load_config
from mission.flight.serve.firmwares import Seat, serve_world
from mission.flight.serve.flight_logs import FlightLogs
from mission.log.reader import read_log


@contextmanager
def world(port: int, said: list[str]) -> Iterator[None]:
    stop, config = threading.Event(), load_config(Path("quickstart"))

    def serve() -> None:
        serve_world(config, ["ardupilot"], port=port, speed=1.0, say=said.append, stop=stop.is_set)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_a_rebooted_ardupilot_is_answered_and_the_aircraft_stands_at_home_again() -> None:
    """It speaks from another port then, as after each parameter change that asks for a reboot."""
    port, said = free_port(), list[str]()
    with world(port, said):
        for _ in range(3):
            process = ArduPilotStandIn(port)
            for count in range(3):
                stamp = answered(process, count)
                assert stamp < 1.0
            process.close()
    assert [line.split(" after")[0] for line in said].count("ArduPilot has started anew") == 2


def answered(process: ArduPilotStandIn, count: int) -> float:
    """The time stamp of the answer to a request that is repeated, as ArduPilot does."""
    answers: list[float] = []

    def has_come() -> bool:
        try:
            process.ask(count)
            answers.append(process.answer()["timestamp"])
        except OSError:
            return False
        return True

    until(has_come)
    return answers[0]


def test_a_fault_after_what_nobody_tells_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    fault = 'vehicle.aircraft.faults=[{kind="gnss_off", after="take-off"}]'
    assert call(["world", "--px4", "--set", fault]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "vehicle.aircraft.faults: after = 'take-off': aerofed world is told when" in line


def test_a_fault_that_arducopter_cannot_be_given_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fault = 'vehicle.aircraft.faults=[{kind="gnss_off", at_s=40}]'
    assert call(["world", "--ardupilot", "--set", fault]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "vehicle.aircraft.faults: gnss_off: ArduPilot's JSON interface cannot leave" in line


def test_a_folder_that_cannot_be_written_to_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert call(["world", "--px4", "--logs", str(tmp_path / "file" / "logs")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--logs" in line


@pytest.mark.slow
def test_a_flight_is_recorded_by_its_mavlink_and_our_truth(tmp_path: Path) -> None:
    """Our own vehicle stands in for the firmware, and a made-up clock for the truth."""
    first, second = free_port(), free_port()
    home = GeodeticPoint(47.0, 8.0, 400.0)
    area = Area.at((400.0, 400.0), (200.0, 200.0), home)
    plan = tmp_path / "p.waypoints"
    rows = [(22, 0.0, 0.0), (16, 0.0, 5e-4), (16, 5e-4, 5e-4)]
    lines = [
        f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{47 + north}\t{8 + east}\t20\t1"
        for seq, (command, north, east) in enumerate(rows)
    ]
    plan.write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    battery = BatteryState(16.0, 1.0, 0.0, 0.5)

    def truth(t_ns: int) -> Moment:
        state = Kinematics.of(t_ns, 7.0, 3.0, -5.0, 0, 0, 0, 1.0, 0, 0, 0, 0, 0, 0)
        return Moment(state, battery, None)

    happened: list[str | int] = []
    plant = SimpleNamespace(t_ns=0, faults=SimpleNamespace(happened=happened.append, news=()))
    clock: Any = SimpleNamespace(truth=SimpleNamespace(at=truth), plant=plant)
    link, logs = (
        LinkConfig(url=f"udpin://127.0.0.1:{second}"),
        FlightLogs(tmp_path / "w", area=area),
    )
    loop = asyncio.new_event_loop()
    seat = Seat("aircraft", "px4", area, clock, print, link, logs)
    work = loop.create_task(seat.follow(logs))

    def record() -> None:
        with suppress(asyncio.CancelledError):
            loop.run_until_complete(work)
        loop.close()

    thread = threading.Thread(target=record)
    udp = ("--udp", str(first), "--udp", str(second), "--speed", "5", "--home", "47,8,400")
    with served(*udp):
        thread.start()
        url, out = f"udpin://127.0.0.1:{first}", str(tmp_path / "out")
        quiet = ("--no-report", "--no-figures", "--quiet", "--out", out)
        assert call(["fly", str(plan), "--vehicle", url, *quiet]) == 0
        log = tmp_path / "w" / "flight-0001.mcap"
        until(lambda: logs.being_written is None and log.exists())
        loop.call_soon_threadsafe(work.cancel)
        thread.join()
    data = read_log(log)
    missions = [record for record in data.missions if record.kind == "mission"]
    assert len(missions) == 1, missions
    (mission,) = missions
    assert [row[1] for row in mission.items] == [22, 16, 16]
    assert mission.items[2][7:9] == pytest.approx((47.0005, 8.0005), abs=1e-6)
    np.testing.assert_allclose(data.truth.pos_m - [203.0, 207.0, 5.0], 0.0, atol=2e-3)
    assert np.ptp(data.belief.pos_m, axis=0).min() > 15.0
    assert "MISSION" in data.modes.names
    assert {"arming", "take-off"} <= set(happened)
