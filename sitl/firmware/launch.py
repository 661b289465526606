"""How a firmware is started for a bridge, whichever it is."""

import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sitl.config import VehicleConfig
from sitl.firmware.bridge import Bridge, bound
from sitl.firmware.process import FirmwareProcess

# The airframe's motors as firmwares describe them: of a duty cycle u they give the thrust
# c u^2 + (1 - c) u, 1 being 22.9 N a rotor at a full battery, and 3.9 N carry the aircraft.
THRUST_CURVE = 0.82
HOVER_THRUST = 0.17


@dataclass(frozen=True)
class Ports:
    """UDP ports on this machine that MAVLink goes between."""

    ours: int
    firmware: int

    @classmethod
    def to(cls, link: socket.socket) -> "Ports":
        """Ports to the socket `link` from one that is free."""
        with bound(socket.SOCK_DGRAM, 0) as free:
            return cls(link.getsockname()[1], free.getsockname()[1])


@dataclass(frozen=True)
class Order:
    """The vehicle, the ports and the speed that a firmware is started for."""

    vehicle: VehicleConfig
    ports: Ports
    speed_mps: float  # the fastest of the mission


@dataclass(frozen=True)
class Launch:
    """A firmware that is about to be started, and the bridge that waits for it."""

    bridge: Bridge
    argv: tuple[str, ...]
    files: Mapping[str, str]  # text by name, for its folder
    env: Mapping[str, str] = field(default_factory=dict)
    own_scripts: bool = False  # found in its folder before the firmware's own

    def start(self, folder: Path, *, processor: int | None = None) -> FirmwareProcess:
        """Make `folder` with the files in it, and start the firmware there.

        Raises:
            FirmwareSilentError: it cannot be started.
            OSError: the folder exists or cannot be written.
        """
        folder.mkdir()
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        env = dict(self.env)
        if self.own_scripts:
            # Its own folder, as the firmware sees it: a path that is relative to us leads it
            # nowhere.
            env["PATH"] = f".{os.pathsep}{os.environ.get('PATH', os.defpath)}"
        return FirmwareProcess(self.argv, folder, env, processor=processor)
