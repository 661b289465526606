"""`aerofed world`."""

import math
import threading
from contextlib import suppress
from pathlib import Path
from typing import Literal

from mission.base.errors import InputError
from mission.base.terminal import PLAIN, Terminal
from mission.commands.options import Flag, Overrides, load

_PX4_URL, _ARDUPILOT_URL = "udpin://0.0.0.0:14030", "tcpout://127.0.0.1:5762"


def world(
    config: Path | None = None,
    *,
    px4: Flag = False,
    ardupilot: Flag = False,
    port: int | None = None,
    wind: float | None = None,
    speed: float | Literal["max"] = 1.0,
    logs: Path | None = None,
    mavlink: str | None = None,
    set_: Overrides = (),
) -> int:
    """Serve the aircraft alone to a PX4 or ArduPilot that you start yourself, until Ctrl-C.

    Start the firmware as docs/autopilots.md says; fly it with whatever you like.
    Aerofed simulates physics, sensors, battery, wind and faults, as configured.
    When the firmware ends or restarts, the aircraft stands at home again.

    Example: aerofed world --px4 --set vehicle.aircraft.wind.speed_mps=8

    Parameters
    ----------
    config
        TOML file, of which area.home_* and vehicle.aircraft.* are used. Without one, the
        quick-start configuration is used.
    px4
        For PX4: listen for its simulator link (TCP, 4560).
    ardupilot
        For ArduPilot: answer its JSON interface (UDP, 9002).
    port
        Port to listen on, where it is not the usual one of the firmware.
    wind
        Steady wind in m/s; vehicle.aircraft.wind.* has direction, turbulence and gusts.
    speed
        Simulated seconds per second, or "max".
    logs
        Folder for a log of each flight, from arming to disarming, with the true positions, and
        what the firmware tells by MAVLink: its belief, modes, mission, fence and rally points.
    mavlink
        Where that is heard, a MAVSDK URL that nobody else uses: udpin://0.0.0.0:14030 with PX4 (its
        link to a camera), tcpout://127.0.0.1:5762 with ArduPilot.
    set_
        Override any key: --set vehicle.aircraft.wind.speed_mps=8
    """
    if px4 == ardupilot:
        raise InputError("aerofed world: one of --px4 and --ardupilot")
    if speed != "max" and not 0 < speed <= 1000:
        raise InputError(f'--speed {speed:g}: more than 0 and at most 1000, or "max"')
    if port is not None and not 1 <= port <= 65535:
        raise InputError(f"--port {port}: must be from 1 to 65535")
    resolved = load(config, set_, {"vehicle.aircraft.wind.speed_mps": wind})
    # Only now, so that wrong input is answered at once.
    from mission.flight.serve.flight_logs import FlightLogs
    from mission.flight.serve.world import Recorder, serve_world
    from sitl.firmware import ardupilot as json_interface
    from sitl.firmware import px4 as hil

    console = Terminal(**PLAIN)
    usual = hil.DEFAULT_PORT if px4 else json_interface.DEFAULT_PORT
    area, url = resolved.area.build(), mavlink or (_PX4_URL if px4 else _ARDUPILOT_URL)
    recorder = None
    if logs is not None:
        recorder = Recorder(area, resolved.link, url, FlightLogs(logs, area=area))
    with suppress(KeyboardInterrupt):
        serve_world(
            resolved,
            "px4" if px4 else "ardupilot",
            port=port or usual,
            speed=math.inf if speed == "max" else speed,
            say=console.print,
            stop=threading.Event(),
            recorder=recorder,
        )
    return 0
