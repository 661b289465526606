"""Firmware as a process: what cannot be started, what ends, and what must not be left behind."""

import asyncio
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import cast

import pytest
from firmware_stand_ins import plant
from patience import HANG_S, until

from sitl.config import FirmwareConfig, VehicleConfig
from sitl.errors import FirmwareSilentError
from sitl.firmware.bridge import Bridge
from sitl.firmware.launch import FirmwareProcess, Launch, check_binary
from sitl.firmware.vehicle import FirmwareVehicle


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # A child of a process that nobody waits for stays as a zombie.
    state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    return state != "Z"


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
        "import sys, time; from pathlib import Path; "
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
    firmware = script(tmp_path / "fw", ". hook.sh")
    launch = Launch(cast(Bridge, None), (firmware,), {"hook.sh": "echo ours"}, own_scripts=True)
    process = launch.start(Path("firmware"))
    until(lambda: bool(process.died))
    assert process.last_words() == "ours"
    process.stop()


def test_an_error_nobody_foresaw_ends_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody would look any more whether the firmware is alive."""

    def broken(_: FirmwareVehicle) -> None:
        raise ZeroDivisionError

    for folder in ("bin", "etc/init.d-posix"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "etc" / "init.d-posix" / "rcS").touch()
    script(tmp_path / "bin" / "px4", "sleep 600")
    firmware = FirmwareConfig(path=tmp_path / "bin" / "px4")
    config = VehicleConfig(autopilot="px4", firmware=firmware)
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
    monkeypatch.setattr(FirmwareVehicle, "_failure", broken)

    async def run() -> None:
        async with asyncio.timeout(HANG_S), vehicle:
            await asyncio.Event().wait()

    with pytest.raises(ZeroDivisionError):
        asyncio.run(run())
