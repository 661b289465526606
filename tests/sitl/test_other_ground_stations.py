"""Ground stations that share no code with MAVSDK, over UDP, with the real aircraft."""

import asyncio
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from patience import HANG_S
from pymavlink import mavftp, mavutil, mavwp
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME, Recorder, make_vehicle, until

from flightdyn.frames import LocalFrame
from flightdyn.random import RandomStreams
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.parameters import TABLE
from sitl.config import VehicleConfig
from sitl.links import UdpLink
from sitl.logfolder import LogFolder
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

pytestmark = pytest.mark.slow

# Home, take-off, two points, landing, as a ground station draws it: north, east, height, command.
PLACES = [(0, 0, 0, 16), (0, 0, 20, 22), (50, 0, 20, 16), (50, 40, 20, 16), (10, 40, 0, 21)]


@pytest.fixture
def waypoint_file(tmp_path: Path) -> Path:
    """A mission in the format that MAVProxy and Mission Planner share."""
    rows = ["QGC WPL 110"]
    for seq, (north, east, height, command) in enumerate(PLACES):
        place = LocalFrame(HOME).to_geodetic(np.array([north, east, 0.0]))
        frame, z = (0, HOME.alt_msl_m) if seq == 0 else (3, height)
        position = f"{place.lat_deg:.8f}\t{place.lon_deg:.8f}\t{z}"
        rows.append(f"{seq}\t{int(seq == 0)}\t{frame}\t{command}\t0\t0\t0\t0\t{position}\t1")
    path = tmp_path / "mission.txt"
    path.write_text("\n".join(rows) + "\n")
    return path


def assert_flown(recorder: Recorder) -> None:
    """The whole mission was flown and ended on the ground where it should."""
    assert [event.seq for event in recorder.of_kind("reached")] == [0, 1, 2, 3, 4]
    for event in recorder.of_kind("reached")[2:4]:
        north, east, height, _ = PLACES[event.seq or 0]
        miss = np.linalg.norm(event.belief.pos_ned_m - np.array([north, east, -height]))
        assert miss < 5.0
    landed = recorder.of_kind("armed")[-1]
    assert landed.text == "disarmed"
    assert np.linalg.norm(landed.truth.pos_ned_m[:2] - np.array([10.0, 40.0])) < 3.0


class Station:
    """pymavlink's own connection class, in a thread of its own as it blocks."""

    def __init__(self, port: int) -> None:
        self.link: Any = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=255, dialect="common"
        )

    def say_hello(self) -> None:
        self.link.mav.heartbeat_send(6, 8, 0, 0, 4)

    def wait(self, kind: str, condition: Callable[[Any], bool] = lambda _: True) -> Any:
        limit = time.monotonic() + HANG_S
        while time.monotonic() < limit:
            message = self.link.recv_match(type=kind, blocking=True, timeout=1.0)
            self.say_hello()
            if message is not None and condition(message):
                return message
        raise AssertionError(f"no {kind}")

    def command(self, number: int, *params: float) -> int:
        seven = (*params, *[0.0] * (7 - len(params)))
        self.link.mav.command_long_send(1, 1, number, 0, *seven)
        return int(self.wait("COMMAND_ACK", lambda ack: ack.command == number).result)

    def fly(self, mission: Path) -> None:
        self.say_hello()
        self.link.wait_heartbeat(timeout=HANG_S)
        self.wait("SYS_STATUS", lambda s: bool(s.onboard_control_sensors_health & 0x10000000))
        self.link.param_fetch_all()
        names: set[str] = set()
        while len(names) < len(TABLE):
            names.add(self.wait("PARAM_VALUE").param_id)
        self.link.param_set_send("RTL_RETURN_ALT", 55.0)
        self.wait("PARAM_VALUE", lambda p: p.param_id == "RTL_RETURN_ALT" and p.param_value == 55.0)

        loader = mavwp.MAVWPLoader()
        assert loader.load(str(mission)) == len(PLACES)
        self.link.waypoint_clear_all_send()
        self.wait("MISSION_ACK")
        self.link.waypoint_count_send(loader.count())
        for _ in range(loader.count()):
            asked = self.wait("MISSION_REQUEST_INT")
            # The old message of an old library: floats instead of integers.
            self.link.mav.send(loader.wp(asked.seq))
        assert self.wait("MISSION_ACK").type == 0
        assert self.command(400, 1.0) == 0
        assert self.command(300) == 0
        self.wait("MISSION_CURRENT", lambda current: current.mission_state == 5)
        self.wait("HEARTBEAT", lambda beat: not beat.base_mode & 128)
        self.link.close()


