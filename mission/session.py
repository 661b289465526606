"""One `aerofed run`: the experiment with everything that watches it, and what it leaves behind."""

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from fl import federation as learning
from mission import figures
from mission.checkpoint import CheckpointFolder, RoundMemory, remembered_data_dir
from mission.config import RunConfig, load_config
from mission.errors import INTERRUPTED, AerofedError, InputError
from mission.experiment import Experiment, RoundResult
from mission.fence import fence_of
from mission.flightplan import FlightPlan
from mission.flyers import await_vehicle, check_link, position_source
from mission.folder import RunFolder, environment, write_atomically
from mission.log.live import LiveView
from mission.log.mavlink import RecordedLink
from mission.log.sink import Sink
from mission.log.values import Devices, Zone
from mission.log.writer import FlightLog
from mission.planfile import write_round_plan
from mission.planner.problem import RoundPlan, RoundProblem
from mission.progress import Progress, make_progress
from mission.records import DeviceRecord, Learnt
from mission.setaside import SetAside
from mission.stopwatch import Stopwatch
from mission.tables import LearningTable, RoundTable, UplinkTable
from mission.world import World, build_world

Status = Literal["running", "finished", "interrupted", "failed"]


@dataclass
class SessionRecorder:
    """Hands what happens to the log, the tables and the progress display."""

    world: World
    folder: RunFolder
    log: FlightLog
    rounds: RoundTable
    uplinks: UplinkTable
    devices: LearningTable
    checkpoint: CheckpointFolder
    set_aside: SetAside
    progress: Progress
    stopwatch: Stopwatch

    def planned(
        self,
        t_ns: int,
        round_number: int,
        problem: RoundProblem,
        plan: RoundPlan,
        flight_plan: FlightPlan,
    ) -> None:
        """Log a plan before it is flown."""
        self.log.plan(
            t_ns,
            round_number,
            problem,
            plan,
            speed_mps=flight_plan.speed_mps,
            ideal_slot_s=flight_plan.ideal_slot_s(),
        )
        path = self.folder.plans / f"round-{round_number:03d}.plan"
        write_round_plan(path, flight_plan, self.world.area)

    def finished(self, result: RoundResult) -> None:
        """Log and tabulate a finished round; from here on it is kept whatever happens."""
        record, learnt = result.record, result.memory.learnt
        if record.scheduled == 0:
            self.progress.notice(
                f"round {record.round}: no device is within reach of the path; "
                "area.home_m, mission.path_budget_m and the channel decide who is"
            )
        self.log.uplinks(result.uplinks)
        self.log.learning(record.round, accuracy=learnt.accuracy, cov=learnt.cov, loss=learnt.loss)
        self.log.round(record)
        self.uplinks.extend(result.uplinks)
        self.devices.extend(self._devices(record.round, learnt))
        self.rounds.append(record)
        if not result.remembered:
            self.set_aside.discard()  # log and tables hold all that the old ones held
            self.checkpoint.save(self.world.federation, result.state, result.memory)
        flight_s = self.stopwatch.wall_s.get("fly", 0.0)
        elapsed_s = record.start_t_s + record.duration_s
        self.progress.round_done(
            record,
            rounds=self.world.config.mission.rounds,
            real_time_factor=elapsed_s / flight_s if flight_s > 0.0 else 0.0,
        )

    def _devices(self, round_number: int, learnt: Learnt) -> Iterator[DeviceRecord]:
        each = zip(self.world.community_of, learnt.device_accuracy, learnt.device_loss, strict=True)
        for device, (community, accuracy, loss) in enumerate(each):
            yield DeviceRecord(round_number, device, community, accuracy, loss)

    def phase(self, name: str) -> None:
        """Show the phase."""
        self.progress.phase(name)


