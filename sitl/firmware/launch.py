"""How a firmware is started for a bridge, and its process: its console kept, ended for certain."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from native.errors import FirmwareSilentError
from sitl.autopilot.parameters import parameters_of
from sitl.config import VehicleConfig
from sitl.firmware import supervisor
from sitl.firmware.bridge import Bridge

CONSOLE = "console.log"
_END_S = 2 * supervisor.GRACE_S + 2.0
# The airframe's motors as firmwares describe them: of a duty cycle u they give the thrust
# c u^2 + (1 - c) u, 1 being 22.9 N a rotor at a full battery, and 3.9 N carry the aircraft.
THRUST_CURVE = 0.82
HOVER_THRUST = 0.17


def check_binary(path: Path) -> None:
    """Check that a binary can be started.

    Raises:
        FirmwareSilentError: there is no such file, or it may not be executed.
    """
    if path.is_dir():
        raise FirmwareSilentError(
            f"vehicle.firmware.path = {path}: is a folder; the firmware's binary is needed"
        )
    if not path.is_file():
        raise FirmwareSilentError(f"vehicle.firmware.path = {path}: no such file")
    if not os.access(path, os.X_OK):
        raise FirmwareSilentError(
            f"vehicle.firmware.path = {path}: may not be executed (chmod +x it, or give the "
            "firmware's binary)"
        )


class FirmwareProcess:
    """A running firmware. It ends with this process, however that ends."""

    def __init__(
        self,
        argv: Sequence[str],
        folder: Path,
        env: Mapping[str, str],
        *,
        processor: int | None = None,
    ) -> None:
        """Start `argv` in `folder`, with `env` added to the environment, on one processor if told.

        Raises:
            FirmwareSilentError: it cannot be started.
        """
        self.console = folder / CONSOLE
        self._name = Path(argv[0]).name
        on = "" if processor is None else str(processor)
        command = [sys.executable, "-I", "-S", supervisor.__file__, on, *argv]
        try:
            with self.console.open("wb") as console:
                self._supervisor = subprocess.Popen(
                    command,
                    cwd=folder,
                    env={**os.environ, **env},
                    stdin=subprocess.PIPE,
                    stdout=console,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # out of reach of a Ctrl-C at the terminal
                )
        except OSError as error:
            raise FirmwareSilentError(f"{argv[0]}: cannot be started: {error.strerror}") from None

    @property
    def died(self) -> str:
        """How the firmware ended, in words; empty while it runs."""
        code = self._supervisor.poll()
        return "" if code is None else f"{self._name} has ended with exit code {code}"

    def last_words(self, lines: int = 5) -> str:
        """Return the last lines of the firmware's console, joined; empty if there are none."""
        try:
            with self.console.open("rb") as console:
                console.seek(0, os.SEEK_END)
                console.seek(max(0, console.tell() - 4096))
                text = console.read().decode(errors="replace")
        except OSError:
            return ""
        said = [line.strip() for line in text.splitlines() if line.strip()]
        return " | ".join("".join(c for c in line if c.isprintable()) for line in said[-lines:])

    def stop(self) -> None:
        """End the firmware, by force if it does not end by itself; may be called twice."""
        if self._supervisor.stdin is not None and not self._supervisor.stdin.closed:
            self._supervisor.stdin.close()
        try:
            self._supervisor.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._supervisor.kill()
            self._supervisor.wait()


@dataclass(frozen=True)
class LaunchOptions:
    """The vehicle, the UDP ports of MAVLink and the speed that a firmware is started for."""

    vehicle: VehicleConfig
    our_port: int  # where it is heard
    its_port: int  # where it listens
    speed_mps: float  # the fastest of the mission

    @property
    def cruise_mps(self) -> float:
        """Speed of legs for which none is ordered: whoever flies, a plan is timed by it."""
        return parameters_of(self.vehicle)["MPC_XY_CRUISE"]


@dataclass(frozen=True)
class Launch:
    """A firmware that is about to be started, and the bridge that waits for it."""

    bridge: Bridge
    argv: tuple[str, ...]
    files: Mapping[str, str]  # text by name, for its folder
    env: Mapping[str, str] = field(default_factory=dict)

    def start(self, folder: Path, *, processor: int | None = None) -> FirmwareProcess:
        """Make `folder` with the files in it, and start the firmware there.

        Raises:
            FirmwareSilentError: it cannot be started.
            OSError: the folder exists or cannot be written.
        """
        folder.mkdir()
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        return FirmwareProcess(self.argv, folder, self.env, processor=processor)
