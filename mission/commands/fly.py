"""`aerofed fly`."""

from pathlib import Path

from mission.commands.options import LIVE_PORT, Flag, Overrides, console, load


def fly(
    plan: Path,
    *,
    config: Path | None = None,
    out: Path | None = None,
    set_: Overrides = (),
    vehicle: str | None = None,
    live: Flag = False,
    live_port: int = LIVE_PORT,
    quiet: Flag = False,
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
    vehicle
        Fly an external autopilot (PX4, ArduPilot, aerofed sitl) instead of the simulated vehicle:
        a MAVSDK URL such as udpin://0.0.0.0:14540; overrides link.kind and link.url.
    live
        Serve what is logged to Foxglove while it is flown, on the loopback address only; with
        --set link.speed=1 in real time.
    live_port
        Port of the live view; 0 takes a free one.
    quiet
        Print nothing but errors.
    """
    watching = console(quiet=quiet, live=live, live_port=live_port)
    external = {"link.kind": None if vehicle is None else "external", "link.url": vehicle}
    resolved = load(config, set_, external)
    # Only now, so that wrong input is answered at once.
    from mission.base.run_folder import output_folder
    from mission.run.planflight.fly import fly_plan

    with output_folder(out, plan.stem) as folder:
        return fly_plan(resolved, plan, folder, console=watching)
