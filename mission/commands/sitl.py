"""`aerofed sitl`."""

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.commands.options import Overrides, load, pace_of, single
from mission.config import OF_VEHICLE
from mission.flight.serve import PX4_HOME


def sitl(
    config: Path | None = None,
    *,
    udp: Annotated[tuple[str, ...], Parameter(negative=())] = ("14540", "14550"),
    speed: float | Literal["max"] | None = None,
    home: str | None = None,
    count: int = 1,
    instance: Annotated[int, Parameter(alias="-I")] = 0,
    logs: Path | None = None,
    set_: Overrides = (),
) -> int:
    """Serve the simulated vehicle to ground stations and MAVSDK programs until Ctrl-C.

    QGroundControl finds it on port 14550, a MAVSDK program on
    udpin://0.0.0.0:14540. After a crash, order a reboot from the ground station:
    it puts the vehicle back at home, as new. Ctrl-C is its end: exit code 0.

    Example: aerofed sitl --udp 14540 --udp 14550 --speed 1

    Args:
        config: TOML file, of which area.home_*, vehicle.* and link.* are used; it needs no others.
            Without one, the vehicle stands where PX4's simulators do, so that scripts written for
            those work.
        udp: Where MAVLink goes; give it once for each ground station: a port of this machine,
            udpout:// or tcpout://HOST:PORT to call, udpin:// or tcpin://HOST:PORT to listen there.
        speed: Simulated seconds per second, or "max". Default: 1, or what PX4_SIM_SPEED_FACTOR
            says.
        home: LAT,LON,ALT in degrees and metres above mean sea level: where the vehicle stands.
            Without it and without a file PX4_HOME_LAT, PX4_HOME_LON and PX4_HOME_ALT count, as with
            PX4.
        count: Number of vehicles, side by side in one world, where they may collide, with system
            ids 1, 2, ... Their ports count up from the first --udp (14540, 14541, ... up to 14549)
            and from those that listen (over TCP 5760, 5770, ...); they share the other --udp.
        instance: Number of the first vehicle, from 0, where others are served already: it has ports
            and system id as if it were counted up to.
        logs: Folder for a log of each flight, from arming to disarming; ground stations may list
            and download the logs.
        set_: Override a key of vehicle.*, area.* or link.*, or the seed: --set
            vehicle.aircraft.wind.speed_mps=5; of one of several by its name: --set
            vehicle-2:vehicle.aircraft.battery.initial=0.3
    """
    pace = pace_of(_heard("PX4_SIM_SPEED_FACTOR", 1.0) if speed is None else speed)
    usual = None if config else _usual_home()
    set_, own = single(set_)
    loaded = partial(load, config, options=_home(home), usual=usual, counts=OF_VEHICLE)
    resolved, each = loaded(set_), {name: loaded(its) for name, its in own.items()}
    # Only now, so that wrong input is answered at once.
    from mission.flight.serve.vehicle import make_vehicles, serve

    served = make_vehicles(resolved, count=count, each=each, udp=udp, logs=logs, instance=instance)
    kept = "no flight is logged; --logs FOLDER logs each"
    if logs is not None:
        of_one = logs if count == 1 else logs / served[0].name
        kept = f"each flight is logged in {logs}, for aerofed compare {of_one}"
    serve(served, speed=pace, say=Terminal(**PLAIN).print, first=kept)
    return 0


def _usual_home() -> dict[str, float]:
    names = ("PX4_HOME_LAT", "PX4_HOME_LON", "PX4_HOME_ALT")
    return {
        key: _heard(name, value) for name, (key, value) in zip(names, PX4_HOME.items(), strict=True)
    }


def _heard(name: str, usual: float) -> float:
    """Return a number from an environment variable of PX4's simulators, or `usual`."""
    text = os.environ.get(name, "")
    try:
        return float(text) if text else usual
    except ValueError:
        raise InputError(f"{name}={text}: must be a number, such as {usual:g}") from None


def _home(text: str | None) -> Mapping[str, float]:
    """The keys that `--home` sets; none where it was not given."""
    if text is None:
        return {}
    try:
        values = [float(part) for part in text.split(",")]
        return dict(zip(PX4_HOME, values, strict=True))
    except ValueError:
        example = ",".join(f"{value:g}" for value in PX4_HOME.values())
        raise InputError(f"--home {text}: LAT,LON,ALT are needed, as --home {example}") from None
