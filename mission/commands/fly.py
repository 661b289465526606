"""`aerofed fly`."""

from pathlib import Path

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, output_folder
from mission.commands.options import LIVE_PORT, Flag, Json, Limits, Overrides, console, load, single
from mission.commands.run import bounds_of, judged, write_page
from mission.config import OF_FLIGHT


def fly(
    plan: Path,
    *others: Path,
    after: float | None = None,
    config: Path | None = None,
    out: Path | None = None,
    set_: Overrides = (),
    vehicle: str | None = None,
    live: Flag = False,
    live_port: int = LIVE_PORT,
    limit: Limits = (),
    junit: Path | None = None,
    no_figures: Flag = False,
    no_report: Flag = False,
    quiet: Flag = False,
    as_json: Json = False,
) -> int:
    """Fly a QGroundControl plan or a waypoint file headless, and compare planned with flown.

    Example: aerofed fly survey.plan --out survey
    Example: aerofed fly a.plan b.plan c.plan --after 5 --limit separation_min_m=5

    Args:
        plan: A QGroundControl .plan (also with surveys, corridor and structure scans) or a MAVLink
            waypoint file (.waypoints, .txt, .mission). Items for cameras, gimbals and servos are
            passed over; what cannot be flown is refused by name. Home is the planned home of the
            plan, or else its first item.
        others: More plans, each flown by a vehicle of its own, vehicle-1, vehicle-2, ... in their
            order: in one world, on one clock, begun at one instant. Each has its own folder in the
            run's, beside separation.json; hulls that touch end both flights.
        after: Simulated seconds by which each of several begins after the one before it.
        config: TOML file; of its keys vehicle.*, link.*, limits.* and seed count here, and it needs
            no others.
        out: Folder for log (flight.mcap), track (track.csv) and summary; it must be new or empty.
            Default: a new one under runs/.
        set_: Override a key of vehicle.*, link.* or limits.*, the seed, or area.home_alt_msl_m
            where the plan has no height of home; the plan says where and how fast: --set
            vehicle.aircraft.wind.speed_mps=8 --set link.speed=1; of several, for one by name: --set
            vehicle-2:vehicle.aircraft.battery.initial=0.3
        vehicle: Fly an external autopilot (PX4, ArduPilot, aerofed sitl) instead of the simulated
            vehicle: a MAVSDK URL such as udpin://0.0.0.0:14540; overrides link.kind and link.url.
        live: Show the flight live in Foxglove, for programs on this machine only; add --set
            link.speed=1 for real time.
        live_port: Port of the live view; 0 takes a free one.
        limit: NAME=VALUE, once for each limit on a number of `aerofed compare`, beside those of the
            table [limits]: exit code 6 and a line for each that is not met.
        junit: Also write the verdict into this file, as JUnit's XML.
        no_figures: Draw no pictures into the folder; the page has its own.
        no_report: Leave out report.html, the page that is written into the folder at the end.
        quiet: Print nothing but errors.
        as_json: Print nothing but the flight's summary as JSON, at the end.
    """
    watching = console(quiet=quiet or as_json, live=live, live_port=live_port)
    external = {"link.kind": None if vehicle is None else "external", "link.url": vehicle}
    set_, own = single(set_)
    resolved = load(config, set_, external, counts=OF_FLIGHT)
    each = {name: load(config, its, external, counts=OF_FLIGHT) for name, its in own.items()}
    if not others and (own or after is not None):
        given = f"--set {next(iter(own))}:..." if own else f"--after {after:g}"
        raise InputError(f"{given}: for several plans, as aerofed fly a.plan b.plan")
    if after is not None and not 0 <= after < 1e6:
        raise InputError(f"--after {after:g}: simulated seconds, less than a million")
    bounds = bounds_of(resolved.limits, limit)
    # Only now, so that wrong input is answered at once.
    from mission.run.plan_flight import fly_plan
    from mission.run.recorded import Around

    page = None if no_report else write_page
    around = Around(watching, figures=not no_figures, page=page)
    with output_folder(out, plan.stem) as folder:
        RunFolder(folder).check()

        def flown() -> int:
            if not others:
                return fly_plan(resolved, plan, folder, around)
            from mission.run.together_flight import fly_plans

            plans = plan, *others
            return fly_plans(resolved, plans, folder, around, after_s=after or 0.0, each=each)

        return judged(
            flown, folder, bounds, junit,
            as_json=as_json, quiet=watching.out.quiet,
        )  # fmt: skip
