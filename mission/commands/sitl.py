"""`aerofed sitl`."""

import math
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mission.commands.options import Overrides, load
from mission.errors import InputError
from mission.terminal import Terminal


def sitl(
    config: Path | None = None,
    *,
    udp: Annotated[tuple[str, ...], Parameter(negative=())] = ("14540", "14550"),
    speed: float | Literal["max"] = 1.0,
    set_: Overrides = (),
) -> int:
    """Serve the simulated vehicle to ground stations and MAVSDK programs until Ctrl-C.

    Parameters
    ----------
    config
        TOML file; its area.home_* and vehicle.* count here. Without one, the quick-start
        configuration is taken.
    udp
        Where to send MAVLink, once for each ground station: a port of this machine, or
        udpout://HOST:PORT to send there, or udpin://HOST:PORT to listen there for anybody.
    speed
        Simulated seconds per second, or "max".
    set_
        Override any key: --set area.home_lat_deg=47.4 --set area.home_lon_deg=8.5
    """
    if speed != "max" and not 0 < speed <= 1000:
        raise InputError(f'--speed {speed:g}: more than 0 and at most 1000, or "max"')
    resolved = load(config, set_)
    # Only now, so that wrong input is answered at once.
    from mission.gcs import station_links
    from mission.serve import link_url, make_vehicle, serve

    console = Terminal(soft_wrap=True, highlight=False, markup=False)
    serve(
        make_vehicle(resolved),
        station_links(resolved.link, [link_url(text) for text in udp]),
        speed=math.inf if speed == "max" else speed,
        say=console.print,
    )
    return 0
