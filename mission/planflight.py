"""One `aerofed fly`: a plan file flown by the simulated vehicle, planned against flown."""

import asyncio
import csv
import io
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fl.radio import CHANNEL_PRESETS
from flightdyn.errors import FlightInputError
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.area import Area
from mission.audience import Audience
from mission.config import AreaConfig, RunConfig
from mission.errors import INTERRUPTED, AerofedError, FlightError, InputError
from mission.fence import fence_of
from mission.figure_flight import draw_flight
from mission.flyer import open_simulated
from mission.flyers import check_link
from mission.folder import RunFolder, environment, write_atomically
from mission.log.live import live_views
from mission.log.values import Devices, FlightData, Zone
from mission.log.writer import FlightLog
from mission.pilot.importer import Imported, import_plan, raw_items
from mission.plancheck import PlannedPath, check_plan, here_means
from mission.plancompare import (
    KEY,
    METADATA,
    PlanFlight,
    flight_metadata,
    plain_numbers,
    plan_flight,
    was_flown,
)
from mission.planfile import PlanFile, read_plan_file
from mission.planner.problem import RoundPlan, RoundProblem
from mission.rundata import load_run
from mission.stopwatch import Stopwatch
from sitl.autopilot.items import PLACES
from sitl.errors import SitlInputError
from sitl.vehicle import Vehicle

Floats = NDArray[np.float64]

_MARGIN_M = 50.0  # around the plan, for the map
_COLUMNS = ("t_s", "true_x_m", "true_y_m", "true_alt_m", "est_x_m", "est_y_m", "est_alt_m")


@dataclass(frozen=True)
class _Ready:
    """Everything that can be refused has been; nothing has been written."""

    plan: PlanFile
    imported: Imported
    path: PlannedPath
    area: Area
    fence: tuple[Zone, ...]
    vehicle: Vehicle
    config: RunConfig


def fly_plan(config: RunConfig, source: Path, path: Path, *, audience: Audience) -> int:
    """Fly the plan in `source` and leave a folder at `path`. Returns the exit code.

    Raises:
        InputError: the plan is damaged or holds what may not be flown; nothing is written then.
        FlightError, LinkLostError: see `Pilot`; the folder keeps what was flown.
    """
    if config.link.kind == "external":
        raise InputError("link.kind = external: plans are flown by the simulated vehicle only")
    stopwatch = Stopwatch()
    with stopwatch("setup"):
        ready = _prepare(config, read_plan_file(source))
        check_link(config.link)
        live = live_views(audience)
        folder = RunFolder.create(path)
        write_atomically(folder.config, ready.config.to_toml())
        write_atomically(folder.path / source.name, source.read_bytes())
        summary: dict[str, Any] = {
            "status": "running",
            "name": source.stem,
            "plan": source.name,
            "seed": config.seed,
            **environment(),
        }
        folder.write_summary(summary)
    status, error = "failed", None
    nobody = Devices(np.zeros((0, 2)), ())
    with FlightLog(
        folder.log, area=ready.area, devices=nobody, fence=ready.fence, mirrors=live
    ) as log:
        log.attach("config.toml", "application/toml", ready.config.to_toml().encode())
        log.attach(source.name, "text/plain", ready.plan.text.encode())
        log.metadata(METADATA, _metadata(ready))
        try:
            with stopwatch("fly"):
                asyncio.run(_fly(ready, log))
            status = "finished"
        except KeyboardInterrupt:
            status = "interrupted"
        except AerofedError as failure:
            summary["error"] = f"t {ready.vehicle.t_ns / 1e9:.1f} s: {failure}"
            error = failure.in_words(f"{summary['error']}; what was flown is in {folder.path}")
        finally:
            if status != "finished":
                folder.write_summary(summary | {"status": status})
    flight = None
    try:
        with stopwatch("figures"):
            flight = _left_behind(folder)
    except AerofedError as failure:
        if error is None:  # otherwise a consequence of what went wrong before
            error, status, summary["error"] = failure, "failed", str(failure)
    if flight is not None:
        summary[KEY] = plain_numbers(flight.numbers)
        if status == "finished" and max(flight.places_m) not in flight.reached:
            status = "failed"
            error = FlightError(f"item {max(flight.places_m)} was never reached")
    # Last of all: a folder that says "finished" has everything.
    sim_s, fly_s = ready.vehicle.t_ns / 1e9, stopwatch.wall_s["fly"]
    times = {"simulated_s": sim_s, "real_time_factor": sim_s / fly_s}
    wall_s = {**stopwatch.wall_s, "total": stopwatch.total_s}
    folder.write_summary(summary | {"status": status, **times, "wall_s": wall_s})
    if error is not None:
        raise error
    if status == "interrupted":
        audience.say(f"interrupted; what was flown is in {folder.path}")
        return INTERRUPTED
    if flight is not None:
        for line in (*flight.numbers.lines(), f"results in {folder.path}"):
            audience.say(line)
    return 0


def _left_behind(folder: RunFolder) -> PlanFlight | None:
    """Track and figures of what was flown, read from the log; None where nothing was."""
    run = load_run(folder.path)
    if not was_flown(run):
        return None
    flight = plan_flight(run)
    write_atomically(folder.path / "track.csv", _track_csv(run.data))
    draw_flight(flight, folder.figures)
    return flight


