"""`aerofed sitl`."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mission.base.errors import InputError
from mission.base.terminal import PLAIN, Terminal
from mission.commands.options import Overrides, load
from mission.flight.serve import PX4_HOME

_COUNTS = ("area", "vehicle", "link", "seed")


def sitl(
    config: Path | None = None,
    *,
    udp: Annotated[tuple[str, ...], Parameter(negative=())] = ("14540", "14550"),
    speed: float | Literal["max"] = 1.0,
    home: str | None = None,
    count: int = 1,
    logs: Path | None = None,
    set_: Overrides = (),
) -> int:
    """Serve the simulated vehicle to ground stations and MAVSDK programs until Ctrl-C.

    QGroundControl finds it on port 14550, a MAVSDK program on
    udpin://0.0.0.0:14540. After a crash, order a reboot from the ground station:
    it puts the vehicle back at home, as new.

    Example: aerofed sitl --udp 14540 --udp 14550 --speed 1

    Parameters
    ----------
    config
        TOML file, of which area.home_*, vehicle.* and link.* are used; it needs no others. Without
        one, the vehicle stands where PX4's simulators do, so that scripts written for those work.
    udp
        Where MAVLink goes; give it once for each ground station: a port of this machine,
        udpout://HOST:PORT to send there, or udpin://HOST:PORT to listen there.
    speed
        Simulated seconds per second, or "max".
    home
        LAT,LON,ALT in degrees and metres above mean sea level: where the vehicle stands.
    count
        Number of vehicles, side by side in one process, with system ids 1, 2, ... Their ports count
        up from the first --udp (14540, 14541, ...); they share the other --udp.
    logs
        Folder for a log of each flight, from arming to disarming; ground stations may list and
        download the logs.
    set_
        Override a key of vehicle.*, area.* or link.*, or the seed:
        --set vehicle.aircraft.wind.speed_mps=5
    """
    if speed != "max" and not 0 < speed <= 1000:
        raise InputError(f'--speed {speed:g}: more than 0 and at most 1000, or "max"')
    resolved = load(config, set_, _home(home), usual=None if config else PX4_HOME, counts=_COUNTS)
    # Only now, so that wrong input is answered at once.
    from mission.flight.serve.vehicle import make_vehicles, serve

    console = Terminal(**PLAIN)
    console.print(
        "no flight is logged; --logs FOLDER logs each"
        if logs is None
        else f"each flight is logged in {logs}, for aerofed compare {logs}"
    )
    serve(
        make_vehicles(resolved, count=count, udp=udp, logs=logs),
        speed=math.inf if speed == "max" else speed,
        say=console.print,
    )
    return 0


def _home(text: str | None) -> Mapping[str, float]:
    """The keys that `--home` sets; none where it was not given.

    Raises:
        InputError: it is no three numbers; their ranges are the keys'.
    """
    if text is None:
        return {}
    try:
        values = [float(part) for part in text.split(",")]
        return dict(zip(PX4_HOME, values, strict=True))
    except ValueError:
        example = ",".join(f"{value:g}" for value in PX4_HOME.values())
        raise InputError(f"--home {text}: LAT,LON,ALT are needed, as --home {example}") from None
