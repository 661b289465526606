"""One `aerofed run`, started or resumed, from set-up to a complete folder."""

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fl.federation import rounds as learning
from fl.plugin_code import passed
from fl.radio.city import STREET_M
from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, write_atomically
from mission.config.loading import load_config
from mission.config.models import RunConfig
from mission.config.preflight import code_digests
from mission.flight.flyers.choice import set_up
from mission.log.live import live_views
from mission.run.callbacks import CallbackContext, make_callbacks
from mission.run.checkpoint import CheckpointFolder, RoundMemory
from mission.run.experiment import Experiment, IdealExperiment
from mission.run.flown_experiment import FlownExperiment
from mission.run.recorded import Around, Summary, fly_recorded
from mission.run.recorder import Ready, recording
from mission.run.resume import read_checkpoint, refuse_others
from mission.scenario.scenario import Scenario


def fly_session(
    config: RunConfig,
    path: Path,
    around: Around,
    *,
    data_dir: Path | None,
) -> int:
    """Run an experiment into a new folder. Returns the exit code.

    A run that is refused leaves no folder. An interrupted or failed run keeps what was flown, with
    a readable log, a summary that says how it ended, and a checkpoint to resume from.

    Raises:
        AerofedError: see the error's exit code; the summary says "failed" then.
    """
    folder = RunFolder(path)
    return _session(config, folder, folder.taken(), around, data_dir=data_dir)


def resume_session(path: Path, around: Around, *, rounds: int | None = None) -> int:
    """Go on with a run that was interrupted or killed, from its last finished round.

    The rounds before are flown again by their plans, so that the folder ends like that of a run
    that was never interrupted; until that has caught up, the old log and tables are kept in the
    checkpoint's folder. With `rounds` it has so many, as if it had been begun with them, also where
    it was finished. A page is made if the run was started with one. Returns the exit code.

    Raises:
        InputError: not a run, damaged, of a vehicle that cannot fly its rounds again, or
            started with another configuration, version or data; or it has `rounds` already.
        AerofedError: as `fly_session`.
    """
    console, folder = around.console, RunFolder(path)
    if rounds is not None or folder.status() != "finished":
        refuse_others(folder)  # before the lock leaves its file there
        locked = folder.lock()
    else:
        locked = nullcontext()
    with locked:
        finished = folder.status() == "finished"  # now: another one may have been at it
        values = {} if finished and rounds is None else read_checkpoint(path)
        done = len(values.get("rounds", ()))
        if finished and rounds in (None, done):
            console.say(f"{path} is finished: nothing to resume; --rounds N gives it more rounds")
            return 0
        if rounds is not None and rounds < done:
            raise InputError(f"--rounds {rounds}: {path} has {done} rounds already; give more")
        longer = {} if rounds is None else {"mission.rounds": rounds}
        config = load_config(folder.config, longer, options={"mission.rounds": "--rounds"})
        around = around if values["report"] else replace(around, page=None)
        data_dir = Path(values["data_dir"]) if values["data_dir"] else None
        return _session(config, folder, nullcontext(), around, data_dir=data_dir, values=values)


def _session(
    config: RunConfig,
    folder: RunFolder,
    taking: AbstractContextManager[None],
    around: Around,
    *,
    data_dir: Path | None,
    values: dict[str, Any] | None = None,
) -> int:
    """Set a run up and fly it, in a folder that is taken once nothing more can be refused; go on
    from the `values` of a checkpoint."""
    console = around.console
    report = bool(values["report"] if values else around.page)
    with ExitStack() as opened:
        with around.stopwatch("setup"), console.waiting("setting up"):
            scenario, backend = set_up(config, data_dir=data_dir)
            config = scenario.config  # which knows its map now
            if values and backend.no_resume:
                raise InputError(
                    f"{folder.path}: {backend.no_resume}: its rounds cannot be flown again, so the "
                    "run cannot be resumed"
                )
            backend.check()
            opened.enter_context(taking)
            backend.await_vehicle(say=console.say)
            checkpoint = CheckpointFolder(
                folder.checkpoint, config=config, data_dir=data_dir, report=report
            )
            memory: tuple[RoundMemory, ...] = ()
            if values:
                memory, state = checkpoint.load(scenario.federation, values)
            else:
                state = learning.init(scenario.federation)
            live = opened.enter_context(live_views(console))
            callbacks = make_callbacks(CallbackContext(folder.path, config))
            opened.enter_context(callbacks)
            if values:  # killed in here, it is one that was interrupted
                folder.write_summary({**folder.read_summary(), "status": "interrupted"})
                folder.set_aside()
            write_atomically(folder.config, config.to_toml())
            if not values:
                checkpoint.save(scenario.federation, state, None)
        ready = Ready(scenario, backend, folder, checkpoint, state, callbacks, memory, live)
        return _fly(ready, around)


