"""One `aerofed fly`: a run of one flight, by a plan file, that serves no devices."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.random import RandomStreams
from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.comparison_text import in_full
from mission.analysis.load import load_run
from mission.analysis.passes import PLAN_FILE
from mission.base.area import Area
from mission.base.console import RunConsole, Stopwatch
from mission.base.errors import AerofedError, FlightError, InputError
from mission.base.record_file import RecordFile
from mission.base.run_folder import RunFolder, write_atomically
from mission.config.area import AreaConfig
from mission.config.models import RunConfig
from mission.flight.flyers.base import Attached, Backend, Flyer, Task
from mission.flight.flyers.choice import backend_for
from mission.flight.missions.geofence import fence_of
from mission.flight.missions.mission_path import record_of
from mission.flight.missions.plan_check import CheckedPath, checked_path, nowhere, placed
from mission.flight.missions.plan_file import PlanFile, checked_home, read_plan_file
from mission.flight.missions.round_mission import Demand
from mission.flight.pilot.parameters import VehicleLimits
from mission.log.export import csv_table, tables
from mission.log.live import LiveView, live_views
from mission.log.values import NOBODY, PlanRecord
from mission.log.writer import FlightLog
from mission.run.budget import RunTotals
from mission.run.progress import PlanProgress, Progress, make_progress
from mission.run.recorded import Around, Summary, fly_recorded
from mission.scenario.limits import guidance_of
from sitl.autopilot.codec.orders import ABSOLUTE_FRAMES, command_name
from sitl.autopilot.parameters import Parameters, parameters_of
from sitl.autopilot.protocol.order_rules import PLACES

_MARGIN_M = 50.0  # around the plan, for the map
_SPEEDS_MPS = (1.0, 30.0)  # that a plan's path may have


@dataclass(frozen=True)
class Order:
    """A plan file that has been checked, with its path, area and vehicle parameters."""

    plan: PlanFile
    path: CheckedPath
    config: RunConfig  # with the area around the plan
    area: Area
    parameters: Parameters  # of the vehicle that the plan is timed by

    @property
    def task(self) -> Task:
        """The flight as a task of a vehicle, with the speed, height and reach that it demands."""
        items, points = self.plan.items, self.path.points_ned_m
        ordered = [item.params[1] for item in items if item.command == mav.MAV_CMD_DO_CHANGE_SPEED]
        radii = [item.params[1] for item in items if item.command == mav.MAV_CMD_NAV_WAYPOINT]
        demand = Demand(
            speed_mps=max(ordered, default=0.0),
            altitude_m=-float(points[:, 2].min()),
            distance_m=float(np.linalg.norm(points[:, :2], axis=1).max()),
            acceptance_m=min((radius for radius in radii if radius > 0.0), default=math.inf),
        )
        return Task(self.config, self.area, RandomStreams(self.config.seed), demand)


def fly_plan(config: RunConfig, source: Path, path: Path, around: Around) -> int:
    """Fly the plan in `source` and leave a folder at `path`. Returns the exit code.

    Raises:
        InputError: the plan is damaged or holds what may not be flown; nothing is written then.
        FlightError, LinkLostError: see `Pilot`; the folder keeps what was flown.
    """
    console = around.console
    with ExitStack() as opened:
        with around.stopwatch("setup"):
            plan = read_plan_file(source)
            order = order_of(config, plan)
            backend = backend_for(order.task)
            if config.link.kind == "external":
                _refuse_heights_above_sea(plan)
            backend.check()
            folder = RunFolder(path)
            opened.enter_context(folder.taken())
            limits = backend.await_vehicle(say=console.say)
            live = opened.enter_context(live_views(console))
            if limits is not None:
                order = order_of(config, plan, _speeds(config, limits))
                backend = backend_for(order.task)
            write_atomically(folder.config, order.config.to_toml())
            write_atomically(folder.path / source.name, plan.content)
        summary = Summary(
            folder,
            name=source.stem,
            plan=source.name,
            seed=config.seed,
            resumable=False,
            position_source=backend.position_source,
        )
        opening = recording(order, backend, folder, around, live)
        return fly_recorded(opening, summary, around)


@dataclass
class PlanFlight:
    """The flight of a plan file: its log, totals, and comparison with the plan."""

    order: Order
    backend: Backend
    log: FlightLog
    attached: Attached
    progress: Progress
    stopwatch: Stopwatch
    totals: RunTotals = field(default_factory=RunTotals)
    comparison: RunComparison | None = None
    ended: bool = False  # by itself: neither failed nor interrupted

    @property
    def files(self) -> Sequence[RecordFile]:
        """The log."""
        return (self.log.file,)

    async def run(self) -> None:
        """Fly the plan from take-off to landing."""
        flyer: Flyer | None = None
        try:
            with self.stopwatch("fly"):
                async with self.backend.open(self.attached) as flyer:
                    try:
                        await flyer.carry_out(
                            self.order.plan, self.order.path, begins=lambda: self.begins(flyer.t_ns)
                        )
                    finally:
                        self.totals.sim_s = flyer.t_ns / 1e9
            self.ended = True
        except AerofedError as failure:
            t_s = self.totals.sim_s
            raise failure.in_words(f"t {t_s:.1f} s: {failure}") from failure.__cause__

    def begins(self, t_ns: int) -> None:
        """Log the planned path, as rounds have theirs, and the items."""
        order = self.order
        points_m = order.area.xyz(order.path.points_ned_m)
        self.log.plan_record(PlanRecord.of_flight(1, t_ns, points_m, slot_s=order.path.slot_s))
        for items in (order.plan.items, order.plan.fence, order.plan.rally):
            if items:
                self.log.mission(record_of(t_ns, items[0].mission_type, items))

    def conclude(self, summary: Summary) -> None:
        """Compare the flight with its plan, if anything was flown, and write `track.csv`.

        Raises:
            FlightError: the plan was flown to its end, and the last place never reached.
        """
        run = load_run(summary.folder.path)
        if run.judged is None:
            return
        for record in run.data.rounds:
            self.totals.add(record)
        write_atomically(summary.folder.path / "track.csv", csv_table(tables(run.data)["track"]))
        self.comparison = compare_run(run)
        total = vars(self.comparison.total).items()
        known = {key: value for key, value in total if key != "round" and math.isfinite(value)}
        summary.add(planned_and_flown=known)
        last = run.judged.passes[-1].passages[-1]
        if self.ended and math.isnan(last.t_s):
            raise FlightError(f"item {last.seq} was never reached")

    def show(self, console: RunConsole) -> None:
        """Print the comparison of planned and flown."""
        if self.comparison is not None:
            for part in in_full([self.comparison], width=console.out.width):
                console.out.print(part)


@contextmanager
def recording(
    order: Order,
    backend: Backend,
    folder: RunFolder,
    around: Around,
    live: tuple[LiveView, ...],
    progress: Progress | None = None,
) -> Iterator[PlanFlight]:
    """Context manager: the flight, with its log open, configuration and plan attached."""
    plan, area = order.plan, order.area
    fence = fence_of(plan.fence, order.parameters, area)
    with ExitStack() as stack:
        progress = progress or make_progress(around.console.out, rounds=1, flown=True)
        stack.callback(progress.close)
        log = stack.enter_context(
            FlightLog(
                folder.log, area=area, devices=NOBODY, fence=fence,
                mirrors=live,
            )
        )  # fmt: skip
        log.attach("config.toml", "application/toml", order.config.to_toml().encode())
        log.attach(plan.path.name, "text/plain", plan.content)
        log.metadata(PLAN_FILE, {"name": plan.path.name})

        def say(text: str) -> None:
            log.note(text, severity=4)
            progress.notice(text)

        watch = PlanProgress(progress, plan.path.name, tuple(seq for seq, _ in order.path.places))
        attached = Attached((log, watch), folder.path, say)
        yield PlanFlight(order, backend, log, attached, progress, around.stopwatch)


def order_of(config: RunConfig, plan: PlanFile, speeds: Mapping[str, float] | None = None) -> Order:
    """Place a plan at its planned home, else at its first place; time it by the parameters of the
    configured vehicle and `speeds`.
    """
    home = plan.home
    if home is None:
        places = (item for item in plan.items if item.command in PLACES and not nowhere(item))
        if (first := next(places, None)) is None:
            raise InputError(f"{plan.path}: neither a planned home nor an item that has a place")
        name = f"item {first.seq}, the first place, which counts as home,"
        home = checked_home(plan.path, first.x, first.y, name=name)
    if math.isnan(home.alt_msl_m):
        home = replace(home, alt_msl_m=config.area.home_alt_msl_m)
    parameters = parameters_of(config.vehicle)
    parameters.apply(speeds or {}, "the vehicle's parameters")
    for fault in config.vehicle.aircraft.faults:
        if isinstance(fault.after, int) and fault.after >= len(plan.items):
            raise InputError(
                f"vehicle.aircraft.faults: after = {fault.after}: {plan.path} has the items 0 to "
                f"{len(plan.items) - 1}"
            )
    plan = replace(plan, items=placed(plan.items, home))
    path = checked_path(plan, home, parameters=parameters, limits=guidance_of(config.vehicle))
    points = np.vstack((path.points_ned_m, *path.rally_ned_m))
    area = Area.around(home, points, margin_m=_MARGIN_M)
    around = AreaConfig(
        size_m=area.size_m,
        home_m=area.home_m,
        home_lat_deg=home.lat_deg,
        home_lon_deg=home.lon_deg,
        home_alt_msl_m=home.alt_msl_m,
    )
    return Order(plan, path, config.model_copy(update={"area": around}), area, parameters)


def _speeds(config: RunConfig, limits: VehicleLimits) -> dict[str, float]:
    """Parameters of a simulated vehicle that is as fast as an external one."""
    known = {
        "MPC_XY_CRUISE": limits.value("cruise_mps", otherwise=math.nan),
        "MPC_XY_VEL_MAX": math.inf if config.link.set_parameters else limits.speed_mps,
    }
    return {
        name: float(np.clip(value, *_SPEEDS_MPS))
        for name, value in known.items()
        if not math.isnan(value)
    }


def _refuse_heights_above_sea(plan: PlanFile) -> None:
    for item in plan.items:
        if item.command in PLACES and item.frame in ABSOLUTE_FRAMES:
            raise InputError(
                f"{plan.path}: item {item.seq}, {command_name(item.command)}: its height is "
                "above sea level; an external vehicle (--vehicle) is sent to heights above its home"
            )
