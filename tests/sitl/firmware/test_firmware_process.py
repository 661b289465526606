"""Firmware as a process: what cannot be started, what ends, and what must not be left behind."""

import asyncio
import fcntl
import math
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from firmware_stand_ins import plant, px4_stand_in, script
from patience import HANG_S, until
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME

from flightdyn.config import AircraftConfig
from flightdyn.random import RandomStreams
from native.errors import FirmwareSilentError, InputError, LinkLostError
from sitl.config import FirmwareConfig, VehicleConfig
from sitl.firmware.launch import FirmwareProcess, LaunchOptions, check_binary
from sitl.firmware.px4 import px4_launch
from sitl.firmware.relay import Relay
from sitl.firmware.vehicle import FirmwareVehicle, plant_for

PARSER = mav.MAVLink(None)


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"  # a child of a process that nobody waits for stays as a zombie


def test_a_missing_binary_is_named(tmp_path: Path) -> None:
    with pytest.raises(FirmwareSilentError, match=r"vehicle.firmware.path = .*px4: no such file"):
        check_binary(tmp_path / "px4")


def test_a_file_that_may_not_be_executed_is_named(tmp_path: Path) -> None:
    (tmp_path / "px4").write_text("")
    with pytest.raises(FirmwareSilentError, match="may not be executed"):
        check_binary(tmp_path / "px4")


def test_how_it_ended_and_its_last_lines_are_known(tmp_path: Path) -> None:
    argv = [script(tmp_path / "fw", "for i in 1 2 3 4 5 6 7; do echo line $i; done; exit 7")]
    process = FirmwareProcess(argv, tmp_path, {})
    until(lambda: bool(process.died))
    assert process.died == "fw has ended with exit code 7"
    assert process.last_words(3) == "line 5 | line 6 | line 7"
    process.stop()
    process.stop()


def test_its_environment_and_folder_are_its_own(tmp_path: Path) -> None:
    argv = [script(tmp_path / "fw", 'echo "$COLOUR"; pwd')]
    process = FirmwareProcess(argv, tmp_path, {"COLOUR": "green"})
    until(lambda: bool(process.died))
    assert process.last_words() == f"green | {tmp_path}"
    process.stop()


