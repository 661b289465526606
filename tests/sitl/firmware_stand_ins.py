"""The firmwares' ends of their simulator protocols, by pymavlink and the json module."""

import json
import socket
import struct
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME

from flightdyn.config import AircraftConfig
from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from sitl.config import FirmwareConfig, VehicleConfig


def plant(physics_hz: int = 250, **changes: Any) -> Plant:
    """The default aircraft on the ground at home."""
    config = AircraftConfig(physics_hz=physics_hz, **changes)
    return Plant(config, home=HOME, streams=RandomStreams(1))


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def px4_stand_in(folder: Path, does: str = "sleep 600") -> VehicleConfig:
    """A vehicle under a shell script that is taken for PX4."""
    for part in ("bin", "etc/init.d-posix"):
        (folder / part).mkdir(parents=True)
    (folder / "etc" / "init.d-posix" / "rcS").touch()
    script(folder / "bin" / "px4", does)
    firmware = FirmwareConfig(path=folder / "bin" / "px4")
    return VehicleConfig(autopilot="px4", firmware=firmware)


class Px4StandIn:
    """PX4's module simulator_mavlink: a client that answers each HIL_SENSOR when told to."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._socket.settimeout(0.05)
        self._out = mav.MAVLink(None, srcSystem=1, srcComponent=1)
        self._in = mav.MAVLink(None)
        self.heard: list[Any] = []
        self.send(mav.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3))

    def hear(self, *, at_once: bool = False) -> list[Any]:
        """What has come since this was asked last, and for a moment more; or `at_once`."""
        before = len(self.heard)
        try:
            while data := self._socket.recv(65536):
                self.heard += self._in.parse_buffer(data) or []
                if at_once:
                    break
        except TimeoutError:
            pass
        return self.heard[before:]

    def send(self, message: Any) -> None:
        self.send_bytes(bytes(message.pack(self._out)))

    def send_bytes(self, data: bytes) -> None:
        self._socket.sendall(data)

    def control(self, t_us: int, motors: tuple[float, ...] = (), *, flags: int = 1) -> None:
        """HIL_ACTUATOR_CONTROLS, armed where there are motors."""
        controls = [*motors, *(0.0 for _ in range(16 - len(motors)))]
        mode = 129 if motors else 1
        self.send(mav.MAVLink_hil_actuator_controls_message(t_us, controls, mode, flags))

    def close(self) -> None:
        self._socket.close()


class ArduPilotStandIn:
    """ArduPilot's JSON backend: asks with pulses, reads a line of JSON."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.settimeout(0.05)

    def ask(self, count: int, pulses: tuple[int, ...] = (1000,) * 4, *, magic: int = 18458) -> None:
        channels = 32 if magic == 29569 else 16
        values = [*pulses, *(0 for _ in range(channels - len(pulses)))]
        self.send_bytes(struct.pack(f"<HHI{channels}H", magic, 800, count, *values))

    def send_bytes(self, data: bytes) -> None:
        self._socket.send(data)

    def lines(self) -> list[str]:
        """The answers that have come, as they came."""
        answers = []
        try:
            while True:
                answers.append(self._socket.recv(65536).decode())
        except TimeoutError:
            return answers

    def answer(self) -> dict[str, Any]:
        """The next answer."""
        while not (line := self._socket.recv(65536).decode()):
            pass  # as ArduPilot does
        # ArduPilot looks for the text between two line ends, and for "[1,2" without spaces.
        assert line[0] == line[-1] == "\n"
        assert " " not in line
        values: dict[str, Any] = json.loads(line)
        return values

    def close(self) -> None:
        self._socket.close()