def _prepare(config: RunConfig, plan: PlanFile) -> _Ready:
    ground = config.area.home_alt_msl_m
    planned = plan.home or GeodeticPoint(config.area.home_lat_deg, config.area.home_lon_deg, ground)
    vehicle, imported = _at(planned, config, plan)
    if plan.home is None:
        first = next((item for item in imported.items if item.command in PLACES), None)
        if first is None:
            raise InputError(f"{plan.path}: neither a planned home nor an item that has a place")
        planned = GeodeticPoint(first.x, first.y, ground)
        vehicle, imported = _at(planned, config, plan)
    path = check_plan(
        imported.items, imported.fence, imported.rally, vehicle=vehicle, source=str(plan.path)
    )
    area_config = _area_around(path, vehicle.autopilot.flight.home)
    area = area_config.build()
    fence = fence_of(imported.fence, vehicle.autopilot.parameters, area)
    return _Ready(
        plan,
        imported,
        path,
        area,
        fence,
        vehicle,
        config.model_copy(update={"area": area_config}),
    )


def _at(home: GeodeticPoint, config: RunConfig, plan: PlanFile) -> tuple[Vehicle, Imported]:
    """A vehicle on the ground at `home`, and the plan as imported for it."""
    if math.isnan(home.alt_msl_m):
        home = GeodeticPoint(home.lat_deg, home.lon_deg, config.area.home_alt_msl_m)
    try:
        vehicle = Vehicle(config.vehicle, home=home, streams=RandomStreams(config.seed))
    except (SitlInputError, FlightInputError) as error:
        raise InputError(str(error)) from None
    vehicle.greet()
    imported = import_plan(plan, heartbeat=b"".join(vehicle.outgoing(0.0)))
    items = here_means(imported.items, home)
    return vehicle, replace(imported, items=items)


def _area_around(path: PlannedPath, home: GeodeticPoint) -> AreaConfig:
    """The rectangle around the plan."""
    points_m = np.vstack((path.points_ned_m, *path.rally_ned_m))[:, :2]
    low, high = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
    return AreaConfig(
        size_m=(float(high[1] - low[1]), float(high[0] - low[0])),
        home_m=(float(-low[1]), float(-low[0])),
        home_lat_deg=home.lat_deg,
        home_lon_deg=home.lon_deg,
        home_alt_msl_m=home.alt_msl_m,
    )


async def _fly(ready: _Ready, log: FlightLog) -> None:
    async with open_simulated(
        ready.config, ready.vehicle, area=ready.area, observers=(log,)
    ) as flyer:
        pilot = flyer.pilot
        await pilot.ready()
        if ready.imported.fence:
            await pilot.upload_fence(raw_items(ready.imported.fence))
        if ready.imported.rally:
            await pilot.upload_rally(raw_items(ready.imported.rally))
        _log_path(flyer.t_ns, log, ready)
        await pilot.arm()
        await pilot.fly_items(raw_items(ready.imported.items))
        if ready.path.returns:
            await pilot.landed()
        else:
            await pilot.land()


def _metadata(ready: _Ready) -> dict[str, str]:
    """What the log has to hold beside the plan's path."""
    area, path = ready.area, ready.path
    return flight_metadata(
        ready.plan.path.name,
        {seq: _xyz(area, ned[None])[0] for seq, ned in path.places.items()},
        [_xyz(area, ned[None])[0] for ned in path.rally_ned_m],
        duration_s=path.duration_s,
    )


def _log_path(t_ns: int, log: FlightLog, ready: _Ready) -> None:
    """The planned path, as the log has it for rounds: one round that serves nobody."""
    points = _xyz(ready.area, ready.path.points_ned_m)
    plan = RoundPlan(points[:, :2], np.zeros((len(points), 0), dtype=bool), value=0.0)
    channel = replace(CHANNEL_PRESETS["suburban"], altitude_m=ready.path.top_m)
    problem = RoundProblem(
        devices_m=np.zeros((0, 2)),
        importance=np.zeros(0),
        start_m=points[0, :2],
        steps=len(points),
        per_step=1,
        path_budget_m=plan.path_m,
        channel=channel,
    )
    legs_m = np.linalg.norm(np.diff(points, axis=0), axis=1)
    speed_mps = float(legs_m.sum()) / ready.path.duration_s
    slots_s = (np.concatenate(([0.0], np.cumsum(legs_m))) / speed_mps).tolist()
    log.plan(
        t_ns, 1, problem, plan,
        speed_mps=speed_mps, ideal_slot_s=slots_s, height_m=points[:, 2],
    )  # fmt: skip


def _xyz(area: Area, pos_ned_m: Floats) -> Floats:
    """(n, 3) NED -> x east, y north in area coordinates, height above home."""
    return np.column_stack((area.from_ned(pos_ned_m), -pos_ned_m[:, 2]))


def _track_csv(data: FlightData) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    rows = np.hstack((data.truth.pos_m, data.belief.pos_m)).tolist()
    for t_ns, row in zip(data.truth.t_ns.tolist(), rows, strict=True):
        writer.writerow([repr(t_ns / 1e9), *(f"{value:.3f}" for value in row)])
    return out.getvalue()
