"""`aerofed run --gcs`: a ground station sees the vehicle that MAVSDK flies, and changes nothing."""

import socket
import threading
import time
from pathlib import Path

import pytest
import small_runs
from mcap.reader import make_reader
from pymavlink import mavutil
from serving import free_port

from mission.cli import call

SMALL = ("--rounds", "1", *small_runs.SMALL, "--set", "planner.kind=paper")


class GroundStation(threading.Thread):
    """Listens, and asks for parameters and the mission again and again."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self.seen: dict[str, int] = {}
        self.highest_m = 0.0
        self._link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
        self._end = threading.Event()

    def run(self) -> None:
        asked_at = 0.0
        while not self._end.is_set():
            message = self._link.recv_match(blocking=True, timeout=0.1)
            if message is None:
                continue
            kind = message.get_type()
            self.seen[kind] = self.seen.get(kind, 0) + 1
            if kind == "GLOBAL_POSITION_INT":
                self.highest_m = max(self.highest_m, message.relative_alt / 1e3)
            if time.monotonic() - asked_at > 0.2:
                asked_at = time.monotonic()
                self._link.mav.heartbeat_send(6, 8, 0, 0, 0)
                self._link.mav.param_request_list_send(1, 1)
                self._link.mav.mission_request_list_send(1, 1)
                # Faster telemetry than MAVSDK asked for.
                self._link.mav.command_long_send(1, 1, 511, 0, 33, 20_000, 0, 0, 0, 0, 0)

    def stop(self) -> None:
        self._end.set()
        self.join()
        self._link.close()


def flown(folder: Path) -> tuple[bytes, bytes, list[tuple[str, int, bytes]]]:
    """Tables, and every message of the log."""
    with (folder / "flight.mcap").open("rb") as file:
        messages = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]
    return (folder / "rounds.csv").read_bytes(), (folder / "uplinks.csv").read_bytes(), messages


@pytest.mark.slow
def test_a_ground_station_sees_the_flight_and_changes_nothing(tmp_path: Path) -> None:
    port = free_port()
    station = GroundStation(port)
    station.start()
    try:
        url = f"udpout://127.0.0.1:{port}"
        assert call(["run", "--out", str(tmp_path / "seen"), "--gcs", url, *SMALL]) == 0
    finally:
        station.stop()
    assert call(["run", "--out", str(tmp_path / "alone"), *SMALL]) == 0
    assert flown(tmp_path / "seen") == flown(tmp_path / "alone")
    assert station.highest_m == pytest.approx(30, abs=3)
    assert station.seen["PARAM_VALUE"] > 20
    assert station.seen["MISSION_COUNT"] > 0
    assert {"HEARTBEAT", "SYS_STATUS", "ATTITUDE", "MISSION_CURRENT"} <= station.seen.keys()
    assert len(small_runs.rows(tmp_path / "seen" / "rounds.csv")) == 1


def test_a_wrong_address_is_refused_before_anything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert call(["run", "--out", str(out), "--gcs", "127.0.0.1:14550", *SMALL]) == 2
    words = "--gcs: 127.0.0.1:14550: no address of a link", "udpout://HOST:PORT"
    small_runs.refused(capsys, *words)
    assert not out.exists()


def test_an_external_autopilot_is_not_shown_to_ground_stations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url, out = "udpout://127.0.0.1:14550", tmp_path / "out"
    options = ["--gcs", url, "--vehicle", "udpin://127.0.0.1:14540"]
    assert call(["run", "--out", str(out), *options, *SMALL]) == 2
    small_runs.refused(capsys, "link: gcs", "--vehicle")
    assert not out.exists()


def test_a_port_in_use_is_a_link_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        url = f"udpin://127.0.0.1:{port}"
        assert call(["run", "--out", str(tmp_path / "out"), "--gcs", url, *SMALL]) == 5
    small_runs.refused(capsys, str(port), "in use")
    assert not (tmp_path / "out").exists()
