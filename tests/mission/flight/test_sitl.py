"""`aerofed sitl`: any ground station may come, several at once, until Ctrl-C."""

import asyncio
import functools
import math
import os
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from patience import HANG_S
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mav
from serving import free_port, served
from small_runs import refused

from mission.cli import call
from mission.config.loading import builtin_config, load_config
from mission.flight.serve.vehicle import _OWN_PORTS, make_vehicles
from sitl.vehicle import Vehicle

pytestmark = pytest.mark.slow

ARM, TAKE_OFF, TERMINATE, REBOOT = 400, 22, 185, 246
ACCEPTED = mav.MAV_RESULT_ACCEPTED
READY = mav.MAV_SYS_STATUS_PREARM_CHECK


def wait_for(client: Any, kind: str, fit: Callable[[Any], bool] = bool) -> Any:
    """The next message of a kind that fits."""
    limit = time.monotonic() + HANG_S
    while time.monotonic() < limit:
        message = client.recv_match(type=kind, blocking=True, timeout=1.0)
        if message is not None and fit(message):
            return message
    raise AssertionError(f"no {kind} that fits")


def command(client: Any, number: int, *params: float) -> int:
    """The MAV_RESULT of a command."""
    values = (*params, *(0.0 for _ in range(7 - len(params))))
    client.mav.command_long_send(client.target_system or 1, 1, number, 0, *values)
    return int(wait_for(client, "COMMAND_ACK", lambda m: m.command == number).result)


def wait_ready(client: Any) -> None:
    wait_for(client, "SYS_STATUS", lambda m: bool(m.onboard_control_sensors_health & READY))


def test_two_ground_stations_at_once() -> None:
    first, second = free_port(), free_port()
    one = mavutil.mavlink_connection(f"udpin:127.0.0.1:{first}")
    two = mavutil.mavlink_connection(f"udpin:127.0.0.1:{second}")
    try:
        with served(
            "--udp", str(first), "--udp", f"udpout://127.0.0.1:{second}", "--speed", "20",
            "--set", "area.home_lat_deg=47.4", "--set", "area.home_lon_deg=8.5",
            "--set", "area.home_alt_msl_m=478",
        ):  # fmt: skip
            for client in (one, two):
                beat = wait_for(client, "HEARTBEAT")
                assert beat.autopilot == mav.MAV_AUTOPILOT_PX4
            wait_ready(one)
            assert command(one, ARM, 1.0) == ACCEPTED
            nan = float("nan")
            climb = (0.0, 0.0, 0.0, nan, nan, nan, 488.0)
            assert command(two, TAKE_OFF, *climb) == ACCEPTED
            seen = wait_for(two, "GLOBAL_POSITION_INT", lambda m: m.relative_alt > 9_000)
            assert (seen.lat / 1e7, seen.lon / 1e7) == pytest.approx((47.4, 8.5), abs=1e-4)
            wait_for(one, "GLOBAL_POSITION_INT", lambda m: m.relative_alt > 9_000)
            # Time goes on in the hover too: nobody waits for a mission here.
            hovering_ms = seen.time_boot_ms + 10_000
            wait_for(one, "GLOBAL_POSITION_INT", lambda m: m.time_boot_ms > hovering_ms)
    finally:
        one.close()
        two.close()