def fly_session(
    config: RunConfig,
    path: Path,
    *,
    data_dir: Path | None,
    console: Console,
    quiet: bool,
    workers: int | None = None,
    live_port: int | None = None,
    log_mavlink: bool = False,
) -> int:
    """Run an experiment into a new folder. Returns the exit code.

    Up to `workers` communities (default: one a core) train at a time. With `live_port` the log's
    messages are served to Foxglove on that port of the loopback address too (0: any free one).
    With `log_mavlink` the log holds what pilot and vehicle said to each other as well.

    Everything that can be refused is refused before the folder is made. An interrupted or failed
    flight keeps what was flown, with a readable log, a summary that says how it ended, and a
    checkpoint to resume from.

    Raises:
        AerofedError: see the error's exit code; the summary says "failed" then.
    """
    stopwatch = Stopwatch()
    with stopwatch("setup"):
        world = build_world(config, data_dir=data_dir)
        if world.strategy is not None:
            check_link(config.link)
        view = _live_view(live_port, console, quiet=quiet)
        folder = RunFolder.create(path)
        with folder.unless_refused():
            await_vehicle(world, say=_teller(console, quiet=quiet))
        text = config.to_toml()
        state = learning.init(world.federation)
        checkpoint = CheckpointFolder(folder.checkpoint, config_toml=text, data_dir=data_dir)
        write_atomically(folder.config, text)
        checkpoint.save(world.federation, state, None)
    return _fly(
        world, folder, checkpoint, state, (), stopwatch,
        console=console, quiet=quiet, workers=workers, mirrors=view, log_mavlink=log_mavlink,
    )  # fmt: skip


def resume_session(
    path: Path,
    *,
    console: Console,
    quiet: bool,
    live_port: int | None = None,
    log_mavlink: bool = False,
) -> int:
    """Go on with a run that was interrupted or killed, from its last finished round.

    The rounds before are flown again by their plans, so that the folder ends like that of a run
    that was never interrupted; until that has caught up, the old log and tables are kept in the
    checkpoint's folder. Who looks on (`live_port`, `log_mavlink`: as `fly_session`) is not
    remembered. Returns the exit code.

    Raises:
        InputError: not a run, finished long ago and damaged, or started with another
            configuration, version or data.
        AerofedError: as `fly_session`.
    """
    stopwatch = Stopwatch()
    with stopwatch("setup"):
        folder = RunFolder(path)
        data_dir = remembered_data_dir(folder.checkpoint)
        if folder.status() == "finished":
            console.print(f"{path} is finished: nothing to resume", soft_wrap=True, highlight=False)
            return 0
        config = load_config(folder.config)
        if config.link.kind == "external":
            raise InputError(
                f"{path}: flown by an external autopilot: its rounds cannot be flown again, so "
                "the run cannot be resumed"
            )
        world = build_world(config, data_dir=data_dir)
        if world.strategy is not None:
            check_link(config.link)
        checkpoint = CheckpointFolder(
            folder.checkpoint, config_toml=folder.config.read_text(), data_dir=data_dir
        )
        found = checkpoint.load(world.federation)
        view = _live_view(live_port, console, quiet=quiet)
        SetAside(folder).take()
    return _fly(
        world, folder, checkpoint, found.state, found.rounds, stopwatch,
        console=console, quiet=quiet, mirrors=view, log_mavlink=log_mavlink,
    )  # fmt: skip


def _teller(console: Console, *, quiet: bool) -> Callable[[str], None]:
    def say(text: str) -> None:
        if not quiet:
            console.print(text, soft_wrap=True, highlight=False, markup=False)

    return say


def _live_view(port: int | None, console: Console, *, quiet: bool) -> tuple[LiveView, ...]:
    if port is None:
        return ()
    view = LiveView(port=port)
    if not quiet:
        console.print(f"live view: open {view.url} in Foxglove", soft_wrap=True, highlight=False)
    return (view,)


