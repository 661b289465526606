"""One `aerofed run`: the experiment with everything that watches it, and what it leaves behind."""

import asyncio
import math
import socket
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from fl import federation as learning
from mission import figures
from mission.config import RunConfig
from mission.errors import INTERRUPTED, AerofedError, LinkLostError
from mission.experiment import Experiment, RoundResult
from mission.flightplan import FlightPlan
from mission.folder import RunFolder, environment, write_atomically
from mission.log.values import Devices
from mission.log.writer import FlightLog
from mission.planner.problem import RoundPlan, RoundProblem
from mission.progress import Progress, make_progress
from mission.stopwatch import Stopwatch
from mission.tables import RoundTable, UplinkTable
from mission.world import World, build_world

Status = Literal["running", "finished", "interrupted", "failed"]


@dataclass
class SessionRecorder:
    """Hands what happens to the log, the tables and the progress display."""

    world: World
    log: FlightLog
    rounds: RoundTable
    uplinks: UplinkTable
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

    def finished(self, t_ns: int, result: RoundResult) -> None:  # noqa: ARG002
        """Log and tabulate a finished round; from here on it is kept whatever happens."""
        record = result.record
        self.log.uplinks(result.uplinks)
        self.log.learning(
            record.round,
            accuracy=record.accuracy,
            cov=record.cov,
            loss=self._loss(result.learnt.local_loss),
        )
        self.log.round(record)
        self.uplinks.extend(result.uplinks)
        self.rounds.append(record)
        flight_s = self.stopwatch.wall_s.get("fly", 0.0)
        elapsed_s = record.start_t_s + record.duration_s
        self.progress.round_done(
            record,
            rounds=self.world.config.mission.rounds,
            real_time_factor=elapsed_s / flight_s if flight_s > 0.0 else 0.0,
        )

    def phase(self, name: str) -> None:
        """Show the phase."""
        self.progress.phase(name)

    def _loss(self, local_loss: NDArray[np.float64]) -> dict[str, float]:
        """Mean training loss over a community's trained devices; NaN where none was trained."""
        federation = self.world.federation
        by_community = (local_loss[federation.members(c)] for c in range(len(federation.names)))
        trained = (loss[np.isfinite(loss)] for loss in by_community)
        return {
            name: float(loss.mean()) if loss.size else math.nan
            for name, loss in zip(federation.names, trained, strict=True)
        }


def fly_session(
    config: RunConfig, path: Path, *, data_dir: Path | None, console: Console, quiet: bool
) -> int:
    """Run an experiment into a new folder. Returns the exit code.

    Everything that can be refused is refused before the folder is made. An interrupted or failed
    flight keeps what was flown, with a readable log and a summary that says how it ended.

    Raises:
        AerofedError: see the error's exit code; the summary says "failed" then.
    """
    stopwatch = Stopwatch()
    with stopwatch("setup"):
        world = build_world(config, data_dir=data_dir)
        if config.link.kind == "udp" and world.strategy is not None:
            _check_port(config.link.udp_port)
        folder = RunFolder.create(path)
        write_atomically(folder.config, config.to_toml())
        write_atomically(folder.devices, world.devices_csv())
    summary: dict[str, Any] = {
        "status": "running",
        "name": config.name,
        "strategy": config.mission.strategy,
        "seed": config.seed,
        "data": world.data_sources(),
        **environment(),
    }
    folder.write_summary(summary)
    with ExitStack() as stack:
        progress = make_progress(console, quiet=quiet)
        stack.callback(progress.close)
        devices = Devices(world.devices_m, world.community_of)
        log = stack.enter_context(FlightLog(folder.log, area=world.area, devices=devices))
        rounds = stack.enter_context(RoundTable(folder.rounds, world.federation.names))
        uplinks = stack.enter_context(UplinkTable(folder.uplinks))
        _attach(log, world)
        experiment = Experiment(
            world,
            SessionRecorder(world, log, rounds, uplinks, progress, stopwatch),
            stopwatch,
            learning.init(world.federation),
            observers=(log,),
        )
        error: AerofedError | None = None
        status: Status = "failed"
        try:
            asyncio.run(experiment.run())
            status = "finished"
        except KeyboardInterrupt:
            status = "interrupted"
        except AerofedError as failure:
            error = failure
            summary["error"] = str(failure)
        finally:
            summary |= {"status": status, **_totals(experiment, stopwatch)}
            folder.write_summary(summary)
    # The figures read the finished log and tables.
    with stopwatch("figures"):
        figures.draw_run(folder.path)
    folder.write_summary(summary | _totals(experiment, stopwatch))
    if error is not None:
        raise error
    if not quiet:
        _say(console, path, experiment, stopwatch)
    if status == "interrupted":
        console.print(f"interrupted; what was flown is in {path}", soft_wrap=True, highlight=False)
        return INTERRUPTED
    return 0


def _check_port(port: int) -> None:
    """Refuse a port that is taken before anything is written."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise LinkLostError(
                f"link.udp_port = {port}: cannot listen on UDP port {port}: {error.strerror}"
            ) from None


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
        "delivered": experiment.delivered,
        "scheduled": experiment.scheduled,
        "accuracy": experiment.accuracy,
        "wall_s": {**stopwatch.wall_s, "total": stopwatch.total_s},
    }


def _say(console: Console, path: Path, experiment: Experiment, stopwatch: Stopwatch) -> None:
    shares = ", ".join(f"{name} {wall_s:.1f} s" for name, wall_s in stopwatch.wall_s.items())
    console.print(
        f"{experiment.rounds_done} rounds, {experiment.flown_m:.0f} m flown in them, "
        f"{experiment.delivered}/{experiment.scheduled} updates delivered; "
        f"{stopwatch.total_s:.1f} s ({shares})",
        soft_wrap=True,
        highlight=False,
    )
    console.print(f"results in {path}", soft_wrap=True, highlight=False)
