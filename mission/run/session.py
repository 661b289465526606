"""One `aerofed run`, from nothing or from its checkpoint, to a folder that is whole."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fl.federation import rounds as learning
from mission.base.console import Audience
from mission.base.errors import INTERRUPTED, InputError
from mission.base.interrupted_files import SetAside
from mission.base.interrupts import one_interruption, run_flight
from mission.base.run_folder import RunFolder, write_atomically
from mission.base.stopwatch import Stopwatch
from mission.config.loading import load_config
from mission.config.models import RunConfig
from mission.log.export.mavlink import RecordedLink
from mission.log.live.view import LiveView, live_views
from mission.run.checkpoint import CheckpointFolder, RoundMemory
from mission.run.experiment import Experiment
from mission.run.outcome import Ending
from mission.run.recorder import recording
from mission.run.resume import data_dir_of, read_checkpoint
from mission.run.setup import World, build_world
from mission.run.summary import Summary

_SETTING_UP = "setting up"


@dataclass(frozen=True)
class _Ready:
    """A run that nothing refuses any more."""

    world: World
    folder: RunFolder
    checkpoint: CheckpointFolder
    state: learning.FederationState
    memory: Sequence[RoundMemory] = ()  # rounds to fly again
    live: tuple[LiveView, ...] = ()


def fly_session(
    config: RunConfig,
    path: Path,
    *,
    data_dir: Path | None,
    audience: Audience,
    workers: int | None = None,
    stopwatch: Stopwatch | None = None,
) -> int:
    """Run an experiment into a new folder. Returns the exit code.

    Up to `workers` devices (default: one a core) train at a time. `stopwatch` may have been
    counting the set-up already.

    Everything that can be refused is refused before the folder is made. An interrupted or failed
    run keeps what was flown, with a readable log, a summary that says how it ended, and a
    checkpoint to resume from.

    Raises:
        AerofedError: see the error's exit code; the summary says "failed" then.
    """
    stopwatch = stopwatch or Stopwatch()
    with stopwatch("setup"), audience.waiting(_SETTING_UP):
        world = build_world(config, data_dir=data_dir)
        if world.strategy is not None:
            world.flyers.check()
        live = live_views(audience)
        folder = RunFolder.create(path)
        with folder.unless_refused():
            if world.strategy is not None:
                world.flyers.await_vehicle(say=audience.say)
        text = config.to_toml()
        state = learning.init(world.federation)
        checkpoint = CheckpointFolder(folder.checkpoint, config_toml=text, data_dir=data_dir)
        ready = _Ready(world, folder, checkpoint, state, live=live)
    with folder.lock():
        with stopwatch("setup"):
            write_atomically(folder.config, text)
            checkpoint.save(world.federation, state, None)
        return _fly(ready, audience, stopwatch, workers=workers)


def resume_session(path: Path, *, audience: Audience, stopwatch: Stopwatch | None = None) -> int:
    """Go on with a run that was interrupted or killed, from its last finished round.

    The rounds before are flown again by their plans, so that the folder ends like that of a run
    that was never interrupted; until that has caught up, the old log and tables are kept in the
    checkpoint's folder. Returns the exit code.

    Raises:
        InputError: not a run, finished long ago and damaged, or started with another
            configuration, version or data.
        AerofedError: as `fly_session`.
    """
    stopwatch = stopwatch or Stopwatch()
    folder = RunFolder(path)
    if folder.status() == "finished":
        audience.say(f"{path} is finished: nothing to resume")
        return 0
    values = read_checkpoint(path)
    data_dir = data_dir_of(values)
    with folder.lock():
        with stopwatch("setup"), audience.waiting(_SETTING_UP):
            config = load_config(folder.config)
            checkpoint = CheckpointFolder(
                folder.checkpoint, config_toml=folder.config.read_text(), data_dir=data_dir
            )
            world = build_world(config, data_dir=data_dir)
            if world.flyers.no_resume:
                raise InputError(
                    f"{path}: {world.flyers.no_resume}: its rounds cannot be flown again, so the "
                    "run cannot be resumed"
                )
            if world.strategy is not None:
                world.flyers.check()
            found = checkpoint.load(world.federation, values)
            live = live_views(audience)
            SetAside(folder).take()
        ready = _Ready(world, folder, checkpoint, found.state, found.rounds, live)
        return _fly(ready, audience, stopwatch)


def _fly(
    ready: _Ready, audience: Audience, stopwatch: Stopwatch, *, workers: int | None = None
) -> int:
    world, folder = ready.world, ready.folder
    write_atomically(folder.devices, world.devices_csv())
    summary = Summary(folder, world, remembered=len(ready.memory))
    summary.started()
    ending = Ending()
    with (
        one_interruption(),
        _experiment(ready, audience, stopwatch, workers=workers) as experiment,
    ):
        try:
            with ending.flight():
                run_flight(experiment.run())
        finally:
            if ending.status != "finished":
                summary.ended(ending, experiment.tally, stopwatch)
    if ending.status == "finished":
        SetAside(folder).discard()
    # The figures read the finished log and tables.
    with ending.aftermath(), stopwatch("figures"), audience.waiting("drawing figures"):
        from mission.figures.run import draw_run  # with it Altair, which nothing before needs

        draw_run(folder.path)
    # Last of all: a folder that says "finished" has everything.
    summary.ended(ending, experiment.tally, stopwatch)
    ending.raise_error(folder.path)
    for line in _outcome(experiment, stopwatch):
        audience.say(line)
    audience.say(f"results in {folder.path}")
    if ending.status == "interrupted":
        again = f"; aerofed run --resume {folder.path} goes on"
        audience.say(f"interrupted{'' if world.flyers.no_resume else again}")
        return INTERRUPTED
    return 0


@contextmanager
def _experiment(
    ready: _Ready, audience: Audience, stopwatch: Stopwatch, *, workers: int | None
) -> Iterator[Experiment]:
    """The experiment, recorded in its folder for as long as the block runs."""
    with recording(
        ready.world, ready.folder, ready.checkpoint,
        audience=audience, stopwatch=stopwatch, mirrors=ready.live,
    ) as recorder:  # fmt: skip
        log = recorder.log
        yield Experiment(
            ready.world,
            ready.folder.path,
            recorder,
            stopwatch,
            ready.state,
            memory=ready.memory,
            workers=workers or os.cpu_count() or 1,
            observers=(log,),
            tap=(lambda link: RecordedLink(link, log)) if audience.log_mavlink else None,
        )


def _outcome(experiment: Experiment, stopwatch: Stopwatch) -> list[str]:
    shares = ", ".join(f"{name} {wall_s:.1f} s" for name, wall_s in stopwatch.wall_s.items())
    tally, world = experiment.tally, experiment.world
    done, mission, lines = tally.rounds_done, world.config.mission, []
    if experiment.finished and done < mission.rounds:
        lines.append(
            f"the path budget of {mission.total_budget_m:g} m is spent, so the run ends before "
            f"round {done + 1}"
        )
    flown = f"{tally.flown_m:.0f} m flown in them"
    if world.strategy is None:
        flown = "nothing flown"
    elif mission.strategy == "barycenter":
        flown = f"hovering, {tally.budget_used_m:.0f} m of the path budget spent"
    lines.append(
        f"{done} round{'' if done == 1 else 's'}, {flown}, "
        f"{tally.delivered}/{tally.scheduled} updates delivered; "
        f"{stopwatch.total_s:.1f} s ({shares})"
    )
    return lines