def test_stopping_ends_it_and_what_it_started_even_where_it_refuses(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    text = f"trap '' TERM INT HUP; sleep 900 & echo $$ $! > {pids}; while :; do wait; done"
    process = FirmwareProcess([script(tmp_path / "fw", text)], tmp_path, {})
    until(lambda: pids.exists() and len(pids.read_text().split()) == 2)
    started = [int(pid) for pid in pids.read_text().split()]
    assert all(map(alive, started))
    process.stop()
    until(lambda: not any(map(alive, started)))
    assert not any(map(alive, started))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_it_ends_with_whoever_started_it_however_that_ends(
    tmp_path: Path, number: signal.Signals
) -> None:
    pids = tmp_path / "pids"
    firmware = script(
        tmp_path / "fw", f"trap '' TERM INT; echo $$ > {pids}; while :; do sleep 1; done"
    )
    program = (
        "import signal, sys, time; from pathlib import Path; "
        # A shell that runs the tests in the background has it ignored, and we inherit that.
        "signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from sitl.firmware.launch import FirmwareProcess; "
        f"FirmwareProcess([{firmware!r}], Path({str(tmp_path)!r}), {{}}); time.sleep(900)"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL)
    until(lambda: pids.exists() and bool(pids.read_text().strip()))
    pid = int(pids.read_text())
    assert alive(pid)
    parent.send_signal(number)
    parent.wait()
    until(lambda: not alive(pid))


def test_scripts_given_to_it_are_found_first_wherever_its_folder_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    config = px4_stand_in(tmp_path, does="mavlink() { echo ours; }; . px4-rc.mavlink")
    launch = px4_launch(LaunchOptions(config, 1, 2, 10.0), plant())
    process = launch.start(Path("firmware"))
    until(lambda: bool(process.died))
    assert process.last_words(1) == "ours"
    process.stop()
    launch.bridge.close()


def test_arducopters_gnss_is_switched_at_the_first_message_after_ours(tmp_path: Path) -> None:
    """By its own time, and not when somebody looks in wall time."""
    firmware = FirmwareConfig(path=tmp_path / "arducopter")
    vehicle = FirmwareVehicle(
        VehicleConfig(autopilot="ardupilot", firmware=firmware),
        plant(),
        tmp_path / "firmware",
        [],
        mission_speed_mps=10.0,
        speed=math.inf,
        hear=lambda *_: None,
        heard=frozenset(),
    )
    sent: list[Any] = []
    vehicle.relay = cast(
        Relay,
        SimpleNamespace(to_firmware=lambda data: sent.extend(PARSER.parse_buffer(data) or ())),
    )
    assert vehicle.plant.sensors is not None
    for on in (True, False, False, True):
        vehicle.plant.sensors.receiver.on = on
        vehicle._take_heard("HEARTBEAT", {})
    assert [(one.param_id, one.param_value) for one in sent] == [
        ("SIM_GPS1_ENABLE", 0.0), ("SIM_GPS1_ENABLE", 1.0)
    ]  # fmt: skip


def test_an_error_nobody_foresaw_ends_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody would look any more whether the firmware is alive."""

    def broken(_: FirmwareVehicle) -> None:
        raise ZeroDivisionError

    config = px4_stand_in(tmp_path)
    vehicle = FirmwareVehicle(
        config,
        plant(),
        tmp_path / "firmware",
        [],
        mission_speed_mps=10.0,
        speed=math.inf,
        hear=lambda *_: None,
        heard=frozenset(),
    )
    monkeypatch.setattr(FirmwareVehicle, "failure", broken)

    async def run() -> None:
        async with asyncio.timeout(HANG_S), vehicle:
            await asyncio.Event().wait()

    with pytest.raises(ZeroDivisionError):
        asyncio.run(run())


def test_two_px4_take_different_instances_where_ports_do_not_tell_them_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in two network namespaces: each has the ports of its own."""
    monkeypatch.setattr("sitl.firmware.px4.INSTANCES", range(238, 240))
    options = LaunchOptions(px4_stand_in(tmp_path), 1, 2, 10.0)
    monkeypatch.setattr("sitl.firmware.px4.Px4Bridge.open", lambda _: None)
    launches = [px4_launch(options, plant()) for _ in range(2)]
    instances = [launch.argv[launch.argv.index("-i") + 1] for launch in launches]
    assert instances == ["238", "239"]
    launches[0].bridge.close()
    again = px4_launch(options, plant())
    assert again.argv[again.argv.index("-i") + 1] == "238"
    for taken, instance in ((launches[1], 239), (again, 238)):
        with Path(f"/tmp/px4_lock-{instance}").open() as theirs:
            fcntl.flock(theirs, fcntl.LOCK_EX | fcntl.LOCK_NB)  # free for PX4
        taken.bridge.close()


def test_locks_that_are_taken_leave_nothing_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of PX4s that are running, or of others of ours."""
    monkeypatch.setattr("sitl.firmware.px4._LOCK", f"{tmp_path}/theirs-{{}}")
    monkeypatch.setattr("sitl.firmware.px4._OUR_LOCK", f"{tmp_path}/ours-{{}}")
    monkeypatch.setattr("sitl.firmware.px4.INSTANCES", range(40, 43))
    monkeypatch.setattr("sitl.firmware.px4.Px4Bridge.open", lambda _: None)
    options = LaunchOptions(px4_stand_in(tmp_path), 1, 2, 10.0)
    held = [(tmp_path / name).open("w") for name in ("theirs-40", "ours-41")]
    for lock in held:
        fcntl.flock(lock, fcntl.LOCK_EX)
    before = len(list(Path("/proc/self/fd").iterdir()))
    launch = px4_launch(options, plant())
    assert launch.argv[launch.argv.index("-i") + 1] == "42"
    launch.bridge.close()
    launch.bridge.close()
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    monkeypatch.setattr("sitl.firmware.px4.INSTANCES", range(40, 42))
    with pytest.raises(LinkLostError, match="no TCP port from 4600 to 4601 is free"):
        px4_launch(options, plant())
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    for lock in held:
        lock.close()


def test_px4_is_given_no_bias_that_it_would_take_for_a_broken_sensor(tmp_path: Path) -> None:
    config = px4_stand_in(tmp_path)
    limit_mps2 = 0.75 * 0.4  # of EKF2_ABL_LIM
    assert 3 * turn_on_mps2(config) <= limit_mps2
    set_so = config.model_copy(
        update={
            "aircraft": AircraftConfig.model_validate(
                {"sensors": {"imu": {"accel_turn_on_mps2": 0.2}}}
            )
        }
    )
    assert turn_on_mps2(set_so) == 0.2


def turn_on_mps2(config: VehicleConfig) -> float:
    sensors = plant_for(config, home=HOME, streams=RandomStreams(1)).sensors
    assert sensors is not None
    return sensors.config.imu.accel_turn_on_mps2


def test_a_fault_of_the_built_in_links_is_refused(tmp_path: Path) -> None:
    aircraft = AircraftConfig.model_validate({"faults": [{"kind": "link_off"}]})
    config = px4_stand_in(tmp_path).model_copy(update={"aircraft": aircraft})
    with pytest.raises(InputError, match="'link_off' is of the built-in autopilot: a firmware has"):
        plant_for(config, home=HOME, streams=RandomStreams(1))