def _fly(
    world: World,
    folder: RunFolder,
    checkpoint: CheckpointFolder,
    state: learning.FederationState,
    memory: Sequence[RoundMemory],
    stopwatch: Stopwatch,
    *,
    console: Console,
    quiet: bool,
    workers: int | None = None,
    mirrors: Sequence[Sink] = (),
    log_mavlink: bool = False,
) -> int:
    config = world.config
    set_aside = SetAside(folder)
    write_atomically(folder.devices, world.devices_csv())
    summary: dict[str, Any] = {
        "status": "running",
        "name": config.name,
        "strategy": config.mission.strategy,
        "seed": config.seed,
        "resumed_after_round": len(memory) or None,
        "position_source": position_source(config.link),
        "data": world.data_sources(),
        **environment(),
    }
    folder.write_summary(summary)
    with ExitStack() as stack:
        progress = make_progress(console, quiet=quiet)
        stack.callback(progress.close)
        devices = Devices(world.devices_m, world.community_of)
        log = stack.enter_context(
            FlightLog(
                folder.log, area=world.area, devices=devices, fence=_fence(world), mirrors=mirrors
            )
        )
        rounds = stack.enter_context(RoundTable(folder.rounds, world.federation.names))
        uplinks = stack.enter_context(UplinkTable(folder.uplinks))
        learnt = stack.enter_context(LearningTable(folder.learning))
        _attach(log, world)
        for notice in world.notices():
            log.note(notice, severity=4)
            if not quiet:
                console.print(notice, soft_wrap=True, highlight=False, markup=False)
        experiment = Experiment(
            world,
            SessionRecorder(
                world, folder, log, rounds, uplinks, learnt, checkpoint, set_aside, progress,
                stopwatch,
            ),
            stopwatch,
            state,
            memory=memory,
            workers=workers or os.cpu_count() or 1,
            observers=(log,),
            tap=(lambda link: RecordedLink(link, log)) if log_mavlink else None,
        )  # fmt: skip
        error: AerofedError | None = None
        status: Status = "failed"
        try:
            asyncio.run(experiment.run())
            status = "finished"
        except KeyboardInterrupt:
            status = "interrupted"
        except AerofedError as failure:
            summary["error"] = str(failure)
            error = type(failure)(f"{failure}; what was flown is in {folder.path}")
        finally:
            if status != "finished":
                summary["status"] = status
                folder.write_summary(summary | _totals(experiment, stopwatch))
    if status == "finished":
        set_aside.discard()
    # The figures read the finished log and tables.
    with stopwatch("figures"):
        figures.draw_run(folder.path)
    # Last of all: a folder that says "finished" has everything.
    folder.write_summary(summary | {"status": status, **_totals(experiment, stopwatch)})
    if error is not None:
        raise error
    if not quiet:
        _say(console, folder.path, experiment, stopwatch)
    if status == "interrupted":
        again = f"; aerofed run --resume {folder.path} goes on"
        console.print(
            f"interrupted{'' if config.link.kind == 'external' else again}",
            soft_wrap=True, highlight=False,
        )  # fmt: skip
        return INTERRUPTED
    return 0


def _fence(world: World) -> tuple[Zone, ...]:
    """A run draws no fence of its own; the vehicle's parameters may hold it near home."""
    if world.config.link.kind == "external":
        return ()  # whatever it has, nobody told us
    return fence_of((), world.vehicle.autopilot.parameters, world.area)


def _attach(log: FlightLog, world: World) -> None:
    """Put what is needed to understand the log into the log."""
    log.attach("config.toml", "application/toml", world.config.to_toml().encode())
    log.attach("devices.csv", "text/csv", world.devices_csv().encode())
    log.metadata("libraries", environment()["libraries"])


def _totals(experiment: Experiment, stopwatch: Stopwatch) -> dict[str, Any]:
    flight_s = stopwatch.wall_s.get("fly", 0.0)
    return {
        "rounds": experiment.rounds_done,
        "flown_in_rounds_m": experiment.flown_m,
        "budget_used_m": experiment.budget_used_m,
        "simulated_s": experiment.sim_s,
        "real_time_factor": experiment.sim_s / flight_s if flight_s > 0.0 else 0.0,
        "battery_changes": experiment.battery_changes,
        "delivered": experiment.delivered,
        "scheduled": experiment.scheduled,
        "accuracy": experiment.accuracy,
        "wall_s": {**stopwatch.wall_s, "total": stopwatch.total_s},
    }


def _say(console: Console, path: Path, experiment: Experiment, stopwatch: Stopwatch) -> None:
    shares = ", ".join(f"{name} {wall_s:.1f} s" for name, wall_s in stopwatch.wall_s.items())
    done, mission = experiment.rounds_done, experiment.world.config.mission
    if experiment.finished and done < mission.rounds:
        console.print(
            f"the path budget of {mission.total_budget_m:g} m is spent, so the run ends before "
            f"round {done + 1}",
            soft_wrap=True,
            highlight=False,
        )
    console.print(
        f"{done} round{'' if done == 1 else 's'}, {experiment.flown_m:.0f} m flown in them, "
        f"{experiment.delivered}/{experiment.scheduled} updates delivered; "
        f"{stopwatch.total_s:.1f} s ({shares})",
        soft_wrap=True,
        highlight=False,
    )
    console.print(f"results in {path}", soft_wrap=True, highlight=False)