def _fly(ready: Ready, around: Around) -> int:
    folder, backend = ready.folder, ready.backend
    config = ready.scenario.config
    for warning in _warnings(ready.scenario):
        around.console.say(f"warning: {warning}")
    names = ready.scenario.aircraft if len(ready.scenario.fleet) > 1 else ()
    summary = Summary(
        folder,
        goes_on=_goes_on(folder.path, backend.no_resume, code_digests(config)),
        name=config.name,
        vehicles=[folder.of_vehicle(name).path.name for name in names] or None,
        strategy=config.mission.strategy,
        seed=config.seed,
        resumed_after_round=len(ready.memory) or None,
        resumable=not backend.no_resume,
        position_source=backend.position_source,
        data=ready.scenario.data_sources(),
        plugins=code_digests(config),
    )
    return fly_recorded(_experiment(ready, around), summary, around)


def _goes_on(path: Path, no_resume: str, plugins: Iterable[str]) -> str:
    """How a run that is cut off can go on, in words."""
    if no_resume:
        return f"; {no_resume}: it cannot be resumed"
    for name in passed(plugins):
        return (
            f"; aerofed.resume({str(path)!r}) goes on in this process alone, with {name!r} as it "
            "was passed: a plug-in of a module can be mended"
        )
    return f"; aerofed run --resume {path} goes on"


def _warnings(scenario: Scenario) -> Iterator[str]:
    """Warnings about settings that are valid but unusual."""
    area, mission = scenario.config.area, scenario.config.mission
    yield from scenario.config.notes
    # A sign, a digit or the order of lat and lon is wrong.
    away_m = float(np.linalg.norm(scenario.devices_m - area.home_m, axis=1).min())
    if away_m > mission.path_budget_m:
        yield (
            f"home lies {away_m:.0f} m from the nearest device, farther than a round's path may "
            f"be long (mission.path_budget_m = {mission.path_budget_m:g})"
        )
    stands: dict[tuple[str, float, float], int] = {}  # who -> the first device there
    places = zip(scenario.community_of, scenario.devices_m.tolist(), strict=True)
    for device, (name, (x, y)) in enumerate(places):
        first = stands.setdefault((name, x, y), device)
        if first != device:
            yield (
                f"{name}: devices {first} and {device} stand at one place, x = {x:g}, y = {y:g} m; "
                "is one there twice?"
            )
            break
    for zone in area.no_fly:
        anywhere = zone.counts_at(*mission.heights_m)
        if anywhere and not all(zone.counts_at(height, height) for height in mission.heights_m):
            yield (
                f"{zone.name} (area.no_fly) is kept out of at every altitude of "
                f"mission.altitude_m = {list(mission.heights_m)}, also where a flight could pass "
                "above or below it"
            )
    radio, (low_m, high_m) = scenario.config.radio, mission.heights_m
    if "buildings" in (radio.truth, radio.belief, radio.prior) and low_m <= STREET_M < high_m:
        yield (
            f"at a height of {STREET_M:g} m, between those of mission.altitude_m = "
            f"{[low_m, high_m]}, 3GPP's path loss among buildings jumps by up to 6 dB, from the "
            "formulas for base stations to those for aircraft"
        )


@contextmanager
def _experiment(ready: Ready, around: Around) -> Iterator[Experiment]:
    """Context manager: the experiment, recorded in its folder while the block runs."""
    write_atomically(ready.folder.devices, ready.scenario.devices_csv())
    with (
        ready.callbacks,  # whose failure at the end belongs into the summary
        recording(ready, around.console, around.stopwatch) as recorder,
    ):
        strategy = ready.scenario.strategy
        kind = IdealExperiment if strategy is None else partial(FlownExperiment, strategy=strategy)
        yield kind(recorder=recorder, stopwatch=around.stopwatch, workers=around.workers)