def test_a_crashed_vehicle_is_rebooted() -> None:
    port = free_port()
    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    try:
        with served("--udp", str(port), "--speed", "20"):
            wait_ready(client)
            client.mav.param_set_send(1, 1, b"MIS_TAKEOFF_ALT", 25.0, 9)
            wait_for(client, "PARAM_VALUE", lambda m: m.param_value == 25.0)
            assert command(client, ARM, 1.0) == ACCEPTED
            assert command(client, REBOOT, 1.0) != ACCEPTED  # on the ground, but armed
            assert command(client, TAKE_OFF, *[float("nan")] * 7) == ACCEPTED
            wait_for(client, "GLOBAL_POSITION_INT", lambda m: m.relative_alt > 20_000)
            assert command(client, REBOOT, 1.0) != ACCEPTED
            assert command(client, TERMINATE, 1.0) == ACCEPTED
            wait_for(client, "STATUSTEXT", lambda m: m.text.startswith("Crashed"))
            assert command(client, ARM, 1.0) != ACCEPTED
            before = wait_for(client, "GLOBAL_POSITION_INT").time_boot_ms
            assert command(client, REBOOT, 2.0) != ACCEPTED  # to switch it off
            assert command(client, REBOOT, 1.0) == ACCEPTED
            wait_for(client, "GLOBAL_POSITION_INT", lambda m: m.time_boot_ms < before)
            wait_for(client, "BATTERY_STATUS", lambda m: m.battery_remaining == 100)
            wait_ready(client)
            assert command(client, ARM, 1.0) == ACCEPTED
            assert command(client, TAKE_OFF, *[float("nan")] * 7) == ACCEPTED
            # As high as the parameter says that was set before.
            wait_for(client, "GLOBAL_POSITION_INT", lambda m: m.relative_alt > 24_000)
    finally:
        client.close()


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        ([], (47.397742, 8.545594, 488.0)),  # PX4's simulators: PX4_HOME_LAT, _LON, _ALT
        (["--set", "area.home_alt_msl_m=10"], (47.397742, 8.545594, 10.0)),
        (["--home=-33.5,151.25,20.5"], (-33.5, 151.25, 20.5)),
    ],
)
def test_home_is_px4s_or_the_one_given(
    arguments: list[str], place: tuple[float, float, float]
) -> None:
    port = free_port()
    with served("--udp", f"udpin://127.0.0.1:{port}", *arguments):
        client = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255)
        try:
            client.mav.heartbeat_send(6, 8, 0, 0, 0)
            home = wait_for(client, "HOME_POSITION")
            assert (home.latitude / 1e7, home.longitude / 1e7) == pytest.approx(place[:2])
            assert home.altitude / 1e3 == pytest.approx(place[2])
        finally:
            client.close()


def test_it_listens_for_whoever_comes() -> None:
    port = free_port()
    with served("--udp", f"udpin://127.0.0.1:{port}", "--speed", "max"):
        client = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255)
        try:
            client.mav.heartbeat_send(6, 8, 0, 0, 0)
            assert wait_for(client, "HEARTBEAT").get_srcSystem() == 1
        finally:
            client.close()


def test_ardupilots_tools_connect_over_tcp_and_the_next_vehicle_is_ten_ports_up() -> None:
    """As pymavlink, MAVProxy and Mission Planner do: tcp:HOST:PORT, and others beside and later."""
    port = free_port(socket.SOCK_STREAM)
    with served("--udp", f"tcpin://127.0.0.1:{port - 10}", "-I", "1", "--speed", "20"):
        for _ in range(2):
            clients = [
                mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=250 + number)
                for number in range(2)
            ]
            for client in clients:
                assert wait_for(client, "HEARTBEAT").get_srcSystem() == 2
                client.target_system = 2
            wait_ready(clients[0])
            assert command(clients[1], ARM, 1.0) == ACCEPTED
            assert command(clients[0], ARM, 0.0) == ACCEPTED
            clients[0].port.sendall(b"\xfd\xff noise that ends in the middle")
            for client in clients:
                client.close()


def test_a_vehicle_calls_a_station_over_tcp() -> None:
    station = mavutil.mavlink_connection("tcpin:127.0.0.1:0")
    try:
        port = station.listen.getsockname()[1]
        with served("--udp", f"tcpout://127.0.0.1:{port}"):
            assert wait_for(station, "HEARTBEAT").get_srcSystem() == 1
    finally:
        station.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--udp", "70000"], ["--udp 70000", "65535"]),
        (["--udp", "udp://host"], ["--udp udp://host", "udpin://HOST:PORT"]),
        (["--speed", "0"], ["--speed 0"]),
        (["--home", "47,8"], ["--home 47,8", "LAT,LON,ALT", "--home 47.3977,8.54559,488"]),
        (["--count", "0"], ["0 vehicles", "from 1 to 64"]),
        (["--count", "3", "--set", "vehicle.system_id=249"], ["system id 251: they end at 250"]),
        (["--count", "2", "--udp", "20540", "--udp", "20541"], ["--udp 20541: vehicle-2 speaks"]),
        (["--instance", "-1"], ["--instance -1", "from 0"]),
        (["--instance", "250"], ["vehicle-251 would have system id 251"]),
        (["--home", "north,8,1"], ["--home north,8,1", "LAT,LON,ALT"]),
        (["--home", "47,200,1"], ["--home: longitude 200.0", "less than or equal to 180"]),
        (["--set", "vehicle.system_id=0"], ["vehicle.system_id = 0"]),
        (["--set", "vehicle.parameters.NO_SUCH=1"], ["NO_SUCH"]),
    ],
)
def test_wrong_input_is_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]
) -> None:
    assert call(["sitl", *arguments]) == 2
    refused(capsys, *words)


