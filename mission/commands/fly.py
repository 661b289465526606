"""`aerofed fly`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mission.terminal import Terminal

RUNS = Path("runs")


def fly(
    plan: Path,
    *,
    config: Path | None = None,
    out: Path | None = None,
    set_: Annotated[
        tuple[str, ...], Parameter(name="--set", negative=(), consume_multiple=True)
    ] = (),
    quiet: bool = False,
) -> int:
    """Fly a QGroundControl plan or a waypoint file headless, and compare planned with flown.

    Parameters
    ----------
    plan
        A QGroundControl .plan or MAVLink .waypoints file. Take-off, waypoint, loiter time, change
        speed, return and land may be in it, a fence and rally points; anything else is refused by
        name. Home is the plan's
        planned home, else its first item.
    config
        TOML file; its vehicle.* and link.* count here.
    out
        Folder for log (flight.mcap), track (track.csv) and summary; it must be new or empty.
        Default: a new one under runs/.
    set_
        Override any key: --set vehicle.aircraft.wind.speed_mps=8 --set link.speed=1
    quiet
        Print nothing but errors.
    """
    # Only now: the configuration's models take half a second to import.
    from mission.configfile import builtin_config, load_config
    from mission.folder import free_folder
    from mission.overrides import parse_override

    overrides = dict(parse_override(text) for text in set_)
    resolved = load_config(config or builtin_config("quickstart.toml"), overrides)
    # Only now, so that wrong input is answered at once.
    from mission.planflight import fly_plan

    folder = out or free_folder(RUNS, plan.stem)
    return fly_plan(resolved, plan, folder, console=Terminal(), quiet=quiet)