def test_pymavlink_mavutil(waypoint_file: Path) -> None:
    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        link = UdpLink("udpin://127.0.0.1:0")
        async with Simulation(vehicle, link):
            station = Station(link.port)
            await asyncio.to_thread(station.fly, waypoint_file)
        assert vehicle.autopilot.parameters["RTL_RETURN_ALT"] == 55.0
        assert_flown(recorder)

    asyncio.run(run())
    assert threading.active_count() < 20


class MavProxy:
    """MAVProxy in a process of its own, driven through its console."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self.said = ""

    async def listen(self) -> None:
        assert self._process.stdout is not None
        while data := await self._process.stdout.read(4096):
            self.said += data.decode(errors="replace")

    async def type(self, line: str, *, answer: str | None = None) -> None:
        assert self._process.stdin is not None
        before = len(self.said)
        self._process.stdin.write(f"{line}\n".encode())
        await self._process.stdin.drain()
        if answer is not None:
            await self.hears(answer, since=before)

    async def hears(self, text: str, *, since: int = 0) -> None:
        limit = time.monotonic() + HANG_S
        while text not in self.said[since:]:
            assert time.monotonic() < limit, f"no {text!r} in {self.said!r}"
            await asyncio.sleep(0.02)


@asynccontextmanager
async def mavproxy(link: UdpLink, folder: Path, more: str = "") -> AsyncIterator[MavProxy]:
    """MAVProxy at the other end of a link, with its usual modules and `more`."""
    script = Path(sys.executable).with_name("mavproxy.py")
    process = await asyncio.create_subprocess_exec(
        sys.executable, str(script), "--master", f"udpout:127.0.0.1:{link.port}",
        "--state-basedir", str(folder), "--source-system", "255",
        "--default-modules", f"wp,param,arm,mode,cmdlong,misc,fence{more}",
        cwd=folder, stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    console = MavProxy(process)
    listening = asyncio.create_task(console.listen())
    try:
        yield console
    finally:
        process.kill()  # it asks before it quits
        await process.wait()
        await listening


def test_mavproxy(waypoint_file: Path, tmp_path: Path) -> None:
    """Connect, read and set parameters, load and fly a mission, list it, see the vehicle land."""
    pytest.importorskip("MAVProxy", reason="needs MAVProxy, a development dependency")

    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        link = UdpLink("udpin://127.0.0.1:0")
        async with Simulation(vehicle, link), mavproxy(link, tmp_path) as console:
            await fly_with(console, vehicle, waypoint_file)
        assert_flown(recorder)

    asyncio.run(run())


async def fly_with(console: MavProxy, vehicle: Any, mission: Path) -> None:
    await console.hears("online system 1")
    await console.hears(f"Received {len(TABLE)} parameters")
    await console.type("param show RTL_RETURN_ALT", answer="RTL_RETURN_ALT   30.0")
    await console.type("param set RTL_RETURN_ALT 41.5")
    await until(lambda: vehicle.autopilot.parameters["RTL_RETURN_ALT"] == 41.5)
    await console.type("param set GF_ACTION 3")
    await until(lambda: vehicle.autopilot.parameters["GF_ACTION"] == 3.0)
    await console.type(f"wp load {mission}", answer="MISSION_ACK: TYPE_MISSION: ACCEPTED")
    assert len(vehicle.autopilot.flight.mission.items) == len(PLACES)
    await console.type("wp list", answer="Saved waypoints to")
    await console.type("long DO_SET_SERVO 1 1500", answer="UNSUPPORTED")
    await console.type("arm throttle", answer="COMPONENT_ARM_DISARM: ACCEPTED")
    # Its "mode" command cannot name PX4's modes; "long" sends any command.
    await console.type("long DO_SET_MODE 129 4 4", answer="DO_SET_MODE: ACCEPTED")
    await until(lambda: vehicle.autopilot.mode is Mode.HOLD and not vehicle.aircraft.armed)
    await console.hears("DISARMED")


def test_two_ground_stations_at_once(waypoint_file: Path) -> None:
    """A second station on a second link watches while the first one flies."""

    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        links = UdpLink("udpin://127.0.0.1:0"), UdpLink("udpin://127.0.0.1:0")
        async with Simulation(vehicle, *links):
            pilot, watcher = (Station(link.port) for link in links)
            watcher.say_hello()

            def watch() -> int:
                watcher.wait("MISSION_ITEM_REACHED", lambda message: message.seq == 4)
                watcher.link.close()
                return 4

            seen, _ = await asyncio.gather(
                asyncio.to_thread(watch), asyncio.to_thread(pilot.fly, waypoint_file)
            )
            assert seen == 4
        assert_flown(recorder)

    asyncio.run(run())


def test_mavproxy_lists_draws_and_downloads(tmp_path: Path) -> None:
    """Fence, rally points, logs and PX4's modes by MAVProxy's own commands."""
    pytest.importorskip("MAVProxy", reason="needs MAVProxy, a development dependency")
    logs = tmp_path / "logs"
    logs.mkdir()
    for number in (1, 2):
        (logs / f"flight-000{number}.mcap").write_bytes(bytes(range(256)) * 50 * number)
    fence, rally = tmp_path / "fence.txt", tmp_path / "rally.txt"
    fence.write_text(_drawn([(120, 120), (-80, 120), (-80, -80), (120, -80)], 5001, 4))
    rally.write_text(_drawn([(20, 30)], 5100, 0))

    async def run() -> None:
        disk = LogFolder(logs, being_written=lambda: None)
        vehicle = Vehicle(
            VehicleConfig(), home=HOME, streams=RandomStreams(1), logs=disk, standalone=True
        )
        link = UdpLink("udpin://127.0.0.1:0")
        console_by = mavproxy(link, tmp_path, ",rally,log")
        async with Simulation(vehicle, link), console_by as console:
            await console.hears("online system 1")
            await console.hears(f"Received {len(TABLE)} parameters")
            await console.type(f"fence load {fence}")
            await until(
                lambda: len(vehicle.autopilot.transfer.lists[mav.MAV_MISSION_TYPE_FENCE]) == 4
            )
            await console.type(f"rally load {rally}")
            await until(
                lambda: len(vehicle.autopilot.transfer.lists[mav.MAV_MISSION_TYPE_RALLY]) == 1
            )
            await console.type("log list", answer="Log 1")
            await console.type("log download 1 fetched.mcap", answer="Finished downloading")
            await console.type("long DO_GRIPPER 1 1", answer="UNSUPPORTED")
            await console.type("arm throttle", answer="COMPONENT_ARM_DISARM: ACCEPTED")
            nan, height = "nan", HOME.alt_msl_m + 15.0
            climb = f"long NAV_TAKEOFF 0 0 0 {nan} {nan} {nan} {height}"
            await console.type(climb, answer="NAV_TAKEOFF: ACCEPTED")
            await until(lambda: vehicle.autopilot.mode is Mode.HOLD)
            await console.type("long NAV_RETURN_TO_LAUNCH", answer="RETURN_TO_LAUNCH: ACCEPTED")
            await until(lambda: not vehicle.aircraft.armed)
        truth = vehicle.aircraft.truth.pos_ned_m
        assert np.linalg.norm(truth[:2]) < 3.0  # home is closer than the rally point

    asyncio.run(run())
    fetched = (tmp_path / "fetched.mcap").read_bytes()
    assert fetched == (logs / "flight-0002.mcap").read_bytes()


def _drawn(places: list[tuple[int, int]], command: int, count: int) -> str:
    """A list in the format that MAVProxy loads fences and rally points from."""
    rows = ["QGC WPL 110"]
    for seq, (north, east) in enumerate(places):
        place = LocalFrame(HOME).to_geodetic(np.array([north, east, 0.0]))
        height = 0 if count else 30  # a corner of a fence has none
        position = f"{place.lat_deg:.8f}\t{place.lon_deg:.8f}\t{height}"
        rows.append(f"{seq}\t0\t3\t{command}\t{count}\t0\t0\t0\t{position}\t1")
    return "\n".join(rows) + "\n"


def fetch_by_pymavlink(port: int) -> bytes:
    """pymavlink's own FTP client: a listing, a file, the parameters."""
    station = Station(port)
    station.say_hello()
    station.link.wait_heartbeat(timeout=HANG_S)
    client = mavftp.MAVFTP(station.link, target_system=1, target_component=1)
    assert client.cmd_list(["/log"]).error_code == mavftp.FtpError.Success
    got: list[bytes] = []
    client.cmd_get(["/log/flight-0001.mcap"], callback=lambda file: got.append(file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=HANG_S)
    client.cmd_get(["@PARAM/param.pck"], callback=lambda file: got.append(file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=HANG_S)
    values = client.ftp_param_decode(got[-1])
    assert values is not None
    assert len(values.params) == len(TABLE)
    station.link.close()
    return got[0]


def test_pymavlink_reads_files(tmp_path: Path) -> None:
    whole = bytes(range(251)) * 400
    (tmp_path / "flight-0001.mcap").write_bytes(whole)

    async def run() -> None:
        disk = LogFolder(tmp_path, being_written=lambda: None)
        vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1), logs=disk)
        link = UdpLink("udpin://127.0.0.1:0")
        async with Simulation(vehicle, link):
            assert await asyncio.to_thread(fetch_by_pymavlink, link.port) == whole

    asyncio.run(run())