def test_a_second_vehicle_on_px4s_ports_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first:
        first.bind(("", 0))  # in place of PX4's 14580, which others may have on this machine
        port = first.getsockname()[1]
        monkeypatch.setitem(_OWN_PORTS, 14540, port)
        assert call(["sitl"]) == 5
    words = capsys.readouterr().err
    process = f" by process {os.getpid()} (" if sys.platform == "linux" else ""
    assert words.startswith(f"aerofed: UDP port {port} is taken{process}")
    assert "--instance 1 " in words


def test_an_instance_is_the_vehicle_of_that_number() -> None:
    config = load_config(builtin_config("quickstart.toml"))
    ports = ("14540", "14550")
    third = make_vehicles(config, count=3, udp=ports, logs=None)[2]
    (alone,) = make_vehicles(config, count=1, udp=ports, logs=None, instance=2)
    assert alone.urls == {"udpout://127.0.0.1:14542": 14582, "udpout://127.0.0.1:14550": 18572}
    assert alone.urls == third.urls
    # Two cannot listen at one place, so that those places count up, too; ArduPilot's by ten.
    listen = ("14550", "udpin://127.0.0.1:14600", "tcpin://127.0.0.1:5760", "tcp://127.0.0.1:7000")
    (alone,) = make_vehicles(config, count=1, udp=listen, logs=None, instance=2)
    assert list(alone.urls) == [
        "udpout://127.0.0.1:14552", "udpin://127.0.0.1:14602", "tcpin://127.0.0.1:5780",
        "tcp://127.0.0.1:7000",
    ]  # fmt: skip
    assert alone.vehicle.aircraft.frame.origin == third.vehicle.aircraft.frame.origin


def test_from_the_tenth_on_vehicles_share_a_port_as_with_px4() -> None:
    """px4-rc.mavlink: 14540 + instance, and 14549 above 9; its own ports count on."""
    config = load_config(builtin_config("quickstart.toml"))
    ports = [list(one.urls.items()) for one in make_vehicles(
        config, count=12, udp=("14540", "14550"), logs=None
    )]  # fmt: skip
    assert ports == [
        [(f"udpout://127.0.0.1:{14540 + min(i, 9)}", 14580 + i),
         ("udpout://127.0.0.1:14550", 18570 + i)]
        for i in range(12)
    ]  # fmt: skip


def test_vehicles_are_called_by_their_numbers_as_their_folders_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def interrupted(_: asyncio.Event) -> None:
        """All is said by then."""

    monkeypatch.setattr(asyncio.Event, "wait", interrupted)
    port = str(free_port())
    arguments = ["--instance", "1", "--count", "2", "--udp", f"udpout://127.0.0.1:{port}"]
    assert call(["sitl", *arguments, "--logs", str(tmp_path)]) == 0
    first, *each = capsys.readouterr().out.splitlines()
    folders = sorted(path.name for path in tmp_path.iterdir())
    assert folders == [line.split()[0] for line in each] == ["vehicle-2", "vehicle-3"]
    assert first.endswith(f"aerofed compare {tmp_path / folders[0]}")
    # Without words about it: one vehicle, the first.
    assert call(["sitl", *arguments[4:]]) == 0
    _, *each = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in each] == ["vehicle-1"]


