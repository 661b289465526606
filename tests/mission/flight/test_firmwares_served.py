"""`aerofed world` of several: made-up firmwares, and one of our own, in one world."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from firmware_threads import CLIMB, ArduPilot, Px4
from patience import until
from pymavlink import mavutil
from serving import free_port

from mission.cli import call
from mission.config.loading import load_config
from mission.flight.serve import firmwares
from mission.flight.serve.firmwares import serve_world

QUICKSTART = Path("quickstart")
ON_TOP = (
    "--set",
    "vehicle-1:area.home_m=[100, 100]",
    "--set",
    "vehicle-2:area.home_m=[100, 100.5]",
)
GNSS_OFF = 'vehicle.aircraft.faults=[{kind="gnss_off", at_s=40}]'


@pytest.fixture
def ports(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Free ones in the place of the usual ones."""
    found = {
        "px4": free_port(socket.SOCK_STREAM, count=2),
        "ardupilot": free_port(count=11),
        "udp": free_port(count=4),
        "heard": free_port(count=2),
    }
    monkeypatch.setitem(firmwares._PORTS, "px4", (found["px4"], 1))
    monkeypatch.setitem(firmwares._PORTS, "ardupilot", (found["ardupilot"], 10))
    monkeypatch.setitem(firmwares._HEARD, "px4", ("udpin://127.0.0.1", found["heard"], 1))
    monkeypatch.setitem(firmwares._HEARD, "ardupilot", ("udpin://127.0.0.1", found["heard"] + 1, 1))
    monkeypatch.setattr(firmwares, "_UDP", (str(found["udp"]),))
    return found


@contextmanager
def world(
    autopilots: list[str], built_in: int = 0, *, logs: Path | None = None
) -> Iterator[list[str]]:
    """A world at full speed, and what it says."""
    said, stop = list[str](), threading.Event()
    failed: list[BaseException] = []

    def serve() -> None:
        try:
            serve_world(
                load_config(QUICKSTART), autopilots, built_in, each={}, speed=float("inf"),
                say=said.append, logs=logs, stop=stop.is_set,
            )  # fmt: skip
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        until(lambda: bool(failed) or any("Ctrl-C ends" in line for line in said))
        yield said
    finally:
        stop.set()
        thread.join()
        assert not failed, failed


def has(said: list[str], text: str) -> Callable[[], bool]:
    return lambda: any(text in line for line in said)


def test_px4s_and_arducopter_fly_in_one_world_and_their_distances_are_told(
    ports: dict[str, int], tmp_path: Path
) -> None:
    with world(["px4", "px4", "ardupilot"], logs=tmp_path / "logs") as said:
        crews: list[Any] = [Px4(ports["px4"]), Px4(ports["px4"] + 1)]
        until(has(said, "vehicle-2: px4 has come"))
        assert not has(said, "time begins")()
        crews.append(climbs := ArduPilot(ports["ardupilot"], CLIMB))
        until(lambda: climbs.seconds > 3.0)
        crews[1].end()
        until(has(said, "vehicle-2: PX4 has hung up"))
        gone_s = climbs.seconds
        until(lambda: climbs.seconds > gone_s + 2.0)
    for crew in crews:
        crew.end()
    told = [line for line in said if " m apart at " in line]
    assert [line.partition(":")[0] for line in told] == [
        "vehicle-1 and vehicle-3", "vehicle-2 and vehicle-3",
    ]  # fmt: skip
    found = json.loads((tmp_path / "logs" / "separation.json").read_text())
    assert found["pairs"][0]["least_m"] == pytest.approx(10.0, abs=0.1)
    assert found["pairs"][1]["least_m"] == pytest.approx(5.0, abs=0.1)
    assert sorted(found["homes"]) == ["vehicle-1", "vehicle-2", "vehicle-3"]
    assert {path.name for path in (tmp_path / "logs").iterdir()} == {
        "separation.json", "vehicle-1", "vehicle-2", "vehicle-3",
    }  # fmt: skip


def test_one_of_our_own_flies_beside_them(ports: dict[str, int]) -> None:
    with world(["ardupilot"], 1) as said:
        heard: Any = mavutil.mavlink_connection(f"udpin:127.0.0.1:{ports['udp'] + 1}")
        before = heard.recv_match(type="HEARTBEAT", blocking=True, timeout=60)
        assert before.get_srcSystem() == 2  # it speaks while time waits for the firmware
        pilot = ArduPilot(ports["ardupilot"])
        until(lambda: pilot.seconds > 5.0)
        tells = heard.recv_match(type="SYSTEM_TIME", blocking=True, timeout=60)
        assert tells.time_boot_ms >= 0
        pilot.end()
        heard.close()
    assert any(line.startswith("vehicle-2 at ") and "MAVLink on" in line for line in said)


def test_who_is_alone_is_not_told_that_all_have_come(ports: dict[str, int]) -> None:
    with world(["ardupilot"]) as said:
        crew = ArduPilot(ports["ardupilot"])
        until(lambda: crew.seconds > 1.0)
        crew.end()
    assert has(said, "ardupilot has come")()
    assert not has(said, "all have come")()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "aerofed world: --px4 or --ardupilot is missing, once for each vehicle"),
        (("--built-in",), "; aerofed sitl serves those of --built-in alone"),
        (("--px4", "--ardupilot", "--port", "4570"), "--port 4570: for one vehicle alone"),
        (
            ("--px4", "--px4", "--mavlink", "udpin://0.0.0.0:14030"),
            "--mavlink udpin://0.0.0.0:14030: for one vehicle alone",
        ),
        (("--px4",) * 65, "65 vehicles: from 1 to 64 in one world"),
        (("--px4", "--set", "vehicle-1:seed=3"), "--set vehicle-1:...: for one of several"),
        (
            ("--px4", "--px4", "--set", "vehicle-3:seed=3"),
            "no vehicle 'vehicle-3' of these: vehicle-1, vehicle-2",
        ),
        (
            ("--px4", "--ardupilot", "--set", "vehicle.traffic=adsb"),
            "vehicle.traffic = 'adsb': a firmware cannot be told of others",
        ),
        (
            ("--px4", "--px4", *ON_TOP),
            "vehicle-1 and vehicle-2 stand 0.50 m apart: aircraft touch within 0.75 m",
        ),
        (
            ("--px4", "--ardupilot", "--set", f"vehicle-2:{GNSS_OFF}"),
            "gnss_off: ArduPilot's JSON interface cannot leave",
        ),
        (("--px4", "--count", "2"), "aerofed world --px4 --px4 serves two"),
    ],
)
def test_what_cannot_be_served_is_refused_in_one_line(
    ports: dict[str, int],  # noqa: ARG001
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    said: str,
) -> None:
    assert call(["world", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_port_that_is_taken_is_said_and_nothing_is_left_open(
    ports: dict[str, int], capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", ports["px4"] + 1))
        assert call(["world", "--px4", "--px4"]) == 5
        (line,) = capsys.readouterr().err.splitlines()
        assert f"TCP port {ports['px4'] + 1}: cannot be had" in line
    with socket.socket() as free:
        free.bind(("127.0.0.1", ports["px4"]))
