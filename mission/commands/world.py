"""`aerofed world`."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.commands.options import Overrides, load, pace_of, single

Times = Annotated[int, Parameter(count=True)]


def world(
    config: Path | None = None,
    *,
    px4: Times = 0,
    ardupilot: Times = 0,
    built_in: Times = 0,
    port: int | None = None,
    wind: float | None = None,
    speed: float | Literal["max"] = 1.0,
    logs: Path | None = None,
    mavlink: str | None = None,
    set_: Overrides = (),
) -> int:
    """Serve the aircraft alone to PX4 or ArduPilot that you start yourself, until Ctrl-C.

    Start the firmware as docs/autopilots.md says; fly it with whatever you like.
    Aerofed simulates physics, sensors, battery, wind and faults, as configured.
    When the firmware ends or restarts, the aircraft stands at home again.

    Several are in one world, side by side, on one clock that waits for the slowest of them.

    Example: aerofed world --px4 --set vehicle.aircraft.wind.speed_mps=8
    Example: aerofed world --px4 --px4 --ardupilot --logs crossing

    Args:
        config: TOML file, of which area.home_* and vehicle.aircraft.* are used. Without one, the
            quick-start configuration is used.
        px4: For PX4: listen for its simulator link (TCP, 4560). Once for each of several: instance
            I, from 0, comes to port 4560 + I.
        ardupilot: For ArduPilot: answer its JSON interface (UDP, 9002). Once for each of several:
            -I I, from 0, asks at port 9002 + 10 I.
        built_in: Beside them, an aircraft under the autopilot of Aerofed, served as by aerofed
            sitl. Once for each.
        port: Port to listen on, where it is not the usual one of the firmware; for one alone.
        wind: Steady wind in m/s; vehicle.aircraft.wind.* has direction, turbulence and gusts.
        speed: Simulated seconds per second, or "max".
        logs: Folder for a log of each flight, from arming to disarming, with the true positions,
            and what the firmware tells by MAVLink: its belief, modes, mission, fence and rally
            points. Of several in a folder of each, beside separation.json: how near each pair came.
        mavlink: Where that is heard, a MAVSDK URL that nobody else uses: udpin://0.0.0.0:14030 with
            PX4 (its link to a camera; 14030 + I), tcpout://127.0.0.1:5762 with ArduPilot (5762 + 10
            I). For one alone.
        set_: Override any key: --set vehicle.aircraft.wind.speed_mps=8; of one of several by its
            name: --set vehicle-2:vehicle.aircraft.battery.initial=0.3
    """
    autopilots = ["px4"] * px4 + ["ardupilot"] * ardupilot
    if not autopilots:
        instead = "; aerofed sitl serves those of --built-in alone" if built_in else ""
        raise InputError(
            f"aerofed world: --px4 or --ardupilot is missing, once for each vehicle{instead}"
        )
    several = len(autopilots) + built_in > 1
    for option, given in (("port", port), ("mavlink", mavlink)):
        if several and given is not None:
            raise InputError(
                f"--{option} {given}: for one vehicle alone; several have the ports of their "
                "instances, as --help says"
            )
    pace = pace_of(speed)
    if port is not None and not 1 <= port <= 65535:
        raise InputError(f"--port {port}: must be from 1 to 65535")
    set_, own = single(set_)
    options = {"vehicle.aircraft.wind.speed_mps": wind}
    resolved = load(config, set_, options)
    if own and not several:
        raise InputError(f"--set {next(iter(own))}:...: for one of several; leave the name out")
    each = {name: load(config, its, options) for name, its in own.items()}
    # Only now, so that wrong input is answered at once.
    from mission.flight.serve.firmwares import serve_world

    with suppress(KeyboardInterrupt):
        serve_world(
            resolved, autopilots, built_in, each=each, port=port, mavlink=mavlink, speed=pace,
            say=Terminal(**PLAIN).print, logs=logs,
        )  # fmt: skip
    return 0