def test_the_environment_of_px4s_simulators_is_heard(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    monkeypatch.setenv("PX4_HOME_LAT", "40")
    monkeypatch.setenv("PX4_SIM_SPEED_FACTOR", "3")
    with served("--udp", str(port)) as process:
        assert process.poll() is None
    monkeypatch.setenv("PX4_HOME_LAT", "north")
    assert call(["sitl"]) == 2
    assert capsys.readouterr().err == (
        "aerofed: PX4_HOME_LAT=north: must be a number, such as 47.3977\n"
    )


def test_a_port_in_use_is_a_link_error(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert call(["sitl", "--udp", f"udpin://127.0.0.1:{port}"]) == 5
    printed = capsys.readouterr()
    assert printed.out == ""
    assert str(port) in printed.err
    assert "in use" in printed.err


def test_several_vehicles_are_each_flown_by_their_own_script(tmp_path: Path) -> None:
    first = free_port(count=3)
    clients = [mavutil.mavlink_connection(f"udpin:127.0.0.1:{first + i}") for i in range(3)]
    everybody = free_port()
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{everybody}")
    logs = tmp_path / "flights"
    try:
        with served(
            "--count", "3", "--udp", str(first), "--udp", str(everybody), "--speed", "20",
            "--logs", str(logs),
        ):  # fmt: skip
            for i, client in enumerate(clients):
                client.target_system = i + 1
                wait_ready(client)
                home = wait_for(client, "HOME_POSITION")
                east = math.radians(home.longitude / 1e7 - 8.545594) * 6.378e6 * 0.6769
                assert east == pytest.approx(5.0 * i, abs=0.1)
            for i, client in enumerate(clients):  # at once, each to a height of its own
                assert command(client, ARM, 1.0) == ACCEPTED
                nan = float("nan")
                climb = (0.0, 0.0, 0.0, nan, nan, nan, 488.0 + 10.0 * (i + 1))
                assert command(client, TAKE_OFF, *climb) == ACCEPTED
            for i, client in enumerate(clients):
                hover_mm = 10_000 * (i + 1)
                fit = functools.partial(_within, hover_mm)
                assert wait_for(client, "GLOBAL_POSITION_INT", fit).get_srcSystem() == i + 1
            heard = {wait_for(station, "HEARTBEAT").get_srcSystem() for _ in range(30)}
            assert heard == {1, 2, 3}
            for client in clients:
                assert command(client, TERMINATE, 1.0) == ACCEPTED
        for i in range(3):
            (log,) = (logs / f"vehicle-{i + 1}").iterdir()
            assert log.name == "flight-0001.mcap"
            assert log.read_bytes().endswith(b"\x89MCAP0\r\n")  # complete
    finally:
        for client in (*clients, station):
            client.close()


def _begins(offset: int, part: Any) -> bool:
    return bool(part.ofs == offset)


def _within(height_mm: int, message: Any) -> bool:
    return abs(message.relative_alt - height_mm) < 1_000


def test_vehicles_do_not_disturb_each_other() -> None:
    """Stepped in turns each flies to the last bit what it flies alone."""

    def made(count: int) -> list[Vehicle]:
        config = load_config(builtin_config("quickstart.toml"), {})
        return [one.vehicle for one in make_vehicles(config, count=count, udp=["14540"], logs=None)]

    def fly(vehicles: list[Vehicle]) -> list[bytes]:
        tracks = [b"" for _ in vehicles]
        for tick in range(3000):
            for i, vehicle in enumerate(vehicles):
                vehicle.step()
                if tick == 100:
                    assert vehicle.autopilot.flight.arm() is None
                    assert vehicle.autopilot.flight.take_off(None) is None
                if tick % 50 == 0:
                    truth = vehicle.aircraft.truth
                    tracks[i] += truth.pos_ned_m.tobytes() + truth.q_frd_to_ned.tobytes()
        return tracks

    together = fly(made(3))
    assert together[0] == fly(made(1))[0]
    assert together == fly(made(3))
    assert len(set(together)) == 3


def test_a_flight_is_logged_and_downloaded(tmp_path: Path) -> None:
    port = free_port()
    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    try:
        with served("--udp", str(port), "--speed", "20", "--logs", str(tmp_path / "logs")):
            wait_ready(client)
            client.mav.log_request_list_send(1, 1, 0, 0xFFFF)
            assert wait_for(client, "LOG_ENTRY").num_logs == 0
            assert command(client, ARM, 1.0) == ACCEPTED
            assert command(client, TAKE_OFF, *[float("nan")] * 7) == ACCEPTED
            wait_for(client, "GLOBAL_POSITION_INT", lambda m: m.relative_alt > 9_000)
            client.mav.log_request_list_send(1, 1, 0, 0xFFFF)
            assert wait_for(client, "LOG_ENTRY").num_logs == 0  # it is still being written
            assert command(client, 21) == ACCEPTED
            wait_for(client, "HEARTBEAT", lambda m: not m.base_mode & 128)
            client.mav.log_request_list_send(1, 1, 0, 0xFFFF)
            entry = wait_for(client, "LOG_ENTRY")
            assert entry.num_logs == 1
            fetched = b""
            while len(fetched) < entry.size:
                client.mav.log_request_data_send(1, 1, 0, len(fetched), 900)
                part = wait_for(client, "LOG_DATA", functools.partial(_begins, len(fetched)))
                fetched += bytes(part.data[: part.count])
        assert fetched == (tmp_path / "logs" / "flight-0001.mcap").read_bytes()
    finally:
        client.close()
