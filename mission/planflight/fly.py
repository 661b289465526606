"""One `aerofed fly`: a plan file flown by the simulated vehicle or an external autopilot, planned
against flown.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission.analysis.compare_plan import (
    KEY,
    METADATA,
    PlanFlight,
    flight_metadata,
    plain_numbers,
    plan_flight,
    was_flown,
)
from mission.analysis.load import load_run
from mission.base import csv_text
from mission.base.console import RunConsole
from mission.base.errors import INTERRUPTED, FlightError
from mission.base.interrupts import one_interruption, run_flight
from mission.base.run_folder import RunFolder, environment, write_atomically
from mission.base.stopwatch import Stopwatch
from mission.config.models import RunConfig
from mission.flight.flyers.ports import check_link
from mission.flight.plan_file import read_plan_file
from mission.log.live.view import live_views
from mission.log.values import Devices, FlightData
from mission.log.write.writer import FlightLog
from mission.planflight.carrier import PlanCarrier, area_xyz, make_carrier
from mission.planflight.prepare import PreparedPlan, prepare_plan
from mission.run.outcome import Outcome

Floats = NDArray[np.float64]

_COLUMNS = ("t_s", "true_x_m", "true_y_m", "true_alt_m", "est_x_m", "est_y_m", "est_alt_m")


def fly_plan(config: RunConfig, source: Path, path: Path, *, console: RunConsole) -> int:
    """Fly the plan in `source` and leave a folder at `path`. Returns the exit code.

    Raises:
        InputError: the plan is damaged or holds what may not be flown; nothing is written then.
        FlightError, LinkLostError: see `Pilot`; the folder keeps what was flown.
    """
    stopwatch, outcome = Stopwatch(), Outcome()
    with stopwatch("setup"):
        ready = prepare_plan(config, read_plan_file(source))
        check_link(config.link)
        live = live_views(console)
        folder = RunFolder.create(path)
        with folder.unless_refused():
            carrier = make_carrier(ready, say=console.say)
        about = _begin(folder, carrier)
        ready = carrier.ready
    nobody = Devices(np.zeros((0, 2)), ())
    with (
        one_interruption(),
        FlightLog(
            folder.log, area=ready.area, devices=nobody, fence=ready.fence, mirrors=live
        ) as log,
    ):
        _attach(log, ready)
        try:
            with stopwatch("fly"), outcome.flight():
                run_flight(carrier.fly(log))
        finally:
            if outcome.status != "finished":
                folder.write_summary({**outcome.summary, **about})
    flight = None
    with stopwatch("figures"), outcome.post_processing():
        flight = _left_behind(folder)
        if flight is not None and outcome.status == "finished":
            _check_end(flight)
    numbers = {} if flight is None else {KEY: plain_numbers(flight.numbers)}
    times = _times(carrier.t_ns, stopwatch)
    # Last of all: a folder that says "finished" has everything.
    folder.write_summary({**outcome.summary, **about, **numbers, **times})
    outcome.raise_error(folder.path)
    if outcome.status == "interrupted":
        console.say(f"interrupted; what was flown is in {folder.path}")
        return INTERRUPTED
    if flight is not None:
        for line in (*flight.numbers.lines(), f"results in {folder.path}"):
            console.say(line)
    return 0


def _begin(folder: RunFolder, carrier: PlanCarrier) -> dict[str, Any]:
    """Write what the flight begins with; returns what its summary says of it."""
    ready = carrier.ready
    source = ready.plan.path
    write_atomically(folder.config, ready.config.to_toml())
    write_atomically(folder.path / source.name, source.read_bytes())
    seed = ready.config.seed
    about = {
        "name": source.stem,
        "plan": source.name,
        "seed": seed,
        "position_source": carrier.position_source,
        **environment(),
    }
    folder.write_summary({"status": "running", **about})
    return about


def _attach(log: FlightLog, ready: PreparedPlan) -> None:
    """What is needed to understand the log."""
    log.attach("config.toml", "application/toml", ready.config.to_toml().encode())
    log.attach(ready.plan.path.name, "text/plain", ready.plan.text.encode())
    log.metadata(METADATA, _metadata(ready))


def _check_end(flight: PlanFlight) -> None:
    last = max(flight.places_m)
    if last not in flight.reached:
        raise FlightError(f"item {last} was never reached")


def _times(t_ns: int, stopwatch: Stopwatch) -> dict[str, Any]:
    sim_s, wall_s = t_ns / 1e9, stopwatch.wall_s
    return {
        "simulated_s": sim_s,
        "real_time_factor": sim_s / wall_s["fly"],
        "wall_s": {**wall_s, "total": stopwatch.total_s},
    }


def _left_behind(folder: RunFolder) -> PlanFlight | None:
    """Track and figures of what was flown, read from the log; None where nothing was."""
    run = load_run(folder.path)
    if not was_flown(run):
        return None
    flight = plan_flight(run)
    write_atomically(folder.path / "track.csv", _track_csv(run.data))
    from mission.figures.flight import draw_flight  # with it Altair, which nothing before needs

    draw_flight(flight, folder.figures)
    return flight


def _metadata(ready: PreparedPlan) -> dict[str, str]:
    """What the log has to hold beside the plan's path."""
    area, path = ready.area, ready.path
    return flight_metadata(
        ready.plan.path.name,
        {seq: area_xyz(area, ned[None])[0] for seq, ned in path.places.items()},
        [area_xyz(area, ned[None])[0] for ned in path.rally_ned_m],
        duration_s=path.duration_s,
    )


def _track_csv(data: FlightData) -> str:
    rows = np.hstack((data.truth.pos_m, data.belief.pos_m)).tolist()
    return csv_text.lines(
        [
            _COLUMNS,
            *(
                [t_ns / 1e9, *(f"{value:.3f}" for value in row)]
                for t_ns, row in zip(data.truth.t_ns.tolist(), rows, strict=True)
            ),
        ]
    )
